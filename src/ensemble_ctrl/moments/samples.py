"""The distribution of measured values."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments._check import finite_array, frozen
from ensemble_ctrl.moments.lanczos import CHUNK, condensed, gauss_of_points, recurrence_of_points, usable
from ensemble_ctrl.moments.orthonormal import WeightedDistribution
from ensemble_ctrl.moments.recurrence import Recurrence, values

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Samples(WeightedDistribution):
    """A parameter that is equally often each of some measured values.

    The fleet is the one that was measured: its range goes from the smallest to the largest value.

    Parameters
    ----------
    values : array_like, shape (n,)
        Measurements in the parameter's own unit, one or more, in any order, repeated where they came repeatedly. One
        value, or equal ones, describe a fleet of equal robots, as an `Interval` without width does.

    Attributes
    ----------
    values : ndarray, shape (n,)
        The same in increasing order, read-only.

    Raises
    ------
    ProblemError
        If there are none, or they are not finite numbers in one row.

    Notes
    -----
    Polynomials up to one order less than there are different values exist; they are orthonormal in sums over the
    values. Lanczos process (`ensemble_ctrl.moments.lanczos`). A value far from all others makes those of high order so
    steep that doubles can't hold them; `max_order` stops before.

    Examples
    --------
    >>> distribution = Samples([1.0, 0.95, 1.05, 1.0])
    >>> distribution, distribution.max_order
    (Samples(4 values, 3 different, 0.95 to 1.05), 2)
    """

    values: FloatArray
    lower: float
    upper: float

    def __init__(self, values: ArrayLike) -> None:
        given = finite_array("values", _numbers(values))
        if given.ndim != 1 or not given.size:
            raise ProblemError(f"values: expected one row of one or more numbers, got shape {given.shape}")
        ordered = frozen(np.sort(given) + 0.0)
        for name, value in (("values", ordered), ("lower", float(ordered[0])), ("upper", float(ordered[-1]))):
            object.__setattr__(self, name, value)

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, Samples) and np.array_equal(self.values, other.values))

    def __hash__(self) -> int:
        return hash((Samples, len(self.values), self.lower, self.upper, self._sum))

    def __repr__(self) -> str:
        n, different = len(self.values), len(self._points[0])
        return f"Samples({n} value{'s' * (n != 1)}, {different} different, {self.lower:g} to {self.upper:g})"

    @cached_property
    def _sum(self) -> float:
        """Sum of the values, which differs for most samples."""
        return float(self.values.sum())

    @cached_property
    def _points(self) -> tuple[FloatArray, FloatArray]:
        """The different values on the scale of s, and their weights, which sum to 2."""
        # equal samples as one point; weights sum to 2
        points, counts = np.unique(np.clip(self.to_scaled(self.values), -1.0, 1.0), return_counts=True)
        return points, np.asarray(counts * (2.0 / len(self.values)), dtype=np.float64)

    @property
    def measured(self) -> FloatArray:
        """The values; see `Distribution.measured`."""
        return self.values

    def recurrence(self, order: int) -> Recurrence:
        """Coefficients up to `order`, or up to the highest order that the values determine."""
        # Lanczos process on condensed points, kept as far as it is orthonormal on all of them
        points = condensed(*self._points, order + 2)
        return usable(recurrence_of_points(*points, order), *self._points)

    def points(self, count: int) -> tuple[FloatArray, FloatArray]:
        """The Gauss rule with `count` points, or the values themselves if there are no more."""
        if len(self._points[0]) <= count:
            return self._points
        return gauss_of_points(*condensed(*self._points, count), count)

    def partial_moments(self, recurrence: Recurrence, s: FloatArray) -> FloatArray:
        """Sums of the polynomials over the values up to `s`."""
        points, weights = self._points
        sums = np.zeros((1, recurrence.order + 1))
        # partial sums of w_i phi(s_i) up to each s, cut where some s ends, by chunks
        ends = np.searchsorted(points, np.asarray(s).ravel(), side="right")
        cuts, at = np.unique(np.concatenate([[0], ends]), return_inverse=True)
        for first, last in pairwise(cuts):
            piece = np.zeros(recurrence.order + 1)
            for i in range(first, last, CHUNK):
                part = slice(i, min(i + CHUNK, last))
                piece += weights[part] @ values(recurrence, points[part])
            sums = np.concatenate([sums, sums[-1:] + piece])
        return sums[at[1:]].reshape(*np.shape(s), recurrence.order + 1)

    def cdf(self, psi: ArrayLike) -> FloatArray:
        """Share of the values that are at most `psi`; see `Distribution.cdf`."""
        below = np.searchsorted(self.values, finite_array("psi", psi), side="right")
        return np.asarray(below / len(self.values))

    def _draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """`count` of the values, each as likely as any other."""
        return np.asarray(self.values[rng.integers(len(self.values), size=count)])


def _numbers(values: ArrayLike) -> ArrayLike:
    """The same, unless it is text, or true and false, which NumPy would read as numbers."""
    try:
        kind = str(np.asarray(values).dtype.kind)
    except ValueError:
        return values
    if kind in "USb":
        raise ProblemError(f"values: expected an array of numbers, got {'text' if kind != 'b' else 'true or false'}")
    return values
