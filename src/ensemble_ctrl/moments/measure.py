"""The law of the parameter that varies between robots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.errors import ProblemError
from ensemble_ctrl.moments._check import finite_array, finite_number, whole_number

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Interval:
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "lower", finite_number("lower", self.lower))
        object.__setattr__(self, "upper", finite_number("upper", self.upper))
        if self.lower > self.upper:
            raise ProblemError(f"upper: expected at least lower = {self.lower:g}, got {self.upper:g}")

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
        >>> Interval(2.0, 6.0).to_scaled([2.0, 5.0])
        array([-1. ,  0.5])
        """
        offset = finite_array("psi", psi) - self.center
        return np.asarray(offset / self.half_width if self.half_width else np.zeros_like(offset))

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
        >>> Interval(1.0, 1.0).sample(3, seed=0)
        array([1., 1., 1.])
        """
        count = whole_number("n", n, 0, 10**9)
        if not isinstance(seed, np.random.Generator):
            seed = np.random.default_rng(whole_number("seed", seed, 0, 2**64 - 1))
        return seed.uniform(self.lower, self.upper, count)
