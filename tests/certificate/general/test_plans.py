"""Plans of the problem files of other systems: proven, tight to a millimetre, and refused when unsafe by one."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.certificate.general.proof import GeneralProof
from ensemble_ctrl.constraints import Obstacle, Solid
from ensemble_ctrl.problem.evaluation.sampled import states
from tests.examples import quick

Floats = NDArray[np.float64]
ROOT = Path(__file__).parents[3]
PLANS = json.loads((Path(__file__).parent / "plans.json").read_text())
"""Commands that the planner found for each problem file, rounded."""
AVOIDING = [name for name in PLANS if name != "own_system"]
SEEN = 2e-4
"""Metres by which the smallest distance of the members and times looked at may be above the true one."""


@cache
def problem_of(name: str) -> ec.Problem:
    """A problem file."""
    folder = "examples" if name == "own_system" else "configs/systems"
    problem = ec.load(ROOT / folder / f"{name}.yaml", trust=True)
    return problem


def controls_of(name: str) -> Floats:
    """The commands of its plan."""
    return np.array(PLANS[name])


@cache
def paths_of(name: str) -> tuple[Floats, Floats]:
    """Members and their states at many times, shapes (members, parameters) and (members, times, states)."""
    problem = problem_of(name)
    members = np.concatenate([problem.fleet.corners, problem.fleet.grid(61 if len(problem.fleet.names) == 1 else 200)])
    fine = 25
    controls = np.repeat(controls_of(name), fine, axis=0)
    return members, problem.fleet.trajectories(controls, members, problem.step / fine)


def least(problem: ec.Problem, states: Floats, obstacle: str) -> float:
    """The smallest distance from an obstacle seen, the radius taken off."""
    places = states[..., problem.fleet.place_columns]
    return min(float(piece.distance(places).min()) for piece in problem.obstacles[obstacle]) - problem.fleet.radius


@pytest.mark.parametrize("name", PLANS)
def test_every_problem_file_is_proven_with_a_small_radius(name: str) -> None:
    problem, controls = problem_of(name), controls_of(name)
    proof = GeneralProof(problem, controls, problem.fleet.parameters)
    assert ec.certify(problem, controls).proven == "yes"
    assert proof.enclosure.radius[:, problem.fleet.place_columns].max() <= 1e-6


@pytest.mark.parametrize("name", quick(AVOIDING, "planar_slalom"))
def test_clearances_are_proven_to_a_millimetre(name: str) -> None:
    problem = problem_of(name)
    for bound in ec.certify(problem, controls_of(name), each=True).clearances:
        seen = least(problem, paths_of(name)[1], bound.obstacle)
        assert seen - 1e-3 <= bound.proven <= seen + 1e-9


@pytest.mark.parametrize("name", AVOIDING)
def test_a_plan_that_is_unsafe_by_a_millimetre_is_refused_with_a_member(name: str) -> None:
    """Robots that are larger by what was left, and a millimetre; by two less they are safe."""
    problem, controls = problem_of(name), controls_of(name)
    worst = min(problem.obstacles, key=lambda obstacle: least(problem, paths_of(name)[1], obstacle))
    left = least(problem, paths_of(name)[1], worst)
    task = ec.parse(f"G avoid({worst})")

    def grown(by: float) -> ec.Problem:
        return replace(problem, fleet=replace(problem.fleet, radius=problem.fleet.radius + by), task=task)

    unsafe = grown(left + 1e-3)
    found = ec.certify(unsafe, controls)
    assert found.proven == "no"
    assert found.counter_example is not None
    assert found.counter_example.amount <= 1e-3 + SEEN
    assert distance_of(unsafe, controls, worst, found.counter_example) < unsafe.fleet.radius
    assert ec.certify(grown(left - 1e-3), controls).proven == "yes"


def distance_of(problem: ec.Problem, controls: Floats, obstacle: str, example: ec.CounterExample) -> float:
    """The distance of a counter-example's member at its time, by a step of integration of its own."""
    assert example.time is not None
    step = min(int(example.time / problem.step), problem.steps - 1)
    members = problem.fleet.members([example.parameters])
    before = states(problem, controls, members)[:, step]
    share = example.time - step * problem.step
    psi = problem.fleet.psi(members)
    there = problem.fleet.system.flow(before.T, controls[step].tolist(), psi, share, 16) if share > 0 else before.T
    place = there[problem.fleet.place_columns].T
    return float(min(piece.distance(place)[0] for piece in problem.obstacles[obstacle]))


LIMITS = {"unknown_mass": ("vx", 1), "planar_slalom": ("tilt", 1), "own_system": ("angle", -1)}


@pytest.mark.parametrize("name", LIMITS)
def test_a_limit_of_another_state_is_refused_and_proven_to_a_thousandth(name: str) -> None:
    problem, controls = problem_of(name), controls_of(name)
    state, sign = LIMITS[name]
    _, paths = paths_of(name)
    column = sign * paths[..., problem.fleet.states.index(state)]
    most = float(column.max())

    def limited(by: float) -> ec.Problem:
        end = sign * (most + by)
        return replace(problem, task=ec.parse(f"G {state} {'<=' if sign > 0 else '>='} {end!r}"))

    found = ec.certify(limited(-1e-3), controls)
    assert found.proven == "no"
    assert found.counter_example is not None
    fine = np.repeat(controls, 25, axis=0)
    member = problem.fleet.members([found.counter_example.parameters])
    path = problem.fleet.trajectories(fine, member, problem.step / 25)
    assert (sign * path[..., problem.fleet.states.index(state)]).max() > most - 1e-3
    assert ec.certify(limited(2e-3), controls).proven == "yes"


def near(rng: np.random.Generator, places: Floats) -> Obstacle | Solid:
    """A small polygon or solid beside a path, turned at random: an edge or a corner is nearest."""
    d = places.shape[-1]
    times = places.shape[1]
    middle = places[rng.integers(len(places)), rng.integers(times // 3, times)]
    away = rng.normal(size=d)
    corners = middle + away / np.linalg.norm(away) * rng.uniform(0.2, 0.6) + rng.uniform(-0.12, 0.12, (8, d))
    return Solid.hull(corners) if d == 3 else Obstacle.polygon(corners[:3])


@pytest.mark.parametrize("name", ["unknown_mass", "quadrotor_delivery", "planar_slalom"])
def test_distances_are_those_from_edges_and_corners(name: str) -> None:
    problem, controls = problem_of(name), controls_of(name)
    slim = replace(problem.fleet, radius=0.01)
    rng, paths = np.random.default_rng(8), paths_of(name)[1]
    for _ in range(6):
        piece = near(rng, paths[..., problem.fleet.place_columns])
        some = replace(problem, fleet=slim, obstacles={"it": (piece,)}, task=ec.parse("G avoid(it)"))
        (bound,) = ec.certify(some, controls).clearances
        seen = least(some, paths, "it")
        if seen > 0:  # how deep a member is inside is not what a proof needs
            assert seen - 1e-3 <= bound.proven <= seen + 1e-9
        assert bound.proven <= seen + 1e-9
