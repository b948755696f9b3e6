"""Chebyshev polynomials on [-1, 1]: values, interpolation, and a bound of its error for entire functions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ELLIPSES = np.geomspace(1.02, 1e6, 400)
"""Sums of the half axes of the Bernstein ellipses on which `interpolation_error` bounds a function."""


def points(count: int) -> Floats:
    """The roots of ``T_count``, shape (count,), in (-1, 1)."""
    return np.asarray(np.cos(np.pi * (np.arange(count) + 0.5) / count))


def coefficients(values: Floats) -> Floats:
    """Coefficients of the interpolant of values at `points`, along the first axis: shape (count, ...) to the same."""
    count = len(values)
    # c_k = (2 - [k = 0]) / K sum_j f(x_j) cos(k (2j + 1) pi / 2K), whole turns of the angle left out
    angle = np.outer(np.arange(count), 2 * np.arange(count) + 1) % (4 * count)
    matrix = np.cos(np.pi / (2 * count) * angle) * (2.0 / count)
    matrix[0] /= 2.0
    return np.asarray(np.tensordot(matrix, values, axes=1))


def polynomials(at: Floats, count: int) -> Floats:
    """``T_0 .. T_{count - 1}`` at points of shape (n,) in [-1, 1]: shape (count, n)."""
    values = np.empty((count, len(at)))
    values[0] = 1.0
    if count > 1:
        values[1] = at
    # T_{k+1} = 2 x T_k - T_{k-1}
    for k in range(2, count):
        np.multiply(values[k - 1], 2.0 * at, out=values[k])
        values[k] -= values[k - 2]
    return values


def interpolation_error(turn: float, count: int) -> float:
    r"""Bound of the error of an interpolant of :math:`f(z) = \int v(t)\, e^{i z \theta(t)}\, dt` at `count` points.

    Parameters
    ----------
    turn : float
        Largest :math:`|\theta|`, radians for a `z` without dimension.
    count : int
        Interpolation points, those of `points`.

    Returns
    -------
    float
        Relative to :math:`\int |v|\, dt`; infinite where it would overflow.

    Notes
    -----
    *Guarantee*: never below the truth for any `v` and :math:`\theta`, in exact arithmetic. On the ellipse with foci
    -1 and 1 and half axes that sum to :math:`\rho`, the imaginary part of `z` is at most :math:`(\rho - 1/\rho) / 2`,
    so :math:`|f| \le M = e^{turn\,(\rho - 1/\rho)/2}`, and the interpolant of degree n = count - 1 is off by at most
    :math:`4 M \rho^{-n} / (\rho - 1)` (Trefethen, Approximation Theory and Approximation Practice, theorem 8.2). Every
    :math:`\rho > 1` gives a bound; the smallest of several is taken.
    """
    rho = ELLIPSES
    exponent = turn * (rho - 1 / rho) / 2 - (count - 1) * np.log(rho) + np.log(4 / (rho - 1))
    least = float(exponent.min())
    return float(np.exp(least)) if least < 700 else np.inf
