r"""Between a state as a function of the parameter, its moments, and its values at the Gauss nodes.

.. math:: m_k = \int_{-1}^{1} \phi_k(s)\, x(s)\, d\mu(s), \qquad x(s) = \sum_k m_k \phi_k(s)

with the measure :math:`\mu` of the basis: :math:`ds` for `LegendreBasis`, twice the distribution for others.

Arrays of moments have shape ``(order + 1,)`` for a scalar state, or ``(..., order + 1, n)``; arrays of values
at q points have shape ``(q,)`` or ``(..., q, n)``. So every transform is a matrix applied from the left with
``@``.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments._check import along_order_axis, finite_array, frozen, scaled_points, whole_number
from ensemble_ctrl.moments.basis import Basis
from ensemble_ctrl.moments.distribution import Distribution

FloatArray = NDArray[np.float64]


def nodes_to_moments(basis: Basis) -> FloatArray:
    r"""Matrix from nodal states to moments: :math:`m_k = \sum_j w_j \phi_k(s_j) x_j`.

    Parameters
    ----------
    basis : Basis
        The basis; its Gauss nodes are where the states are given.

    Returns
    -------
    ndarray, shape (order + 1, order + 1)
        ``[k, j]`` is w_j phi_k(s_j), dimensionless, read-only; the inverse of `moments_to_nodes`.

    Notes
    -----
    The Gauss rule applied to ``eq:moment`` (Arias et al., One Ring to Rule Them All).

    **Guarantee**: exact for states of degree `order` or less in s; for others these are the moments of the
    interpolating polynomial, which solve the truncated ``eq:moment_system`` exactly.

    Examples
    --------
    >>> from ensemble_ctrl.moments import LegendreBasis
    >>> nodes_to_moments(LegendreBasis(order=1)).round(4)
    array([[ 0.7071,  0.7071],
           [-0.7071,  0.7071]])
    """
    return _nodes_to_moments(basis)


def moments_to_nodes(basis: Basis) -> FloatArray:
    """Matrix from moments to nodal states: ``[j, k]`` is phi_k(s_j).

    Parameters
    ----------
    basis : Basis
        The basis; its Gauss nodes are where the states are wanted.

    Returns
    -------
    ndarray, shape (order + 1, order + 1)
        Dimensionless, read-only; the inverse of `nodes_to_moments`.

    Examples
    --------
    >>> from ensemble_ctrl.moments import LegendreBasis
    >>> moments_to_nodes(LegendreBasis(order=1)).round(4)
    array([[ 0.7071, -0.7071],
           [ 0.7071,  0.7071]])
    """
    return _moments_to_nodes(basis)


def moments_of_function(
    basis: Basis, f: Callable[[FloatArray], ArrayLike], quadrature: int | None = None
) -> FloatArray:
    """Moments of a function of the scaled parameter, by Gauss quadrature.

    Parameters
    ----------
    basis : Basis
        The basis that moments are taken against.
    f : callable
        Takes scaled parameters of shape (q,), gives values of shape (q,) or (..., q, n), in the state's unit.
    quadrature : int, optional
        Number q of Gauss points, ``order + 1`` to 200; by default ``order + 32``.

    Returns
    -------
    ndarray, shape (order + 1,) or (..., order + 1, n)
        Moments, in the state's unit.

    Raises
    ------
    ProblemError
        If `quadrature` is out of range, or the values of `f` have the wrong shape or are not finite.

    Notes
    -----
    Arias et al., One Ring to Rule Them All, ``eq:moment``.

    **Guarantee**: exact, up to rounding, for polynomials of degree ``2 * q - 1 - order`` or less.

    Examples
    --------
    >>> from ensemble_ctrl.moments import LegendreBasis
    >>> moments_of_function(LegendreBasis(order=2), lambda s: 1 + s)[:2].round(4)
    array([1.4142, 0.8165])
    """
    count = basis.order + 32 if quadrature is None else quadrature
    # m_k = sum_q w_q phi_k(s_q) f(s_q)
    s, weights = basis.rule(whole_number("quadrature", count, basis.order + 1, 200))
    values = along_order_axis("values of f", f(s), s.size)
    return np.asarray((weights[:, None] * basis.evaluate(s)).T @ values)


def moments_of_samples(basis: Basis, s: ArrayLike, values: ArrayLike) -> FloatArray:
    """Moments of the polynomial that fits samples best in least squares.

    Parameters
    ----------
    basis : Basis
        The basis; its order is the degree of the fit.
    s : array_like, shape (q,)
        Scaled parameters of the samples in [-1, 1], at least ``order + 1`` different ones.
    values : array_like, shape (q,) or (..., q, n)
        Measured states, in their own unit.

    Returns
    -------
    ndarray, shape (order + 1,) or (..., order + 1, n)
        Moments, in the state's unit.

    Raises
    ------
    ProblemError
        If points lie outside [-1, 1], are too few, or do not match `values`.

    Notes
    -----
    Every sample has the same weight. Not in the paper, whose online loop takes moments of measured positions.

    **Guarantee**: exact for states of degree `order` or less; for others the fit tends to the moments of
    ``eq:moment`` as samples fill [-1, 1] evenly.

    Examples
    --------
    >>> from ensemble_ctrl.moments import LegendreBasis
    >>> moments_of_samples(LegendreBasis(order=1), [-1.0, 0.0, 1.0], [1.0, 2.0, 3.0]).round(4)
    array([2.8284, 0.8165])
    """
    points = scaled_points("s", s)
    if points.ndim != 1 or np.unique(points).size <= basis.order:
        wanted = f"one row of at least {basis.order + 1} different points"
        raise ProblemError(f"s: expected {wanted} for order {basis.order}, got shape {points.shape}")
    # least squares by QR: min |Phi m - x|
    q, r = np.linalg.qr(basis.evaluate(points))
    return np.linalg.solve(r, q.T @ along_order_axis("values", values, points.size))


def evaluate_moments(basis: Basis, moments: ArrayLike, s: ArrayLike) -> FloatArray:
    """The state with the given moments, at scaled parameters.

    Parameters
    ----------
    basis : Basis
        The basis that the moments were taken against.
    moments : array_like, shape (order + 1,) or (..., order + 1, n)
        Moments, in the state's unit.
    s : array_like, shape S
        Scaled parameters, dimensionless.

    Returns
    -------
    ndarray, shape S or (..., *S, n)
        States, in their own unit.

    Raises
    ------
    ProblemError
        If `moments` does not have ``order + 1`` orders, or an argument is not finite.

    Notes
    -----
    The inverse of ``eq:moment`` (Arias et al., One Ring to Rule Them All), truncated.

    Examples
    --------
    >>> from ensemble_ctrl.moments import LegendreBasis
    >>> basis = LegendreBasis(order=2)
    >>> evaluate_moments(basis, moments_of_function(basis, lambda s: 1 + s), [0.0, 0.5]).round(4)
    array([1. , 1.5])
    """
    array = along_order_axis("moments", moments, basis.order + 1)
    points = finite_array("s", s)
    # x(s) = sum_k m_k phi_k(s)
    states = basis.evaluate(points.ravel()) @ array
    return np.asarray(states.reshape(array.shape[:-2] + points.shape + array.shape[1:][-1:]))


def change_of_basis(old: Basis, new: Basis) -> FloatArray:
    r"""Matrix from the moments of a polynomial in one basis to its moments in another.

    .. math:: [k, j] = \int \phi^\mathrm{new}_k \, \phi^\mathrm{old}_j \, d\mu_\mathrm{new}

    Parameters
    ----------
    old, new : Basis
        Bases of any two measures on [-1, 1].

    Returns
    -------
    ndarray, shape (new.order + 1, old.order + 1)
        Upper triangular, dimensionless, read-only.

    Notes
    -----
    **Guarantee**: exact, up to rounding, for the polynomial with the given moments in the old basis.

    Examples
    --------
    >>> from ensemble_ctrl.moments import Beta, LegendreBasis
    >>> change_of_basis(LegendreBasis(1), Beta(0.0, 1.0, 2, 1).basis(1)).round(4)
    array([[1.    , 0.5774],
           [0.    , 0.8165]])
    """
    return _change_of_basis(old, new)


def inner_products(distribution: Distribution, basis: Basis) -> FloatArray:
    r"""Inner products of a basis under a distribution that need not be its own, :math:`\int \phi_j \phi_k\, d\mu`.

    Parameters
    ----------
    distribution : Distribution
        Its measure has total mass 2.
    basis : Basis
        Of any measure on [-1, 1].

    Returns
    -------
    ndarray, shape (order + 1, order + 1)
        Symmetric, dimensionless; with it, moments m of a state in `basis` give twice the fleet's mean square as
        ``m @ inner_products @ m``.

    Notes
    -----
    **Guarantee**: exact, up to rounding, and also for distributions of so few values that they have no basis of that
    order.

    Examples
    --------
    >>> from ensemble_ctrl.moments import LegendreBasis, Samples
    >>> inner_products(Samples([1.0, 1.2]), LegendreBasis(1)).round(4) + 0.0
    array([[1., 0.],
           [0., 3.]])
    """
    # the Gauss rule of the distribution is exact for products of degree 2 N
    s, weights = distribution.rule(basis.order + 1)
    phi = basis.evaluate(s)
    return np.asarray((weights[:, None] * phi).T @ phi)


@lru_cache(maxsize=1024)
def _nodes_to_moments(basis: Basis) -> FloatArray:
    """The matrix behind `nodes_to_moments`, made once."""
    # m_k = sum_i w_i phi_k(s_i) x(s_i)
    return frozen((basis.weights[:, None] * basis.evaluate(basis.nodes)).T)


@lru_cache(maxsize=1024)
def _moments_to_nodes(basis: Basis) -> FloatArray:
    """The matrix behind `moments_to_nodes`, made once."""
    # x(s_i) = sum_k m_k phi_k(s_i)
    return frozen(basis.evaluate(basis.nodes))


@lru_cache(maxsize=1024)
def _change_of_basis(old: Basis, new: Basis) -> FloatArray:
    """The matrix behind `change_of_basis`, made once."""
    # exact for phi_new phi_old; triangular, as phi_new,k is orthogonal to lower degrees
    s, weights = new.rule((old.order + new.order) // 2 + 1)
    return frozen(np.triu((weights[:, None] * new.evaluate(s)).T @ old.evaluate(s)))
