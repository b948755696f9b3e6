"""What a task reads besides the states of trajectories: headings, speeds and turn rates of robots on arcs."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl.formula import Formula
from ensemble_ctrl.constraints.stl.leaves import Predicate, Within
from ensemble_ctrl.constraints.stl.rewrite import SOME_TURNS, leaves
from ensemble_ctrl.problem.zones import required

if TYPE_CHECKING:
    from ensemble_ctrl.problem.fleet import Fleet
    from ensemble_ctrl.problem.problem import Problem

Floats = NDArray[np.float64]

MORE = 1.1
"""Factor on what a robot can turn, for errors of its model that are bounded elsewhere."""


def names_in(leaf: Formula) -> tuple[str, ...]:
    """The states and signals that a leaf names; none for a place."""
    if isinstance(leaf, Within):
        return (leaf.state,)
    return tuple(name for name, _ in leaf.coefficients) if isinstance(leaf, Predicate) else ()


def signals_read(problem: Problem) -> tuple[str, ...]:
    """The signals that a task reads, in the system's order."""
    named = {name for leaf in leaves(required(problem)) for name in names_in(leaf)}
    return tuple(name for name in problem.fleet.system.signals if name in named)


def rates_read(problem: Problem) -> tuple[str, ...]:
    """Those of them that are speeds, turn rates or commands: nothing is proven of these where commands may be late."""
    return tuple(name for name in signals_read(problem) if name != problem.fleet.system.heading_state)


def columns(problem: Problem) -> tuple[str, ...]:
    """Names of the states of trajectories, and of the signals that the task reads."""
    return (*problem.fleet.states, *problem.specification.signals)


def with_signals(problem: Problem, states: Floats, controls: Floats, members: Floats, step: float) -> Floats:
    """States of members with the signals that the task reads as further columns (`columns`).

    Parameters
    ----------
    problem : Problem
    states : ndarray, shape (members, steps + 1, states)
    controls : ndarray, shape (steps, n_u)
        At the times of `states`, one row a step.
    members : ndarray, shape (members, parameters)
    step : float
        Seconds.

    Returns
    -------
    ndarray, shape (members, steps + 1, columns)
    """
    names, fleet = problem.specification.signals, problem.fleet.of_one_start
    if not names:
        return states
    robots = fleet.coefficients(members)
    more = [fleet.arcs.signal(name, controls, robots, step) for name in names]
    return np.concatenate([states, np.stack(more, axis=-1)], axis=-1)


def angle_range(problem: Problem, name: str) -> tuple[float, float]:
    """Radians between which an angle of a member is, whatever the commands within the input bounds.

    Notes
    -----
    Of a system that an ODE defines, `SOME_TURNS`: nothing is known of it.
    """
    fleet = problem.fleet.of_one_start
    if name not in fleet.system.signals:
        return SOME_TURNS
    if name != "heading":
        k = fleet.system.controls.index(name)
        return float(fleet.input_lower[k]) - np.pi, float(fleet.input_upper[k]) + np.pi
    # |theta - theta_0| <= T b (1 + beta) max |omega|, the latter at a corner of the commands' bounds, and errors
    bounds = fleet.uncertainty
    ends = np.stack([fleet.input_lower, fleet.input_upper])
    ends = ends + bounds.command_errors(fleet.system.controls, ends) * np.array([[-1.0], [1.0]])
    with np.errstate(all="ignore"):
        fastest = max(abs(float(fleet.arcs.rates(first, second)[1])) for first, second in product(*ends.T))
    strays = float(np.prod([1 + share for share in bounds.varies.values()]))
    pushed = bounds.disturbance.get("heading", 0.0) * (problem.duration + bounds.delay)
    turned = MORE * (problem.duration * fleet.fastest[1] * strays * fastest + pushed)
    starts = _headings_at_start(fleet)
    return float(starts.min()) - turned - np.pi, float(starts.max()) + turned + np.pi


def _headings_at_start(fleet: Fleet) -> Any:
    """Headings from +x at the corners of the ranges, radians."""
    still = np.zeros((1, len(fleet.input_lower)))
    return fleet.arcs.headings(still, fleet.coefficients(fleet.corners), 0.0)[:, 0]
