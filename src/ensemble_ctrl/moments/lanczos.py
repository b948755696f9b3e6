"""The recurrence of a measure of points and weights, by the Lanczos process."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.moments.recurrence import Recurrence, gauss, values

FloatArray = NDArray[np.float64]

BLOCK = 4096
"""Points that are taken at once: more are first replaced, block by block, by their Gauss rules."""
CHUNK = 65_536
"""Points at which polynomials are evaluated at once."""
ORTHONORMAL = 1e-9
"""Largest error of an inner product that is accepted."""
TIED = 1e-13
"""Off-diagonals below this, relative to the spread of the points, mean that the points are used up."""


def recurrence_of_points(s: FloatArray, weights: FloatArray, order: int) -> Recurrence:
    """Recurrence up to `order`, or up to the highest order that the points determine.

    Parameters
    ----------
    s : ndarray, shape (n,)
        Points in [-1, 1], all different.
    weights : ndarray, shape (n,)
        Not negative, with a positive sum.
    order : int
        Highest order wanted.

    Returns
    -------
    Recurrence
        Of order at most n - 1; with its last ``a`` zero where the points are used up.

    Notes
    -----
    Gautschi, Orthogonal Polynomials: Computation and Approximation (2004), section 2.2.3; every vector is
    orthogonalised twice against all earlier ones, so that errors do not grow with the order.
    """
    share = weights / weights.sum()
    # shifted and scaled to mean 0 and deviation 1, so that the coefficients are of order 1
    centre = float(share @ s)
    spread = float(np.sqrt(share @ np.square(s - centre)))
    if spread == 0.0:
        return Recurrence.of(np.array([centre]), np.zeros(1))
    t = (s - centre) / spread
    most = min(order, len(s) - 1)
    vectors = np.zeros((most + 1, len(s)))
    vectors[0] = np.sqrt(share)
    diagonal, beside = np.zeros(most + 1), np.zeros(most + 1)
    least = TIED * max(1.0, float(np.abs(t).max()))
    for k in range(most + 1):
        # Lanczos step: a_k v_{k+1} = t v_k - b_k v_k - a_{k-1} v_{k-1}, orthogonalised twice
        known = vectors[: k + 1]
        residual = t * known[-1]
        diagonal[k] = known[-1] @ residual
        for _ in range(2):
            residual = residual - known.T @ (known @ residual)
        beside[k] = np.linalg.norm(residual)
        # a vanishing residual: as many polynomials as there are different points
        if beside[k] < least or k + 1 == len(s):
            beside[k] = 0.0
            return Recurrence.of(centre + spread * diagonal[: k + 1], spread * beside[: k + 1])
        if k < most:
            vectors[k + 1] = residual / beside[k]
    return Recurrence.of(centre + spread * diagonal, spread * beside)


def usable(recurrence: Recurrence, s: FloatArray, weights: FloatArray) -> Recurrence:
    """The beginning of a recurrence that gives orthonormal values at the measure's own points.

    Parameters
    ----------
    recurrence : Recurrence
        Of the measure.
    s, weights : ndarray, shape (n,)
        The measure, of total mass 2.

    Notes
    -----
    At a point of the measure far from the others the polynomials of high order turn so steeply that rounding `s` alone
    spoils their values. This measures it, and keeps the orders that are orthonormal to `ORTHONORMAL`.
    """
    size = recurrence.order + 1
    gram = np.zeros((size, size))
    with np.errstate(over="ignore", invalid="ignore"):
        for i in range(0, len(s), CHUNK):
            # Gram matrix of phi_0..phi_N under the measure, by chunks; the identity without rounding
            phi = values(recurrence, s[i : i + CHUNK])
            gram += (weights[i : i + CHUNK, None] * phi).T @ phi
        off = np.maximum.accumulate(np.abs(np.tril(gram - np.eye(size))).max(axis=1))
    return recurrence.upto(max(int((off <= ORTHONORMAL).sum()) - 1, 0))


def condensed(s: FloatArray, weights: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Fewer points with the same integrals of every polynomial up to degree ``2 count - 1``.

    Parameters
    ----------
    s, weights : ndarray, shape (n,)
        Points in increasing order, all different, and their weights.
    count : int
        Points kept of each block.

    Notes
    -----
    *Guarantee*: exact up to rounding; each block of points is replaced by its own Gauss rule.
    """
    if len(s) <= max(BLOCK, 2 * count):
        return s, weights
    # each block by its Gauss rule of `count` points, then all of them together
    blocks = [gauss_of_points(s[i : i + BLOCK], weights[i : i + BLOCK], count) for i in range(0, len(s), BLOCK)]
    points, masses = (np.concatenate(part) for part in zip(*blocks, strict=True))
    return merged(points, masses)


def merged(s: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The points in increasing order, equal ones as one."""
    points, at = np.unique(s, return_inverse=True)
    return points, np.asarray(np.bincount(at, weights, len(points)), dtype=np.float64)


def gauss_of_points(s: FloatArray, weights: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """The Gauss rule with `count` points, or fewer if there are fewer, of the same total weight."""
    found = recurrence_of_points(s, weights, count - 1)
    nodes, shares = gauss(found, found.order + 1)
    return nodes, shares * (weights.sum() / 2)
