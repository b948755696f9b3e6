"""What polyhedra and obstacles share: checks and small computations on rows ``G x <= h``."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError, UnsupportedError
from ensemble_ctrl.core.values import numbers

Array = NDArray[np.float64]
MAX_ROWS = 250_000
TOLERANCE = 1e-9


def checked_rows(value: ArrayLike, name: str) -> Array:
    """A read-only copy of a matrix of row vectors, each finite and not zero."""
    rows = numbers(name, value, "rows of numbers")
    if rows.ndim != 2 or not rows.size:
        raise ProblemError(f"{name}: expected shape (rows, n), got {rows.shape}")
    if not np.isfinite(rows).all():
        raise ProblemError(f"{name}: expected finite numbers, got {rows.tolist()}")
    zero = np.flatnonzero(~rows.any(axis=1))
    if zero.size:
        raise ProblemError(f"{name}: expected rows that are not zero, got zeros in row {int(zero[0])}")
    rows.setflags(write=False)
    return rows


def is_feasible(G: Array, h: Array) -> bool:
    """Whether some x has ``G x <= h`` (unit rows), by Fourier-Motzkin elimination."""
    slack = TOLERANCE * max(1.0, float(np.abs(h).max(initial=0.0)))
    while G.shape[1] > 1:
        G, h = _eliminate_last(G, h)
    # one coordinate is left: g x <= h is an upper bound for g > 0, a lower one for g < 0
    slope = np.where(np.abs(G[:, 0]) > 1e-14, G[:, 0], 0.0)
    up, down = slope > 0, slope < 0
    low = float((h[down] / slope[down]).max(initial=-np.inf))
    high = float((h[up] / slope[up]).min(initial=np.inf))
    return bool((h[slope == 0] >= -slack).all()) and low <= high + slack


def _eliminate_last(G: Array, h: Array) -> tuple[Array, Array]:
    """Project ``G x <= h`` along the last coordinate."""
    last = np.where(np.abs(G[:, -1]) > 1e-14, G[:, -1], 0.0)
    up, down, none = last > 0, last < 0, last == 0
    if up.sum() * down.sum() > MAX_ROWS:
        raise UnsupportedError(f"polyhedron: too many rows for {G.shape[1]} dimensions, expected fewer than {len(G)}")
    a, b = last[up][:, None], -last[down][None, :]
    # each pair of an upper and a lower row, in the combination whose last coefficient vanishes
    weight = a + b
    pairs = (b / weight)[..., None] * G[up][:, None, :-1] + (a / weight)[..., None] * G[down][None, :, :-1]
    bounds = b / weight * h[up][:, None] + a / weight * h[down][None, :]
    width = G.shape[1] - 1
    return np.vstack([G[none, :-1], pairs.reshape(bounds.size, width)]), np.concatenate([h[none], bounds.ravel()])


def is_cone_trivial(G: Array) -> bool:
    """Whether ``G d <= 0`` has no solution but zero, so that ``G x <= h`` is bounded for every h."""
    # a direction d != 0 can be scaled to have some coordinate at 1 or -1: 2 n feasibility problems
    sides = np.vstack([np.eye(G.shape[1]), -np.eye(G.shape[1])])
    base = np.zeros(len(G))
    return not any(is_feasible(np.vstack([G, side]), np.append(base, -1.0)) for side in sides)
