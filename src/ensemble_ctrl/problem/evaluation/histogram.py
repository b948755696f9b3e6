"""Histograms that can be added: bins of one width, whose number is fixed before anything is counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BINS = 2000
"""Bins of a histogram."""
ROOM = 0.25
"""Share of the values' range by which the bins reach beyond it on each side."""


@dataclass(frozen=True, eq=False)
class Histogram:
    """How many values are in each of `BINS` bins.

    Attributes
    ----------
    part : str
        What the values are of.
    low : float
        Where the first bin begins, a multiple of the width.
    width : float
        Of every bin, a power of two, so that the edges are exact.
    below, above : int
        Values outside of the bins; infinite ones are above.
    counts : ndarray of int, shape (BINS,)

    Examples
    --------
    >>> h = Histogram.over("x", np.array([0.0, 1.0])).counted(np.array([0.25, 0.3, 9.0]))
    >>> h.width, int(h.counts.sum()), h.above
    (0.0009765625, 2, 1)
    >>> h.merge(h).quantile(0.25)
    (0.25, 0.2509765625)
    """

    part: str
    low: float
    width: float
    below: int
    above: int
    counts: Ints

    @classmethod
    def over(cls, part: str, values: Floats) -> Self:
        """An empty one with bins around some values."""
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
        span = (high - low) * (1 + 2 * ROOM) or max(abs(low), 1.0) * 1e-6
        # one bin is lost where the first edge is rounded down
        width = 2.0 ** np.ceil(np.log2(span / (BINS - 1)))
        middle = low / 2 + high / 2
        begin = (np.floor(middle / width) - BINS // 2) * width
        return cls(part, float(begin), float(width), 0, 0, np.zeros(BINS, dtype=np.int64))

    @property
    def edges(self) -> Floats:
        """Where bins begin and end, shape (BINS + 1,)."""
        return np.asarray(self.low + self.width * np.arange(BINS + 1), dtype=np.float64)

    @property
    def total(self) -> int:
        """How many values were counted."""
        return self.below + int(self.counts.sum()) + self.above

    def counted(self, values: Floats) -> Self:
        """With further values."""
        # bin k holds low + k width <= x < low + (k + 1) width; two more take what is outside
        place = np.clip(np.floor((values - self.low) / self.width), -1, BINS).astype(np.int64) + 1
        found = np.bincount(place, minlength=BINS + 2)
        return replace(
            self,
            below=self.below + int(found[0]),
            above=self.above + int(found[-1]),
            counts=self.counts + found[1:-1],
        )

    def merge(self, other: Histogram) -> Self:
        """Both together.

        Raises
        ------
        ProblemError
            If they are of different parts, or their bins differ.
        """
        for name in ("part", "low", "width"):
            mine, given = getattr(self, name), getattr(other, name)
            if mine != given:
                raise ProblemError(f"histogram: expected {name} {mine!r}, got {given!r}")
        below, above = self.below + other.below, self.above + other.above
        return replace(self, below=below, above=above, counts=self.counts + other.counts)

    def quantile(self, share: float) -> tuple[float, float]:
        """The edges between which the value lies that a share of all values does not exceed; infinite outside."""
        after = np.cumsum([self.below, *self.counts, self.above])
        k = int(np.searchsorted(after, max(1, np.ceil(share * after[-1]))))
        edges = [-np.inf, *self.edges.tolist(), np.inf]
        return edges[k], edges[k + 1]

    def as_data(self) -> dict[str, Any]:
        """As plain data: counts from the first to the last that is not zero."""
        some = np.flatnonzero(self.counts)
        first, last = (int(some[0]), int(some[-1])) if len(some) else (0, -1)
        counts = self.counts[first : last + 1].tolist()
        numbers = {"low": self.low, "width": self.width, "below": self.below, "above": self.above}
        return {"part": self.part, **numbers, "first": first, "counts": counts}

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Self:
        """What `as_data` gave."""
        counts = np.zeros(BINS, dtype=np.int64)
        counts[data["first"] : data["first"] + len(data["counts"])] = data["counts"]
        return cls(data["part"], data["low"], data["width"], data["below"], data["above"], counts)
