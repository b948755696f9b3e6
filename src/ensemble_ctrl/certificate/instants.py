"""Exact time: windows and grid times as fractions, so that no instant is taken for one near it.

A time given in seconds means the shortest decimal that reads back as the same number, which is what a user wrote:
``0.3`` is three steps of a tenth.  Grid times are exact multiples of ``duration / steps``.  Only the length and the
beginning of a piece of time become floating-point numbers, each rounded once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.values import exact

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Mesh:
    """The time of a plan in pieces, none of which crosses a grid time.

    Attributes
    ----------
    owner : ndarray of int, shape (pieces,)
        The step of the controls that each piece is of; one more than the last after the end, where robots stand.
    begin, length : ndarray, shape (pieces,)
        Seconds.
    """

    owner: Ints
    begin: Floats
    length: Floats

    @classmethod
    def of(cls, duration: float, steps: int, times: Sequence[int] | None = None, per_step: int = 1) -> Mesh:
        """The pieces between `times`, in ticks of which a step has `per_step`; by default whole steps.

        All grid times are among `times`, which are in order.
        """
        at = range(steps + 1) if times is None else times
        # a tick is the fraction T / (S per_step); begin and length of each piece are rounded once
        tick = exact(duration) / (steps * per_step)
        up, down = tick.numerator, tick.denominator
        owner = np.array([min(time // per_step, steps) for time in at[:-1]], dtype=np.int64)
        begin = np.array([time * up / down for time in at[:-1]])
        length = np.array([(b - a) * up / down for a, b in pairwise(at)])
        return cls(owner, begin, length)


@dataclass(frozen=True, eq=False)
class Spans:
    """Pieces of steps: from one share of a step to another, 0 to 1.

    Attributes
    ----------
    step : ndarray of int, shape (spans,)
    begin, end : ndarray, shape (spans,)
        Equal where only an instant is meant.
    """

    step: Ints
    begin: Floats
    end: Floats

    @classmethod
    def whole(cls, steps: Ints) -> Spans:
        """Whole steps."""
        return cls(steps, np.zeros(len(steps)), np.ones(len(steps)))

    @classmethod
    def of(cls, begin: float, end: float, duration: float, steps: int) -> Spans:
        """What the window from `begin` to `end` holds of equal steps; after the end robots stand.

        Notes
        -----
        *Guarantee*: exactly the instants of the window, but for one rounding of the first and the last share.
        """
        # ends of the window in steps, as fractions; whole steps between, shares at the first and the last
        step = exact(duration) / steps
        low, high = (min(exact(time) / step, Fraction(steps)) for time in (begin, end))
        first = min(floor(low), steps - 1)
        last = max(first, ceil(high) - 1)
        spans = cls.whole(np.arange(first, last + 1))
        spans.begin[0], spans.end[-1] = float(low - first), float(high - last)
        return spans
