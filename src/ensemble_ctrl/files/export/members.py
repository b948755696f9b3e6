"""Sampled members with their states at the grid times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.ensemble import Member

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Members:
    """Some robots of the fleet under the plan's commands.

    Attributes
    ----------
    parameters : tuple of dict of str to float
        Whose trajectories these are.
    states : tuple of str
        Those of the system: for robots on arcs ``x``, ``y`` and ``heading``.
    units : tuple of str
        Of the states; empty where the system declares none.
    values : ndarray, shape (members, steps + 1, states)
        Metres for positions; a heading counts from +x counter-clockwise, in radians, not wrapped.
    """

    parameters: tuple[Member, ...]
    states: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats

    @property
    def names(self) -> list[str]:
        """What each member is called: its parameters, such as ``traction=0.9``."""
        return [", ".join(f"{name}={value:.6g}" for name, value in one.items()) or "robot" for one in self.parameters]


def sampled(problem: Problem, controls: Floats, count: int) -> Members:
    """`count` members spread over the ranges of the parameters; none for 0."""
    fleet = problem.fleet
    members = fleet.center[None] if count == 1 else fleet.spread(count)
    system, named = fleet.system, tuple(fleet.named(member) for member in members)
    found = np.zeros((0, len(controls) + 1, len(system.states)))
    if count:
        found = fleet.full_states(controls, members, problem.duration / len(controls))
    known = dict.fromkeys(fleet.places, "m") | dict(zip(system.states, system.state_units, strict=False))
    return Members(named, system.states, tuple(known.get(name, "") for name in system.states), found)
