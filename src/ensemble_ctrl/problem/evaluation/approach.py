"""Smallest distance of members from what they avoid, evaluated only where they may be close."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.problem.specification import AvoidConstraint

Floats = NDArray[np.float64]


def approach(
    paths: Floats, box: tuple[Floats, Floats], times: Floats, avoid: AvoidConstraint
) -> tuple[Floats, NDArray[np.int64]]:
    """Each member's smallest distance from the pieces of what is avoided, and the time index of it.

    Of the times of its window, only those are evaluated where the block's bounding box is as close as some member's
    smallest distance so far, or overlaps.
    """
    when = np.flatnonzero(avoid.during(times))
    closest, at = np.full(len(paths), np.inf), np.zeros(len(paths), dtype=np.int64)
    members, moved = np.arange(len(paths)), avoid.offsets(times)
    for piece in avoid.pieces:
        # branch and bound over time: no member is closer than the bounding box
        bound = _box_distance(box[0][when] - moved[when], box[1][when] - moved[when], piece) - avoid.radius
        for group in _nearest_first(bound):
            if bound[group[0]] > max(float(closest.max()), 0.0):
                break
            seen = paths[:, when[group]]
            distance = piece.distance(seen if avoid.motion is None else seen - moved[when[group]]) - avoid.radius
            k = distance.argmin(axis=1)
            least = distance[members, k]
            at = np.where(least < closest, when[group][k], at)
            closest = np.minimum(least, closest)
    return closest, at


def _box_distance(low: Floats, high: Floats, piece: Obstacle) -> Floats:
    """Distance between the block's bounding box and the piece's at each time: a lower bound of any member's."""
    corners = piece.vertices
    # gap of two boxes along each axis, 0 where they overlap
    apart = np.maximum(np.maximum(low - corners.max(axis=0), corners.min(axis=0) - high), 0.0)
    return np.asarray(np.linalg.norm(apart, axis=1))


def _nearest_first(bound: Floats) -> Iterator[NDArray[np.int64]]:
    """Time indices in groups of 16, nearest first."""
    order = np.argsort(bound, kind="stable")
    for i in range(0, len(order), 16):
        yield order[i : i + 16]
