"""Which parameters and states are consistent with measurements of all states, for any system, errors being bounded.

From a box of states and a box of parameters, the enclosure of the certificate says where the states can be after some
commands: a polynomial in the parameters, and a radius around it.  Cells of parameters whose states then miss the box
that a measurement leaves are refuted; what is left is the new box of parameters, and its states within the
measurement's box are the new set.

*Guarantee*: as long as the system is the model and the measurements' errors are within their bounds, the true values
are never excluded; an empty set therefore shows that some assumption is wrong.

L. Jaulin, M. Kieffer, O. Didrit, E. Walter, Applied Interval Analysis, 2001, chapter 6.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.general.boxes import Boxes
from ensemble_ctrl.certificate.general.enclosure import Enclosure, enclose
from ensemble_ctrl.certificate.general.start import Start
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]

HALVINGS = {1: 6, 2: 3, 3: 2}
"""Times that cells are halved along each of so many parameters, else once."""
OUT = 1e-12
"""By how much boxes are widened for rounding, relative to their ends."""


@dataclass(frozen=True, eq=False)
class Box:
    """States between two ends, shape (states,) each."""

    low: Floats
    high: Floats

    @classmethod
    def about(cls, middle: Floats, half: Floats) -> Box:
        """Of a measurement and its errors."""
        return cls(_down(middle - half), _up(middle + half))

    @property
    def middle(self) -> Floats:
        """Shape (states,)."""
        return np.asarray((self.low + self.high) / 2)

    @property
    def half(self) -> Floats:
        """Half the sides, rounded up, shape (states,)."""
        return _up(np.maximum(self.high - self.middle, self.middle - self.low))

    def meet(self, other: Box) -> Box | None:
        """What both have; None if that is nothing."""
        low, high = np.maximum(self.low, other.low), np.minimum(self.high, other.high)
        return Box(low, high) if (low <= high).all() else None


class StateSets:
    """The box of parameters of one robot, and where its states can get to.

    Parameters
    ----------
    fleet : Fleet
        The ranges that are assumed, of parameters of the system only.
    """

    def __init__(self, fleet: Fleet) -> None:
        self.system, self.names = fleet.system, fleet.names
        self.assumed = np.stack([fleet.lower, fleet.upper], axis=1).reshape(-1, 2)
        self.ranges = self.assumed.copy()

    def reach(self, box: Box, controls: Floats, step: float) -> Enclosure:
        """Where states from a box get to under commands.

        Raises
        ------
        Unenclosed
            If there is no enclosure.
        """
        own = np.full(len(self.names), -1, dtype=np.int64)
        start = Start(self.names, self.ranges[:, 0], self.ranges[:, 1], box.middle, own, box.half)
        return enclose(self.system, start, controls, len(controls) * step)

    def contract(self, enclosure: Enclosure, steps: int, seen: Box) -> Box | None:
        """Narrow the parameters to those whose states are in `seen` at the end of an enclosure of so many steps.

        Returns
        -------
        Box or None
            Their states within `seen`; None, and the parameters as they were, if there are none.
        """
        cells = self._cells(enclosure, steps * enclosure.parts - 1)
        low, high = sides(cells)
        left = ((low <= seen.high) & (high >= seen.low)).all(axis=1)
        if not left.any():
            return None
        found = Box(low[left].min(axis=0), high[left].max(axis=0)).meet(seen)
        if found is not None and len(self.names):
            # the hull of the cells left, within what was known
            centre, half = cells.centre[left], cells.half[left]
            ends = np.stack([_down(centre - half).min(axis=0), _up(centre + half).max(axis=0)], axis=1)
            narrow = np.clip(ends, self.ranges[:, :1], self.ranges[:, 1:])
            self.ranges = narrow
        return found

    def _cells(self, enclosure: Enclosure, piece: int) -> Boxes:
        """The end of a piece, on small cells of parameters."""
        end = np.ones(1)
        boxes = Boxes.of(enclosure, np.eye(len(self.system.states)), np.array([piece]), end, end)
        for _ in range(HALVINGS.get(len(enclosure.wide), 1)):
            for k in range(len(enclosure.wide)):
                boxes = boxes.halved(np.full(len(boxes), 1 + k))
        return boxes


def during(enclosure: Enclosure, step: int) -> Box:
    """All states during a step of an enclosure."""
    return _hull(enclosure, step * enclosure.parts + np.arange(enclosure.parts), -1.0, 1.0)


def at_beginning(enclosure: Enclosure, step: int) -> Box:
    """All states at the beginning of a step of an enclosure."""
    return _hull(enclosure, np.array([step * enclosure.parts]), -1.0, -1.0)


def at_end(enclosure: Enclosure, steps: int) -> Box:
    """All states at the end of so many steps of an enclosure."""
    return _hull(enclosure, np.array([steps * enclosure.parts - 1]), 1.0, 1.0)


def _hull(enclosure: Enclosure, pieces: NDArray[np.int64], begin: float, end: float) -> Box:
    """All states during a part of some pieces."""
    count, states = len(pieces), enclosure.c.shape[1]
    cells = Boxes.of(enclosure, np.eye(states), pieces, np.full(count, begin), np.full(count, end))
    low, high = sides(cells)
    return Box(low.min(axis=0), high.max(axis=0))


def sides(cells: Boxes) -> tuple[Floats, Floats]:
    """Ends of the quantities on each box, shape (boxes, quantities) each."""
    # c_00 +- (sum of all other |c|, and the pad)
    middle = cells.c[:, :, 0, 0]
    away = np.abs(cells.c).sum(axis=(2, 3)) - np.abs(middle) + cells.pad
    spare = OUT * (1 + np.abs(cells.c).sum(axis=(2, 3)))
    return middle - away - spare, middle + away + spare


def _down(values: Floats) -> Floats:
    """A little less."""
    return np.asarray(values - OUT * (1 + np.abs(values)))


def _up(values: Floats) -> Floats:
    """A little more."""
    return np.asarray(values + OUT * (1 + np.abs(values)))
