"""What polyhedra and obstacles share: checks and small computations on rows ``G x <= h``."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.errors import ProblemError, UnsupportedError

Array = NDArray[np.float64]
MAX_ROWS = 250_000
TOLERANCE = 1e-9


def checked_rows(value: ArrayLike, name: str) -> Array:
    """A read-only copy of a matrix of row vectors, each finite and not zero."""
    rows = np.array(value, dtype=float)
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
    weight = a + b
    pairs = (b / weight)[..., None] * G[up][:, None, :-1] + (a / weight)[..., None] * G[down][None, :, :-1]
    bounds = b / weight * h[up][:, None] + a / weight * h[down][None, :]
    width = G.shape[1] - 1
    return np.vstack([G[none, :-1], pairs.reshape(bounds.size, width)]), np.concatenate([h[none], bounds.ravel()])


def is_cone_trivial(G: Array) -> bool:
    """Whether ``G d <= 0`` has no solution but zero, so that ``G x <= h`` is bounded for every h."""
    if G.shape[1] == 2:  # no two neighbouring normals are half a turn or more apart
        angles = np.sort(np.arctan2(G[:, 1], G[:, 0]))
        return len(G) > 2 and bool((np.diff(angles, append=angles[0] + 2 * np.pi) < np.pi - TOLERANCE).all())
    sides = np.vstack([np.eye(G.shape[1]), -np.eye(G.shape[1])])
    base = np.zeros(len(G))
    return not any(is_feasible(np.vstack([G, side]), np.append(base, -1.0)) for side in sides)


def boundary_vertices(G: Array, h: Array) -> Array:
    """Corners of the bounded plane set ``G x <= h`` (unit rows), counter-clockwise, without repeats."""
    first, second = np.triu_indices(len(G), k=1)
    det = G[first, 0] * G[second, 1] - G[first, 1] * G[second, 0]
    crossing = np.abs(det) > 1e-12
    first, second, det = first[crossing], second[crossing], det[crossing]
    x = (h[first] * G[second, 1] - h[second] * G[first, 1]) / det
    y = (G[first, 0] * h[second] - G[second, 0] * h[first]) / det
    points = np.stack([x, y], axis=1)
    slack = TOLERANCE * max(1.0, float(np.abs(h).max()))
    return _ordered(points[(points @ G.T <= h + slack).all(axis=1)], slack)


def _ordered(points: Array, slack: float) -> Array:
    """Points of a convex curve by angle round their centre, near-equal ones merged."""
    if not len(points):
        return points
    offset = points - points.mean(axis=0)
    points = points[np.argsort(np.arctan2(offset[:, 1], offset[:, 0]), kind="stable")]
    kept: list[Array] = []
    for point in points:
        if not any(np.abs(point - other).max() <= 10 * slack for other in kept):
            kept.append(point)
    vertices = np.array(kept)
    vertices.setflags(write=False)
    return vertices


def space_vertices(G: Array, h: Array) -> Array:
    """Corners of the bounded set ``G x <= h`` (unit rows) in space, without repeats, shape (corners, 3)."""
    triples = np.array(list(combinations(range(len(G)), 3)), dtype=np.int64).reshape(-1, 3)
    rows = G[triples]
    crossing = np.abs(np.linalg.det(rows)) > 1e-12
    points = np.linalg.solve(rows[crossing], h[triples[crossing]][..., None])[..., 0]
    slack = TOLERANCE * max(1.0, float(np.abs(h).max(initial=0.0)))
    points = points[(points @ G.T <= h + slack).all(axis=1)]
    kept: list[Array] = []
    for point in points:
        if not any(np.abs(point - other).max() <= 10 * slack for other in kept):
            kept.append(point)
    vertices = np.array(kept).reshape(-1, 3)
    vertices.setflags(write=False)
    return vertices
