"""Signed distances to convex polygons in extended precision, from their corners alone."""

from __future__ import annotations

import numpy as np

from .model import Long, Longs, Polygon


def corners_of(polygon: Polygon) -> Longs:
    """Corners, counter-clockwise, shape (corners, 2)."""
    corners = np.array(polygon, dtype=Long)
    x, y = (corners - corners[0]).T
    area = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    return corners if area > 0 else corners[::-1]


def facet_clearances(corners: Longs, points: Longs) -> Longs:
    """Distance beyond the line of each side, shape (..., sides)."""
    along = np.roll(corners, -1, axis=0) - corners
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.hypot(along[:, 0], along[:, 1])[:, None]
    away = points[..., None, :] - corners
    return np.asarray((away * outward).sum(axis=-1))


def signed_distance(corners: Longs, points: Longs) -> Longs:
    """Distance of points from a polygon, minus the depth inside."""
    clearance = facet_clearances(corners, points).max(axis=-1)
    along = np.roll(corners, -1, axis=0) - corners
    away = points[..., None, :] - corners
    share = np.clip((away * along).sum(axis=-1) / (along**2).sum(axis=-1), Long(0), Long(1))
    rest = away - share[..., None] * along
    outside = np.hypot(rest[..., 0], rest[..., 1]).min(axis=-1)
    return np.asarray(np.where(clearance > 0, outside, clearance))
