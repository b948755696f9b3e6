"""What some commands are worth: judged the same way for every program, and never by a program's own word."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import ensemble_ctrl as ec

Floats = NDArray[np.float64]

MEMBERS = 200
"""Members replayed, the ends of the ranges first."""


def cost(problem: ec.Problem, controls: Floats) -> float:
    """Weighted effort less weighted robustness of the worst of `MEMBERS` members; infinite if one runs away."""
    weights = problem.objective.efforts(controls.shape[1])
    effort = float((controls**2 @ weights).sum()) * problem.duration / len(controls)
    try:
        worst, _ = ec.replay(problem, controls, members=MEMBERS).worst
    except ec.RunawayError:
        return float("inf")
    return effort - problem.objective.robustness * worst


def verdict(problem: ec.Problem, controls: Floats) -> str:
    """``proven`` for all members, ``found`` for the middle one alone, ``wrong`` if a proof is refuted, or ``none``."""
    try:
        middle = ec.replay(problem, controls, parameters=problem.fleet.center[None])
    except ec.RunawayError:
        return "none"
    if ec.certify(problem, controls).proven == "yes":
        return "wrong" if ec.replay(problem, controls, members=MEMBERS).violating.any() else "proven"
    return "none" if middle.violating.any() else "found"
