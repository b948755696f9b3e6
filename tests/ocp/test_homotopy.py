"""What routes are called."""

from __future__ import annotations

import numpy as np
import pytest

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.ocp.guesses.homotopy import distinct, homotopy
from ensemble_ctrl.ocp.guesses.routes import routes

START, GOAL = np.array([0.0, 0.0]), np.array([10.0, 0.0])
NEAR = (Obstacle.box([[2.0, 3.0], [-0.5, 0.5]]),)
FAR = (Obstacle.box([[6.0, 7.0], [-0.5, 0.5]]),)
BEHIND = (Obstacle.box([[-3.0, -2.0], [-0.5, 0.5]]),)
OBSTACLES = {"far": FAR, "near": NEAR, "behind": BEHIND}


def called(*middle: list[float]) -> str:
    return homotopy(np.array([START, *middle, GOAL]), OBSTACLES)


@pytest.mark.parametrize(
    ("middle", "name"),
    [
        ([[2.5, -1.0], [6.5, -1.0]], "near left, far left"),
        ([[2.5, 1.0], [6.5, 1.0]], "near right, far right"),
        ([[2.5, 1.0], [4.5, 0.0], [6.5, -1.0]], "near right, far left"),
        ([[2.5, -1.0], [4.5, 0.0], [6.5, 1.0]], "near left, far right"),
    ],
)
def test_left_is_what_lies_to_the_left_in_the_order_of_passing(middle: list[list[float]], name: str) -> None:
    assert called(*middle) == name


def test_the_way_back_swaps_the_sides() -> None:
    assert homotopy(np.array([GOAL, [6.5, 1.0], [2.5, 1.0], START]), OBSTACLES) == "far left, near left"


def test_nothing_is_passed() -> None:
    assert homotopy(np.array([START, [0.0, 1.0]]), {"behind": BEHIND}) == "straight"
    assert homotopy(np.array([START, GOAL]), {}) == "straight"


def test_pieces_on_both_sides_and_a_full_turn() -> None:
    gate = (Obstacle.box([[4, 5], [1, 2]]), Obstacle.box([[4, 5], [-2, -1]]))
    assert homotopy(np.array([START, GOAL]), {"gate": gate}) == "gate between"
    turn = np.array([START, [2.5, -1], [4, 0], [2.5, 1], [1, 0.5], [2, -1.5], GOAL])
    assert homotopy(turn, {"near": NEAR}) == "near left and round"


def test_every_way_through_a_row_has_its_own_name() -> None:
    names = {homotopy(r.corners, {"near": NEAR, "far": FAR}) for r in routes(START, GOAL, [*NEAR, *FAR], 0.1, 9, False)}
    assert names == {f"near {a}, far {b}" for a in ("left", "right") for b in ("left", "right")}


def test_names_are_made_distinct() -> None:
    assert distinct(["a", "b", "a", "a"]) == ["a", "b", "a (2)", "a (3)"]
