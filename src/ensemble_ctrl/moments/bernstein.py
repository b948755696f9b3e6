r"""Bernstein coefficients of a state over the ensemble, or over a part of it.

On [lower, upper], with :math:`t = (s - lower) / (upper - lower)`, a polynomial of degree d is

.. math:: x(s) = \sum_{i=0}^{d} b_i \binom{d}{i} t^i (1 - t)^{d-i}

The weights of the :math:`b_i` are non-negative and sum to one, so all states of that part of the ensemble lie
in the convex hull of the coefficients; the first and the last coefficient are the states at its ends.
"""

from __future__ import annotations

from functools import cache, lru_cache
from math import comb

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments._check import MAX_ORDER, finite_number, frozen, whole_number
from ensemble_ctrl.moments.basis import Basis, LegendreBasis, recurrence_of
from ensemble_ctrl.moments.measure import Interval
from ensemble_ctrl.moments.operators import affine_multiplication_matrix
from ensemble_ctrl.moments.recurrence import three_term
from ensemble_ctrl.moments.transform import change_of_basis, nodes_to_moments

FloatArray = NDArray[np.float64]


def moments_to_bernstein(
    basis: Basis, lower: float = -1.0, upper: float = 1.0, degree: int | None = None
) -> FloatArray:
    """Matrix from moments to Bernstein coefficients on [lower, upper].

    Parameters
    ----------
    basis : Basis
        The basis that moments are taken against.
    lower, upper : float, optional
        The part of the ensemble, in scaled parameters: ``-1 <= lower <= upper <= 1``. All of it by default.
    degree : int, optional
        Degree of the coefficients, 0 to 50; by default the order. A lower degree keeps the first
        ``degree + 1`` moments only; a higher one describes the same polynomial with a tighter hull.

    Returns
    -------
    ndarray, shape (degree + 1, order + 1)
        Dimensionless, read-only; columns beyond `degree` are zero.

    Raises
    ------
    ProblemError
        If the range is not inside [-1, 1] or `degree` is out of range.

    Notes
    -----
    Farouki, Legendre-Bernstein basis transformations, J. Comput. Appl. Math. 119 (2000) 145-160: whole-number
    binomial sums, rounded once. A part of the range is first expanded in its own Legendre polynomials.

    **Guarantee**: the convex hull of the coefficients contains, up to rounding, the truncated state for every
    parameter of the range. Sufficient, not necessary; with ``degree < order`` the dropped moments have to be
    bounded apart.

    Examples
    --------
    >>> moments_to_bernstein(LegendreBasis(order=1)).round(4)
    array([[ 0.7071, -1.2247],
           [ 0.7071,  1.2247]])
    """
    part = _checked_part(lower, upper)
    return _moments_to_bernstein(basis, part, _checked_degree(basis, degree))


def nodes_to_bernstein(basis: Basis, lower: float = -1.0, upper: float = 1.0, degree: int | None = None) -> FloatArray:
    """Matrix from nodal states to Bernstein coefficients on [lower, upper].

    Parameters
    ----------
    basis : Basis
        The basis; its Gauss nodes are where the states are given.
    lower, upper : float, optional
        The part of the ensemble, in scaled parameters: ``-1 <= lower <= upper <= 1``. All of it by default.
    degree : int, optional
        Degree of the coefficients, 0 to 50; by default the order, see `moments_to_bernstein`.

    Returns
    -------
    ndarray, shape (degree + 1, order + 1)
        Dimensionless, read-only; every row sums to one.

    Raises
    ------
    ProblemError
        If the range is not inside [-1, 1] or `degree` is out of range.

    Notes
    -----
    **Guarantee**: the convex hull of the coefficients contains, up to rounding, the polynomial through the
    nodal states for every parameter of the range. Sufficient, not necessary; with ``degree < order`` the
    dropped moments have to be bounded apart.

    Examples
    --------
    >>> nodes_to_bernstein(LegendreBasis(order=1)).round(4)
    array([[ 1.366, -0.366],
           [-0.366,  1.366]])
    """
    part = _checked_part(lower, upper)
    return _nodes_to_bernstein(basis, part, _checked_degree(basis, degree))


def bernstein_to_moments(basis: Basis, degree: int | None = None) -> FloatArray:
    """Matrix from Bernstein coefficients on [-1, 1] to moments.

    Parameters
    ----------
    basis : Basis
        The basis that moments are taken against.
    degree : int, optional
        Degree of the coefficients, 0 to 50; by default the order.

    Returns
    -------
    ndarray, shape (order + 1, degree + 1)
        Dimensionless, read-only; rows beyond `degree` are zero. At ``degree = order`` the inverse of
        `moments_to_bernstein`; at a higher degree it keeps the first ``order + 1`` moments.

    Raises
    ------
    ProblemError
        If `degree` is out of range.

    Notes
    -----
    Farouki, J. Comput. Appl. Math. 119 (2000) 145-160: whole-number binomial sums, rounded once.

    Examples
    --------
    >>> bernstein_to_moments(LegendreBasis(order=1)).round(4)
    array([[ 0.7071,  0.7071],
           [-0.4082,  0.4082]])
    """
    return _bernstein_to_moments(basis, _checked_degree(basis, degree))


def _checked_degree(basis: Basis, degree: int | None) -> int:
    """The requested degree, by default the order."""
    return basis.order if degree is None else whole_number("degree", degree, 0, MAX_ORDER)


def _checked_part(lower: float, upper: float) -> Interval:
    """The requested range, inside [-1, 1]."""
    part = Interval(finite_number("lower", lower), finite_number("upper", upper))
    if part.lower < -1 or part.upper > 1:
        got = f"{part.lower:g} to {part.upper:g}"
        raise ProblemError(f"lower, upper: expected scaled parameters in [-1, 1], got {got}")
    return part


@lru_cache(maxsize=4096)
def _nodes_to_bernstein(basis: Basis, part: Interval, degree: int) -> FloatArray:
    """The matrix behind `nodes_to_bernstein`, made once."""
    # x_j -> m_k -> Bernstein coefficients
    return frozen(_moments_to_bernstein(basis, part, degree) @ nodes_to_moments(basis))


@lru_cache(maxsize=4096)
def _moments_to_bernstein(basis: Basis, part: Interval, degree: int) -> FloatArray:
    """The matrix behind `moments_to_bernstein`, made once."""
    # a degree below the order: the coefficients of the projection onto m_0 .. m_degree
    kept = min(degree, basis.order)
    matrix = np.zeros((degree + 1, basis.order + 1))
    matrix[:, : kept + 1] = _legendre_in_bernstein(degree, kept) @ _restriction(basis, kept, part)
    return frozen(matrix)


def _restriction(basis: Basis, order: int, part: Interval) -> FloatArray:
    """Column k: phi_k on `part`, in the Legendre polynomials of `part` itself."""
    # phi_k(center + half s) in Legendre polynomials of s: the recurrence with s replaced by its matrix
    multiply = affine_multiplication_matrix(LegendreBasis(order), part)
    constant = np.eye(order + 1)[0]
    recurrence = recurrence_of(basis).upto(order)
    return np.stack(three_term(recurrence, constant, lambda column: multiply @ column), axis=-1)


@cache
def _legendre_in_bernstein(degree: int, order: int) -> FloatArray:
    """Column k: the Bernstein coefficients of phi_k, of the given degree, on the whole range."""
    # P_k in Bernstein form of a degree, exact whole numbers over binomials (Farouki 2000)
    rows = [[_elevated(k, i, degree) / comb(degree, i) for k in range(order + 1)] for i in range(degree + 1)]
    return frozen(np.array(rows) * _norms(order))


def _elevated(k: int, i: int, degree: int) -> int:
    """binom(degree, i) times Bernstein coefficient i of P_k."""
    # P_k = sum_j c_j B_j^k, c_j = (-1)^(k+j) binom(k, j), raised to degree n (Farouki 2000)
    return sum((-1) ** (k + j) * comb(k, j) ** 2 * comb(degree - k, i - j) for j in range(min(k, i) + 1))


@lru_cache(maxsize=1024)
def _bernstein_to_moments(basis: Basis, degree: int) -> FloatArray:
    """The matrix behind `bernstein_to_moments`, made once."""
    if not isinstance(basis, LegendreBasis):
        # other measures: the Legendre moments of the same polynomial, then a change of basis
        legendre = LegendreBasis(degree)
        return frozen(change_of_basis(legendre, basis) @ _bernstein_to_moments(legendre, degree))
    # m_k of a Bernstein polynomial: int B_i P_k, exact whole numbers over one quotient
    rows = [[_legendre_moment(k, i, degree) for i in range(degree + 1)] for k in range(basis.order + 1)]
    return frozen(np.array(rows) * _norms(basis.order)[:, None])


def _legendre_moment(k: int, i: int, degree: int) -> float:
    """Integral over [-1, 1] of P_k times Bernstein polynomial i of the given degree."""
    # B_j^k B_i^n = binom(i+j, j) binom(n-i+k-j, k-j) / binom(n+k, k) B_{i+j}^{n+k}, whose integral is 2 / (n+k+1)
    total: int = sum(
        (-1) ** (k + j) * comb(k, j) * comb(i + j, j) * comb(degree - i + k - j, k - j) for j in range(k + 1)
    )
    return 2 * total / (comb(degree + k, k) * (degree + k + 1))


def _norms(order: int) -> FloatArray:
    """phi_k / P_k for k = 0..order."""
    norms: FloatArray = np.sqrt(np.arange(order + 1) + 0.5)
    return norms
