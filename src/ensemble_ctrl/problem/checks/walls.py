"""Closed walls: obstacles all around the start, or all around a region, without a gap that a robot fits through."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.constraints.disc import obstacle_of
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem.checks.finding import SLACK, Finding
from ensemble_ctrl.problem.checks.presence import Presence

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from ensemble_ctrl.problem.problem import Problem
    from ensemble_ctrl.problem.specification import AvoidConstraint

Floats = NDArray[np.float64]

MOST = 400
"""Convex pieces beyond which no wall is looked for."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A convex set that the middle of a robot never enters: all that is nearer to a polygon than its radius.

    Attributes
    ----------
    name : str
        In words.
    corners : ndarray, shape (corners, 2)
        Of the polygon, which is convex, or the middle of a disc; metres from the start.
    radius : float
        Metres; of a disc, its own is in it.
    """

    name: str
    corners: Floats
    radius: float

    @property
    def middle(self) -> Floats:
        """A point well inside."""
        return np.asarray(self.corners.mean(axis=0))


@dataclass(frozen=True, eq=False)
class Wall:
    """A closed polyline that no robot crosses, with the start on one side and a region on the other.

    Attributes
    ----------
    pieces : tuple of Piece
        In order around it.
    corners : ndarray, shape (2 n, 2)
        A point of each piece, and after it one that it shares with the next; metres from the start.
    around_start : bool
        Whether the start is inside of it, and not the region.
    """

    pieces: tuple[Piece, ...]
    corners: Floats
    around_start: bool


def wall_findings(problem: Problem, way: Sequence[Presence]) -> Iterator[Finding]:
    """Regions of a way of doing the task that no way leads to."""
    if len(problem.fleet.places) != 2:
        return
    for presence in way:
        region = problem.regions.get(presence.leaf.name)
        if region is None or region.is_empty or not region.is_bounded or len(region.vertices) < 3:
            continue
        wall = closed(pieces(problem, way, presence.latest), obstacle_of(region).vertices - problem.fleet.start_place)
        if wall is not None:
            body = problem.fleet.footprint
            yield _closed_in(presence, wall, problem.fleet.radius + (0.0 if body is None else body.narrow))


def pieces(problem: Problem, way: Sequence[Presence], until: float) -> list[Piece]:
    """What robots never enter up to a time: static obstacles, and what is outside of regions that they stay in."""
    origin, until = problem.fleet.start_place, min(until, problem.duration)
    found = [
        Piece(repr(avoid.name), piece.core - origin, piece.rounding + kept_clear(avoid))
        for avoid in problem.specification.avoid
        if avoid.motion is None
        and (avoid.footprint is None or avoid.footprint.holds_point)
        and avoid.begin <= 0
        and avoid.end >= until
        for piece in avoid.pieces
    ]
    size = 1.0 + max((float(np.abs(piece.corners).max()) for piece in found), default=0.0)
    for stay in way:
        region = problem.regions.get(stay.leaf.name)
        throughout = not stay.chosen and stay.hold[0] <= 0 and stay.hold[1] >= until
        if throughout and region is not None and region.is_bounded and len(region.vertices) > 2:
            found += _outside(stay.leaf.name, region, origin, size)
    return found


def kept_clear(avoid: AvoidConstraint) -> float:
    """Metres around the planned point that are kept out, whatever the heading: a disc within the body."""
    return avoid.radius + (0.0 if avoid.footprint is None else max(0.0, avoid.footprint.narrow - SLACK))


def _outside(name: str, region: Polyhedron, origin: Floats, size: float) -> Iterator[Piece]:
    """Rectangles beyond each side of a polygon; those of neighbouring sides overlap."""
    corners = obstacle_of(region).vertices - origin
    long = size + float(np.abs(corners).max())
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = long * (b - a) / float(np.hypot(*(b - a)))
        # a side from left to right has its outside below: (dx, dy) turned by -90 degrees
        out = np.array([along[1], -along[0]])
        rectangle = [a - along, a - along + out, b + along + out, b + along]
        yield Piece(f"the edge of {name!r}", np.array(rectangle), 0.0)


def closed(parts: Sequence[Piece], region: Floats) -> Wall | None:
    """A wall of some pieces between the start, which is the origin, and a convex region, if one is found.

    Parameters
    ----------
    parts : sequence of Piece
    region : ndarray, shape (corners, 2)
        Metres from the start.

    Returns
    -------
    Wall or None

    Notes
    -----
    *Guarantee*: a path from the start to the region crosses the wall, so a robot on it enters a piece. Each side of the
    polyline has both ends in one piece, which is convex, at least a slack of 1e-9 m for each metre of a coordinate from
    its boundary; and the polyline winds around the start another number of times than around the region, which are
    both further from it than that. Rounding is a millionth of the slack. None proves nothing.
    """
    goal = region.mean(axis=0)
    if len(parts) > MOST or not (_is_blocked(parts, goal) and _may_surround(parts)):
        return None
    joints = _joints(parts)
    # a closed curve separates two places if it crosses the line between them an odd number of times
    odd = {pair: _crosses(parts[pair[0]].middle, at, parts[pair[1]].middle, goal) for pair, at in joints.items()}
    next_to: dict[int, list[int]] = {}
    for a, b in joints:
        next_to.setdefault(a, []).append(b)
    best: list[int] | None = None
    for first in sorted({a for a, b in joints if odd[a, b]}):
        cycle = _odd_cycle(first, next_to, odd)
        best = cycle if cycle and (best is None or len(cycle) < len(best)) else best
    return None if best is None else _checked([parts[k] for k in best], best, joints, region)


def _is_blocked(parts: Sequence[Piece], goal: Floats) -> bool:
    """Whether something may be on the straight line from the start to a place."""
    if not parts:
        return False
    # distance of each middle from the segment, less the circle around the piece
    middles = np.array([part.middle for part in parts])
    reach = [float(np.hypot(*(part.corners - part.middle).T).max()) + part.radius for part in parts]
    share = np.clip(middles @ goal / max(float(goal @ goal), 1e-300), 0.0, 1.0)
    return bool((np.hypot(*(middles - share[:, None] * goal).T) <= np.array(reach)).any())


def _may_surround(parts: Sequence[Piece]) -> bool:
    """Whether three pieces or more may touch each other in a ring, by the boxes around them."""
    low = np.array([part.corners.min(axis=0) - part.radius for part in parts])
    high = np.array([part.corners.max(axis=0) + part.radius for part in parts])
    touch = ((low[:, None] <= high) & (low <= high[:, None])).all(axis=2) & ~np.eye(len(parts), dtype=bool)
    # pieces with fewer than two neighbours are in no ring; without them, others may have fewer
    while len(touch) and not (some := touch.sum(axis=1) >= 2).all():
        touch = touch[np.ix_(some, some)]
    return len(touch) > 0


def _joints(parts: Sequence[Piece]) -> dict[tuple[int, int], Floats]:
    """Points that two pieces share, by the pieces, each pair both ways around."""
    import shapely

    shapes = np.array([_shape(part) for part in parts])
    radii = [part.radius for part in parts]
    near = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=2 * max(radii))
    found: dict[tuple[int, int], Floats] = {}
    for a, b in zip(*near.tolist(), strict=True):
        if a >= b or shapes[a].distance(shapes[b]) > radii[a] + radii[b]:
            continue
        both = shapes[a].intersection(shapes[b])
        if both.is_empty:
            # halfway between where both end on the shortest line between the polygons, d long: r_a and d - r_b
            ends = np.array(shapely.shortest_line(shapes[a], shapes[b]).coords)
            d = float(np.hypot(*(ends[1] - ends[0])))
            at = ends[0] + (radii[a] + d - radii[b]) / 2 * (ends[1] - ends[0]) / d
        else:
            at = np.array(both.centroid.coords[0])
        found[a, b] = found[b, a] = at
    return found


def _crosses(before: Floats, at: Floats, after: Floats, goal: Floats) -> bool:
    """Whether the way over a joint crosses the line from the origin to the goal an odd number of times."""
    return _cuts(before, at, goal) != _cuts(at, after, goal)


def _cuts(a: Floats, b: Floats, goal: Floats) -> bool:
    """Whether a segment crosses the line from the origin to the goal."""

    def side(p: Floats, q: Floats, r: Floats) -> bool:
        return bool((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]) > 0)

    zero = np.zeros(2)
    return side(zero, goal, a) != side(zero, goal, b) and side(a, b, zero) != side(a, b, goal)


def _odd_cycle(first: int, next_to: dict[int, list[int]], odd: dict[tuple[int, int], bool]) -> list[int] | None:
    """The shortest closed walk over joints from a piece that crosses the line an odd number of times."""
    # breadth first over (piece, parity of crossings so far)
    start, end = (first, False), (first, True)
    before = {start: start}
    waiting = deque([start])
    while waiting and end not in before:
        here = waiting.popleft()
        for piece in next_to[here[0]]:
            there = (piece, here[1] != odd[here[0], piece])
            if there not in before:
                before[there] = here
                waiting.append(there)
    if end not in before:
        return None
    walk, here = list[int](), before[end]
    while here != start:
        walk.append(here[0])
        here = before[here]
    return [first, *walk[::-1]]


def _checked(
    parts: Sequence[Piece], numbers: Sequence[int], joints: dict[tuple[int, int], Floats], region: Floats
) -> Wall | None:
    """The wall along some pieces, if it is one: all that `closed` guarantees is looked at here."""
    import shapely

    shared = [joints[a, b] for a, b in zip(numbers, [*numbers[1:], numbers[0]], strict=True)]
    corners = np.concatenate([[part.middle, at] for part, at in zip(parts, shared, strict=True)])
    slack = SLACK * max(1.0, float(np.abs(corners).max()), float(np.abs(region).max()))
    # depth of both ends of each side in the piece that the side is in
    sides = zip(parts, [shared[-1], *shared[:-1]], shared, strict=True)
    depths = [_depths(part, np.array([one, part.middle, two])) for part, one, two in sides]
    ring = shapely.LinearRing(corners)
    apart = min(ring.distance(shapely.Point(0.0, 0.0)), ring.distance(shapely.Polygon(region)))
    turns = _winding(corners, np.zeros(2)), _winding(corners, region[0])
    if np.min(depths) <= slack or apart <= slack or turns[0] == turns[1]:
        return None
    return Wall(tuple(parts), corners, turns[0] != 0)


def _depths(part: Piece, points: Floats) -> Floats:
    """How deep points are in a piece, shape (points,), metres; below zero outside."""
    import shapely

    area, dots = _shape(part), shapely.points(points)
    inside = np.where(shapely.contains(area, dots), shapely.distance(area.boundary, dots), 0.0)
    return np.asarray(part.radius + inside - shapely.distance(area, dots))


def _shape(part: Piece) -> BaseGeometry:
    """The hull of a piece's corners."""
    from shapely import MultiPoint

    return MultiPoint(part.corners).convex_hull


def _winding(corners: Floats, point: Floats) -> int:
    """How often a closed polyline winds around a point."""
    seen = corners - point
    after = np.roll(seen, -1, axis=0)
    cross = seen[:, 0] * after[:, 1] - seen[:, 1] * after[:, 0]
    return round(float(np.arctan2(cross, (seen * after).sum(axis=1)).sum()) / (2 * np.pi))


def _closed_in(presence: Presence, wall: Wall, radius: float) -> Finding:
    """A finding for a region that no way leads to."""
    names = sorted({part.name for part in wall.pieces})
    listed = ", ".join(names[:-1]) + " and " + names[-1] if len(names) > 1 else names[0]
    inside = "the start" if wall.around_start else "the region"
    message = f"no way leads from the start to {presence.leaf.name!r}: {listed} close {inside} in"
    width = f" wider than the robots, {2 * radius:g} m" if radius else ""
    hint = f"open a gap{width}, or do not avoid one of them throughout"
    column = presence.leaf.column
    return Finding(("task",), message, hint, offset=column - 1 if column else None)


__all__ = ["Piece", "Wall", "closed", "pieces", "wall_findings"]
