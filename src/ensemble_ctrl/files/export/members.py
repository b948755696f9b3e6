"""Sampled members with their states at the grid times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.ensemble import Member
from ensemble_ctrl.problem.starts import by_start

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
    starts : tuple of str
        The name of each member's start; empty where all start alike.
    """

    parameters: tuple[Member, ...]
    states: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    starts: tuple[str, ...] = ()

    @property
    def names(self) -> list[str]:
        """What each member is called: its start, if there are several, and its parameters, such as ``traction=0.9``."""
        starts = self.starts or ("",) * len(self.parameters)
        return [_name(start, one) for start, one in zip(starts, self.parameters, strict=True)]


def sampled(problem: Problem, controls: Floats, count: int) -> Members:
    """`count` members spread over the ranges of the parameters, the same at each start; none for 0."""
    each = {start: _alike(one, controls, count) for start, one in by_start(problem).items()}
    first = next(iter(each.values()))
    parameters = tuple(member for some in each.values() for member in some.parameters)
    starts = tuple(start for start, some in each.items() for _ in some.parameters) if problem.fleet.starts else ()
    return replace(
        first, parameters=parameters, values=np.concatenate([some.values for some in each.values()]), starts=starts
    )


def _name(start: str, parameters: Member) -> str:
    """Of one member."""
    words = [start] if start else []
    return ", ".join([*words, *(f"{name}={value:.6g}" for name, value in parameters.items())]) or "robot"


def _alike(problem: Problem, controls: Floats, count: int) -> Members:
    """Members that start at one place."""
    fleet = problem.fleet
    members = fleet.center[None] if count == 1 else fleet.spread(count)
    system, named = fleet.system, tuple(fleet.named(member) for member in members)
    found = np.zeros((0, len(controls) + 1, len(system.states)))
    if count:
        found = fleet.full_states(controls, members, problem.duration / len(controls))
    known = dict.fromkeys(fleet.places, "m") | dict(zip(system.states, system.state_units, strict=False))
    return Members(named, system.states, tuple(known.get(name, "") for name in system.states), found)
