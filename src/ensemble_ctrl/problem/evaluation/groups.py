"""Members that move alike, judged together: where their middle is, how far they are from it, and where they are.

Members are ordered so that those of one group have near parameters. What is far from a group's middle is then far
from all of it, and most positions of most members need never be computed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import Signals, StateSignals
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem.problem import Problem
from ensemble_ctrl.problem.signals import columns

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUNDING = 1e-12
"""Metres, and relative, by which reaches are enlarged: more than the rounding of what they are computed from."""


class Group(Protocol):
    """Some members at all sampled times.

    Attributes
    ----------
    middle : ndarray, shape (times, d)
        A curve that all of them are near, metres.
    reach : ndarray, shape (times,)
        No member is further from it at any sampled time, metres.
    signals : Signals
        Their states at the sampled times.
    """

    @property
    def middle(self) -> Floats:
        """A curve that all of them are near, shape (times, d), metres."""

    @property
    def reach(self) -> Floats:
        """The distance that none of them exceeds from it, shape (times,), metres."""

    @property
    def signals(self) -> Signals:
        """Their states, for the robustness of a formula."""

    def places(self, when: Ints) -> Floats:
        """Positions at some of the times, shape (d, members, len(when)), metres."""


Grouping = Callable[[Floats], Group]
"""What makes the group of members of shape (members, parameters)."""


@dataclass(frozen=True, eq=False)
class StatesGroup:
    """A group whose states, and signals that the task reads, were all computed, shape (members, times, columns)."""

    problem: Problem
    states: Floats

    @cached_property
    def _box(self) -> tuple[Floats, Floats]:
        """The smallest box that holds every member, at each time."""
        places = self.states[..., self.problem.fleet.place_columns]
        return places.min(axis=0), places.max(axis=0)

    @cached_property
    def middle(self) -> Floats:
        """The middles of the boxes that hold every member."""
        low, high = self._box
        return np.asarray(low / 2 + high / 2)

    @cached_property
    def reach(self) -> Floats:
        """Half the diagonals of these boxes."""
        low, high = self._box
        half = np.linalg.norm(high - low, axis=1) / 2
        return np.asarray(half * (1 + ROUNDING) + ROUNDING)

    @cached_property
    def signals(self) -> StateSignals:
        """The states as they are."""
        return StateSignals(self.states, columns(self.problem), self.problem.duration / (self.states.shape[1] - 1))

    def places(self, when: Ints) -> Floats:
        """Positions at some of the times."""
        return np.asarray(self.states[:, when][..., self.problem.fleet.place_columns].transpose(2, 0, 1))


@dataclass(frozen=True, eq=False)
class PosedGroup:
    """A group of robots on arcs with their headings, for bodies.

    Attributes
    ----------
    group : Group
    coefficients : ndarray, shape (members, 5)
    turned : ndarray, shape (times,)
        Integral of the turn rate for a factor of 1, radians.
    heading_from : str
        The axis from which coefficients count headings.
    """

    group: Group
    coefficients: Floats
    turned: Floats
    heading_from: str

    @property
    def middle(self) -> Floats:
        """As of the group."""
        return self.group.middle

    @property
    def reach(self) -> Floats:
        """As of the group."""
        return self.group.reach

    @property
    def signals(self) -> Signals:
        """As of the group."""
        return self.group.signals

    def places(self, when: Ints) -> Floats:
        """As of the group."""
        return self.group.places(when)

    def headings(self, when: Ints) -> Floats:
        """Headings at some of the times, from +x, counter-clockwise, shape (members, len(when)), radians."""
        # theta_n = theta_0 + b Omega_n
        own = self.coefficients[:, 2, None] + self.coefficients[:, 1, None] * self.turned[when]
        return np.asarray(own if self.heading_from == "x" else np.pi / 2 - own)


def ordered(members: Floats, size: int) -> Iterator[Ints]:
    """Indices of members of shape (members, parameters) in groups of at most `size`, near each other in each.

    Notes
    -----
    The box of parameters is halved at the median, along the side that is longest in comparison with the whole.
    """
    width = np.ptp(members, axis=0) if len(members) else np.zeros(members.shape[1])
    wide = np.flatnonzero(width > 0)
    scaled = members[:, wide] / width[wide]
    if len(wide) < 2:
        order = np.argsort(scaled[:, 0], kind="stable") if len(wide) else np.arange(len(members))
        yield from (order[i : i + size] for i in range(0, len(order), size))
        return
    todo = [np.arange(len(members))]
    while todo:
        here = todo.pop()
        if len(here) <= size:
            yield here
            continue
        values = scaled[here]
        side = int(np.ptp(values, axis=0).argmax())
        # a whole number of groups on the left, as near to one half as can be
        left = max(1, round(len(here) / size / 2)) * size
        split = np.argpartition(values[:, side], left)
        todo += [here[split[left:]], here[split[:left]]]
