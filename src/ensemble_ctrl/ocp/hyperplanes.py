"""Separating hyperplanes between the fleet and convex obstacles: the disjunction over facets, decided.

A hyperplane with unit normal `n` keeps a set of points clear of an obstacle by ``min n.p - max n.vertex``.  With the
hyperplanes fixed, avoiding is a set of linear rows.  Re-choosing them at the solution of the last round keeps that
solution feasible, so the rounds never get worse.

In the plane the best normal is looked for among directions.  In space it is along the shortest way between both convex
hulls (E. G. Gilbert, An iterative procedure for computing the minimum of a quadratic form on a convex set, 1966); where
they overlap, along the facet that is left soonest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem.specification import AvoidConstraint

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

DIRECTIONS = 72
"""Directions tried before the best one is refined."""
ITERATIONS = 60
"""Of Gilbert's algorithm; the hyperplane is valid after any number of them."""
REACH = 0.15
"""Pairs closer than this share of the map's size are constrained from the start."""


@dataclass(frozen=True, eq=False)
class Hyperplanes:
    """For each pair of a convex piece and a step, the best hyperplane found, or one for each cell of the fleet.

    A *side* is a piece as seen by one cell; sides are numbered by cell, then piece.

    Attributes
    ----------
    parts : tuple of ndarray
        For each cell the matrix from the fleet's points to its own.
    cell : ndarray of int, shape (sides,)
        The cell of each side.
    radius : ndarray, shape (sides,)
        Metres by which each piece grows.
    active : ndarray of bool, shape (sides, steps)
        Whether the piece is to be kept out of during the step.
    normal : ndarray, shape (sides, steps, d)
        Unit normals, pointing to the fleet's side.
    support : ndarray, shape (sides, steps)
        Largest ``n . vertex`` of the piece, and of half the box of start positions, and what the piece bends from a
        straight motion during the step, metres.
    drift : ndarray, shape (sides, steps, 2)
        How far the piece has moved along ``n`` at both ends of the step, metres.
    gap : ndarray, shape (sides, steps)
        Distance in metres, beyond the radius, between the points of the step and the piece along the normal; negative
        where none separates them, infinite where the pair is not active.  *Guarantee*: never above the true
        distance between their convex hulls.
    """

    parts: tuple[Floats, ...]
    cell: Ints
    radius: Floats
    active: NDArray[np.bool_]
    normal: Floats
    support: Floats
    drift: Floats
    gap: Floats

    def joined(self, other: Hyperplanes) -> Hyperplanes:
        """All sides of both."""
        cell = np.concatenate([self.cell, other.cell + len(self.parts)])
        names = ("radius", "active", "normal", "support", "drift", "gap")
        rest = [np.concatenate([getattr(self, name), getattr(other, name)]) for name in names]
        return Hyperplanes(self.parts + other.parts, cell, *rest)

    def grown(self, within: Floats) -> Hyperplanes:
        """The same for a fleet that grows by so much in each step, metres."""
        return replace(self, support=self.support + within, gap=self.gap - within)

    def nearest(self, points: Floats) -> Floats:
        """Smallest ``n . p`` over a cell's points, relative to the piece, at both ends of each step, (sides, steps)."""
        near = np.empty(self.support.shape)
        for cell, part in enumerate(self.parts):
            # min_i n . P_i - drift at the begin and at the end of each step, the smaller of both
            own, rows = part @ points, self.cell == cell
            ends = [
                np.einsum("tpd,otd->otp", own[end : len(own) - 1 + end], self.normal[rows]).min(axis=2, initial=np.inf)
                for end in (0, 1)
            ]
            near[rows] = np.minimum(*(least - self.drift[rows, :, end] for end, least in enumerate(ends)))
        return near


def separate(
    points: Floats,
    avoid: Sequence[AvoidConstraint],
    duration: float,
    shift: Floats | None = None,
    parts: tuple[Floats, ...] | None = None,
    near: float = np.inf,
    begin: float = 0.0,
    within: float = np.inf,
) -> Hyperplanes:
    """Best separating hyperplanes for every step, points at both its ends together.

    Parameters
    ----------
    points : ndarray, shape (steps + 1, points, d)
        Metres.
    avoid : sequence of AvoidConstraint
        What to keep out of, and when.
    duration : float
        Seconds from the first point to the last.
    shift : ndarray, shape (d,), optional
        Half the sides of a box of start positions, metres: it lies around every point.
    parts : tuple of ndarray, optional
        For each cell of the fleet the matrix from the points to its own; one cell if not given.
    near : float
        Metres beyond which a hyperplane across an axis will do.
    begin : float
        Time of the first point, seconds.
    within : float
        Pairs whose bounding boxes are further apart, in metres, are left out, as if they were not active.
    """
    steps, d = len(points) - 1, points.shape[2]
    shift = np.zeros(d) if shift is None else shift
    parts = (np.eye(points.shape[1]),) if parts is None else parts
    pieces = [(piece, each) for each in avoid for piece in each.pieces]
    if not pieces:
        none, normals, ends = np.zeros((0, steps)), np.zeros((0, steps, d)), np.zeros((0, steps, 2))
        return Hyperplanes(parts, np.zeros(0, dtype=int), np.zeros(0), none.astype(bool), normals, none, ends, none)
    times = np.linspace(begin, begin + duration, steps + 1)
    offsets, bent = [each.offsets(times) for _, each in pieces], [each.bends(times) for _, each in pieces]
    # a moving obstacle in its own frame: points relative to it at both ends of a step, plus its deviation from a chord
    moved, bends = np.tile(offsets, (len(parts), 1, 1)), np.tile(bent, (len(parts), 1))
    shapes, places = [piece for piece, _ in pieces], np.array(offsets)
    reach = near + np.array([each.radius + float(bend.max()) for (_, each), bend in zip(pieces, bent, strict=True)])
    found = [_found(part @ points, shapes, places, shift, reach, within) for part in parts]
    normal, support, gap = (np.concatenate(column) for column in zip(*found, strict=True))
    drift = np.stack([np.einsum("otd,otd->ot", normal, end) for end in (moved[:, :-1], moved[:, 1:])], axis=-1)
    # gap beyond the radius, less what a moving piece bends within the step
    radius = np.tile([each.radius for _, each in pieces], len(parts))
    active = np.tile([each.steps(steps, duration, begin) for _, each in pieces], (len(parts), 1)) & (gap < np.inf)
    gap = np.where(active, gap - bends - radius[:, None], np.inf)
    cell = np.repeat(np.arange(len(parts)), len(pieces))
    return Hyperplanes(parts, cell, radius, active, normal, support + bends, drift, gap)


def _found(
    own: Floats, pieces: Sequence[Obstacle], offsets: Floats, shift: Floats, near: Floats, within: float
) -> tuple[Floats, Floats, Floats]:
    """Normal, support and gap of the best hyperplane for each convex piece at every step.

    Beyond `near`, a number for each piece, of one across an axis; beyond `within` the gap is infinite.
    """
    normal, support, gap = _across_axes(own, pieces, offsets, shift)
    close = gap <= np.minimum(near, within)[:, None]
    best = _by_direction if own.shape[2] == 2 else _by_shortest_way
    for o in np.flatnonzero(close.any(axis=1)).tolist():
        rows = np.flatnonzero(close[o])
        ends = [own[rows + end] - offsets[o, rows + end, None] for end in (0, 1)]
        normal[o, rows], support[o, rows], gap[o, rows] = best(np.concatenate(ends, axis=1), pieces[o], shift)
    gap[~close & (gap > within)] = np.inf
    return normal, support, gap


def _across_axes(
    own: Floats, pieces: Sequence[Obstacle], offsets: Floats, shift: Floats
) -> tuple[Floats, Floats, Floats]:
    """Normal, support and gap of the best hyperplane across an axis, between bounding boxes, for all pieces at once."""
    # boxes of the points at each grid time, relative to each piece, and of both ends of each step together
    low, high = own.min(axis=1) - offsets, own.max(axis=1) - offsets
    low, high = np.minimum(low[:, :-1], low[:, 1:]) - shift, np.maximum(high[:, :-1], high[:, 1:]) + shift
    under, over = (np.stack([end(piece.vertices, axis=0) for piece in pieces])[:, None] for end in (np.min, np.max))
    # gaps along +x, +y, .., -x, -y, ..
    beyond = np.concatenate([low - over, under - high], axis=2)
    side = beyond.argmax(axis=2)
    normal = np.concatenate([np.eye(own.shape[2]), -np.eye(own.shape[2])])[side]
    support = np.take_along_axis(np.concatenate([over, -under], axis=2)[:, 0], side, axis=1) + np.tile(shift, 2)[side]
    return normal, support, beyond.max(axis=2)


def _by_shortest_way(points: Floats, piece: Obstacle, shift: Floats) -> tuple[Floats, Floats, Floats]:
    """Best normal, support and gap for one convex piece at every step, in any dimension."""
    steps, rows, vertices = len(points), np.arange(len(points)), piece.core
    facets, _ = piece.unit_rows()
    # start from the facet with the largest gap: where the hulls overlap, it is left soonest
    gaps = np.stack([_gap(points, vertices, np.broadcast_to(n, (steps, len(n))), shift) for n in facets])
    which = gaps.argmax(axis=0)
    normal, gap = facets[which], gaps[which, rows]
    # Gilbert: `nearest` is a point of the difference of both hulls, moved towards the one that lies least along it
    nearest = points.mean(axis=1) - vertices.mean(axis=0)
    for _ in range(ITERATIONS):
        length = np.linalg.norm(nearest, axis=1, keepdims=True)
        tried = np.where(length > 1e-12, nearest / np.maximum(length, 1e-12), normal)
        here = _gap(points, vertices, tried, shift)
        better = here > gap
        normal, gap = np.where(better[:, None], tried, normal), np.where(better, here, gap)
        far = points[rows, np.einsum("tpd,td->tp", points, tried).argmin(axis=1)]
        far = far - vertices[(tried @ vertices.T).argmax(axis=1)]
        along = far - nearest
        share = -np.einsum("td,td->t", nearest, along) / np.maximum(np.einsum("td,td->t", along, along), 1e-18)
        nearest = nearest + np.clip(share, 0.0, 1.0)[:, None] * along
    return normal, (normal @ vertices.T).max(axis=1) + np.abs(normal) @ shift, gap


def _gap(points: Floats, vertices: Floats, normal: Floats, shift: Floats) -> Floats:
    """``min n.p - max n.vertex - |n|.shift`` at every step, for normals of shape (steps, d)."""
    near = np.einsum("tpd,td->tp", points, normal).min(axis=1)
    return np.asarray(near - (normal @ vertices.T).max(axis=1) - np.abs(normal) @ shift)


def _by_direction(points: Floats, piece: Obstacle, shift: Floats) -> tuple[Floats, Floats, Floats]:
    """Best normal, support and gap for one convex piece at every step, in the plane."""
    vertices = piece.core
    # gap(n) = min n.p - max n.vertex - |n|.shift, along even directions and the edges' normals; the best is refined
    angles = np.linspace(0.0, 2 * np.pi, DIRECTIONS, endpoint=False)
    edges = np.roll(vertices, -1, axis=0) - vertices
    angles = np.concatenate([angles, np.arctan2(-edges[:, 0], edges[:, 1])])
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    gaps = (points @ normals.T).min(axis=1) - (vertices @ normals.T).max(axis=0) - np.abs(normals) @ shift
    angle = angles[gaps.argmax(axis=1)]
    width = 2 * np.pi / DIRECTIONS
    for _ in range(2):
        angle, gap = _refined(points, vertices, shift, angle, width)
        width /= 5
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    support = (normal @ vertices.T).max(axis=1) + np.abs(normal) @ shift + piece.rounding
    return normal, support, gap - piece.rounding


def _refined(points: Floats, vertices: Floats, shift: Floats, angle: Floats, width: float) -> tuple[Floats, Floats]:
    """Best of eleven angles within `width` around each given one, and its gap."""
    # gap(n) at eleven angles around each step's best
    tried = angle[:, None] + width * np.linspace(-1.0, 1.0, 11)
    normals = np.stack([np.cos(tried), np.sin(tried)], axis=-1)
    near = np.einsum("tpd,tad->tap", points, normals).min(axis=2)
    gaps = near - (normals @ vertices.T).max(axis=2) - np.abs(normals) @ shift
    best = gaps.argmax(axis=1)
    rows = np.arange(len(angle))
    return tried[rows, best], gaps[rows, best]
