"""Intervals with the intervals of their derivatives: bounds of the Jacobian of a right-hand side over boxes of states.

A `Gradient` stands for every smooth function whose value is in ``[low, high]`` and whose derivative by the k-th state
is in ``[low_by[k], high_by[k]]``. Every operation is rounded outwards. Many boxes are treated at once: values have the
shape (boxes,), derivatives (states, boxes).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.errors import NotSmooth
from ensemble_ctrl.certificate.general.basis import UNIT
from ensemble_ctrl.certificate.general.smooth import Smooth

Floats = NDArray[np.float64]
Pair = tuple[Floats, Floats]

LIBRARY = 16 * UNIT
"""Relative error of NumPy's elementary functions, with room to spare."""


@dataclass(eq=False)
class Gradient(Smooth):
    """An interval of values and one of derivatives by each state, for each of many boxes.

    Attributes
    ----------
    low, high : ndarray, shape (boxes,)
        Bounds of the value.
    low_by, high_by : ndarray, shape (states, boxes)
        Bounds of the derivatives.
    """

    low: Floats
    high: Floats
    low_by: Floats
    high_by: Floats

    @classmethod
    def of(cls, low: Floats, high: Floats, states: int, state: int | None = None) -> Gradient:
        """A parameter, a command or a number; or the given state itself."""
        by = np.zeros((states, len(low)))
        if state is not None:
            by[state] = 1.0
        return cls(low, high, by, by)

    def _uses(self, piece: int) -> tuple[int, ...]:
        """The states whose derivative is not zero."""
        # sup |d f / d x_k| > 0
        by = np.maximum(np.abs(self.low_by[:, piece]), np.abs(self.high_by[:, piece]))
        return tuple(np.flatnonzero(by > 0).tolist())

    def _constant(self, value: float) -> Gradient:
        """A number."""
        return self._lifted(value)

    def _lifted(self, other: Any) -> Gradient:
        """A number, or one for each box, as an interval of width zero."""
        if isinstance(other, Gradient):
            return other
        values = np.array(np.broadcast_to(np.asarray(other, dtype=float), self.low.shape))
        return Gradient.of(values, values, len(self.low_by))

    def __neg__(self) -> Gradient:
        return Gradient(-self.high, -self.low, -self.high_by, -self.low_by)

    def __abs__(self) -> Gradient:
        known = (self.low > 0) | (self.high < 0)
        self._require(known, "the right-hand side takes |.| of what may vanish", NotSmooth)
        positive, minus = self.low > 0, -self
        pick = [np.where(positive, a, b) for a, b in zip(vars(self).values(), vars(minus).values(), strict=True)]
        return Gradient(*pick)

    def __add__(self, other: Any) -> Gradient:
        o = self._lifted(other)
        pairs = zip(vars(self).values(), vars(o).values(), strict=True)
        low, high, low_by, high_by = (a + b for a, b in pairs)
        return Gradient(down(low), up(high), down(low_by), up(high_by))

    def __mul__(self, other: Any) -> Gradient:
        o = self._lifted(other)
        # (f g)' = f' g + f g', on intervals
        value = times((self.low, self.high), (o.low, o.high))
        mine = times((self.low_by, self.high_by), (o.low, o.high))
        theirs = times((o.low_by, o.high_by), (self.low, self.high))
        return Gradient(*value, down(mine[0] + theirs[0]), up(mine[1] + theirs[1]))

    def __truediv__(self, other: Any) -> Gradient:
        return self * self._lifted(other).reciprocal()

    def _whole_power(self, power: int) -> Gradient:
        """Even powers are not negative."""
        found: Gradient = super()._whole_power(power)
        return Gradient(np.maximum(found.low, 0.0), found.high, found.low_by, found.high_by) if not power % 2 else found

    def _of(self, value: Pair, slope: Pair) -> Gradient:
        """The chain rule, from the bounds of a function and of its derivative on this interval."""
        return Gradient(*value, *times((self.low_by, self.high_by), slope))

    def reciprocal(self) -> Gradient:
        """``1 / x``."""
        self._require((self.low > 0) | (self.high < 0), "the right-hand side divides by something that may vanish")
        # (1 / x)' = -1 / x^2
        value = down(1.0 / self.high), up(1.0 / self.low)
        square = times(value, value)
        return self._of(value, (-square[1], -np.maximum(square[0], 0.0)))

    def sqrt(self) -> Gradient:
        """Square root."""
        self._require(self.low > 0, "the right-hand side takes a square root of something that may not be positive")
        # sqrt' = 1 / (2 sqrt)
        value = _monotone(np.sqrt, self.low, self.high)
        return self._of(value, (down(0.5 / value[1]), up(0.5 / value[0])))

    def exp(self) -> Gradient:
        """Exponential."""
        with np.errstate(over="ignore"):
            value = _monotone(np.exp, self.low, self.high)
        return self._of(value, value)

    def log(self) -> Gradient:
        """Logarithm."""
        self._require(self.low > 0, "the right-hand side takes a logarithm of something that may not be positive")
        return self._of(_monotone(np.log, self.low, self.high), (down(1.0 / self.high), up(1.0 / self.low)))

    def arctan(self) -> Gradient:
        """Arc tangent, with the derivative ``1 / (1 + x^2)``."""
        # range of x^2 on the interval, from zero on where it holds zero
        least = np.where((self.low <= 0) & (self.high >= 0), 0.0, np.minimum(np.abs(self.low), np.abs(self.high)))
        most = np.maximum(np.abs(self.low), np.abs(self.high))
        slope = 1.0 / (1.0 + most**2) * (1 - LIBRARY), 1.0 / (1.0 + least**2) * (1 + LIBRARY)
        return self._of(_monotone(np.arctan, self.low, self.high), slope)

    def tanh(self) -> Gradient:
        """Hyperbolic tangent, with the derivative ``1 - tanh^2``."""
        low, high = _monotone(np.tanh, self.low, self.high)
        # range of tanh^2, from zero on where the interval holds zero
        squares = times((low, high), (low, high))
        least = np.where((low <= 0) & (high >= 0), 0.0, np.minimum(np.abs(low), np.abs(high)) ** 2 * (1 - LIBRARY))
        return self._of((low, high), (np.maximum(down(1.0 - squares[1]), 0.0), up(1.0 - least)))

    def sin(self) -> Gradient:
        """Sine."""
        return self._of(sine(self.low, self.high), sine(self.low, self.high, quarter=1))

    def cos(self) -> Gradient:
        """Cosine."""
        low, high = sine(self.low, self.high)
        return self._of(sine(self.low, self.high, quarter=1), (-high, -low))


def down(x: Floats) -> Floats:
    """The next number below."""
    return np.asarray(np.nextafter(x, -np.inf))


def up(x: Floats) -> Floats:
    """The next number above."""
    return np.asarray(np.nextafter(x, np.inf))


def times(a: Pair, b: Pair) -> Pair:
    """Bounds of the product of two intervals."""
    # a bilinear function is extreme at the corners
    products = [x * y for x in a for y in b]
    return down(np.minimum.reduce(products)), up(np.maximum.reduce(products))


def _monotone(function: Callable[[Floats], Floats], low: Floats, high: Floats) -> Pair:
    """Bounds of a function that rises, with the library's error."""
    a, b = function(low), function(high)
    return down(a - LIBRARY * np.abs(a)), up(b + LIBRARY * np.abs(b))


def sine(low: Floats, high: Floats, quarter: int = 0) -> Pair:
    """Bounds of ``sin(x + quarter pi / 2)`` on intervals.

    The extrema at ``(4 k + 1 - quarter) pi / 2`` and ``(4 k + 3 - quarter) pi / 2`` are looked for in the interval
    widened by more than the rounding of their places.
    """
    function = np.cos if quarter else np.sin
    wide = LIBRARY * (1 + np.abs(low) + np.abs(high))
    a, b = function(low), function(high)

    def holds(place: float) -> NDArray[np.bool_]:
        """Whether the widened interval holds ``place pi / 2`` plus whole turns; true for what is not finite."""
        first = np.ceil((low - wide) / (2 * np.pi) - place / 4 - LIBRARY * (1 + np.abs(low)))
        last = np.floor((high + wide) / (2 * np.pi) - place / 4 + LIBRARY * (1 + np.abs(high)))
        return np.asarray(~(last < first))

    # -1 and 1 where an extremum is in the interval, else the values at its ends
    least = np.where(holds(3.0 - quarter), -1.0, np.minimum(a, b) - LIBRARY)
    most = np.where(holds(1.0 - quarter), 1.0, np.maximum(a, b) + LIBRARY)
    return np.maximum(least, -1.0), np.minimum(most, 1.0)
