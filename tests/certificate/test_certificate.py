"""The certificate against brute force: no sampled value may ever lie below a proven bound."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.certificate.clearance import Prover, separation
from ensemble_ctrl.certificate.enclosure import Flow, Track, growth
from ensemble_ctrl.certificate.task import bound_task, on_grid
from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import ExactOps, StateSignals, ground, member_robustness, parse
from ensemble_ctrl.duties import grounded, other_parts
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Fleet, Problem
from ensemble_ctrl.replay import trajectories
from ensemble_ctrl.systems import Unicycle

Floats = NDArray[np.float64]
CONFIG = Path(__file__).parents[2] / "configs" / "five_obstacles.yaml"
SLOW = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])

seeds = st.integers(0, 2**31)
widths = st.sampled_from([0.0, 1e-3, 0.1, 0.4])


def problem_of(
    steps: int,
    width: float,
    heading_from: str,
    obstacles: Mapping[str, tuple[Obstacle, ...]],
    task: str,
    radius: float = 0.0,
) -> Problem:
    """A fleet at the origin with obstacles far enough for a legal start."""
    fleet = Fleet(
        Unicycle("y" if heading_from == "y" else "x"),
        Interval(1 - width, 1 + width),
        np.zeros(2),
        0.3,
        np.array([-20.0, -2.0]),
        np.array([20.0, 2.0]),
        radius,
    )
    regions = {"home": Polyhedron.box([[-1.0, 1.0], [-1.0, 1.0]]), "there": Polyhedron.box([[0.5, 2.0], [-1.0, 2.0]])}
    return Problem("test", fleet, 0.25 * steps, steps, parse(task), regions, obstacles)


def random_controls(rng: np.random.Generator, steps: int) -> Floats:
    """Commands within the bounds, some of them exactly zero."""
    controls = rng.uniform(-2, 2, (steps, 2)) * (rng.random((steps, 2)) < 0.8)
    return np.asarray(controls)


def random_polygon(rng: np.random.Generator) -> Obstacle:
    """A convex polygon some way from the origin."""
    angles = np.sort(rng.uniform(0, 2 * np.pi, 5))
    angles = np.linspace(0, 2 * np.pi, 5, endpoint=False) + 0.5 * (angles - angles.mean()) / 5
    centre = rng.uniform(1.2, 2.5) * np.array([np.cos(t := rng.uniform(0, 2 * np.pi)), np.sin(t)])
    return Obstacle.polygon(centre + rng.uniform(0.2, 0.9) * np.stack([np.cos(angles), np.sin(angles)], axis=1))


@SLOW
@given(seeds, st.integers(1, 30), widths, st.sampled_from("xy"))
def test_no_member_is_ever_closer_than_proven(seed: int, steps: int, width: float, heading_from: str) -> None:
    rng = np.random.default_rng(seed)
    piece = random_polygon(rng)
    problem = problem_of(steps, width, heading_from, {"o": (piece,)}, "G avoid(o)")
    controls = random_controls(rng, steps)
    law = problem.fleet.parameter
    (bound,) = certify(problem, controls).clearances
    parameters = np.linspace(law.lower, law.upper, 101)
    seen = piece.distance(trajectories(problem, controls, parameters, 20)).min()
    assert bound.proven <= seen + 1e-12
    assert bound.proven <= bound.sampled
    assert bound.sampled - bound.proven < 2e-3
    assert bound.sampled >= seen - 2e-2 * max(1.0, width * steps)


@SLOW
@given(seeds, st.integers(2, 24), widths)
def test_task_bound_holds_for_every_member(seed: int, steps: int, width: float) -> None:
    rng = np.random.default_rng(seed)
    half = steps // 2 * 0.25
    texts = [
        f"F[0,{half}] in(there)",
        f"G[0,{half}] in(home)",
        "F in(there) or G in(home)",
        f"F[0,{half}] (x >= 0.4 and G[0,0.25] y <= 0.5)",
        "not in(there) U in(home)",
        "(x <= 0.7) U (y >= 0.2 or y <= -0.2)",
        "G (in(home) or in(there))",
        "F G[0,0.25] in(home)",
        "mean(F in(there))",
        "share(0.5, G in(home))",
    ]
    problem = problem_of(steps, width, "x", {}, texts[int(rng.integers(len(texts)))])
    controls = random_controls(rng, steps)
    (bound,) = certify(problem, controls).parts
    law = problem.fleet.parameter
    edges = np.linspace(law.lower, law.upper, 1001)
    parameters = (edges[:-1] + edges[1:]) / 2
    substeps = 4
    fine = trajectories(problem, controls, parameters, substeps)
    formula = grounded(problem, other_parts(problem)[0])
    dense = member_robustness(formula, StateSignals(fine, ("x", "y"), problem.step / substeps), ExactOps())
    assert bound.covered
    assert bound.proven <= dense.min() + 1e-6


@settings(max_examples=100, deadline=None)
@given(seeds, st.integers(1, 200), st.sampled_from("xy"))
def test_rounding_error_is_below_its_bound(seed: int, steps: int, heading_from: str) -> None:
    rng = np.random.default_rng(seed)
    problem = problem_of(steps, 0.1, heading_from, {}, "F in(home)")
    controls = random_controls(rng, steps)
    flow = Flow.of(problem, controls, problem.fleet.parameter)
    centre = np.array([rng.uniform(0.9, 1.1)])
    exact = _long_double_path(problem, controls, centre[0])
    error = np.abs(Track.of(flow, centre).position[0] - exact).max()
    assert float(error) <= flow.rounding()


def _long_double_path(problem: Problem, controls: Floats, parameter: float) -> NDArray[np.longdouble]:
    """The same arcs in extended precision."""
    wide = np.longdouble
    v, w = controls.astype(wide).T
    step, c = wide(problem.duration) / wide(len(v)), wide(parameter)
    turned = np.concatenate([[wide(0)], np.cumsum(w * step)[:-1]])
    half = c * w * step / 2
    ratio = np.where(half == 0, wide(1), np.sin(half) / np.where(half == 0, wide(1), half))
    angle = wide(problem.fleet.own_heading) + c * turned + half
    parts = [np.cos(angle), np.sin(angle)]
    parts = parts if problem.fleet.system.heading_from == "x" else parts[::-1]
    moves = np.stack([c * v * step * ratio * part for part in parts], axis=1)
    return np.concatenate([np.zeros((1, 2), wide), np.cumsum(moves, axis=0)])


@settings(max_examples=200, deadline=None)
@given(seeds)
def test_derivative_by_the_parameter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem = problem_of(12, 0.1, "x", {}, "F in(home)")
    flow = Flow.of(problem, random_controls(rng, 12), problem.fleet.parameter)
    c, h = rng.uniform(0.5, 1.5), 1e-5
    low, middle, high = (Track.of(flow, np.array([p])) for p in (c - h, c, c + h))
    assert np.abs((high.position - low.position) / (2 * h) - middle.slope).max() < 1e-6


@settings(max_examples=200, deadline=None)
@given(seeds)
def test_separation_is_never_above_the_distance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    piece, corners = random_polygon(rng), rng.normal(size=(1, 4, 2)) * rng.uniform(0.01, 2)
    weights = rng.dirichlet(np.ones(4), 2000)
    assert separation(corners, piece.vertices)[0] <= piece.distance(weights @ corners[0]).min() + 1e-12


def _five() -> tuple[Problem, Floats]:
    """The five-obstacle problem with its certified controls."""
    plan = ec.plan(ec.load(CONFIG, ["verify.members=100", "moments.order=auto"]))
    return plan.problem, plan.controls


@pytest.fixture(scope="module")
def five() -> tuple[Problem, Floats]:
    return _five()


def test_five_obstacles_within_a_millimetre_of_the_sampled_minimum(five: tuple[Problem, Floats]) -> None:
    problem, controls = five
    certificate = certify(problem, controls)
    assert certificate.proven == "yes"
    law = problem.fleet.parameter
    paths = trajectories(problem, controls, np.linspace(law.lower, law.upper, 2001), 20)
    for bound, pieces in zip(certificate.clearances, problem.obstacles.values(), strict=True):
        seen = min(piece.distance(paths).min() for piece in pieces)
        assert seen - 1e-3 <= bound.proven <= seen


def test_a_plan_made_unsafe_by_a_millimetre_is_rejected(five: tuple[Problem, Floats]) -> None:
    problem, controls = five
    certificate = certify(problem, controls)
    closest = min(certificate.clearances, key=lambda b: b.sampled)
    grown = problem.with_(fleet=replace(problem.fleet, radius=closest.sampled + 1e-3))
    refused = certify(grown, controls)
    assert refused.proven == "no"
    found = refused.counter_example
    assert found is not None
    assert closest.obstacle in found.what
    member = trajectories(grown, controls, np.array([found.parameter]), 64)
    (piece,) = problem.obstacles[closest.obstacle]
    assert piece.distance(member).min() < grown.fleet.radius


def test_a_corner_cut_between_grid_times_is_found() -> None:
    # two steps of 1.5 m past a thin wall: clear at every grid time, through it in between
    wall = {"wall": (Obstacle.box([[0.7, 0.8], [-1.0, 1.0]]),)}
    problem = problem_of(2, 0.0, "x", wall, "G avoid(wall)").with_(duration=2.0)
    problem = problem.with_(fleet=replace(problem.fleet, heading=0.0))
    controls = np.array([[1.5, 0.0], [1.5, 0.0]])
    assert all(problem.obstacles["wall"][0].distance(trajectories(problem, controls, np.ones(1))[0]) > 0)
    certificate = certify(problem, controls)
    assert certificate.proven == "no"
    assert certificate.counter_example is not None
    assert certificate.counter_example.time == pytest.approx(0.5, abs=0.05)


def test_touching_counts_as_clear_only_up_to_rounding() -> None:
    wall = {"wall": (Obstacle.box([[1.0, 2.0], [-1.0, 1.0]]),)}
    problem = problem_of(1, 0.0, "x", wall, "G avoid(wall)").with_(duration=1.0)
    problem = problem.with_(fleet=replace(problem.fleet, heading=0.0))
    certificate = certify(problem, np.array([[1.0, 0.0]]))
    assert certificate.proven == "undecided"
    assert abs(certificate.clearance) < 2e-3


@pytest.mark.parametrize("controls", [[[0.0, 0.0]], [[0.0, 2.0]], [[2.0, 0.0]], [[1.0, 1e-9]]])
def test_degenerate_commands(controls: list[list[float]]) -> None:
    wall = {"wall": (Obstacle.box([[3.0, 4.0], [-1.0, 1.0]]),)}
    certificate = certify(problem_of(1, 0.1, "x", wall, "G avoid(wall)"), np.array(controls))
    assert certificate.proven == "yes"


def test_another_range_is_another_question(five: tuple[Problem, Floats]) -> None:
    problem, controls = five
    assert certify(problem, controls, Interval(0.95, 1.05)).proven == "yes"
    assert certify(problem, controls, Interval(0.7, 1.3)).proven == "no"


def test_windows_off_the_grid_are_not_covered() -> None:
    problem = problem_of(4, 0.1, "x", {}, "F[0.1,0.6] in(home)")
    assert not on_grid(other_parts(problem)[0], problem.step)
    certificate = certify(problem, np.zeros((4, 2)))
    assert certificate.proven == "undecided"
    assert not certificate.parts[0].covered


def test_inputs_hash_changes_with_anything_claimed(five: tuple[Problem, Floats]) -> None:
    problem, controls = five
    original = certify(problem, controls).inputs
    assert certify(problem, controls).inputs == original
    nudged = np.array(controls)
    nudged[3, 0] = np.nextafter(nudged[3, 0], 9.0)
    assert certify(problem, nudged).inputs != original
    assert certify(problem.with_(fleet=replace(problem.fleet, radius=1e-6)), controls).inputs != original


def test_prover_is_bounded_in_boxes() -> None:
    problem = problem_of(30, 0.4, "x", {"o": (Obstacle.box([[1.5, 2.0], [1.5, 2.0]]),)}, "G avoid(o)")
    flow = Flow.of(problem, random_controls(np.random.default_rng(3), 30), problem.fleet.parameter)
    prover = Prover(flow, 0.6, 1.4, limit=600)
    bound = prover.bound("o", problem.obstacles["o"][0], np.arange(30), 0.0)
    assert prover.boxes <= 4 * 600
    assert bound.proven <= bound.sampled


def test_nested_formula_against_dense_sampling() -> None:
    regions = {"a": Polyhedron.box([[0.3, 1.5], [-1.0, 1.0]])}
    problem = problem_of(20, 0.1, "x", {}, "F in(there)")
    formula = ground(parse("F[0,3] G[0,1] (in(a) or y >= 0.2)"), regions, {})
    controls = np.tile([[0.5, 0.1]], (20, 1))
    flow = Flow.of(problem, controls, problem.fleet.parameter)
    bound = bound_task(flow, formula, 0.9, 1.1)
    fine = trajectories(problem, controls, np.linspace(0.9, 1.1, 51), 8)
    dense = member_robustness(formula, StateSignals(fine, ("x", "y"), problem.step / 8), ExactOps()).min()
    assert dense - 3e-2 <= bound.proven <= dense + 1e-9


@settings(max_examples=200, deadline=None)
@given(seeds, st.sampled_from([0.02, 0.2, 0.4]))
def test_taylor_remainder_and_bulge_bound_the_truth(seed: int, half: float) -> None:
    rng = np.random.default_rng(seed)
    steps = int(rng.integers(1, 12))
    problem = problem_of(steps, 0.45, "x", {}, "F in(home)")
    turning = 2.0 if rng.random() < 0.5 else -2.0
    controls = np.column_stack([rng.uniform(-2, 2, steps), np.full(steps, turning)])
    flow = Flow.of(problem, controls, problem.fleet.parameter)
    track = Track.of(flow, np.array([1.0]))
    offset = rng.uniform(-half, half)
    truth = Track.of(flow, np.array([1.0 + offset])).position[0]
    remainder = np.linalg.norm(truth - track.position[0] - offset * track.slope[0], axis=1)
    assert (remainder <= offset**2 / 2 * flow.remainder() + 1e-12).all()
    n = np.arange(steps)
    share = rng.random(steps)
    inside, _ = flow.moved(n, share, np.ones(steps))
    ends, _ = flow.moved(n, np.ones(steps), np.ones(steps))
    bulge = growth(flow, n, np.full(steps, flow.step), np.ones(steps), np.zeros(steps), flow.remainder())
    assert (np.linalg.norm(inside - share[:, None] * ends, axis=1) <= bulge + 1e-12).all()


def test_a_share_is_never_refuted_by_its_cells() -> None:
    problem = ec.load_text(
        """
        fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
        horizon: {duration: 2 s, steps: 10}
        task: share(0.95, F x >= 1.816)
        """
    )
    certificate = certify(problem, np.tile([[1.0, 0.0]], (10, 1)))
    assert certificate.proven != "no"
    assert certificate.counter_example is None


def test_rounding_grows_with_the_map() -> None:
    near, far = (
        problem_of(4, 0.1, "x", {"o": (Obstacle.box([[at, at + 1.0], [-1.0, 1.0]]),)}, "G avoid(o)")
        for at in (3.0, 3e6)
    )
    controls = np.ones((4, 2))
    errors = [Flow.of(p, controls, p.fleet.parameter).rounding() for p in (near, far)]
    assert errors[0] < 1e-11
    assert errors[1] > 1e-8
