"""Separating hyperplanes between the fleet and convex obstacles: the disjunction over facets, decided.

A line with unit normal `n` keeps a set of points clear of an obstacle by ``min n.p - max n.vertex``.  With the lines
fixed, avoiding is a set of linear rows.  Re-choosing them at the solution of the last round keeps that solution
feasible, so the rounds never get worse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem.specification import AvoidConstraint

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

DIRECTIONS = 72
"""Directions tried before the best one is refined."""
REACH = 0.15
"""Pairs closer than this share of the map's size are constrained from the start."""


@dataclass(frozen=True, eq=False)
class Hyperplanes:
    """For each pair of a convex piece and a step, the best line found, or one for each cell of the fleet.

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
    normal : ndarray, shape (sides, steps, 2)
        Unit normals, pointing to the fleet's side.
    support : ndarray, shape (sides, steps)
        Largest ``n . vertex`` of the piece, and of half the box of start positions, and what the piece bends from a
        straight motion during the step, metres.
    drift : ndarray, shape (sides, steps, 2)
        How far the piece has moved along ``n`` at both ends of the step, metres.
    gap : ndarray, shape (sides, steps)
        Distance in metres, beyond the radius, between the points of the step and the piece along the normal; negative
        where no line separates them, infinite where the pair is not active.  *Guarantee*: never above the true
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

    def nearest(self, points: Floats) -> Floats:
        """Smallest ``n . p`` over a cell's points, relative to the piece, at both ends of each step, (sides, steps)."""
        near = np.empty(self.support.shape)
        for cell, part in enumerate(self.parts):
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
    points : ndarray, shape (steps + 1, points, 2)
        Metres.
    avoid : sequence of AvoidConstraint
        What to keep out of, and when.
    duration : float
        Seconds from the first point to the last.
    shift : ndarray, shape (2,), optional
        Half the sides of a box of start positions, metres: it lies around every point.
    parts : tuple of ndarray, optional
        For each cell of the fleet the matrix from the points to its own; one cell if not given.
    near : float
        Metres beyond which a line along an axis will do.
    begin : float
        Time of the first point, seconds.
    within : float
        Pairs whose bounding boxes are further apart, in metres, are left out, as if they were not active.
    """
    shift = np.zeros(2) if shift is None else shift
    parts = (np.eye(points.shape[1]),) if parts is None else parts
    steps = len(points) - 1
    pieces = [(piece, each) for each in avoid for piece in each.pieces]
    if not pieces:
        none, pairs = np.zeros((0, steps)), np.zeros((0, steps, 2))
        return Hyperplanes(parts, np.zeros(0, dtype=int), np.zeros(0), none.astype(bool), pairs, none, pairs, none)
    times = np.linspace(begin, begin + duration, steps + 1)
    offsets, bent = [each.offsets(times) for _, each in pieces], [each.bends(times) for _, each in pieces]
    moved, bends = np.tile(offsets, (len(parts), 1, 1)), np.tile(bent, (len(parts), 1))
    found = [
        _found(_both_ends(own - offset[:, None]), piece.vertices, shift, near + each.radius + float(bend.max()), within)
        for own in (part @ points for part in parts)
        for (piece, each), offset, bend in zip(pieces, offsets, bent, strict=True)
    ]
    normal, support, gap = (np.stack(column) for column in zip(*found, strict=True))
    drift = np.stack([np.einsum("otd,otd->ot", normal, end) for end in (moved[:, :-1], moved[:, 1:])], axis=-1)
    radius = np.tile([each.radius for _, each in pieces], len(parts))
    active = np.tile([each.steps(steps, duration, begin) for _, each in pieces], (len(parts), 1)) & (gap < np.inf)
    gap = np.where(active, gap - bends - radius[:, None], np.inf)
    cell = np.repeat(np.arange(len(parts)), len(pieces))
    return Hyperplanes(parts, cell, radius, active, normal, support + bends, drift, gap)


def _both_ends(points: Floats) -> Floats:
    """The points at both ends of each step together, shape (steps, 2 * points, 2)."""
    return np.concatenate([points[:-1], points[1:]], axis=1)


def _found(
    points: Floats, vertices: Floats, shift: Floats, near: float, within: float
) -> tuple[Floats, Floats, Floats]:
    """Normal, support and gap of the best line for one convex piece at every step.

    Beyond `near` of a line along an axis; beyond `within` the gap is infinite.
    """
    ends = points.max(axis=1) + shift, points.min(axis=1) - shift
    beyond = np.stack([ends[1] - vertices.max(axis=0), vertices.min(axis=0) - ends[0]], axis=1).reshape(len(points), 4)
    side, gap = beyond.argmax(axis=1), beyond.max(axis=1)
    normal = np.concatenate([np.eye(2), -np.eye(2)])[side]
    support = (normal @ vertices.T).max(axis=1) + np.abs(normal) @ shift
    close = gap <= min(near, within)
    if close.any():
        normal[close], support[close], gap[close] = _best(points[close], vertices, shift)
    gap[~close & (gap > within)] = np.inf
    return normal, support, gap


def _best(points: Floats, vertices: Floats, shift: Floats) -> tuple[Floats, Floats, Floats]:
    """Best normal, support and gap for one convex piece at every step."""
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
    return normal, (normal @ vertices.T).max(axis=1) + np.abs(normal) @ shift, gap


def _refined(points: Floats, vertices: Floats, shift: Floats, angle: Floats, width: float) -> tuple[Floats, Floats]:
    """Best of eleven angles within `width` around each given one, and its gap."""
    tried = angle[:, None] + width * np.linspace(-1.0, 1.0, 11)
    normals = np.stack([np.cos(tried), np.sin(tried)], axis=-1)
    near = np.einsum("tpd,tad->tap", points, normals).min(axis=2)
    gaps = near - (normals @ vertices.T).max(axis=2) - np.abs(normals) @ shift
    best = gaps.argmax(axis=1)
    rows = np.arange(len(angle))
    return tried[rows, best], gaps[rows, best]
