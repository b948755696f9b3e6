"""First guesses keep the input bounds and bring the nominal robot near its places."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.ocp.guesses.roadmap import ALL, combined, roadmap_guesses
from ensemble_ctrl.ocp.guesses.routes import LONGEST, Route
from ensemble_ctrl.ocp.truncation import positions
from ensemble_ctrl.problem import Problem, Routes
from ensemble_ctrl.systems import Unicycle
from tests.examples import examples

from .problems import FLEET, five

NOMINAL = np.array([[1.0]])
WANTED: tuple[Routes, Routes] = ("all", 8)


@pytest.mark.parametrize("heading_from", ["x", "y"])
@pytest.mark.parametrize("steps", [32, 160])
def test_seeds_keep_the_bounds_and_arrive(steps: int, heading_from: Literal["x", "y"]) -> None:
    problem = five(fleet=replace(FLEET, system=Unicycle(heading_from)))
    found = roadmap_guesses(problem, steps, 2)
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
        positions(problem, roadmap_guesses(problem, 32, 1)[0].controls, NOMINAL)
        for problem in (five(fleet=replace(FLEET, system=Unicycle(axis))) for axis in ("x", "y"))
    ]
    np.testing.assert_allclose(paths[0], paths[1], atol=1e-9)


@examples(30)
@given(st.tuples(*[st.floats(-2, 2)] * 4))
def test_any_bounds_are_kept(ends: tuple[float, float, float, float]) -> None:
    """Bounds that exclude standing still, or going straight, too."""
    lower, upper = np.sort(np.reshape(ends, (2, 2)), axis=0)
    fleet = replace(FLEET, input_lower=lower, input_upper=upper)
    problem = replace_unchecked(five(), fleet)
    for seed in roadmap_guesses(problem, 32, 1):
        assert (seed.controls >= lower).all()
        assert (seed.controls <= upper).all()


def replace_unchecked(problem: Problem, fleet: object) -> Problem:
    """A copy with another fleet, without the check that it can reach the goal."""
    copy = object.__new__(Problem)
    copy.__dict__.update(problem.__dict__, fleet=fleet)
    return copy


def test_without_a_route_the_guess_is_a_straight_line() -> None:
    # boxes that touch without overlapping: no check proves that they are closed
    ring = np.array([[[5, 8], [4, 4.2]], [[5, 8], [6.8, 7]], [[5, 5.2], [4.2, 6.8]], [[7.8, 8], [4.2, 6.8]]])
    problem = five().with_(obstacles={"wall": tuple(Obstacle.box(box) for box in ring)})
    (only,) = roadmap_guesses(problem, 32, 2)
    np.testing.assert_array_equal(only.corners, [[1, 1], [6.5, 5.5]])
    assert np.linalg.norm(positions(problem, only.controls, NOMINAL)[0, -1] - [6.5, 5.5]) < 0.3


def test_two_visits_are_driven_in_order() -> None:
    problem = five()
    regions = {"goal": problem.regions["goal"], "way": type(problem.regions["goal"]).box([[0, 1], [3, 4]])}
    task = parse("F[14,16] in(goal) and F[4,6] in(way) and G avoid(obstacles)")
    both = problem.with_(task=task, regions=regions)
    path = positions(both, roadmap_guesses(both, 160, 1)[0].controls, NOMINAL)[0]
    assert np.linalg.norm(path - [0.5, 3.5], axis=1)[40:61].min() < 0.4
    assert np.linalg.norm(path[-1] - [6.5, 5.5]) < 0.4


def test_all_routes_are_every_kind_once_and_hold_the_few_shortest() -> None:
    every, few = (roadmap_guesses(five(), 32, wanted) for wanted in WANTED)
    assert len(few) == 8
    assert few[0].length == every[0].length
    assert {seed.name for seed in few} <= {seed.name for seed in every}
    assert len({seed.name for seed in every}) == len(every) <= ALL
    lengths = [seed.length for seed in every]
    assert lengths == sorted(lengths)
    assert lengths[-1] <= LONGEST * lengths[0] + 1e-9


def test_all_routes_of_an_open_map_are_one() -> None:
    assert [s.name for s in roadmap_guesses(five().with_(obstacles={}, task=parse("F in(goal)")), 32, "all")] == [
        "straight"
    ]


@given(st.lists(st.lists(st.floats(0, 9), min_size=1, max_size=4), max_size=4), st.integers(1, 300))
def test_combinations_come_shortest_first(lengths: list[list[float]], most: int) -> None:
    """Against every combination, sorted."""
    choices = [[Route(np.zeros((2, 2)), length, ()) for length in sorted(leg)] for leg in lengths]
    found = [sum(route.length for route in legs) for legs in combined(choices, most)]
    every = sorted(sum(route.length for route in legs) for legs in product(*choices))
    np.testing.assert_allclose(found, every[:most], atol=1e-9)
    assert len({tuple(map(id, legs)) for legs in combined(choices, most)}) == len(found)
