"""The normal distribution, cut off at the ends of a range."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, hypot
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments._check import ends, finite_array, finite_number
from ensemble_ctrl.moments.basis import gauss_rule
from ensemble_ctrl.moments.lanczos import recurrence_of_points
from ensemble_ctrl.moments.orthonormal import WeightedDistribution
from ensemble_ctrl.moments.recurrence import Recurrence, values

FloatArray = NDArray[np.float64]

MOST_DEVIATIONS = 1000.0
"""Deviations that the mean may be outside of the range."""
NARROW = 1e-6
"""Least deviation, in half-widths of the range."""
SILENT = 745.0
"""The density is cut off where it has fallen by exp(SILENT), below any double."""
POINTS = 80
"""Gauss points on a panel, two deviations wide: enough for polynomials of degree 102 times the density."""


@dataclass(frozen=True)
class TruncatedNormal(WeightedDistribution):
    """A parameter with a normal distribution, truncated to a range.

    Parameters
    ----------
    lower, upper : float
        Ends of the range, in the parameter's own unit, finite, ``lower <= upper``.
    mean, deviation : float
        Mean and standard deviation of the normal distribution before it is cut off, in the parameter's unit. The mean
        may be outside of the range, by at most 1000 deviations; the deviation is above 0, and at least a millionth of
        the range's half-width.

    Raises
    ------
    ProblemError
        If a number is out of range or not finite.

    Notes
    -----
    Discretised Lanczos process (`ensemble_ctrl.moments.lanczos`): Gauss-Legendre panels two deviations wide, of 80
    points each, integrate the polynomials against the density to rounding.

    Examples
    --------
    >>> distribution = TruncatedNormal(0.9, 1.1, mean=1.0, deviation=0.03)
    >>> distribution.basis(2).nodes.round(4) + 0.0
    array([-0.5095,  0.    ,  0.5095])
    """

    lower: float
    upper: float
    mean: float
    deviation: float
    numbers: ClassVar[tuple[str, ...]] = ("mean", "deviation")

    def __post_init__(self) -> None:
        low, high = ends(self.lower, self.upper)
        mean, deviation = finite_number("mean", self.mean), finite_number("deviation", self.deviation)
        if deviation <= 0:
            raise ProblemError(f"deviation: expected a number above 0, got {deviation:g}")
        if deviation < NARROW * (high - low) / 2:
            raise ProblemError(
                f"deviation: expected at least a millionth of the range's half-width, got {deviation:g} for "
                f"[{low:g}, {high:g}]"
            )
        if not low - MOST_DEVIATIONS * deviation <= mean <= high + MOST_DEVIATIONS * deviation:
            raise ProblemError(
                f"mean: expected at most {MOST_DEVIATIONS:g} deviations outside of [{low:g}, {high:g}], got {mean:g}"
            )
        for name, value in zip(("lower", "upper", "mean", "deviation"), (low, high, mean, deviation), strict=True):
            object.__setattr__(self, name, value)

    def recurrence(self, order: int) -> Recurrence:
        """Coefficients up to `order`."""
        # discretised measure: polynomials of degree 2 order + 1 times the density (Gautschi 2004, section 2.2)
        s, weights = self._panels(self._edges(), max(POINTS, order + 41))
        return recurrence_of_points(s, weights, order)

    def partial_moments(self, recurrence: Recurrence, s: FloatArray) -> FloatArray:
        """Integrals of the polynomials up to `s`, panel by panel."""
        edges = self._edges()
        inside = np.clip(s, edges[0], edges[-1])
        # panels cut at every requested s; the partial moment is the sum of the panels before it
        cuts = np.unique(np.concatenate([edges, inside.ravel()]))
        points, weights = self._panels(cuts, POINTS)
        pieces = (weights[:, None] * values(recurrence, points)).reshape(len(cuts) - 1, POINTS, -1).sum(axis=1)
        sums = np.concatenate([np.zeros_like(pieces[:1]), np.cumsum(pieces, axis=0)]) * (2 / weights.sum())
        return np.asarray(sums[np.searchsorted(cuts, inside)])

    def _scaled(self) -> tuple[float, float]:
        """Mean and deviation on the scale of s; a range without width is filled evenly."""
        h = self.half_width
        return ((self.mean - self.center) / h, self.deviation / h) if h else (0.0, np.inf)

    def _edges(self) -> FloatArray:
        """Edges of panels over the part of [-1, 1] where the density is more than nothing."""
        mean, deviation = self._scaled()
        if deviation > 1e3 * (1 + abs(mean)):
            return np.array([-1.0, 1.0])
        peak = min(max(mean, -1.0), 1.0)
        outside = abs(mean - peak)
        # panels two deviations wide, or as wide as the density falls by e^2 where its peak is cut off
        width = 2 * deviation / max(1.0, outside / deviation)
        # the density falls by exp(-SILENT) at r from its peak: r^2 / 2 + r |mean - peak| = SILENT deviation^2
        reach = deviation * (2 * SILENT * deviation / (hypot(outside, np.sqrt(2 * SILENT) * deviation) + outside))
        low, high = max(-1.0, peak - reach), min(1.0, peak + reach)
        left = np.linspace(low, peak, 1 + ceil((peak - low) / width))
        right = np.linspace(peak, high, 1 + ceil((high - peak) / width))
        return np.unique(np.concatenate([left, [peak], right]))

    def _panels(self, edges: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
        """Points and weights of a composite Gauss rule, in increasing order; the weights up to a factor."""
        nodes, weights = gauss_rule(count)
        # Gauss-Legendre points of each panel, its half length as a factor of the weights
        half = np.diff(edges)[:, None] / 2
        s = (edges[:-1, None] + half + half * nodes).ravel()
        mean, deviation = self._scaled()
        peak = min(max(mean, -1.0), 1.0)
        away = (s - peak) / deviation
        # log density relative to its peak: no underflow before SILENT
        exponent = -away * (away / 2 + (peak - mean) / deviation)
        return s, (half * weights).ravel() * np.exp(exponent)

    def cdf(self, psi: ArrayLike) -> FloatArray:
        """Share of the fleet with a parameter of at most `psi`; see `Distribution.cdf`."""
        from scipy.special import log_ndtr

        at = finite_array("psi", psi)
        if not self.half_width:
            return np.where(at >= self.lower, 1.0, 0.0)
        low, high, flipped = self._tails()
        z = (np.clip(at, self.lower, self.upper) - self.mean) / self.deviation
        # (Phi(z) - Phi(low)) / (Phi(high) - Phi(low)), in logarithms
        below = np.exp(_log_difference(log_ndtr(-z if flipped else z), low) - _log_difference(high, low))
        return np.asarray(np.clip(1 - below if flipped else below, 0.0, 1.0))

    def _draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """`count` parameters, by the inverse of the cdf."""
        from scipy.special import ndtri_exp

        share = rng.random(count)
        if not self.half_width:
            return np.full(count, self.lower)
        low, high, flipped = self._tails()
        with np.errstate(divide="ignore"):
            # inverse cdf in logarithms: exact far out in a tail
            z = ndtri_exp(np.logaddexp(low + np.log1p(-share), high + np.log(share)))
        return np.clip(self.mean + self.deviation * (-z if flipped else z), self.lower, self.upper)

    def _tails(self) -> tuple[float, float, bool]:
        """Logarithms of the normal distribution's shares below the ends, seen from the side on which they are small."""
        from scipy.special import log_ndtr

        low, high = (self.lower - self.mean) / self.deviation, (self.upper - self.mean) / self.deviation
        flipped = low + high > 0
        if flipped:
            low, high = -high, -low
        return float(log_ndtr(low)), float(log_ndtr(high)), flipped


def _log_difference(larger: ArrayLike, smaller: ArrayLike) -> FloatArray:
    """Logarithm of ``exp(larger) - exp(smaller)``."""
    with np.errstate(divide="ignore"):
        return np.asarray(larger + np.log1p(-np.exp(np.asarray(smaller) - np.asarray(larger))))
