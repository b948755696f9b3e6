"""First guesses keep the input bounds and bring the nominal robot near its places."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.ocp.seeds import seeds
from ensemble_ctrl.ocp.truncation import positions
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.systems import Unicycle

from .problems import FLEET, five

NOMINAL = np.array([[1.0]])


@pytest.mark.parametrize("heading_from", ["x", "y"])
@pytest.mark.parametrize("steps", [32, 160])
def test_seeds_keep_the_bounds_and_arrive(steps: int, heading_from: Literal["x", "y"]) -> None:
    problem = five(fleet=replace(FLEET, system=Unicycle(heading_from)))
    found = seeds(problem, steps, 2)
    assert len(found) == 2
    assert found[0].length < found[1].length
    for seed in found:
        assert seed.controls.shape == (steps, 2)
        assert (np.abs(seed.controls) <= 2).all()
        path = positions(problem, seed.controls, NOMINAL)[0]
        assert np.linalg.norm(path[-1] - [6.5, 5.5]) < 0.3
        deepest = min(float(piece.distance(path).min()) for _, piece in problem.pieces)
        assert deepest > -0.2


def test_both_conventions_drive_the_same_path() -> None:
    paths = [
        positions(problem, seeds(problem, 32, 1)[0].controls, NOMINAL)
        for problem in (five(fleet=replace(FLEET, system=Unicycle(axis))) for axis in ("x", "y"))
    ]
    np.testing.assert_allclose(paths[0], paths[1], atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.floats(-2, 2)] * 4))
def test_any_bounds_are_kept(ends: tuple[float, float, float, float]) -> None:
    """Bounds that exclude standing still, or going straight, too."""
    lower, upper = np.sort(np.reshape(ends, (2, 2)), axis=0)
    fleet = replace(FLEET, input_lower=lower, input_upper=upper)
    problem = replace_unchecked(five(), fleet)
    for seed in seeds(problem, 32, 1):
        assert (seed.controls >= lower).all()
        assert (seed.controls <= upper).all()


def replace_unchecked(problem: Problem, fleet: object) -> Problem:
    """A copy with another fleet, without the check that it can reach the goal."""
    copy = object.__new__(Problem)
    copy.__dict__.update(problem.__dict__, fleet=fleet)
    return copy


def test_without_a_route_the_guess_is_a_straight_line() -> None:
    ring = np.array([[[5, 8], [4, 4.2]], [[5, 8], [6.8, 7]], [[5, 5.2], [4, 7]], [[7.8, 8], [4, 7]]])
    problem = five().with_(obstacles={"wall": tuple(Obstacle.box(box) for box in ring)})
    (only,) = seeds(problem, 32, 2)
    np.testing.assert_array_equal(only.corners, [[1, 1], [6.5, 5.5]])
    assert np.linalg.norm(positions(problem, only.controls, NOMINAL)[0, -1] - [6.5, 5.5]) < 0.3


def test_two_visits_are_driven_in_order() -> None:
    problem = five()
    regions = {"goal": problem.regions["goal"], "way": type(problem.regions["goal"]).box([[0, 1], [3, 4]])}
    task = parse("F[14,16] in(goal) and F[4,6] in(way) and G avoid(obstacles)")
    both = problem.with_(task=task, regions=regions)
    path = positions(both, seeds(both, 160, 1)[0].controls, NOMINAL)[0]
    assert np.linalg.norm(path - [0.5, 3.5], axis=1)[40:61].min() < 0.4
    assert np.linalg.norm(path[-1] - [6.5, 5.5]) < 0.4
