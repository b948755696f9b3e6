"""A short way past one obstacle, and robots to drive it."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.propagation import Errors
from ensemble_ctrl.planning.online.simulated import Factors, Fixed, Flaws, SimulatedRobot
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem import Objective, Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import Unicycle

Floats = NDArray[np.float64]

NOISE = Errors(0.01, float(np.radians(1.0)))
FLEET = Fleet(Unicycle(), {"traction": Interval(0.85, 1.15)}, np.zeros(2), 0.0, np.full(2, -1.2), np.full(2, 1.2), 0.05)
SHORT = Problem(
    name="short",
    fleet=FLEET,
    duration=5.0,
    steps=50,
    task=parse("F[4,5] in(goal) and G avoid(obstacles)"),
    regions={"goal": Polyhedron.box([[2.0, 2.8], [-0.4, 0.4]])},
    obstacles={"block": (Obstacle.box([[0.9, 1.3], [-0.5, 0.05]]),)},
    objective=Objective(1.0, np.array([2.4, 0.0]), 10.0, 0.1),
)


@cache
def plan() -> Floats:
    """A plan for `SHORT`, made once."""
    return solve(SHORT).controls


def options(**changes: Any) -> OnlineOptions:
    """A loop with a deadline that a busy machine meets too: a whole period."""
    return OnlineOptions(**{"applied_steps": 10, "deadline": 1.0, "errors": NOISE, "rounds": 2, **changes})


def robot(factors: Factors | float = 1.0, seed: int = 0, **flaws: Any) -> SimulatedRobot:
    """A robot at the start, measured 0.1 s late with as much noise as is assumed."""
    given = {"position": NOISE.position, "heading": NOISE.heading, "delay": 0.1, **flaws}
    truth = Fixed(factors, factors) if isinstance(factors, float) else factors
    return SimulatedRobot(FLEET.arcs, np.zeros(2), 0.0, SHORT.step, truth, Flaws(**given), seed)


def clearance(problem: Problem, driven: SimulatedRobot) -> float:
    """Smallest distance of the true path from an obstacle, metres, beyond the radius."""
    track = np.array(driven.track)[:, :2]
    return min(float(piece.distance(track).min()) for _, piece in problem.pieces) - problem.fleet.radius
