"""The Beta distribution."""

from __future__ import annotations

from dataclasses import dataclass
from math import lgamma, log
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.moments._check import ends, finite_array, number_between
from ensemble_ctrl.moments.orthonormal import WeightedDistribution
from ensemble_ctrl.moments.recurrence import Recurrence, slopes

FloatArray = NDArray[np.float64]

SHAPES = 1e-3, 1e6
"""Least and largest shape."""


@dataclass(frozen=True)
class Beta(WeightedDistribution):
    r"""A parameter with a Beta distribution over a range.

    Its density at the share t of the way from `lower` to `upper` is proportional to
    :math:`t^{a-1} (1-t)^{b-1}`: uniform for a = b = 1, a bump for larger shapes, a bath-tub for smaller ones.

    Parameters
    ----------
    lower, upper : float
        Ends of the range, in the parameter's own unit, finite, ``lower <= upper``.
    a, b : float
        Shapes at the lower and at the upper end, 0.001 to 1e6, dimensionless. The mean is at the share a / (a + b).

    Raises
    ------
    ProblemError
        If a number is out of range or not finite.

    Notes
    -----
    The polynomials are Jacobi's, whose recurrence is known in closed form (Gautschi, Orthogonal Polynomials (2004),
    table 1.1).

    Examples
    --------
    >>> distribution = Beta(0.9, 1.1, a=2, b=5)
    >>> distribution.basis(1).diagonal.round(4)
    array([-0.4286, -0.2381])
    """

    lower: float
    upper: float
    a: float
    b: float
    numbers: ClassVar[tuple[str, ...]] = ("a", "b")

    def __post_init__(self) -> None:
        low, high = ends(self.lower, self.upper)
        shapes = {name: number_between(name, getattr(self, name), *SHAPES) for name in ("a", "b")}
        for name, value in ({"lower": low, "upper": high} | shapes).items():
            object.__setattr__(self, name, value)

    def recurrence(self, order: int) -> Recurrence:
        """Jacobi's coefficients up to `order`."""
        # Jacobi recurrence for (1 - s)^(b-1) (1 + s)^(a-1) (Gautschi 2004, table 1.1)
        k = np.arange(1.0, order + 2)
        high, low = self.b - 1, self.a - 1
        twice = 2 * k + low + high
        diagonal = np.empty(order + 2)
        diagonal[0] = (low - high) / (self.a + self.b)
        diagonal[1:] = (low - high) * (low + high) / (twice * (twice + 2))
        # for k = 1 the factors k + low + high and twice - 1 cancel, and may both be zero
        ratio = np.concatenate([[1.0], (k[1:] + low + high) / (twice[1:] - 1)])
        square = 4 * k * (k + high) * (k + low) * ratio / (twice**2 * (twice + 1))
        return Recurrence.of(diagonal[:-1], np.sqrt(square))

    def partial_moments(self, recurrence: Recurrence, s: FloatArray) -> FloatArray:
        r"""Integrals of the polynomials up to `s`, from :math:`((1-s^2) w \phi_k')' = -k (k + a + b - 1) w \phi_k`."""
        share = (1 + np.clip(s, -1.0, 1.0)) / 2
        k = np.arange(1, recurrence.order + 1)
        edge = self._edge(share)[..., None]
        # for k >= 1: int_{-1}^s w phi_k = -(1 - s^2) w phi_k' / (k (k + a + b - 1)); for k = 0 the cdf
        later = -edge * slopes(recurrence, 2 * share - 1)[..., 1:] / (k * (k + self.a + self.b - 1))
        return np.concatenate([np.sqrt(2.0) * self._share(share)[..., None], later], axis=-1)

    def _edge(self, share: FloatArray) -> FloatArray:
        """``(1 - s^2) w(s)`` for the density w of mass 2."""
        # 4 q^a (1 - q)^b / B(a, b) for q = (1 + s) / 2, in logarithms
        scale = log(4.0) + lgamma(self.a + self.b) - lgamma(self.a) - lgamma(self.b)
        with np.errstate(divide="ignore"):
            return np.asarray(np.exp(scale + self.a * np.log(share) + self.b * np.log1p(-share)))

    def _share(self, share: FloatArray) -> FloatArray:
        """Share of the fleet below a share of the range."""
        from scipy.special import betainc

        return np.asarray(betainc(self.a, self.b, share))

    def cdf(self, psi: ArrayLike) -> FloatArray:
        """Share of the fleet with a parameter of at most `psi`; see `Distribution.cdf`."""
        values = finite_array("psi", psi)
        if not self.half_width:
            return np.where(values >= self.lower, 1.0, 0.0)
        return self._share((1 + np.clip(self.to_scaled(values), -1.0, 1.0)) / 2)

    def _draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """`count` parameters."""
        # s = 2 q - 1 for q with the Beta distribution on [0, 1]
        share = rng.beta(self.a, self.b, count)
        return np.clip(self.to_parameter(2 * share - 1), self.lower, self.upper)
