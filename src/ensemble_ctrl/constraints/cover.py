"""Few convex polygons that cover a set: neighbours are joined to their hull wherever that is allowed.

Every polygon that is given stays inside one of those that come back, so joining can only grow what is covered. The
pairs that add the least area are joined first, as many at a time as have no polygon in common.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.exact import turn

Floats = NDArray[np.float64]
Shapes = NDArray[np.object_]
"""An array of shapely polygons."""
Allowed = Callable[[Shapes, Floats], NDArray[np.bool_]]
"""Which hulls may replace their two polygons, from the hulls and the area that each adds."""

CORNERS = 8
"""Polygons with more corners lose some, where a tolerance allows it."""


def joined(shapes: Shapes, allowed: Allowed, reach: float = 0.0) -> Shapes:
    """Join convex polygons to convex polygons, until no hull of two neighbours is allowed.

    Parameters
    ----------
    shapes : ndarray of shapely.Polygon, shape (n,)
        Convex.
    allowed : callable
        ``allowed(hulls, added)`` with the area that each hull adds to its two polygons, which counts their overlap
        twice.
    reach : float
        Largest distance between polygons that are neighbours.

    Returns
    -------
    ndarray of shapely.Polygon, shape (m,)
        Convex. *Guarantee*: each of `shapes` lies in one of them, to the last bit.
    """
    import shapely

    found = _Pairs(np.asarray(shapes, dtype=object), allowed, reach)
    while len(chosen := found.disjoint()):
        # replace each chosen pair by its hull, and drop polygons that a hull covers
        hulls = found.hulls[chosen]
        gone = np.zeros(len(found.shapes), dtype=bool)
        gone[found.pairs[chosen]] = True
        gone[shapely.STRtree(found.shapes).query(hulls, predicate="covers")[1]] = True
        found.replace(gone, hulls)
    return found.shapes


class _Pairs:
    """The polygons there are, and the allowed hulls of two neighbours."""

    def __init__(self, shapes: Shapes, allowed: Allowed, reach: float) -> None:
        self.shapes, self._allowed, self._reach = shapes, allowed, reach
        self.pairs = np.zeros((0, 2), dtype=np.int64)
        self.hulls: Shapes = np.zeros(0, dtype=object)
        self._added = np.zeros(0)
        self._find(0)

    def disjoint(self) -> NDArray[np.int64]:
        """Indices of pairs that have no polygon in common, those that add least first."""
        taken, chosen = np.zeros(len(self.shapes), dtype=bool), []
        # greedy matching in the order of the area added
        for k in np.argsort(self._added, kind="stable").tolist():
            a, b = self.pairs[k]
            if not (taken[a] or taken[b]):
                taken[a] = taken[b] = True
                chosen.append(k)
        return np.array(chosen, dtype=np.int64)

    def replace(self, gone: NDArray[np.bool_], hulls: Shapes) -> None:
        """Take some polygons out and put others in."""
        kept = ~gone[self.pairs].any(axis=1)
        # new indices of the polygons that stay
        place = np.cumsum(~gone) - 1
        self.pairs, self.hulls, self._added = place[self.pairs[kept]], self.hulls[kept], self._added[kept]
        self.shapes = np.concatenate([self.shapes[~gone], hulls])
        self._find(len(self.shapes) - len(hulls))

    def _find(self, first: int) -> None:
        """Add the allowed pairs of the polygons from `first` on with all others."""
        import shapely

        new, old = shapely.STRtree(self.shapes).query(self.shapes[first:], predicate="dwithin", distance=self._reach)
        new = new + first
        # neighbours within reach, each pair once
        once = (old < first) | (old < new)
        pairs = np.column_stack([new[once], old[once]])
        hulls = shapely.convex_hull(shapely.geometrycollections(self.shapes[pairs]))
        area = shapely.area(self.shapes)
        # area that a join adds; what overlaps counts as gained
        added = shapely.area(hulls) - area[pairs].sum(axis=1)
        good = self._allowed(hulls, added)
        self.pairs = np.concatenate([self.pairs, pairs[good]])
        self.hulls = np.concatenate([self.hulls, hulls[good]])
        self._added = np.concatenate([self._added, added[good]])


def within(area: Any) -> Allowed:
    """Allow the hulls that a shapely geometry covers."""
    import shapely

    shapely.prepare(area)

    def allowed(hulls: Shapes, added: Floats) -> NDArray[np.bool_]:
        return np.asarray(shapely.covers(area, hulls), dtype=bool)

    return allowed


def with_fewer_corners(corners: Floats, area: Any, most: int) -> Floats:
    """Grow a convex polygon until it has at most `most` corners, as far as it stays inside of an area.

    Parameters
    ----------
    corners : ndarray, shape (n, 2)
        Counter-clockwise, without straight ones.
    area : shapely geometry
        Prepared (`shapely.prepare`), if many polygons are tested against it.
    most : int
        Sides are taken out one by one, those that add least first, and their neighbours extended until they meet.

    Returns
    -------
    ndarray, shape (m, 2)
        *Guarantee*: contains the polygon.
    """
    import shapely

    while len(corners) > most:
        # ear of a side: the triangle between it and the point where its neighbours meet
        tips = _tips(corners)
        sides = np.flatnonzero(np.isfinite(tips).all(axis=1))
        ears = shapely.polygons(np.stack([corners, tips, np.roll(corners, -1, axis=0)], axis=1)[sides])
        order = np.argsort(shapely.area(ears), kind="stable").tolist()
        kept = (k for k in order if _holds(corners, int(sides[k]), tips[sides[k]]) and shapely.covers(area, ears[k]))
        side = next((int(sides[k]) for k in kept), None)
        if side is None:
            break
        corners = np.delete(np.roll(corners, -side, axis=0), 0, axis=0)
        corners[0] = tips[side]
    return corners


def _tips(corners: Floats) -> Floats:
    """Where the neighbours of each side meet beyond it, shape (n, 2), a few roundings further out; else not finite."""
    # unit directions of the sides, and those of both neighbours
    along = np.roll(corners, -1, axis=0) - corners
    along /= np.linalg.norm(along, axis=1)[:, None]
    before, behind = np.roll(along, 1, axis=0), np.roll(along, -1, axis=0)
    gap = np.roll(corners, -1, axis=0) - corners
    # intersection of the neighbours' lines by Cramer's rule; no tip where they are parallel or diverge
    sine = before[:, 0] * behind[:, 1] - before[:, 1] * behind[:, 0]
    share = gap[:, 0] * behind[:, 1] - gap[:, 1] * behind[:, 0]
    outwards = np.stack([before[:, 1] + behind[:, 1], -before[:, 0] - behind[:, 0]], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead = np.where(sine > 1e-12, share / sine, np.nan)
        outwards /= 1 + np.einsum("ij,ij->i", before, behind)[:, None]
    # a few roundings outwards, so that the side stays inside
    further = 64 * np.finfo(float).eps * np.abs(corners).max()
    return np.asarray(corners + ahead[:, None] * before + further * outwards)


def _holds(corners: Floats, side: int, tip: Floats) -> bool:
    """Whether a polygon with a tip in place of a side still holds both ends of the side and is convex, exactly."""
    two_before, before, first, last, behind, two_behind = corners[(side + np.arange(-2, 4)) % len(corners)].tolist()
    outside = tip.tolist()
    kept = turn(before, first, outside) <= 0 and turn(outside, last, behind) <= 0
    return kept and turn(two_before, before, outside) > 0 and turn(outside, behind, two_behind) > 0
