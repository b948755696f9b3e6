r"""Three-term recurrences of orthonormal polynomials, and the Gauss rules that follow from them.

.. math:: s\,\phi_k = a_k \phi_{k+1} + b_k \phi_k + c_k \phi_{k-1}, \qquad c_k = a_{k-1}, \quad \phi_0 = 1/\sqrt 2

All measures here have total mass 2.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SMALL = 1e-7
"""Gauss weights below this are computed from the polynomials."""


class Recurrence(NamedTuple):
    """Coefficients for k = 0..order.

    Attributes
    ----------
    a, b, c : ndarray, shape (order + 1,)
        Dimensionless; ``c[0]`` is 0, and so is the last ``a`` of a measure of order + 1 points.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray

    @classmethod
    def of(cls, diagonal: FloatArray, beside: FloatArray) -> Recurrence:
        """From the diagonal b and the off-diagonal a of a Jacobi matrix, each of shape (order + 1,)."""
        arrays = beside, diagonal, np.concatenate([[0.0], beside[:-1]])
        for array in arrays:
            array.setflags(write=False)
        return cls(*arrays)

    @property
    def order(self) -> int:
        """Highest polynomial."""
        return len(self.b) - 1

    def upto(self, order: int) -> Recurrence:
        """The coefficients for k = 0..order, or all there are."""
        return Recurrence(*(array[: order + 1] for array in self))


def three_term(
    recurrence: Recurrence, first: FloatArray, multiply: Callable[[FloatArray], FloatArray]
) -> list[FloatArray]:
    """phi_0..phi_order of whatever `multiply` multiplies by s: a point, or a polynomial's coefficients."""
    a, b, c = recurrence
    # a_k phi_{k+1} = (s - b_k) phi_k - c_k phi_{k-1}
    terms = [np.zeros_like(first), first]
    for k in range(recurrence.order):
        terms.append((multiply(terms[-1]) - b[k] * terms[-1] - c[k] * terms[-2]) / a[k])
    return terms[1:]


def values(recurrence: Recurrence, s: FloatArray) -> FloatArray:
    """phi_0..phi_order at s, on a new last axis."""
    first = np.full(s.shape, np.sqrt(0.5))
    return np.stack(three_term(recurrence, first, lambda term: s * term), axis=-1)


def slopes(recurrence: Recurrence, s: FloatArray) -> FloatArray:
    """Derivatives of phi_0..phi_order at s, on a new last axis."""
    a, b, c = recurrence
    phi = values(recurrence, s)
    slope = np.zeros_like(phi)
    for k in range(recurrence.order):
        # the derivative of the recurrence: a_k phi'_{k+1} = phi_k + (s - b_k) phi'_k - c_k phi'_{k-1}
        below = c[k] * slope[..., k - 1] if k else 0.0
        slope[..., k + 1] = (phi[..., k] + (s - b[k]) * slope[..., k] - below) / a[k]
    return slope


def roots(recurrence: Recurrence, k: int) -> FloatArray:
    """Roots of phi_k in increasing order: the eigenvalues of the Jacobi matrix, shape (k,)."""
    return _eigen(recurrence, k)[0] if k else np.empty(0)


def gauss(recurrence: Recurrence, count: int) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of the Gauss rule with `count` points.

    Notes
    -----
    Golub and Welsch, Calculation of Gauss quadrature rules, Math. Comp. 23 (1969) 221-230: large weights from the first
    entries of the eigenvectors, which small ones lose to rounding; small ones from the inverse of the sum of squares of
    the polynomials, which grow there, so that their recurrence is stable.
    """
    nodes, first = _eigen(recurrence, count)
    # Golub and Welsch 1969: w_j = 2 v_0j^2; small weights as Christoffel numbers 1 / sum_k phi_k(s_j)^2
    weights = 2 * first**2
    small = weights < SMALL
    weights[small] = 1 / np.square(values(recurrence.upto(count - 1), nodes[small])).sum(axis=-1)
    return nodes, weights * (2 / weights.sum())


def _eigen(recurrence: Recurrence, count: int) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues of the Jacobi matrix of `count` rows, and the first entries of its eigenvectors."""
    _, b, c = recurrence.upto(count - 1)
    # Jacobi matrix: diagonal b, off-diagonal c; shifted by b_0 so that small spreads keep their digits
    found, vectors = np.linalg.eigh(np.diag(b - b[0]) + np.diag(c[1:], 1) + np.diag(c[1:], -1))
    return b[0] + found, vectors[0]
