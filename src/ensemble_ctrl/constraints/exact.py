"""Decisions about points, lines and planes in exact arithmetic: turns, hulls, and intersections of half-spaces.

Every float is a whole number times a power of two, so a determinant of floats has a sign that can be found without
rounding. No tolerance stands in this file: near-equal corners stay apart, at any distance from the origin.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from itertools import combinations
from math import lcm

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Whole = tuple[int, int, int]
"""A line ``a x + b y = c``, or a point ``(x / w, y / w)``, in whole numbers."""

FRAME = 2**100
"""Half the side of the square, metres, beyond which a set counts as unbounded."""
FILTER = 4.0 * float(np.finfo(float).eps)
"""Relative error, rounded up, of a cross product of differences (Shewchuk 1997 has 3.3 units of half this size)."""
TINY = float(np.finfo(float).tiny)
"""Below it, products of floats lose digits."""


def corner_turns(corners: Array) -> Ints:
    """Sign of the turn at each corner of a closed polygon: 1 to the left, -1 to the right, 0 straight on or back."""
    before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
    first, second = corners - before, after - corners
    # cross product in floats, with Shewchuk's error bound; in rational numbers where its sign is not certain
    one, other = first[:, 0] * second[:, 1], first[:, 1] * second[:, 0]
    signs = np.sign(one - other).astype(np.int64)
    for k in np.flatnonzero(np.abs(one - other) <= FILTER * (np.abs(one) + np.abs(other)) + TINY):
        signs[k] = _rational_turn(before[k].tolist(), corners[k].tolist(), after[k].tolist())
    return signs


def turn(before: Sequence[float], corner: Sequence[float], after: Sequence[float]) -> float:
    """A number with the sign of the turn at one corner."""
    # as in `corner_turns`, for one corner
    one = (corner[0] - before[0]) * (after[1] - corner[1])
    other = (corner[1] - before[1]) * (after[0] - corner[0])
    if abs(one - other) > FILTER * (abs(one) + abs(other)) + TINY:
        return one - other
    return _rational_turn(before, corner, after)


def _rational_turn(*points: Sequence[float]) -> int:
    """The sign of the turn at the second of three points, in rational numbers."""
    (ax, ay), (bx, by), (cx, cy) = (map(Fraction, point) for point in points)
    cross = (bx - ax) * (cy - by) - (by - ay) * (cx - bx)
    return (cross > 0) - (cross < 0)


def hull(points: Array) -> Array:
    """The corners of the convex hull, counter-clockwise, some of `points` as they are; fewer than 3 if it is flat.

    Notes
    -----
    *Guarantee*: every point is inside of it or on its boundary, exactly. Straight corners are left out. Points that
    come counter-clockwise keep their order, and the first one that is a corner stays the first.
    """
    distinct, first = np.unique(points, axis=0, return_index=True)
    if len(distinct) < 3:
        return np.asarray(points[np.sort(first)])
    # Andrew's monotone chain on points sorted by x, then y
    listed = distinct.tolist()
    lower, upper = _chain(listed, range(len(listed))), _chain(listed, reversed(range(len(listed))))
    found = first[[*lower[:-1], *upper[:-1]]]
    return np.asarray(points[np.roll(found, -int(found.argmin()))])


def _chain(points: list[list[float]], order: Iterable[int]) -> list[int]:
    """The part of the hull that turns left along sorted points."""
    kept: list[int] = []
    for k in order:
        while len(kept) > 1 and turn(points[kept[-2]], points[kept[-1]], points[k]) <= 0:
            kept.pop()
        kept.append(k)
    return kept


def intersection(G: Array, h: Array) -> tuple[Array, bool]:
    """The corners of ``G x <= h`` in the plane, counter-clockwise, and whether the set is bounded.

    Parameters
    ----------
    G, h : ndarray, shapes (rows, 2) and (rows,)
        Finite.

    Returns
    -------
    corners : ndarray, shape (corners, 2)
        From the leftmost (of these the lowest) one on. None for an empty set, one for a point, two for a segment. Each
        is the exact corner rounded to the nearest floats; of an unbounded set, some lie on a square with sides of
        ``2 * FRAME``.
    bounded : bool
        An empty set is.
    """
    # a square of side 2 FRAME, cut by every row in homogeneous whole numbers
    lines: list[Whole] = [(0, -1, FRAME), (1, 0, FRAME), (0, 1, FRAME), (-1, 0, FRAME)]
    points: list[Whole] = [_crossing(a, b) for a, b in zip(lines[-1:] + lines[:-1], lines, strict=True)]
    for row in zip(*G.T.tolist(), h.tolist(), strict=True):
        points, lines = _cut(points, lines, _whole(row))
    # unbounded: a corner lies on the square; corners that round to the same floats are one
    bounded = all(max(abs(x), abs(y)) < FRAME * w for x, y, w in points)
    rounded = [(x / w, y / w) for x, y, w in points]
    corners = [point for k, point in enumerate(rounded) if k == 0 or point not in (rounded[k - 1], rounded[0])]
    first = corners.index(min(corners)) if corners else 0
    return np.array(corners[first:] + corners[:first]).reshape(-1, 2), bounded


def _whole(row: Iterable[float]) -> Whole:
    """A line times the number that makes it whole."""
    # floats are dyadic rationals: the least common denominator makes the row whole without rounding
    ratios = [value.as_integer_ratio() for value in row]
    scale = lcm(*(denominator for _, denominator in ratios))
    a, b, c = (numerator * (scale // denominator) for numerator, denominator in ratios)
    return a, b, c


def _crossing(first: Whole, second: Whole) -> Whole:
    """Where two lines that are not parallel cross."""
    (a, b, c), (d, e, f) = first, second
    # Cramer's rule
    x, y, w = c * e - b * f, a * f - c * d, a * e - b * d
    return (x, y, w) if w > 0 else (-x, -y, -w)


def _cut(points: list[Whole], lines: list[Whole], row: Whole) -> tuple[list[Whole], list[Whole]]:
    """A convex polygon without what lies beyond a line; line k leads from point k to the next one."""
    a, b, c = row
    # sign of a x + b y - c at each corner, scaled by w > 0
    beyond = [a * x + b * y - c * w for x, y, w in points]
    if all(value <= 0 for value in beyond):
        return points, lines
    # Sutherland and Hodgman 1974: corners on the near side stay, and sides that cross the line end on it
    kept: list[tuple[Whole, Whole]] = []
    for k, (here, point, line) in enumerate(zip(beyond, points, lines, strict=True)):
        there = beyond[(k + 1) % len(points)]
        if here <= 0:
            kept.append((point, line if there <= 0 else row if here == 0 else line))
        if here < 0 < there:
            kept.append((_crossing(line, row), row))
        elif there < 0 < here:
            kept.append((_crossing(line, row), line))
    return [point for point, _ in kept], [line for _, line in kept]


def space_corners(A: Array, b: Array) -> Array:
    """The corners of ``A x <= b`` in space, shape (corners, 3), each rounded once.

    Notes
    -----
    *Guarantee*: no corner is missing, however near it is to another one, or how flat the angle. Crossings of three
    planes are left out in floating point only where that is certain; the others are found in rational numbers.
    """
    # every three planes; floats discard crossings that are clearly outside, rational numbers decide the others
    triples = np.array(list(combinations(range(len(A)), 3)), dtype=np.int64).reshape(-1, 3)
    size = np.linalg.norm(A, axis=1)
    doubtful = triples[_maybe_inside(A / size[:, None], b / size, triples)]
    rows = [(*map(Fraction, row), Fraction(level)) for row, level in zip(A.tolist(), b.tolist(), strict=True)]
    found: set[tuple[Fraction, Fraction, Fraction]] = set()
    for i, j, k in doubtful.tolist():
        point = _plane_crossing(rows[i], rows[j], rows[k])
        if point is not None and all(r[0] * point[0] + r[1] * point[1] + r[2] * point[2] <= r[3] for r in rows):
            found.add(point)
    rounded = {tuple(float(x) for x in point) for point in found}
    return np.array(sorted(rounded)).reshape(-1, 3)


def _maybe_inside(G: Array, h: Array, triples: Ints) -> NDArray[np.bool_]:
    """Which crossings of three planes may be inside of all others: those that are clearly outside are not."""
    maybe = np.ones(len(triples), dtype=bool)
    # only well-conditioned crossings, |det| > 1e-4 for unit rows, with a slack far above their error
    sure = np.abs(np.linalg.det(G[triples])) > 1e-4
    points = np.linalg.solve(G[triples[sure]], h[triples[sure]][..., None])[..., 0]
    slack = 1e-6 * (1.0 + np.abs(h).max(initial=0.0) + np.abs(points).max(axis=1, initial=0.0))
    maybe[sure] = (points @ G.T <= h + slack[:, None]).all(axis=1)
    return maybe


def _plane_crossing(*planes: Sequence[Fraction]) -> tuple[Fraction, Fraction, Fraction] | None:
    """Where three planes cross, by Cramer's rule; None if they do not in one point."""
    (a, b, c, p), (d, e, f, q), (g, h, i, r) = planes
    det = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    if det == 0:
        return None
    x = p * (e * i - f * h) - b * (q * i - f * r) + c * (q * h - e * r)
    y = a * (q * i - f * r) - p * (d * i - f * g) + c * (d * r - q * g)
    z = a * (e * r - q * h) - b * (d * r - q * g) + p * (d * h - e * g)
    return x / det, y / det, z / det
