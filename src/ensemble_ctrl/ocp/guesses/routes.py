"""Shortest routes around obstacles, one for each way of passing them.

A visibility graph over the corners of the grown obstacles is searched together with each route's crossing word: rays go
up from every obstacle, and a route is identified by the rays it crosses in order, left (-) or right (+), a crossing
and its return cancelled.  Two routes with different words can't be deformed into each other (Bhattacharya et al.,
Topological constraints in search-based robot path planning, 2012).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from itertools import count, islice

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.core.deferred import dataclass

Floats = NDArray[np.float64]
Word = tuple[int, ...]

LONGEST = 2.5
"""Routes without loops end at this many times the length of the shortest."""
MANY, SECTORS = 20, 1024
"""From how many pieces on shadows are looked at first, and in how many sectors round each corner."""
EXPANSIONS = 20_000
"""Largest number of search states taken up in one search."""


@dataclass(frozen=True, eq=False)
class Route:
    """A polyline around the obstacles.

    Attributes
    ----------
    corners : ndarray, shape (corners, 2)
        Metres, start and end included.
    length : float
        Metres.
    word : tuple of int
        Crossing word: +-(i + 1) for the ray above piece i.
    """

    corners: Floats
    length: float
    word: Word


def routes(
    start: Floats, goal: Floats, pieces: Sequence[Obstacle], clearance: float, most: int, loops: bool = True
) -> list[Route]:
    """The shortest routes of different kinds that keep `clearance` metres from the obstacles.

    Parameters
    ----------
    start, goal : ndarray, shape (2,)
        Metres.
    pieces : sequence of Obstacle
        Convex pieces to go around.
    clearance : float
        Metres.
    most : int
        Largest number of routes.
    loops : bool
        Whether a route may meet itself or go round an obstacle; without loops a kind is left out if its shortest route
        does, and routes end at `LONGEST` times the shortest.

    Returns
    -------
    list of Route
        Shortest first; empty where no way leads to the goal.
    """
    corners = np.array([start, goal, *_corners(pieces, clearance)], dtype=float)
    keep = _clear_points(corners, pieces, clearance)
    keep[:2] = True
    corners = corners[keep]
    lengths = _visible_lengths(corners, pieces, clearance)
    if not _is_connected(lengths):
        return []
    anchors = np.array([piece.vertices.mean(axis=0) for piece in pieces]).reshape(-1, 2)
    if loops:
        return list(islice(_search(corners, lengths, anchors), most))
    found: list[Route] = []
    for route in islice(_search(corners, lengths, anchors, is_simple), most):
        if found and route.length > LONGEST * found[0].length + 1e-9:
            break
        found.append(route)
    return found


def _is_connected(lengths: Floats) -> bool:
    """Whether any way leads from corner 0 to corner 1; where none does, the search would try every word first."""
    reached = np.arange(len(lengths)) == 0
    while not reached[1]:
        # breadth-first: all corners that are seen from those reached
        wider = reached | np.isfinite(lengths[reached]).any(axis=0)
        if (wider == reached).all():
            return False
        reached = wider
    return True


def corridor_route(start: Floats, goal: Floats, regions: Sequence[Polyhedron]) -> Route | None:
    """The shortest route that never leaves the union of convex `regions`, through the middles of their overlaps."""
    # nodes: middles of the overlaps of two regions; edges within one region
    middles = [
        both.vertices.mean(axis=0)
        for i, a in enumerate(regions)
        for b in regions[i + 1 :]
        if not (both := Polyhedron(*(np.concatenate(part) for part in _rows(a, b)))).is_empty
        and both.is_bounded
        and len(both.vertices)
    ]
    places = np.array([start, goal, *middles], dtype=float)
    inside = np.array([region.contains(places) for region in regions])
    together = (inside[:, :, None] & inside[:, None, :]).any(axis=0)
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    lengths = np.where(together & (apart > 0), apart, np.inf)
    return next(_search(places, lengths, np.zeros((0, 2))), None)


def _rows(a: Polyhedron, b: Polyhedron) -> Iterator[tuple[Floats, Floats]]:
    """The rows and bounds of two polyhedra, to be joined."""
    yield a.A, b.A
    yield a.lower, b.lower
    yield a.upper, b.upper


def is_simple(path: Floats, anchors: Floats) -> bool:
    """Whether a polyline never crosses itself and goes less than once round each anchor.

    Parameters
    ----------
    path : ndarray, shape (corners, 2)
        Metres; all but its last segment are taken to be simple already.
    anchors : ndarray, shape (anchors, 2)
        Points not on the path.
    """
    return not _crosses_itself(path) and bool((np.ptp(swept(path, anchors), axis=0) < 2 * np.pi).all())


def swept(path: Floats, anchors: Floats) -> Floats:
    """Angle in radians, counter-clockwise, by which a polyline has gone round each anchor; shape (corners, anchors)."""
    rays = path[:, None] - anchors
    a, b = rays[:-1], rays[1:]
    # angle from one ray to the next: atan2 of cross and dot product
    turns = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], (a * b).sum(axis=-1))
    return np.concatenate([np.zeros((1, len(anchors))), turns.cumsum(axis=0)])


def _crosses_itself(path: Floats) -> bool:
    """Whether the last segment crosses an earlier one."""
    if len(path) < 4:
        return False
    a, b = path[-2], path[-1]
    # segments cross where each has the ends of the other on both sides
    beside = np.sign(_cross(b - a, path[:-2] - a))
    c, d = path[:-3], path[1:-2]
    across = np.sign(_cross(d - c, a - c)) * np.sign(_cross(d - c, b - c)) < 0
    return bool((across & (beside[:-1] * beside[1:] < 0)).any())


def _cross(a: Floats, b: Floats) -> Floats:
    """Cross product in the plane."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _search(
    corners: Floats, lengths: Floats, anchors: Floats, allowed: Callable[[Floats, Floats], bool] | None = None
) -> Iterator[Route]:
    """A* over (corner, word) from corner 0; yields each new word that arrives at corner 1, shortest first.

    What is left of the way is at least the shortest way whatever its word. With `allowed`, of a path and the anchors, a
    state whose shortest path is not allowed leads nowhere.
    """
    order, left = count(), _ways_left(lengths)
    seen: set[tuple[int, Word]] = set()
    queue: list[tuple[float, int, float, int, Word, tuple[int, ...]]] = [(left[0], next(order), 0.0, 0, (), (0,))]
    while queue and len(seen) < EXPANSIONS:
        _, _, length, here, word, path = heapq.heappop(queue)
        if (here, word) in seen:
            continue
        seen.add((here, word))
        if allowed and not allowed(corners[list(path)], anchors):
            continue
        if here == 1:
            yield Route(corners[list(path)], length, word)
            continue
        for there in np.flatnonzero(np.isfinite(lengths[here])).tolist():
            # the word of the way with this segment; the estimate is the length so far and the shortest way left
            longer = _extended(word, corners[here], corners[there], anchors)
            if there not in path and (there, longer) not in seen:
                step = length + float(lengths[here, there])
                heapq.heappush(queue, (step + left[there], next(order), step, there, longer, (*path, there)))


def _ways_left(lengths: Floats) -> list[float]:
    """Length of the shortest way from each corner to corner 1, infinite where there is none (Dijkstra)."""
    left = np.full(len(lengths), np.inf)
    left[1] = 0.0
    waiting = np.ones(len(lengths), dtype=bool)
    while np.isfinite(left[waiting]).any():
        here = int(np.where(waiting, left, np.inf).argmin())
        waiting[here] = False
        np.minimum(left, left[here] + lengths[:, here], out=left)
    return left.tolist()


def _extended(word: Word, a: Floats, b: Floats, anchors: Floats) -> Word:
    """The word after walking from `a` to `b`, with cancelling neighbours removed."""
    if not len(anchors) or a[0] == b[0]:
        return word
    # rays go up from the anchors: crossed where the segment passes over one, + to the right, - to the left
    crossed = (anchors[:, 0] >= min(a[0], b[0])) & (anchors[:, 0] < max(a[0], b[0]))
    fraction = (anchors[:, 0] - a[0]) / (b[0] - a[0])
    above = crossed & (a[1] + fraction * (b[1] - a[1]) > anchors[:, 1])
    sign = 1 if b[0] > a[0] else -1
    letters = list(word)
    for i in sorted(np.flatnonzero(above), key=lambda i: fraction[i]):
        letter = sign * (int(i) + 1)
        if letters and letters[-1] == -letter:
            letters.pop()
        else:
            letters.append(letter)
    return tuple(letters)


def _corners(pieces: Sequence[Obstacle], clearance: float) -> Iterator[Floats]:
    """Corners of the obstacles grown by `clearance`, with sharp tips cut off at two clearances."""
    for piece in pieces:
        v = piece.vertices
        out = _outward(v)
        # mitred offset: along the bisector by 1 / cos of half the turn, at most 2
        mid = out + np.roll(out, 1, axis=0)
        mid /= np.linalg.norm(mid, axis=1)[:, None]
        stretch = np.minimum(1 / np.maximum((mid * out).sum(axis=1), 1e-3), 2.0)
        yield from v + 1.001 * clearance * stretch[:, None] * mid


def _clear_points(points: Floats, pieces: Sequence[Obstacle], clearance: float) -> NDArray[np.bool_]:
    """Which points keep (nearly) their clearance from every obstacle."""
    clear = np.ones(len(points), dtype=bool)
    for piece in pieces:
        clear &= piece.distance(points) > 0.99 * clearance
    return clear


def _visible_lengths(corners: Floats, pieces: Sequence[Obstacle], clearance: float) -> Floats:
    """Length of each straight connection, infinite where an obstacle (grown by most of the clearance) is hit."""
    # visibility graph: lengths of pairs that see each other; shadows and boxes first, then the segment test
    i, j = np.nonzero(np.triu(~_shadowed(corners, pieces, 0.9 * clearance), 1))
    a, b = corners[i], corners[j]
    low, high = np.minimum(a, b).T, np.maximum(a, b).T
    blocked = np.zeros(len(i), dtype=bool)
    free = np.arange(len(i))
    for piece in pieces:
        (left, under), (right, over) = _box(piece, 0.9 * clearance)
        near = free[(low[0, free] < right) & (high[0, free] > left)]
        near = near[(low[1, near] < over) & (high[1, near] > under)]
        blocked[near] = _hits(a[near], b[near], piece, 0.9 * clearance)
        free = free[~blocked[free]]
    lengths = np.full((len(corners), len(corners)), np.inf)
    lengths[i, j] = lengths[j, i] = np.where(blocked, np.inf, np.linalg.norm(b - a, axis=1))
    return lengths


def _shadowed(corners: Floats, pieces: Sequence[Obstacle], grown: float) -> NDArray[np.bool_]:
    """Pairs that are hidden from each other by a disc inside of a grown piece: most pairs, among many pieces.

    Each corner sees as far in a direction as to the nearest disc that covers all of its sector.
    """
    hidden = np.zeros((len(corners), len(corners)), dtype=bool)
    if len(pieces) < MANY:
        return hidden
    middles = np.array([piece.vertices.mean(axis=0) for piece in pieces])
    radius = 0.99 * np.array([_inradius(piece, middle) + grown for piece, middle in zip(pieces, middles, strict=True)])
    width = 2 * np.pi / SECTORS
    for k, corner in enumerate(corners):
        away, others = middles - corner, corners - corner
        far = np.hypot(*away.T)
        discs = far > radius
        # sectors wholly within the angle asin(r / d) to either side of the disc's middle
        angle, half = np.arctan2(away[discs, 1], away[discs, 0]), np.arcsin(radius[discs] / far[discs])
        first, last = np.ceil((angle - half) / width).astype(int), np.floor((angle + half) / width).astype(int)
        wide = np.maximum(last - first, 0)
        place = np.arange(wide.sum()) - np.repeat(np.cumsum(wide) - wide, wide) + np.repeat(first, wide)
        depth = np.full(SECTORS, np.inf)
        np.minimum.at(depth, place % SECTORS, np.repeat(far[discs], wide))
        # behind the disc's middle the segment passes through the disc
        sector = np.floor(np.arctan2(others[:, 1], others[:, 0]) / width).astype(int) % SECTORS
        hidden[k] = np.hypot(*others.T) > depth[sector]
    return hidden


def _inradius(piece: Obstacle, middle: Floats) -> float:
    """Distance from a point inside of a convex piece to its nearest side."""
    return float(((piece.A @ middle - piece.b) / np.linalg.norm(piece.A, axis=1)).min())


def _box(piece: Obstacle, grown: float) -> tuple[Floats, Floats]:
    """Low and high corner of the box round a piece with every side moved outwards by `grown`."""
    out = _outward(piece.vertices)
    before = np.roll(out, 1, axis=0)
    # corners of the polygon with all sides moved out: v + grown (n_1 + n_2) / (1 + n_1 . n_2)
    tips = piece.vertices + grown * (out + before) / (1 + (out * before).sum(axis=1))[:, None]
    return tips.min(axis=0), tips.max(axis=0)


def _outward(corners: Floats) -> Floats:
    """Unit normals of the sides that begin at each corner of a convex polygon."""
    along = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return np.asarray(normals / np.linalg.norm(along, axis=1)[:, None])


def _hits(a: Floats, b: Floats, piece: Obstacle, grown: float) -> NDArray[np.bool_]:
    """Whether segments a-b meet the convex piece with every side moved outwards by `grown`."""
    length = np.linalg.norm(piece.A, axis=1)
    inward, level = piece.A / length[:, None], piece.b / length - grown
    # Cyrus-Beck: the share of the segment that is inside of all sides, from `enter` to `leave`
    depth_a, depth_b = a @ inward.T - level, b @ inward.T - level
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = depth_a / (depth_a - depth_b)
    enter = np.where((depth_a < 0) & (depth_b >= 0), crossing, 0.0).max(axis=1)
    leave = np.where((depth_a >= 0) & (depth_b < 0), crossing, 1.0).min(axis=1)
    outside = ((depth_a < 0) & (depth_b < 0)).any(axis=1)
    return np.asarray(~outside & (enter < leave - 1e-9))
