"""The paper's loop: what is left of a problem, plans without proof, and what the true track did."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from shapely import LineString, box

from ensemble_ctrl.core.errors import UnsupportedError
from ensemble_ctrl.files.config import load, load_text
from ensemble_ctrl.planning.online.driver import drive
from ensemble_ctrl.planning.online.propagation import PoseSet
from ensemble_ctrl.planning.online.published import PublishedLoop, rest_of, violations
from ensemble_ctrl.planning.online.settings import OnlineSettings
from ensemble_ctrl.planning.online.simulated import FINE
from ensemble_ctrl.problem import Problem
from tests.paths import CONFIGS

Floats = NDArray[np.float64]

TEXT = """
name: wall
fleet:
  model: unicycle
  parameters: {traction: {range: [0.9, 1.1]}}
  start: {position: [0, 0], heading: 60 deg}
horizon: {duration: 6 s, steps: 12}
moments: {order: 3, coordinates: modal, integrator: rk4}
regions:
  goal: {box: [[2.5, 3.5], [-0.5, 0.5]]}
obstacles:
  wall: {box: [[1.0, 1.8], [-2.0, 0.6]]}
task: F[4, 6] in(goal) and G[1, 6] avoid(wall)
objective: {terminal: {target: [3, 0]}}
solve: {method: minlp, guarantee: moment, grid: full, facets: linear, polish: false, margin: 0}
online:
  applied_steps: 3
  deadline: 1 s
  learn: false
  noise: {position: 1 cm, heading: 1 deg}
  robot: {traction: 0.95, noise: {position: 1 cm, heading: 1 deg}, delay: 0.1 s, seed: 4}
"""
POSE = PoseSet(np.array([0.5, 0.9]), np.full(2, 0.01), 0.3, 0.02)


def wall() -> Problem:
    """A wall between the start and the goal."""
    return load_text(TEXT)


@pytest.mark.parametrize(
    ("begin", "task"),
    [
        (0, "G[1,6] avoid(wall) and F[4,6] in(goal)"),
        (1, "G[0.5,5.5] avoid(wall) and F[3.5,5.5] in(goal)"),
        (4, "G[0,4] avoid(wall) and F[2,4] in(goal)"),
        (8, "G[0,2] avoid(wall) and F[0,2] in(goal)"),
    ],
)
def test_what_is_left_has_its_windows_earlier_and_starts_at_the_pose(begin: int, task: str) -> None:
    rest = rest_of(wall(), begin, POSE)
    assert str(rest.task) == task
    assert (rest.steps, rest.duration, rest.step) == (12 - begin, 6.0 - begin / 2, 0.5)
    np.testing.assert_allclose(rest.fleet.position, POSE.position)
    assert rest.fleet.heading == POSE.heading
    assert (rest.fleet.lower[0], rest.fleet.upper[0]) == (0.9, 1.1)


def test_violations_are_those_of_the_track() -> None:
    problem = wall()
    # a straight drive through the wall at 0.5 m/s, 12 * FINE samples of 0.05 s
    track = np.column_stack([0.025 * np.arange(12 * FINE + 1), np.full(12 * FINE + 1, 0.2)])
    found = violations(problem, track, FINE)
    inside = LineString(track).intersection(box(1.0, -2.0, 1.8, 0.6)).length / 0.5
    assert found["seconds"] == pytest.approx(inside, abs=0.1)
    assert found["clearance"] == pytest.approx(-0.4, abs=0.03)
    # before its window the wall may be entered
    early = np.concatenate([track[40:60], np.tile([[0.0, 1.0]], (101, 1))])
    assert violations(problem, early, FINE)["seconds"] == 0.0
    assert violations(problem, early, FINE)["clearance"] > 0


def test_the_loop_measures_solves_again_and_applies_a_few_steps() -> None:
    problem = wall()
    settings = problem.online or OnlineSettings()
    fleet = settings.simulated(problem)
    loop = PublishedLoop(problem, settings.options, timer=lambda: 0.0)
    outcome = drive(loop, fleet, fleet)
    assert [step.begin for step in outcome.steps] == [0, 3, 6, 9]
    assert {step.proof for step in outcome.steps} == {"none"}
    assert outcome.sources["new"] >= 3
    assert outcome.ending in ("finished", "failed")
    (robot,) = fleet.robots.values()
    began = round(outcome.start / problem.step) * FINE
    track = np.array(robot.track)[began : began + problem.steps * FINE + 1, :2]
    assert np.linalg.norm(track[-1] - [3, 0]) < 0.5
    found = violations(problem, track, FINE)
    # the mean keeps out at the grid times only
    assert found["clearance"] > -0.4
    assert found["seconds"] < 2.0


def test_it_is_of_one_robot_and_of_what_the_paper_has_equations_for() -> None:
    problem = wall()
    assert problem.online is not None
    controls = np.zeros((12, 2))
    with pytest.raises(UnsupportedError, match="the published loop is of one robot"):
        PublishedLoop(problem, problem.online.options, controls, robots=("red", "blue"))
    receding = replace(problem.online.options, horizon="receding", run_for=6.0)
    with pytest.raises(UnsupportedError, match="with `horizon: shrinking`"):
        PublishedLoop(problem, receding, controls)


@pytest.mark.parametrize("word", ["one", "three", "five"])
def test_the_files_are_the_papers_loop_on_the_examples_maps(word: str) -> None:
    loop, plain = load(CONFIGS / "online" / f"paper_{word}_obstacles.yaml"), load(CONFIGS / f"{word}_obstacles.yaml")
    assert loop.solve.as_published
    assert (loop.coordinates, loop.integrator, loop.order) == ("modal", "rk4", 8)
    assert str(loop.task) == str(plain.task)
    assert loop.fleet.identity == plain.fleet.identity
    for (name, piece), (other, same) in zip(loop.pieces, plain.pieces, strict=True):
        assert name == other
        np.testing.assert_array_equal(piece.A, same.A)
        np.testing.assert_array_equal(piece.b, same.b)
    assert loop.online is not None
    assert loop.online.options.applied_steps < loop.steps
