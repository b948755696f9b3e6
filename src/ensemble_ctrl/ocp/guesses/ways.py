"""Ways for a point around convex obstacles in one to three dimensions: first guesses of where a fleet may go."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle

Floats = NDArray[np.float64]

CELLS = {2: 60, 3: 36}
"""Cells along the longest side of the map."""
TRODDEN = 0.15
"""Share of the map's size around a known way in which another one is slow."""
TRIES = 3
"""How often another way is looked for before there is said to be none."""
SHY = 0.4
"""Metres of clearance up to which a way through a narrow place counts as longer: it keeps to the middle of gaps."""


def ways(start: Floats, end: Floats, pieces: Sequence[Obstacle], keep: float, count: int) -> list[Floats]:
    """Up to `count` short ways between two places, with an obstacle between each two of them; arguments as of `way`."""
    found = [way(start, end, pieces, keep)]
    known = list(found)
    for _ in range(TRIES * (count - 1) if pieces and len(start) > 1 else 0):
        other = way(start, end, pieces, keep, tuple(known))
        known.append(other)
        if _is_clear(other, pieces, 0.0) and all(_apart(other, one, pieces) for one in found):
            found.append(other)
        if len(found) == count:
            break
    return found


def _apart(first: Floats, second: Floats, pieces: Sequence[Obstacle]) -> bool:
    """Whether an obstacle lies between two ways with the same ends."""
    shares = np.linspace(0.0, 1.0, 50)
    a, b = resampled(first, shares), resampled(second, shares)
    # straight connections of points at equal shares of both ways: do they cross an obstacle?
    between = a[:, None] + shares[None, ::5, None] * (b - a)[:, None]
    return any(bool((piece.distance(between) < 0).any()) for piece in pieces)


def way(start: Floats, end: Floats, pieces: Sequence[Obstacle], keep: float, known: tuple[Floats, ...] = ()) -> Floats:
    """A short way between two places.

    Parameters
    ----------
    start, end : ndarray, shape (d,)
        Metres.
    pieces : sequence of Obstacle
        What to go around.
    keep : float
        Metres from every piece.
    known : tuple of ndarray, shapes (corners, d)
        Ways that it should not follow.

    Returns
    -------
    ndarray, shape (corners, d)
        From `start` to `end`; the straight line where nothing is in its way, or where no way is found.
    """
    straight = np.stack([start, end])
    if not pieces or len(start) == 1 or (not known and _is_clear(straight, pieces, keep)):
        return straight
    grid = _grid(start, end, pieces)
    # cost of a cell per metre: 1 to 5 as its clearance falls from SHY to 0, and more on known ways
    free = np.min([piece.distance(grid) for piece in pieces], axis=0) - keep
    slow = 1.0 + 4.0 * np.clip(1.0 - free / SHY, 0.0, 1.0)
    for other in known:
        slow = slow + _trodden(grid, other)
    found = _shortest(grid, free > 0, slow, start, end)
    return straight if found is None else _smoothed(np.concatenate([start[None], found, end[None]]), pieces, keep)


def resampled(corners: Floats, shares: Floats) -> Floats:
    """Points of a polyline at shares of its length from 0 to 1, shape (shares, d)."""
    # interpolation over the length along the polyline
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    at = shares * lengths[-1]
    return np.stack([np.interp(at, lengths, column) for column in corners.T], axis=1)


def _is_clear(corners: Floats, pieces: Sequence[Obstacle], keep: float) -> bool:
    """Whether a polyline keeps away from every piece, looked at in 200 places."""
    points = resampled(corners, np.linspace(0.0, 1.0, 200))
    return all(bool((piece.distance(points) > keep).all()) for piece in pieces)


def _grid(start: Floats, end: Floats, pieces: Sequence[Obstacle]) -> Floats:
    """Cells around everything, shape (n_1, ..., n_d, d)."""
    corners = np.concatenate([start[None], end[None], *(piece.vertices for piece in pieces)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    border = 0.15 * float((high - low).max()) + 0.2
    low, high = low - border, high + border
    size = float((high - low).max()) / CELLS[len(start)]
    axes = [np.arange(a, b + size, size) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def _trodden(grid: Floats, way: Floats) -> Floats:
    """How much slower each cell gets for lying on a way that is known, but near its ends."""
    # distance from the middle 80 % of the way; slower by up to 6 on it
    middle = resampled(way, np.linspace(0.1, 0.9, 60))
    near = np.min([np.linalg.norm(grid - point, axis=-1) for point in middle], axis=0)
    width = TRODDEN * float(np.ptp(grid.reshape(-1, grid.shape[-1]), axis=0).max())
    return np.asarray(6.0 * np.clip(1.0 - near / width, 0.0, 1.0))


def _shortest(grid: Floats, free: NDArray[np.bool_], slow: Floats, start: Floats, end: Floats) -> Floats | None:
    """Centres of the cells on a shortest way between the free cells nearest to both ends; None without one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    shape, d = free.shape, grid.shape[-1]
    index, centres, usable = np.arange(free.size).reshape(shape), grid.reshape(-1, d), free.ravel()
    if not usable.any():
        return None
    slow = slow.ravel()
    rows, columns, costs = [], [], []
    # edges between neighbouring cells, each pair once: length times the mean cost of both ends
    for move in product((-1, 0, 1), repeat=d):
        if move <= (0,) * d:
            continue
        here = tuple(slice(max(0, -m), n - max(0, m)) for m, n in zip(move, shape, strict=True))
        there = tuple(slice(max(0, m), n - max(0, -m)) for m, n in zip(move, shape, strict=True))
        a, b = index[here].ravel(), index[there].ravel()
        both = usable[a] & usable[b]
        a, b = a[both], b[both]
        rows.append(a)
        columns.append(b)
        costs.append(np.linalg.norm(centres[a] - centres[b], axis=1) * (slow[a] + slow[b]) / 2)
    places = (np.concatenate(rows), np.concatenate(columns))
    graph: Any = coo_array((np.concatenate(costs), places), shape=(free.size, free.size)).tocsr()
    first, last = (_nearest(centres, usable, place) for place in (start, end))
    # Dijkstra from the cell nearest to the start, then back from the end by predecessors
    searched: Any = dijkstra(graph, directed=False, indices=np.array([first]), return_predecessors=True)
    before = searched[1][0]
    if first != last and before[last] < 0:
        return None
    found = [last]
    while found[-1] != first:
        found.append(int(before[found[-1]]))
    return np.asarray(centres[found[::-1]])


def _nearest(centres: Floats, usable: NDArray[np.bool_], place: Floats) -> int:
    """The free cell nearest to a place."""
    away = np.where(usable, np.linalg.norm(centres - place, axis=1), np.inf)
    return int(away.argmin())


def _smoothed(corners: Floats, pieces: Sequence[Obstacle], keep: float) -> Floats:
    """A way in steps of the grid, made straighter while it stays clear."""
    for _ in range(20):
        tried = corners.copy()
        # binomial smoothing (1, 2, 1) / 4
        tried[1:-1] = (corners[:-2] + 2 * corners[1:-1] + corners[2:]) / 4
        if not _is_clear(tried, pieces, keep):
            break
        corners = tried
    return corners
