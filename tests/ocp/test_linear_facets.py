"""The linear model: a path that keeps out and visits, and its choice against every other one of a small map."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog
from shapely import LineString, box

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.ocp import linear_facets as module
from ensemble_ctrl.ocp.linear_facets import LinearPlan, linear_facets
from ensemble_ctrl.problem import Objective, Problem

from .problems import BOXES, FLEET, five

Floats = NDArray[np.float64]


def wall(low: float, high: float, steps: int = 32) -> Problem:
    """A wall on the straight way from (0, 0) to (4, 0)."""
    return Problem(
        "wall",
        FLEET.with_(position=[0.0, 0.0], heading=0.0),
        8.0,
        steps,
        parse("F[6,8] in(goal) and G avoid(wall)"),
        {"goal": Polyhedron.box([[3.5, 4.5], [-0.5, 0.5]])},
        {"wall": (Obstacle.box([[1.5, 2.5], [low, high]]),)},
        objective=Objective(1.0, np.array([4.0, 0.0]), 10.0, 0.1),
    )


def test_the_path_keeps_out_visits_in_time_and_is_no_faster_than_the_robots() -> None:
    problem = five()
    found = linear_facets(problem, 60.0)
    assert found.found
    assert found.path.shape == (17, 2)
    line = LineString(found.path)
    for low, high in (np.array(corners).T for corners in BOXES.values()):
        assert line.distance(box(*low, *high)) >= module.ROOM - 1e-6
    goal = problem.regions["goal"]
    assert any((goal.A @ p >= goal.lower).all() and (goal.A @ p <= goal.upper).all() for p in found.path[14:])
    assert np.linalg.norm(np.diff(found.path, axis=0), axis=1).max() <= 2.0 * 0.9 * 1.0 + 1e-9
    np.testing.assert_allclose(found.path[0], [1, 1], atol=1e-9)
    assert found.bound <= found.cost + 1e-9


def test_the_chosen_facets_hold_at_both_ends_of_every_step() -> None:
    found = linear_facets(five(), 60.0)
    gaps = found.sides.gaps(found.path[:, None])
    assert (found.chosen.sum(axis=0) == len(BOXES)).all()
    assert (gaps[found.chosen] >= module.ROOM - 1e-6).all()
    z = found.of_piece(2, np.array([1, 10, 11, 160]), 160)
    own = found.chosen[found.sides.piece == 2]
    np.testing.assert_array_equal(z, own[:, [0, 1, 1, 15]].T)
    fine = found.fine(160)
    np.testing.assert_allclose(fine[::10], found.path, atol=1e-12)


@pytest.mark.parametrize(("low", "high", "below"), [(-0.4, 1.5, True), (-1.5, 0.4, False)])
def test_it_takes_the_shorter_way(low: float, high: float, below: bool) -> None:
    found = linear_facets(wall(low, high), 60.0)
    middle = found.path[np.abs(found.path[:, 0] - 2.0) < 0.6]
    assert len(middle)
    assert (middle[:, 1] < low).all() if below else (middle[:, 1] > high).all()


def test_no_choice_of_facets_costs_less(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every choice of a short horizon, each a linear program."""
    monkeypatch.setattr(module, "STEPS", 3)
    monkeypatch.setattr(module, "GAP", 0.0)
    problem = wall(-0.4, 1.5).with_(task=parse("F in(goal) and G avoid(wall)"))
    found = linear_facets(problem, 60.0)
    model = module._Model()
    place = module._moving(problem, model, 3)
    z = module._keeping_out(problem, model, found.sides, place)
    module._visiting(problem, model, place)
    A = np.zeros((len(model.most), len(model.costs)))
    for row, column, value in model.entries:
        A[row, column] += value
    visits = np.flatnonzero(model.whole)[z.size :]
    best = np.inf
    for choice, when in product(product(range(4), repeat=3), visits):
        lower, upper = np.array(model.lower), np.array(model.upper)
        one = np.zeros(z.shape)
        one[choice, range(3)] = 1
        lower[z] = upper[z] = one
        lower[when] = 1
        tried = linprog(np.array(model.costs), A, np.array(model.most), bounds=np.column_stack([lower, upper]).tolist())
        best = min(best, np.inf if tried.fun is None else tried.fun)
    assert found.cost == pytest.approx(best, rel=1e-6)


def test_there_is_none_where_the_goal_is_out_of_reach() -> None:
    far = wall(-0.4, 1.5).with_(regions={"goal": Polyhedron.box([[13.0, 14.0], [0.0, 1.0]])})
    found = linear_facets(far, 60.0)
    assert not found.found
    assert isinstance(found, LinearPlan)
    assert "infeasible" in found.message.lower()


def test_windows_shorter_than_its_steps_have_a_grid_time() -> None:
    problem = five().with_(task=parse("F[14.3,14.6] in(goal) and G avoid(obstacles)"))
    found = linear_facets(problem, 60.0)
    steps = len(found.path) - 1
    inside = np.linspace(0, 16, steps + 1)
    goal = problem.regions["goal"]
    when = inside[(goal.lower[:, None] <= goal.A @ found.path.T).all(axis=0)]
    assert ((when >= 14.3) & (when <= 14.6)).any()
