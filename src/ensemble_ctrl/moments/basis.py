r"""Orthonormal polynomials, the functions that moments are taken against; Legendre's, for the uniform distribution.

Their basis is orthonormal with respect to :math:`ds` on [-1, 1], which makes :math:`\phi_0 = 1/\sqrt 2`:

.. math:: \phi_k(s) = \sqrt{(2k + 1)/2}\; P_k(s), \qquad \int_{-1}^{1} \phi_j \phi_k\, ds = \delta_{jk}

The paper's printed numbers use this normalisation (its text says :math:`\phi_0 = 1`, see *Errata*).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.moments._check import MAX_ORDER, finite_array, frozen, whole_number
from ensemble_ctrl.moments.recurrence import Recurrence, values

FloatArray = NDArray[np.float64]


class Basis(Protocol):
    r"""Polynomials :math:`\phi_0, \ldots, \phi_N`, orthonormal under a measure :math:`\mu` on [-1, 1] of mass 2.

    `LegendreBasis` documents the methods; :math:`ds` there is :math:`d\mu` here.
    """

    @property
    def order(self) -> int:
        """Truncation order N; the basis has ``order + 1`` members."""

    @property
    def diagonal(self) -> FloatArray:
        """Coefficients b of the recurrence, shape (order + 1,); zero for a symmetric measure."""

    @property
    def nodes(self) -> FloatArray:
        """Gauss nodes in increasing order, shape (order + 1,)."""

    @property
    def weights(self) -> FloatArray:
        """Gauss weights, shape (order + 1,), which sum to 2."""

    def __hash__(self) -> int:
        """Bases are equal, and hash, by value."""

    def evaluate(self, s: ArrayLike) -> FloatArray:
        """Values of the basis, shape ``(*S, order + 1)``."""

    def recurrence(self) -> tuple[FloatArray, FloatArray]:
        """Coefficients a and c of the recurrence, each of shape (order + 1,)."""

    def roots(self, k: int) -> FloatArray:
        """Roots of phi_k, shape (k,)."""

    def rule(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Points and weights that integrate polynomials up to degree ``2 count - 1`` exactly."""

    def partial_moments(self, s: FloatArray) -> FloatArray:
        r"""Integrals of the basis over the measure up to `s`, shape ``(*S, order + 1)``; `s` may be infinite."""

    def signed_moments(self) -> tuple[FloatArray, FloatArray]:
        """Integrals of the positive and of the negative parts, each of shape (order + 1,)."""


def recurrence_of(basis: Basis) -> Recurrence:
    """All three coefficients of a basis."""
    a, c = basis.recurrence()
    return Recurrence(a, basis.diagonal, c)


@dataclass(frozen=True)
class LegendreBasis:
    r"""The first ``order + 1`` orthonormal Legendre polynomials on [-1, 1].

    .. math::
        \phi_0 = \tfrac{1}{\sqrt 2}, \quad \phi_1 = \sqrt{\tfrac32}\, s, \quad
        \phi_2 = \sqrt{\tfrac58}\,(3 s^2 - 1), \quad \phi_3 = \sqrt{\tfrac78}\,(5 s^3 - 3 s)

    Parameters
    ----------
    order : int
        Truncation order, 0 to 50; moments 0..order are kept.

    Raises
    ------
    ProblemError
        If `order` is not a whole number from 0 to 50.

    Notes
    -----
    Arias et al., One Ring to Rule Them All, ``eq:moment`` and ``eq:RecurrenceFinal``.

    Examples
    --------
    >>> LegendreBasis(order=2).evaluate(1.0).round(4)
    array([0.7071, 1.2247, 1.5811])
    """

    order: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "order", whole_number("order", self.order, 0, MAX_ORDER))

    def evaluate(self, s: ArrayLike) -> FloatArray:
        """Values of the basis, by the three-term recurrence.

        Parameters
        ----------
        s : array_like, shape S
            Scaled parameter, dimensionless; points outside [-1, 1] are extrapolated.

        Returns
        -------
        ndarray, shape (*S, order + 1)
            ``[..., k]`` is phi_k(s), dimensionless.

        Raises
        ------
        ProblemError
            If `s` is not made of finite numbers.

        Examples
        --------
        >>> LegendreBasis(order=1).evaluate([-1.0, 0.0]).round(4)
        array([[ 0.7071, -1.2247],
               [ 0.7071,  0.    ]])
        """
        return _evaluate(self.order, finite_array("s", s))

    def recurrence(self) -> tuple[FloatArray, FloatArray]:
        r"""Bonnet coefficients of the recurrence.

        .. math:: s\,\phi_k = a_k \phi_{k+1} + c_k \phi_{k-1}, \qquad c_k = a_{k-1} = k / \sqrt{4k^2 - 1}

        Returns
        -------
        a, c : ndarray, shape (order + 1,)
            Dimensionless, read-only; ``c[0]`` is 0.

        Notes
        -----
        Arias et al., One Ring to Rule Them All, ``eq:RecurrenceFinal``.

        Examples
        --------
        >>> a, c = LegendreBasis(order=2).recurrence()
        >>> a.round(4), c.round(4)
        (array([0.5774, 0.5164, 0.5071]), array([0.    , 0.5774, 0.5164]))
        """
        a, _, c = _recurrence(self.order)
        return a, c

    @property
    def diagonal(self) -> FloatArray:
        """The recurrence's coefficients of phi_k itself: zero, for the uniform distribution is symmetric.

        Returns
        -------
        ndarray, shape (order + 1,)
            Zeros, read-only.
        """
        return _recurrence(self.order).b

    @property
    def nodes(self) -> FloatArray:
        """Gauss nodes in increasing order: the roots of phi_{order+1}.

        Returns
        -------
        ndarray, shape (order + 1,)
            Scaled parameters in (-1, 1), dimensionless, read-only.

        Examples
        --------
        >>> LegendreBasis(order=2).nodes.round(4)
        array([-0.7746,  0.    ,  0.7746])
        """
        return gauss_rule(self.order + 1)[0]

    @property
    def weights(self) -> FloatArray:
        """Gauss weights, which sum to 2; exact for polynomials up to degree ``2 * order + 1``.

        Returns
        -------
        ndarray, shape (order + 1,)
            Positive, dimensionless, read-only.

        Examples
        --------
        >>> LegendreBasis(order=2).weights.round(4)
        array([0.5556, 0.8889, 0.5556])
        """
        return gauss_rule(self.order + 1)[1]

    def roots(self, k: int) -> FloatArray:
        """Roots of phi_k in increasing order, between which its sign alternates.

        Parameters
        ----------
        k : int
            Index of the polynomial, 0 to `order`.

        Returns
        -------
        ndarray, shape (k,)
            Points of (-1, 1), dimensionless, read-only; empty for k = 0.

        Raises
        ------
        ProblemError
            If `k` is not a whole number from 0 to `order`.

        Examples
        --------
        >>> LegendreBasis(order=4).roots(2).round(4)
        array([-0.5774,  0.5774])
        """
        return _roots(whole_number("k", k, 0, self.order))

    def rule(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Nodes and weights of the Gauss rule with `count` points, 1 or more, each of shape (count,)."""
        return gauss_rule(count)

    def partial_moments(self, s: FloatArray) -> FloatArray:
        r"""Integrals of the basis from -1 to `s`.

        Parameters
        ----------
        s : ndarray, shape S
            Scaled parameters; beyond [-1, 1], and infinite ones, count as the ends.

        Returns
        -------
        ndarray, shape (*S, order + 1)
            Dimensionless; zero at -1, and (sqrt 2, 0, 0, ...) at 1.
        """
        # int_{-1}^s phi_k, constant outside of [-1, 1]
        inside = np.clip(s, -1.0, 1.0)
        # antiderivatives from -1, where that of phi_0 = sqrt(1/2) is -sqrt(1/2)
        parts = [_antiderivative(k, inside) for k in range(self.order + 1)]
        parts[0] = parts[0] + np.sqrt(0.5)
        return np.stack(parts, axis=-1)

    def signed_moments(self) -> tuple[FloatArray, FloatArray]:
        r"""Integrals of the positive and the negative parts of the basis.

        .. math:: m_k^{\pm} = \int_{-1}^{1} \max\{\pm\phi_k(s), 0\}\, ds

        Returns
        -------
        positive, negative : ndarray, shape (order + 1,)
            Dimensionless; ``positive - negative`` is sqrt(2) for k = 0 and 0 after.

        Notes
        -----
        ``m+`` and ``m-`` of Arias et al., One Ring to Rule Them All, ``eq:polyhedron_moment``. Exact up to
        rounding: the antiderivative is differenced between roots.

        Examples
        --------
        >>> LegendreBasis(order=2).signed_moments()[0].round(4)
        array([1.4142, 0.6124, 0.6086])
        """
        pairs = np.array([_signed_moment(k) for k in range(self.order + 1)])
        return pairs[:, 0], pairs[:, 1]


@cache
def gauss_rule(count: int) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of the Gauss-Legendre rule with `count` points, read-only."""
    nodes, _ = np.polynomial.legendre.leggauss(count)
    # Christoffel numbers 1 / sum_k phi_k(s_i)^2, scaled to the sum of 2
    weights = 1 / np.square(_evaluate(count - 1, nodes)).sum(axis=-1)
    return frozen(nodes), frozen(weights * (2 / weights.sum()))


def _evaluate(order: int, s: FloatArray) -> FloatArray:
    """phi_0..phi_order at s, on a new last axis."""
    return values(_recurrence(order), s)


@cache
def _recurrence(order: int) -> Recurrence:
    """The coefficients a, b and c for k = 0..order, read-only."""
    k = np.arange(order + 2, dtype=np.float64)
    # s phi_k = c_{k+1} phi_{k+1} + c_k phi_{k-1}, c_k = k / sqrt(4 k^2 - 1)
    c = k / np.sqrt(np.abs(4 * k**2 - 1))
    return Recurrence.of(np.zeros(order + 1), c[1:].copy())


def _roots(k: int) -> FloatArray:
    """Roots of phi_k."""
    return gauss_rule(k)[0] if k else frozen(np.empty(0))


@cache
def _signed_moment(k: int) -> tuple[float, float]:
    """Integrals of max(phi_k, 0) and of max(-phi_k, 0)."""
    # between its roots phi_k has one sign: m+- are sums of differences of the antiderivative
    breaks = np.concatenate([[-1.0], _roots(k), [1.0]])
    pieces = np.diff(_antiderivative(k, breaks))
    return float(np.maximum(pieces, 0).sum()), float(np.maximum(-pieces, 0).sum())


def _antiderivative(k: int, s: FloatArray) -> FloatArray:
    """An antiderivative of phi_k: (P_{k+1} - P_{k-1}) / (2k+1) in orthonormal terms."""
    # (2 k + 1) P_k = P'_{k+1} - P'_{k-1}, integrated, in the normalisation of phi
    phi = _evaluate(k + 1, s)
    above = phi[..., k + 1] / np.sqrt((2 * k + 1) * (2 * k + 3))
    below = phi[..., k - 1] / np.sqrt((2 * k - 1) * (2 * k + 1)) if k else 0.0
    return np.asarray(above - below)
