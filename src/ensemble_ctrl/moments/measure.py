"""The uniform distribution, the paper's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.moments._check import ends, finite_array
from ensemble_ctrl.moments.basis import LegendreBasis, gauss_rule
from ensemble_ctrl.moments.distribution import Distribution

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Interval(Distribution):
    r"""A parameter spread uniformly over a range.

    The basis lives on :math:`s \in [-1, 1]`; the physical parameter is :math:`\psi = c + h s`.

    Parameters
    ----------
    lower, upper : float
        Ends of the range, in the parameter's own unit, finite, ``lower <= upper``. Equal ends describe a
        fleet of equal robots.

    Raises
    ------
    ProblemError
        If an end is not finite, or the ends are in the wrong order.

    Notes
    -----
    The paper rescales its parameter to [-1, 1] (Arias et al., One Ring to Rule Them All,
    ``eq:unicycle_bilinear``); the centre, which a range such as [0.9, 1.1] needs, is not in its text (see
    *Errata*).

    Examples
    --------
    >>> speed = Interval(0.9, 1.1)
    >>> speed.to_parameter([-1.0, 0.0, 1.0]).round(4)
    array([0.9, 1. , 1.1])
    """

    lower: float
    upper: float
    uniform: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for name, value in zip(("lower", "upper"), ends(self.lower, self.upper), strict=True):
            object.__setattr__(self, name, value)

    def basis(self, order: int) -> LegendreBasis:
        """Orthonormal Legendre polynomials; see `Distribution.basis`."""
        return LegendreBasis(order)

    def rule(self, count: int) -> tuple[FloatArray, FloatArray]:
        """The Gauss-Legendre rule with `count` points; see `Distribution.rule`."""
        return gauss_rule(count)

    def cdf(self, psi: ArrayLike) -> FloatArray:
        """Share of the fleet with a parameter of at most `psi`; see `Distribution.cdf`."""
        values = finite_array("psi", psi)
        if not self.half_width:
            return np.where(values >= self.lower, 1.0, 0.0)
        return np.asarray((np.clip(self.to_scaled(values), -1.0, 1.0) + 1.0) / 2.0)

    def _draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """`count` parameters."""
        return rng.uniform(self.lower, self.upper, count)
