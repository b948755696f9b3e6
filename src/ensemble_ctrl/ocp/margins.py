"""What the program adds to the distance from an obstacle, the same for hyperplanes and for binaries."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ensemble_ctrl.ocp.arrays import CasadiArrays
from ensemble_ctrl.ocp.truncation import Truncation
from ensemble_ctrl.problem import Problem

SMOOTH = 0.05
"""``|v omega|`` is replaced by the larger ``sqrt((v omega)^2 + SMOOTH^2)``, which can be differentiated."""


def keeping(problem: Problem, truncation: Truncation, tail: float) -> float:
    """Metres that every point has to keep, without the robot's radius and the arc; `tail` counts for hulls only."""
    return problem.solve.margin + (tail if truncation.hull else 0.0)


def curvature(problem: Problem, truncation: Truncation, steps: int) -> float:
    """Metres by which an arc leaves its chord for ``|v omega| = 1``; none unless the points are hulls."""
    if not truncation.hull:
        return 0.0
    return float(problem.fleet.arcs.sagitta(1.0, 1.0, *problem.fleet.fastest, problem.duration / steps))


def bulge(problem: Problem, curvature: float, first: Any, second: Any) -> Any:
    """Metres for the arc of one step, an expression of its two commands."""
    # sagitta h^2/8 a b |v omega|, with a smooth absolute value above it
    v, omega = problem.fleet.arcs.rates(first, second, CasadiArrays)
    return curvature * ca.sqrt((v * omega) ** 2 + SMOOTH**2)


def largest_bulge(problem: Problem, truncation: Truncation, steps: int) -> float:
    """The largest `bulge` that the inputs allow, metres."""
    v, omega = problem.fleet.arcs.rates(
        *np.maximum(np.abs(problem.fleet.input_lower), np.abs(problem.fleet.input_upper))
    )
    return curvature(problem, truncation, steps) * float(np.hypot(v * omega, SMOOTH))
