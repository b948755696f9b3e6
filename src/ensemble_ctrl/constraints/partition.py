"""Triangles of a polygon joined to convex pieces: diagonals that no reflex corner needs are taken out, longest first.

Hertel and Mehlhorn, Fast triangulation of simple polygons (1983). Every diagonal is tested once, and the pieces are
bounded by diagonals and sides alone, so that together they are the polygon.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import exact

Array = NDArray[np.float64]
Point = tuple[float, float]
Side = tuple[Point, Point]
"""A directed side of a piece, which lies to its left."""

STRAIGHT = 1e-10
"""Sine of the largest turn to the right that counts as straight on: corners on one line, but for rounding."""


def convex_parts(triangles: Array) -> list[Array]:
    """Convex polygons made of the triangles of a polygon, that share whole sides.

    Parameters
    ----------
    triangles : ndarray, shape (triangles, 3, 2)
        Metres; in either direction.

    Returns
    -------
    list of ndarray, shape (corners, 2)
        Counter-clockwise. *Guarantee*: every triangle lies in one of them, and their corners are corners of triangles;
        a piece that is convex but for rounding is replaced by its hull.
    """
    behind = _sides(triangles)
    before = {after: side for side, after in behind.items()}
    # a side whose reverse belongs to another triangle is a diagonal
    diagonals = [(u, v) for u, v in behind if u < v and (v, u) in behind]
    # Hertel and Mehlhorn 1983: a diagonal is inessential if both of its ends stay convex without it
    for u, v in sorted(diagonals, key=_length, reverse=True):
        ends = [(before[side], behind[side[::-1]]) for side in ((u, v), (v, u))]
        if all(_is_convex(come[0], come[1], go[1]) for come, go in ends):
            for come, go in ends:
                behind[come], before[go] = go, come
            for side in ((u, v), (v, u)):
                del behind[side], before[side]
    return [exact.hull(np.array(corners)) for corners in _loops(behind)]


def _sides(triangles: Array) -> dict[Side, Side]:
    """Each side of each triangle, counter-clockwise, and the one after it."""
    behind: dict[Side, Side] = {}
    for triangle in triangles.tolist():
        a, b, c = map(tuple, triangle)
        # every triangle counter-clockwise, by an exact turn
        if exact.turn(a, b, c) < 0:
            b, c = c, b
        behind |= {(a, b): (b, c), (b, c): (c, a), (c, a): (a, b)}
    return behind


def _length(side: Side) -> float:
    """Of a side, metres."""
    (ax, ay), (bx, by) = side
    return hypot(bx - ax, by - ay)


def _is_convex(come: Point, corner: Point, go: Point) -> bool:
    """Whether a way turns left, or goes straight on but for rounding."""
    first, second = (corner[0] - come[0], corner[1] - come[1]), (go[0] - corner[0], go[1] - corner[1])
    # sine and cosine of the turn, times both lengths
    cross, along = first[0] * second[1] - first[1] * second[0], first[0] * second[0] + first[1] * second[1]
    return cross >= 0.0 or (along > 0.0 and cross > -STRAIGHT * hypot(*first) * hypot(*second))


def _loops(behind: dict[Side, Side]) -> Iterator[list[Point]]:
    """The corners of each piece."""
    done: set[Side] = set()
    for first in behind:
        side, corners = first, []
        while side not in done:
            done.add(side)
            corners.append(side[0])
            side = behind[side]
        if corners:
            yield corners
