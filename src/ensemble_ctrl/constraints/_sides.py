"""Both sides of every row of ``lower <= A x <= upper``: what is written, and what the other rows imply."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints._rows import TOLERANCE

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def joined(A: Array, lower: Array, upper: Array) -> tuple[Array, Array, Array, Ints, Array]:
    """Rows along one line as a single two-sided row, as ``eq:SetPoly`` writes them.

    Rows count as parallel or opposite when their unit normals, or one and the negative of the other, differ by at
    most `TOLERANCE`, so ``0.3 x + 0.2 y`` and ``-3 x - 2 y`` are opposite.

    Returns
    -------
    normals : ndarray, shape (lines, n)
        Of unit length.
    lower, upper : ndarray, shape (lines,)
        The tightest of the line's rows, in the unit of x.
    line : ndarray of int, shape (rows,)
        The line of each row of `A`.
    scale : ndarray, shape (rows,)
        ``A[i] = scale[i] * normals[line[i]]``, negative where the row is opposite to its line's normal.
    """
    length = np.linalg.norm(A, axis=1)
    units = A / length[:, None]
    kept: list[int] = []
    line, sign = np.zeros(len(A), dtype=np.int64), np.ones(len(A))
    for i, unit in enumerate(units):
        # the sign of each kept normal that the row repeats, 0 for those of other directions
        same = np.linalg.norm(units[kept] - unit, axis=1) <= TOLERANCE
        turned = np.linalg.norm(units[kept] + unit, axis=1) <= TOLERANCE
        found = np.flatnonzero(same | turned)
        if found.size:
            line[i], sign[i] = found[0], 1.0 if same[found[0]] else -1.0
        else:
            line[i] = len(kept)
            kept.append(i)
    # the tightest bounds of each line; an opposite row swaps and negates its own
    low, high = np.full(len(kept), -np.inf), np.full(len(kept), np.inf)
    np.maximum.at(low, line, np.where(sign > 0, lower, -upper) / length)
    np.minimum.at(high, line, np.where(sign > 0, upper, -lower) / length)
    return units[kept], low, high, line, sign * length


def closed(normals: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """The bounds with each open side replaced by the value that all rows together imply, infinite where none does.

    A linear program per open side.  An open side of an empty set, and one that the solver cannot settle, stays open.
    """
    from scipy.optimize import linprog

    above, below = np.isfinite(upper), np.isfinite(lower)
    # one-sided rows G x <= h of the sides that are given
    G, h = np.vstack([normals[above], -normals[below]]), np.concatenate([upper[above], -lower[below]])

    def largest(direction: Array) -> float:
        found = linprog(-direction, A_ub=G, b_ub=h, bounds=(None, None), method="highs")
        return np.inf if found.status or found.x is None else float(direction @ found.x)

    high = np.array([bound if one else largest(a) for a, bound, one in zip(normals, upper, above, strict=True)])
    low = np.array([bound if one else -largest(-a) for a, bound, one in zip(normals, lower, below, strict=True)])
    # a set without an inside: the solver's last digits must not turn it inside out
    return np.where(below, low, np.minimum(low, high)), np.where(above, high, np.maximum(low, high))
