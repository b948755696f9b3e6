r"""What multiplying by the parameter does to moments.

Moment arrays have shape ``(order + 1,)`` or ``(..., order + 1, n)``: the order is the last axis but one.
With :math:`a, c` of `Basis.recurrence`, :math:`b` of `Basis.diagonal` and the shifts :math:`L, R`,

.. math:: J m = R(a \circ m) + b \circ m + L(c \circ m)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.moments._check import along_order_axis
from ensemble_ctrl.moments.basis import Basis
from ensemble_ctrl.moments.distribution import Distribution

FloatArray = NDArray[np.float64]


def multiplication_matrix(basis: Basis) -> FloatArray:
    r"""Matrix of "multiply by s" on moments, truncated at the basis's order.

    Parameters
    ----------
    basis : Basis
        The basis that moments are taken against.

    Returns
    -------
    ndarray, shape (order + 1, order + 1)
        The Jacobi matrix J: symmetric, tridiagonal, dimensionless; its diagonal is zero for a symmetric distribution.
        Its eigenvalues are the Gauss nodes.

    Notes
    -----
    From ``eq:RecurrenceFinal`` (Arias et al., One Ring to Rule Them All).

    **Guarantee**: exact for functions of degree below `order`; for higher ones the product's moment
    ``order + 1`` is dropped, which is the truncation of ``eq:moment_system``.

    Examples
    --------
    >>> from ensemble_ctrl.moments import LegendreBasis
    >>> multiplication_matrix(LegendreBasis(order=2)).round(4)
    array([[0.    , 0.5774, 0.    ],
           [0.5774, 0.    , 0.5164],
           [0.    , 0.5164, 0.    ]])
    """
    # the Jacobi matrix: s phi_k = c_{k+1} phi_{k+1} + b_k phi_k + c_k phi_{k-1}
    _, c = basis.recurrence()
    return np.diag(basis.diagonal) + np.diag(c[1:], 1) + np.diag(c[1:], -1)


def affine_multiplication_matrix(basis: Basis, interval: Distribution) -> FloatArray:
    r"""Matrix of "multiply by psi" on moments: :math:`G = c\,I + h\,J`.

    Parameters
    ----------
    basis : Basis
        The basis that moments are taken against.
    interval : Distribution
        Distribution of the parameter; its range has centre c and half-width h.

    Returns
    -------
    ndarray, shape (order + 1, order + 1)
        Symmetric tridiagonal, in the parameter's unit.

    Notes
    -----
    The paper has the case c = 0, h = 1 (Arias et al., One Ring to Rule Them All, ``eq:moment_system``).

    Examples
    --------
    >>> from ensemble_ctrl.moments import Interval, LegendreBasis
    >>> affine_multiplication_matrix(LegendreBasis(order=1), Interval(0.9, 1.1)).round(4)
    array([[1.    , 0.0577],
           [0.0577, 1.    ]])
    """
    # psi phi_k = (c + h s) phi_k, truncated
    return interval.center * np.eye(basis.order + 1) + interval.half_width * multiplication_matrix(basis)


def shift_left(moments: ArrayLike) -> FloatArray:
    """Moments moved one order down: ``(L m)_k = m_{k+1}``, with zero at the top.

    Parameters
    ----------
    moments : array_like, shape (order + 1,) or (..., order + 1, n)
        Moments, in the state's unit.

    Returns
    -------
    ndarray, shape of `moments`
        Shifted moments, in the state's unit.

    Raises
    ------
    ProblemError
        If `moments` is a single number or not finite.

    Notes
    -----
    Arias et al., One Ring to Rule Them All, ``eq:moment_system``.

    Examples
    --------
    >>> shift_left([1.0, 2.0, 3.0])
    array([2., 3., 0.])
    """
    return _shift(moments, -1)


def shift_right(moments: ArrayLike) -> FloatArray:
    """Moments moved one order up: ``(R m)_k = m_{k-1}``, with ``(R m)_0 = 0``.

    Parameters
    ----------
    moments : array_like, shape (order + 1,) or (..., order + 1, n)
        Moments, in the state's unit.

    Returns
    -------
    ndarray, shape of `moments`
        Shifted moments, in the state's unit; the highest is dropped.

    Raises
    ------
    ProblemError
        If `moments` is a single number or not finite.

    Notes
    -----
    Arias et al., One Ring to Rule Them All, ``eq:moment_system`` (the text's R is corrected, see *Errata*).

    Examples
    --------
    >>> shift_right([1.0, 2.0, 3.0])
    array([0., 1., 2.])
    """
    return _shift(moments, 1)


def _shift(moments: ArrayLike, by: int) -> FloatArray:
    """Roll along the order axis by one and zero what came round the end."""
    array = along_order_axis("moments", moments, None)
    axis = max(array.ndim - 2, 0)
    shifted = np.roll(array, by, axis)
    vacated = 0 if by > 0 else -1
    np.moveaxis(shifted, axis, 0)[vacated] = 0.0
    return shifted
