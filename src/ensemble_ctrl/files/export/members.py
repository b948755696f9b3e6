"""Sampled members with their states at the grid times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.ensemble import Member
from ensemble_ctrl.problem.evaluation.sampled import states
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Members:
    """Some robots of the fleet under the plan's commands.

    Attributes
    ----------
    parameters : tuple of dict of str to float
        Whose trajectories these are.
    states : tuple of str
        For robots on arcs ``x``, ``y`` and ``heading``; else those of the system.
    units : tuple of str
        Of the states; empty where the system does not tell.
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
    named = tuple(fleet.named(member) for member in members)
    length = len(controls) + 1
    if not isinstance(fleet, Fleet):
        units = tuple("m" if name in fleet.places else "" for name in fleet.states)
        found = states(problem, controls, members) if count else np.zeros((0, length, len(units)))
        return Members(named, fleet.states, units, found)
    found = states(problem, controls, members) if count else np.zeros((0, length, 2))
    turns = _headings(fleet, controls, members, problem.duration / len(controls))
    return Members(named, ("x", "y", "heading"), ("m", "m", "rad"), np.concatenate([found, turns[..., None]], axis=2))


def _headings(fleet: Fleet, controls: Floats, members: Floats, step: float) -> Floats:
    """Headings of robots on arcs at the grid times, from +x, shape (members, steps + 1)."""
    drives = fleet.drives(members)
    _, omega = fleet.system.rates(*controls.T)
    turned = np.concatenate([[0.0], step * np.cumsum(omega)])
    own = drives[:, 2, None] + drives[:, 1, None] * turned
    return np.asarray(own if fleet.system.heading_from == "x" else np.pi / 2 - own)
