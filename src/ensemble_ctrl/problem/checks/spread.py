"""How far one control can drive a fleet, and how far apart: bounds that no plan exceeds.

Take two members with factors a, a' on speed, b, b' on turn rate and start headings g, g', at the same place. Their
velocities at time t differ by at most ``|a - a'| v + a v min(2, |g - g' + (b - b') W(t)|)``, with the top speed v and
``|W(t)| <= w t`` for the top turn rate w; the same holds with a' in place of the second a. So at the end they are apart
by at most

    |a - a'| v T + a v min(2 T, |g - g'| T + |b - b'| w T^2 / 2)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem

Floats = NDArray[np.float64]


def top_speed(problem: Problem) -> float:
    """The largest commanded speed, m/s; no bound is known of systems that do not move on arcs."""
    if not problem.fleet.system.on_arcs:
        return np.inf
    return float(np.abs([problem.fleet.input_lower[0], problem.fleet.input_upper[0]]).max())


def furthest(problem: Problem) -> float:
    """How far from its start any member can be at the end, metres."""
    if not problem.fleet.system.on_arcs:
        return np.inf
    return (
        float(np.abs(problem.fleet.coefficients(problem.fleet.corners)[:, 0]).max())
        * top_speed(problem)
        * problem.duration
    )


def apart(problem: Problem, first: Floats, second: Floats) -> float:
    """How far apart two members can be at the end, less how far apart they start, metres.

    Parameters
    ----------
    first, second : ndarray, shape (parameters,)

    Notes
    -----
    *Guarantee*: no control brings them further apart.
    """
    if not problem.fleet.system.on_arcs:
        return np.inf
    one, other = problem.fleet.coefficients(np.stack([first, second]))[:, :3]
    return _bound(problem, np.abs(one - other), min(abs(float(one[0])), abs(float(other[0]))))


def widest(problem: Problem) -> float:
    """How far from the middle member any other can be at the end, if both start at one place, metres."""
    if not problem.fleet.system.on_arcs:
        return np.inf
    fleet = problem.fleet
    middle = fleet.coefficients(fleet.center[None])[0, :3]
    # |a - a'|, |b - b'|, |g - g'| are largest at corners, as coefficients are affine in the parameters
    most = np.abs(fleet.coefficients(fleet.corners)[:, :3] - middle).max(axis=0)
    return _bound(problem, most, abs(float(middle[0])))


def _bound(problem: Problem, differences: Floats, factor: float) -> float:
    """The bound above for differences in a, b and g."""
    fleet, T, v = problem.fleet, problem.duration, top_speed(problem)
    linear, angular, heading = differences.tolist()
    # |a - a'| v T + a v min(2 T, |g - g'| T + |b - b'| w T^2 / 2)
    turn = abs(float(fleet.arcs.rates(*np.maximum(np.abs(fleet.input_lower), np.abs(fleet.input_upper)))[1]))
    return float(v * (linear * T + factor * min(2 * T, heading * T + angular * turn * T**2 / 2)))
