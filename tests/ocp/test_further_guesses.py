"""Guesses of further kinds: trees that any system can follow, and other timings of a way."""

from __future__ import annotations

import importlib
import importlib.util
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.ocp.guesses import GUESSES
from ensemble_ctrl.ocp.guesses.registry import Request
from ensemble_ctrl.ocp.guesses.warped import warped

families: Any = importlib.import_module("benchmarks.finding.families")

TEXT = """
fleet:
  model: double_integrator
  parameters: {mass: {range: [0.98, 1.02]}}
  start: {position: [0, 0]}
  input_bounds: {fx: [-1, 1], fy: [-1, 1]}
horizon: {duration: 8 s, steps: 40}
regions: {goal: {box: [[2.5, 3.5], [-0.5, 0.5]]}}
obstacles: {wall: {box: [[1.2, 1.4], [-2, 0.8]]}, gate: {box: [[1.2, 1.4], [0.8, 3]]}}
motions: {gate: {path: [[0, [0, 0]], [4, [0, 0]], [4.5, [0, 3]], [8, [0, 3]]]}}
task: "F[6, 8] in(goal) and G avoid(wall) and G avoid(gate)"
"""


def entered(problem: ec.Problem, guess: Any) -> float:
    """How far the guess is from what the task avoids, metres, at its own times."""
    times = np.linspace(0.0, problem.duration, len(guess.states))
    paths = guess.states[:, problem.fleet.place_columns, 0][None]
    return float(min(avoid.distances(paths, times).min() for avoid in problem.specification.avoid))


def test_trees_find_the_time_at_which_a_gate_opens() -> None:
    pytest.importorskip("ompl")
    trees: Any = importlib.import_module("ensemble_ctrl.ocp.guesses.state_trees")
    problem = ec.load_text(TEXT)
    ((name, places),) = trees.itineraries(problem)
    guess, again = (trees.grown(problem, 40, name, places, 1, 4000, lambda: False) for _ in range(2))
    np.testing.assert_array_equal(guess.controls, again.controls)
    way = guess.states[:, :2, 0]
    late = np.linspace(0.0, 8.0, 41) >= 6.0
    assert np.linalg.norm(way[late] - [3.0, 0.0], axis=1).min() < 0.6
    # every state was looked at once a step: between two of them a corner of an obstacle may be cut
    assert entered(problem, guess) > -0.1
    # the states are those under the commands
    driven = problem.fleet.trajectories(guess.controls, problem.fleet.center[None], 0.2)[0]
    np.testing.assert_allclose(driven, guess.states[:, :, 0], atol=1e-6)


def test_no_tree_where_the_start_is_not_free_or_there_is_nowhere_to_go() -> None:
    pytest.importorskip("ompl")
    trees: Any = importlib.import_module("ensemble_ctrl.ocp.guesses.state_trees")
    problem = ec.load_text(TEXT.replace("F[6, 8] in(goal)", "F x >= 2"))
    assert list(trees.StateTreeGuesses().propose(Request(problem, 40))) == []
    (place,) = next(trees.itineraries(ec.load_text(TEXT)))[1]
    assert trees.grown(problem, 40, "a", [replace(place, late=-1.0)], 1, 100, lambda: False) is None


def test_which_systems_trees_are_for() -> None:
    arcs, plane, line = (families.drawn(*one).problem() for one in (("mazes", 1), ("gates", 0), ("plants", 2)))
    assert not GUESSES["state trees"].accepts(arcs)
    assert not GUESSES["state trees"].accepts(line)
    if importlib.util.find_spec("ompl"):
        assert GUESSES["state trees"].accepts(plane)


@pytest.mark.parametrize(("family", "seed"), [("mazes", 1), ("mazes", 2), ("gates", 0)])
def test_other_timings_keep_the_way_and_its_ends(family: str, seed: int) -> None:
    """Forwards, in reverse, and for a system of one's own; bounds of the commands may not let a robot keep it."""
    case = families.drawn(family, seed)
    problem, fleet = case.problem(), case.problem().fleet
    step = problem.duration / len(case.controls)

    def way(controls: Any) -> Any:
        return fleet.trajectories(controls, fleet.center[None], step)[0][:, fleet.place_columns]

    before, found = way(case.controls), list(warped(problem, case.controls))
    assert [guess.kind for guess in found] == ["timing"] * 4
    halfway = []
    for guess in found:
        after = guess.states[:, fleet.place_columns, 0] if guess.states.size else way(guess.controls)
        assert np.linalg.norm(after[:, None] - before, axis=2).min(axis=1).max() < 0.15
        assert np.linalg.norm(after[-1] - before[-1]) < 0.4
        assert (guess.controls >= fleet.input_lower - 1e-12).all()
        assert (guess.controls <= fleet.input_upper + 1e-12).all()
        gone = np.linalg.norm(np.diff(after[: len(after) // 2], axis=0), axis=1).sum()
        halfway.append(gone / np.linalg.norm(np.diff(after, axis=0), axis=1).sum())
    sooner, later, faster, waiting = halfway
    assert sooner > later
    assert faster > waiting


def test_guesses_with_other_timings_are_for_the_best_attempt() -> None:
    problem = families.drawn("gates", 0).problem()
    assert list(GUESSES["timing"].propose(Request(problem, 40))) == []
    assert len(next(GUESSES["timing"].propose(Request(problem, 40, np.zeros((40, 2)))))) == 4


@pytest.mark.slow
def test_a_vehicle_that_can_not_turn_into_the_gates_is_led_around_them() -> None:
    """Of both routes through a gate none leads to a plan; the tree goes to the end of the corridor and turns there."""
    pytest.importorskip("ompl")
    plan = ec.plan(families.drawn("gates", 1).problem(300.0), check=False)
    assert plan.certificate is not None
    assert plan.certificate.proven == "yes"
    assert {route["kind"] for route in plan.details["routes"]} >= {"route", "state tree"}
