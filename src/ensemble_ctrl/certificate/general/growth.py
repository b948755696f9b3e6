r"""How far the true state may be from the polynomial, from the defect and bounds of the Jacobian.

With ``e = x - x~``, the mean value theorem gives ``e' = J e + d`` with ``|d| <= defect`` and `J` in the bounds of the
Jacobian over the tube, and `e` jumps by at most `jump` from one piece to the next.  Two bounds of ``|e|`` hold:

1. *Comparison*: ``r' = M r + defect`` with ``M_ii = max(sup J_ii, 0)`` and ``M_ij = sup |J_ij|``, non-negative, so that
   `r` never falls within a piece.
2. *A turning frame* (Lohner 1987): ``e = A z``; with ``J = J_m + [-R, R]`` and ``e(s) = exp(J_m s) w(s)``,
   ``|w(s) - w(0)| <= p = (exp(W h) - 1) |w(0)| + exp(W h) h E defect`` for ``E = exp(h |J_m|)`` and ``W = E R E``;
   then the new frame is an orthogonal factor of ``exp(h J_m) A``.

Every matrix exponential is a Taylor sum whose tail and roundings are added to the result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.errors import Unenclosed
from ensemble_ctrl.certificate.general.basis import UNIT, UP

Floats = NDArray[np.float64]

TERMS = 60
"""Terms of a Taylor sum of a matrix exponential."""
LARGEST = 10.0
"""Largest norm of the exponent for which these terms are enough."""
SQUARINGS = 4
"""Times that a bound of an exponential is squared at most."""


@dataclass(frozen=True, eq=False)
class Jacobian:
    """Bounds of the Jacobian on each piece, shapes (steps, cells, states, states)."""

    low: Floats
    high: Floats

    def comparison(self) -> Floats:
        """The non-negative matrix of the comparison system, shape (steps, cells, states, states)."""
        # M_ij = sup |J_ij| off the diagonal, M_ii = max(sup J_ii, 0) on it
        matrix = np.maximum(np.abs(self.low), np.abs(self.high))
        k = np.arange(matrix.shape[-1])
        matrix[..., k, k] = np.maximum(self.high[..., k, k], 0.0)
        return np.asarray(matrix)


def radii(jacobian: Jacobian, defect: Floats, jump: Floats, step: float) -> Floats:
    """Bounds of ``|x - x~|`` throughout each piece, shape (steps, cells, states): the better of both bounds.

    Parameters
    ----------
    jacobian : Jacobian
    defect, jump : ndarray, shape (steps, cells, states)
        Bounds of the defect within each piece, and of the jump at its beginning.
    step : float
        Upper bound of the seconds of a piece.

    Raises
    ------
    Unenclosed
        If a piece is too long for its Jacobian.
    """
    plain = _compared(jacobian.comparison(), defect, jump, step)
    try:
        turned = _turned(jacobian, defect, jump, step)
    except Unenclosed:  # the frame's own spread is too large; the comparison holds all the same
        return plain
    return np.asarray(np.fmin(plain, turned))


def _compared(matrix: Floats, defect: Floats, jump: Floats, step: float) -> Floats:
    """The bound by the comparison system at the end of each piece."""
    found, r = np.empty_like(defect), np.zeros_like(defect[0])
    # exp(M h) for all pieces at once
    grown = exponential_bound(matrix * (step * UP))
    for k in range(len(defect)):
        # int exp(M (h - s)) defect ds <= h exp(M h) defect, since all entries are non-negative
        r = np.einsum("cij,cj->ci", grown[k], (r + jump[k]) + (step * UP) * defect[k]) * UP
        found[k] = r
    return found


def _turned(jacobian: Jacobian, defect: Floats, jump: Floats, step: float) -> Floats:
    """The bound in a turning frame throughout each piece."""
    cells, states = defect.shape[1:]
    found, identity = np.empty_like(defect), np.eye(states)
    frame, z = np.tile(identity, (cells, 1, 1)), np.zeros((cells, states))
    with np.errstate(invalid="ignore", over="ignore"):
        # J = J_m + [-rho, rho]; exp(J_m h), its error, E = exp(h |J_m|) and exp(W h) with W = E rho E
        middle = (jacobian.low + jacobian.high) / 2
        radius = np.maximum(jacobian.high - middle, middle - jacobian.low) * UP
        exacts, errors, bounds = exponential(middle, step)
        swells = exponential_bound(bounds @ radius @ bounds * (step * UP**3))
        for k in range(len(defect)):
            exact, error, bound, swell = exacts[k], errors[k], bounds[k], swells[k]
            # the jump in the frame: zeta + |A^-1 gamma|; then |w(0)| <= |A| zeta
            z = z + _solved(frame, jump[k][..., None])[..., 0]
            start = (np.abs(frame) @ z[..., None]) * UP
            # pi = (exp(W h) - 1) |w(0)| + exp(W h) h E delta, and |e| <= E (|A| zeta + pi) (Lohner 1987)
            driven = swell @ (bound @ defect[k][..., None]) * (step * UP**3)
            away = np.maximum(swell - identity * (1 - UNIT), 0.0) @ start * UP + driven
            found[k] = (bound @ (start + away) * UP)[..., 0]
            # e at the end: exp(J_m h) (A z + away), in the new frame
            whole = exact @ frame
            slack = (error @ np.abs(frame) + states * UNIT * (np.abs(exact) @ np.abs(frame))) * UP
            frame = _frame(whole, z)
            # zeta' = |Q^-1 exp(J_m h) A| zeta + |Q^-1| E pi
            inner = _solved(frame, whole) @ z[..., None] + _bounded(frame, slack @ z[..., None])
            outer = _bounded(frame, bound @ away)
            z = ((inner + outer) * UP**2)[..., 0]
    return found


def _frame(whole: Floats, z: Floats) -> Floats:
    """Orthogonal factors of matrices whose columns are sorted by their weight, so that the longest one is kept."""
    # columns of exp(J_m h) A by their length times zeta, the heaviest first; QR of that order
    weight = np.linalg.norm(whole, axis=1) * z
    order = np.argsort(-weight, axis=1)
    return np.asarray(np.linalg.qr(np.take_along_axis(whole, order[:, None, :], axis=2))[0])


def _solved(frame: Floats, columns: Floats) -> Floats:
    """Bounds of ``|Q^-1 y|`` for each column `y` of matrices, where `Q` is orthogonal up to rounding.

    ``Q^-1 = (1 - G)^-1 Q^T`` with ``G = 1 - Q^T Q``: it differs from ``Q^T`` by at most ``|G| / (1 - |G|)`` of it.
    """
    # |Q^T y|, and 2 n u |Q^T| |y| for its rounding
    product = np.abs(frame.transpose(0, 2, 1) @ columns)
    return _completed(frame, product + 2 * len(frame[0]) * UNIT * (np.abs(frame.transpose(0, 2, 1)) @ np.abs(columns)))


def _bounded(frame: Floats, size: Floats) -> Floats:
    """Bounds of ``|Q^-1 y|`` for all ``|y| <= size``."""
    return _completed(frame, np.abs(frame.transpose(0, 2, 1)) @ size)


def _completed(frame: Floats, product: Floats) -> Floats:
    """From bounds of ``|Q^T y|`` to those of ``|Q^-1 y|``."""
    n = frame.shape[-1]
    # row-sum norm of I - Q^T Q, and 4 n (n + 2) u for its rounding (Higham, section 3.1)
    gap = np.abs(np.eye(n) - frame.transpose(0, 2, 1) @ frame).sum(axis=2).max(axis=1) + 4 * n * (n + 2) * UNIT
    if not (gap < 1e-6).all():
        return np.full_like(product, np.inf)
    return np.asarray((product + 2 * gap[:, None, None] * product.max(axis=1, keepdims=True)) * UP)


def exponential_bound(matrix: Floats) -> Floats:
    """Upper bound of the exponential of non-negative matrices, entry by entry.

    Notes
    -----
    The exponent is halved until its norm is at most `LARGEST`, and the result is squared as often. The tail after the
    last term is at most that term times ``q / (1 - q)`` with ``q = |M| / TERMS``, spread over all entries by its norm.
    """
    n = matrix.shape[-1]
    # row-sum norms; scaling and squaring: exp(M) = exp(M / 2^k)^(2^k)
    norms = matrix.sum(axis=-1).max(axis=-1, initial=0.0) * UP
    norm, halvings = float(norms.max(initial=0.0)), 0
    if not np.isfinite(norm):
        piece = int(np.flatnonzero(~np.isfinite(norms))[0])
        raise Unenclosed("the derivative of the right-hand side is not bounded near the way", piece)
    while norm > LARGEST * 2**halvings:
        halvings += 1
        if halvings > SQUARINGS:
            raise Unenclosed("the right-hand side grows too fast for its steps", int(norms.argmax()))
    matrix = matrix / 2**halvings
    # sum_j M^j / j!, the tail bounded by a geometric series with ratio q = |M| / TERMS
    term = total = np.broadcast_to(np.eye(n), matrix.shape)
    for j in range(1, TERMS):
        term = term @ matrix / j
        total = total + term
    q = norm / 2**halvings / TERMS
    total = (total + term.sum(axis=-1).max(axis=-1)[..., None, None] * (q / (1 - q))) * UP**2
    for _ in range(halvings):
        total = total @ total * UP
    return np.asarray(total)


def exponential(matrix: Floats, step: float) -> tuple[Floats, Floats, Floats]:
    """``exp(h M)`` nearly, a bound of its error, and one of ``exp(s |M|)`` for all ``0 <= s <= h``, entry by entry.

    Every term of the Taylor sum is right to ``(n + 3) j`` roundings of the same term of ``exp(h |M|)``.
    """
    bound = exponential_bound(np.abs(matrix) * (step * UP))
    n = matrix.shape[-1]
    # |h M|: the remainder of the Taylor sum is bounded by its powers
    size = np.abs(matrix) * step
    norm = size.sum(axis=-1).max(axis=-1)[..., None, None]
    if not (norm <= LARGEST).all():
        raise Unenclosed("the right-hand side grows too fast for its steps", int(norm.argmax()))
    term = total = np.broadcast_to(np.eye(n), matrix.shape)
    for j in range(1, TERMS):
        term = term @ matrix * (step / j)
        total = total + term
    tail = norm**TERMS / 6.0e81  # TERMS! = 8.32e81, and the rest of the tail is below a quarter of it
    error = (n + 5) * TERMS * UNIT * bound + tail * UP
    return np.asarray(total), np.asarray(error), bound
