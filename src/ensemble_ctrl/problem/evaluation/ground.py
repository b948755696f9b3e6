"""Robots on arcs that cross patches of terrain: their factors there, and the instants at which these change."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass

if TYPE_CHECKING:
    from ensemble_ctrl.problem.fleet import Fleet
    from ensemble_ctrl.problem.terrain import Patch

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

Move = Callable[[Ints, Floats, Floats, Floats], Floats]
"""States of robots after some seconds: of their numbers, their states, seconds, and ratios of factors, (2, robots)."""

PROBES = (0.25, 0.5, 0.75, 1.0)
"""Shares of a time at which it is looked whether a robot has crossed a border."""
HALVINGS = 40
"""Bisections of the instant of a crossing."""
MOST_CROSSINGS = 4
"""Crossings in one tick; who crosses more often is as elsewhere for the rest of it, which a patch allows."""


@dataclass(frozen=True, eq=False)
class Ground:
    """The terrain below some robots.

    Parameters
    ----------
    patches : mapping of str to Patch
    fleet : Fleet
    members : ndarray, shape (robots, parameters)
    """

    patches: Mapping[str, Patch]
    fleet: Fleet
    members: Floats

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The parameters that some patch changes, in the system's order."""
        return parameters(self.patches, self.fleet)

    @cached_property
    def _own(self) -> Floats:
        """The robots' own values of these parameters, shape (names, robots)."""
        psi = self.fleet.psi(self.members)
        return np.array([psi[name] for name in self.names])

    def inside(self, places: Floats) -> Bools:
        """In which patches places of shape (2, robots) are, shape (patches, robots)."""
        return np.stack([patch.contains(places.T) for patch in self.patches.values()])

    def near(self, places: Floats, reach: Floats) -> Ints:
        """Numbers of the robots that may touch a patch on a way of a length `reach`, shape (robots,)."""
        found = np.zeros(places.shape[1], dtype=bool)
        for patch in self.patches.values():
            corners = np.concatenate([piece.vertices for piece in patch.pieces])
            low, high = corners.min(axis=0)[:, None] - reach, corners.max(axis=0)[:, None] + reach
            found |= ((places >= low) & (places <= high)).all(axis=0)
        return np.flatnonzero(found)

    def ratios(self, robots: Ints, inside: Bools, settings: Floats) -> Floats:
        """Ratios of the factors on speed and turn rate to their own, of robots inside some patches, shape (2, robots).

        Settings from -1 to 1, of shape (names, robots), are from the smallest to the largest value there.
        """
        found = np.ones((2, len(robots)))
        for name, own, setting in zip(self.names, self._own[:, robots], settings, strict=True):
            low, high = own.copy(), own.copy()
            for patch, here in zip(self.patches.values(), inside, strict=True):
                if name in patch.parameters:
                    least, most = patch.between(name, own)
                    low, high = (
                        np.where(here, np.minimum(low, least), low),
                        np.where(here, np.maximum(high, most), high),
                    )
            value = np.clip(low + (setting + 1) / 2 * (high - low), low, high)
            for k, part in enumerate(self.fleet.arcs.directions[name]):
                found[k] *= value / own if part else 1.0
        return found

    def crossed(self, states: Floats, settings: Floats, tick: float, reach: Floats, move: Move) -> Floats:
        """States of the robots after a tick, with the factors that each patch gives within it.

        Parameters
        ----------
        states : ndarray, shape (rows, robots)
            Places in the first two rows, metres.
        settings : ndarray, shape (names, robots)
        tick : float
            Seconds.
        reach : ndarray, shape (robots,)
            Metres that they move at most with their own factors.
        move : callable
        """
        count = states.shape[1]
        found = move(np.arange(count), states, np.full(count, tick), np.ones((2, count)))
        some = self.near(states[:2], reach * self._largest)
        here, left, settings = states[:, some], np.full(len(some), tick), settings[:, some]
        for _ in range(MOST_CROSSINGS if len(some) else 0):
            inside = self.inside(here[:2])
            ratios = self.ratios(some, inside, settings)
            seconds = self._until(some, here, inside, left, ratios, move)
            here, left = move(some, here, seconds, ratios), left - seconds
        found[:, some] = move(some, here, left, np.ones((2, len(some))))
        return found

    def _until(self, some: Ints, here: Floats, inside: Bools, left: Floats, ratios: Floats, move: Move) -> Floats:
        """Seconds until each of some robots has crossed a border, or what is left of the tick."""

        def crossed(seconds: Floats) -> Bools:
            return np.asarray((self.inside(move(some, here, seconds, ratios)[:2]) != inside).any(axis=0))

        low, high, known = np.zeros(len(some)), left.copy(), np.zeros(len(some), dtype=bool)
        for share in PROBES:
            now = crossed(share * left)
            high = np.where(now & ~known, share * left, high)
            known |= now
            low = np.where(known, low, share * left)
        for _ in range(HALVINGS if known.any() else 0):
            middle = (low + high) / 2
            now = crossed(middle)
            low, high = np.where(known & ~now, middle, low), np.where(known & now, middle, high)
        return high

    @cached_property
    def _largest(self) -> Floats:
        """The largest ratio of a robot's speed to that with its own factor, shape (robots,)."""
        found = np.ones(len(self.members))
        for name, own in zip(self.names, self._own, strict=True):
            ends = [patch.parameters[name][1] for patch in self.patches.values() if name in patch.parameters]
            found *= np.maximum(1.0, max(ends) / own)
        return found


def parameters(patches: Mapping[str, Patch], fleet: Fleet) -> tuple[str, ...]:
    """The parameters that some patch changes, in the system's order."""
    return tuple(
        name for name in fleet.system.parameters if any(name in patch.parameters for patch in patches.values())
    )
