"""Orthonormal polynomials of distributions that are not uniform."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments._check import MAX_ORDER, finite_array, frozen, whole_number
from ensemble_ctrl.moments.distribution import Distribution
from ensemble_ctrl.moments.recurrence import Recurrence, gauss, roots, values

FloatArray = NDArray[np.float64]


class WeightedDistribution(Distribution):
    """A distribution whose polynomials are computed: a subclass gives their recurrence and their integrals."""

    @property
    def max_order(self) -> int:
        """Highest order of a basis of this distribution: 50, or less for a distribution of a few values."""
        # n different values determine polynomials up to degree n - 1 only
        return min(MAX_ORDER, cached_recurrence(self, MAX_ORDER).order)

    def basis(self, order: int) -> OrthonormalBasis:
        """Orthonormal polynomials of the distribution; see `Distribution.basis`."""
        return OrthonormalBasis(self, order)

    def rule(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Points and weights that integrate polynomials up to degree ``2 count - 1``; see `Distribution.rule`."""
        return _cached_rule(self, count)

    def points(self, count: int) -> tuple[FloatArray, FloatArray]:
        """What `rule` gives, made anew: the distribution's own Gauss rule with `count` points."""
        return gauss(cached_recurrence(self, count - 1), count)

    @abstractmethod
    def recurrence(self, order: int) -> Recurrence:
        """Coefficients up to `order`, or up to the highest order that the distribution's values determine."""

    @abstractmethod
    def partial_moments(self, recurrence: Recurrence, s: FloatArray) -> FloatArray:
        """Integrals over the distribution up to `s` of the distribution's polynomials, shape ``(*S, order + 1)``."""


@dataclass(frozen=True)
class OrthonormalBasis:
    r"""The first ``order + 1`` polynomials that are orthonormal under a distribution.

    .. math:: \int \phi_j \phi_k\, d\mu = \delta_{jk}, \qquad \mu = 2\, \text{distribution of } s \text{ on } [-1, 1]

    so :math:`\phi_0 = 1/\sqrt 2` and the mean is :math:`m_0/\sqrt 2`, as for `LegendreBasis`, which documents the
    methods.

    Parameters
    ----------
    distribution : WeightedDistribution
        How the parameter is spread.
    order : int
        Truncation order, 0 to ``distribution.max_order``.

    Raises
    ------
    ProblemError
        If `order` is not a whole number in that range.

    Examples
    --------
    >>> from ensemble_ctrl.moments import Samples
    >>> OrthonormalBasis(Samples([0.9, 1.0, 1.1]), order=2).nodes.round(4) + 0.0
    array([-1.,  0.,  1.])
    """

    distribution: WeightedDistribution
    order: int

    def __post_init__(self) -> None:
        order = whole_number("order", self.order, 0, MAX_ORDER)
        object.__setattr__(self, "order", order)
        most = self._recurrence.order
        if order > most:
            raise ProblemError(f"order: expected at most {most} for {self.distribution!r}, got {order}")

    @property
    def _recurrence(self) -> Recurrence:
        """Coefficients a, b and c."""
        return cached_recurrence(self.distribution, self.order)

    def evaluate(self, s: ArrayLike) -> FloatArray:
        """Values of the basis, shape ``(*S, order + 1)``."""
        return values(self._recurrence, finite_array("s", s))

    def recurrence(self) -> tuple[FloatArray, FloatArray]:
        """Coefficients a and c of the recurrence, each of shape (order + 1,), read-only."""
        return self._recurrence.a, self._recurrence.c

    @property
    def diagonal(self) -> FloatArray:
        """Coefficients b of the recurrence, shape (order + 1,), read-only; zero for a symmetric distribution."""
        return self._recurrence.b

    @property
    def nodes(self) -> FloatArray:
        """Gauss nodes in increasing order, shape (order + 1,), read-only."""
        return _cached_gauss(self)[0]

    @property
    def weights(self) -> FloatArray:
        """Gauss weights, which sum to 2, shape (order + 1,), read-only."""
        return _cached_gauss(self)[1]

    def rule(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Points and weights that integrate polynomials up to degree ``2 count - 1``; see `Distribution.rule`."""
        return self.distribution.rule(count)

    def roots(self, k: int) -> FloatArray:
        """Roots of phi_k in increasing order, shape (k,)."""
        return roots(self._recurrence, whole_number("k", k, 0, self.order))

    def partial_moments(self, s: FloatArray) -> FloatArray:
        """Integrals of the basis over the distribution up to `s`, shape ``(*S, order + 1)``; `s` may be infinite."""
        return self.distribution.partial_moments(self._recurrence, s)

    def signed_moments(self) -> tuple[FloatArray, FloatArray]:
        """Integrals of the positive and of the negative parts of the basis, each of shape (order + 1,)."""
        positive, negative = _cached_signed_moments(self)
        return positive, negative


@lru_cache(maxsize=256)
def cached_recurrence(distribution: WeightedDistribution, order: int) -> Recurrence:
    """The distribution's recurrence, made once: a lower order is the beginning of a higher one."""
    return (
        distribution.recurrence(order) if order >= MAX_ORDER else cached_recurrence(distribution, MAX_ORDER).upto(order)
    )


@lru_cache(maxsize=256)
def _cached_rule(distribution: WeightedDistribution, count: int) -> tuple[FloatArray, FloatArray]:
    """The distribution's points and weights, made once."""
    points, weights = distribution.points(count)
    return frozen(points), frozen(weights)


@lru_cache(maxsize=256)
def _cached_gauss(basis: OrthonormalBasis) -> tuple[FloatArray, FloatArray]:
    """The basis's Gauss rule, made once."""
    # Gauss rule of N + 1 points: exact for products phi_j phi_k, so nodes and moments are inverse
    nodes, weights = gauss(cached_recurrence(basis.distribution, basis.order), basis.order + 1)
    return frozen(nodes), frozen(weights)


@lru_cache(maxsize=256)
def _cached_signed_moments(basis: OrthonormalBasis) -> tuple[FloatArray, FloatArray]:
    """Differences of the partial moments between the roots, each of one sign."""
    # between neighbouring roots of phi_k its sign is constant: m+- are sums of differences of partial moments
    breaks = [np.concatenate([[-np.inf], basis.roots(k), [np.inf]]) for k in range(basis.order + 1)]
    ends = np.cumsum([len(part) for part in breaks])[:-1]
    parts = np.split(basis.partial_moments(np.concatenate(breaks)), ends)
    pieces = [np.diff(part[:, k]) for k, part in enumerate(parts)]
    positive = np.array([np.maximum(piece, 0.0).sum() for piece in pieces])
    negative = np.array([np.maximum(-piece, 0.0).sum() for piece in pieces])
    return frozen(positive), frozen(negative)
