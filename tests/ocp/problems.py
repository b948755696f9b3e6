"""Problems that several tests plan: the five obstacles of the paper's example, without a file."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.planner import Solution, solve
from ensemble_ctrl.problem import Objective, Problem, SolveOptions
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import Unicycle

BOXES = {
    "o1": [[2.0, 3.0], [1.5, 3.0]],
    "o2": [[3.6, 4.6], [0.2, 2.2]],
    "o3": [[4.0, 5.0], [3.2, 4.4]],
    "o4": [[1.2, 2.2], [3.8, 5.0]],
    "o5": [[5.6, 6.6], [2.2, 3.4]],
}
FLEET = Fleet(Unicycle(), {"traction": Interval(0.9, 1.1)}, np.ones(2), np.pi / 4, np.full(2, -2.0), np.full(2, 2.0))


def five(order: int | None = 8, fleet: Fleet = FLEET, **options: Any) -> Problem:
    """Five obstacles, a goal to be in during the last 2 s of 16 s."""
    return Problem(
        name="five",
        fleet=fleet,
        duration=16.0,
        steps=160,
        task=parse("F[14,16] in(goal) and G[0,16] avoid(obstacles)"),
        regions={"goal": Polyhedron.box([[6, 7], [5, 6]])},
        obstacles={name: (Obstacle.box(box),) for name, box in BOXES.items()},
        objective=Objective(1.0, np.array([6.5, 5.5]), 10.0, 0.1),
        order=order,
        solve=SolveOptions(**options),
    )


@cache
def planned() -> Solution:
    """The plan for `five` at order 8, made once."""
    return solve(five())
