"""Sampled members with their positions and headings at the grid times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.fleet import Member
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.replay import trajectories

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Members:
    """Some robots of the fleet under the plan's commands.

    Attributes
    ----------
    parameters : tuple of dict of str to float
        Whose trajectories these are.
    positions : ndarray, shape (members, steps + 1, 2)
        Metres.
    headings : ndarray, shape (members, steps + 1)
        Radians, counted from +x counter-clockwise, not wrapped.
    """

    parameters: tuple[Member, ...]
    positions: Floats
    headings: Floats

    @property
    def names(self) -> list[str]:
        """What each member is called: its parameters, such as ``traction=0.9``."""
        return [", ".join(f"{name}={value:.6g}" for name, value in one.items()) or "robot" for one in self.parameters]


def sampled(problem: Problem, controls: Floats, count: int) -> Members:
    """`count` members spread over the ranges of the parameters, run by exact arcs; none for 0."""
    fleet = problem.fleet
    members = _spread(problem, count)
    drives = fleet.drives(members)
    _, omega = fleet.system.rates(*controls.T)
    step = problem.duration / len(controls)
    turned = np.concatenate([[0.0], step * np.cumsum(omega)])
    own = drives[:, 2, None] + drives[:, 1, None] * turned
    headings = own if fleet.system.heading_from == "x" else np.pi / 2 - own
    positions = trajectories(problem, controls, members) if count else np.zeros((0, len(controls) + 1, 2))
    return Members(tuple(fleet.named(member) for member in members), positions, headings)


def _spread(problem: Problem, count: int) -> Floats:
    """Members to show: the middle one for 1, both ends of the first range included for more."""
    fleet = problem.fleet
    return fleet.center[None] if count == 1 else fleet.spread(count)
