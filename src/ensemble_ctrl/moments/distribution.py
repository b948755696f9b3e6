r"""What every distribution of the parameter can do.

It says how the parameter is spread over the fleet. Its basis lives on :math:`s \in [-1, 1]`, where the
distribution is a measure of total mass 2, so that :math:`\phi_0 = 1/\sqrt 2` and the mean is :math:`m_0/\sqrt 2`
whatever the distribution.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.moments._check import MAX_ORDER, finite_array, whole_number
from ensemble_ctrl.moments.basis import Basis

FloatArray = NDArray[np.float64]


class Distribution(ABC):
    r"""How the parameter is spread over the fleet; equal and hashable by value.

    The physical parameter is :math:`\psi = c + h s` with the centre c and the half-width h of its range.

    Attributes
    ----------
    lower, upper : float
        Ends of the range, in the parameter's own unit, ``lower <= upper``; no member is outside.
    """

    lower: float
    upper: float
    numbers: ClassVar[tuple[str, ...]] = ()
    """Attributes that give its shape, in the order in which the constructor takes them after `lower` and `upper`."""
    uniform: ClassVar[bool] = False
    """Whether equal parts of the range have equal shares of the fleet."""

    @property
    def measured(self) -> FloatArray | None:
        """The values of the members in increasing order, each as often as the others, where these were measured."""
        return None

    def over(self, lower: float, upper: float) -> Distribution:
        """The same shape over another range."""
        make: Callable[..., Distribution] = type(self)
        return make(lower, upper, *(getattr(self, name) for name in self.numbers))

    @property
    def center(self) -> float:
        """Middle of the range, in the parameter's unit."""
        return 0.5 * self.lower + 0.5 * self.upper

    @property
    def half_width(self) -> float:
        """Half the length of the range, in the parameter's unit, at least 0."""
        return 0.5 * self.upper - 0.5 * self.lower

    def to_parameter(self, s: ArrayLike) -> FloatArray:
        """The physical parameter at scaled points.

        Parameters
        ----------
        s : array_like
            Scaled points, dimensionless, [-1, 1] for members of the ensemble.

        Returns
        -------
        ndarray, shape of `s`
            Parameter psi, in its own unit.

        Raises
        ------
        ProblemError
            If `s` is not made of finite numbers.
        """
        return np.asarray(self.center + self.half_width * finite_array("s", s))

    def to_scaled(self, psi: ArrayLike) -> FloatArray:
        """The scaled point of a physical parameter, the inverse of `to_parameter`.

        Parameters
        ----------
        psi : array_like
            Parameter, in its own unit.

        Returns
        -------
        ndarray, shape of `psi`
            Scaled points, dimensionless; 0 everywhere when the range has no width.

        Raises
        ------
        ProblemError
            If `psi` is not made of finite numbers.

        Examples
        --------
        >>> from ensemble_ctrl.moments import Interval
        >>> Interval(2.0, 6.0).to_scaled([2.0, 5.0])
        array([-1. ,  0.5])
        """
        offset = finite_array("psi", psi) - self.center
        return np.asarray(offset / self.half_width if self.half_width else np.zeros_like(offset))

    @property
    def max_order(self) -> int:
        """Highest order of a basis of this distribution: 50, or less for a distribution of a few values."""
        return MAX_ORDER

    @abstractmethod
    def basis(self, order: int) -> Basis:
        """Orthonormal polynomials of the distribution.

        Parameters
        ----------
        order : int
            Truncation order, 0 to `max_order`.

        Raises
        ------
        ProblemError
            If `order` is not a whole number from 0 to `max_order`.
        """

    @abstractmethod
    def rule(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Points and weights that integrate polynomials over the distribution.

        Parameters
        ----------
        count : int
            Polynomials up to degree ``2 count - 1`` are integrated exactly, up to rounding.

        Returns
        -------
        s, weights : ndarray, shape (points,)
            Scaled points in [-1, 1], and positive weights, which sum to 2.
        """

    @abstractmethod
    def cdf(self, psi: ArrayLike) -> FloatArray:
        """Share of the fleet with a parameter of at most `psi`.

        Parameters
        ----------
        psi : array_like
            Parameters, in their own unit.

        Returns
        -------
        ndarray, shape of `psi`
            Shares, 0 to 1.

        Raises
        ------
        ProblemError
            If `psi` is not made of finite numbers.
        """

    def quantile(self, share: ArrayLike) -> FloatArray:
        """The smallest parameter that at least a share of the fleet does not exceed, the inverse of `cdf`.

        Parameters
        ----------
        share : array_like
            0 to 1.

        Returns
        -------
        ndarray, shape of `share`
            Parameters in [lower, upper], right to a few roundings of the range, never too small.

        Raises
        ------
        ProblemError
            If `share` is not made of finite numbers.

        Examples
        --------
        >>> from ensemble_ctrl.moments import Interval, Samples
        >>> Interval(2.0, 6.0).quantile([0.25, 1.0]), Samples([1.0, 2.0, 3.0, 4.0]).quantile(0.5)
        (array([3., 6.]), array(2.))
        """
        wanted = finite_array("share", share)
        low, high = np.full(wanted.shape, self.lower), np.full(wanted.shape, self.upper)
        high = np.where(self.cdf(low) >= wanted, low, high)
        # bisection with cdf(low) < share <= cdf(high); 60 halvings reach rounding
        for _ in range(60):
            middle = low / 2 + high / 2
            enough = self.cdf(middle) >= wanted
            low, high = np.where(enough, low, middle), np.where(enough, middle, high)
        return high

    def sample(self, n: int, seed: int | np.random.Generator) -> FloatArray:
        """Parameters of `n` robots drawn at random.

        Parameters
        ----------
        n : int
            Number of draws, at least 0.
        seed : int or numpy.random.Generator
            An integer gives the same draws every time; a generator continues its stream.

        Returns
        -------
        ndarray, shape (n,)
            Parameters psi in [lower, upper], in their own unit.

        Raises
        ------
        ProblemError
            If `n` is not a whole number, or `seed` is neither a whole number from 0 nor a generator.

        Examples
        --------
        >>> from ensemble_ctrl.moments import Interval
        >>> Interval(1.0, 1.0).sample(3, seed=0)
        array([1., 1., 1.])
        """
        count = whole_number("n", n, 0, 10**9)
        if not isinstance(seed, np.random.Generator):
            seed = np.random.default_rng(whole_number("seed", seed, 0, 2**64 - 1))
        return self._draw(count, seed)

    @abstractmethod
    def _draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """`count` parameters."""
