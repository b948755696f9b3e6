"""Signed distances of points and convex bodies from polygons and discs, from corners alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .world import Shape

Floats = NDArray[np.float64]


def is_disc(shape: Shape) -> bool:
    """Whether a shape is a centre and a radius."""
    return isinstance(shape[0], float)


def _corners(shape: Shape) -> Floats:
    """Corners, counter-clockwise; of a disc its centre."""
    if is_disc(shape):
        return np.array([shape[:2]], dtype=float)
    corners = np.array(shape, dtype=float)
    x, y = (corners - corners[0]).T
    return corners if (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() > 0 else corners[::-1]


def distance(shape: Shape, points: Floats) -> Floats:
    """Of points of shape (..., 2); minus the depth inside."""
    corners = _corners(shape)
    if is_disc(shape):
        return np.asarray(np.hypot(*np.moveaxis(points - corners[0], -1, 0)) - shape[2])
    found = np.full(points.shape[:-1], np.inf)
    beyond = np.full(points.shape[:-1], -np.inf)
    for here, there in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = there - here
        away = points - here
        share = np.clip((away @ along) / (along @ along), 0, 1)
        found = np.minimum(found, np.linalg.norm(away - share[..., None] * along, axis=-1))
        beyond = np.maximum(beyond, away @ np.array([along[1], -along[0]]) / np.hypot(*along))
    return np.where(beyond > 0, found, beyond)


def beyond_sides(shape: Shape, points: Floats, radius: float) -> Floats:
    """At least how far points are beyond a side of a polygon grown by a radius with sharp corners, or of a disc."""
    if is_disc(shape):
        return distance(shape, points) - radius
    corners, found = _corners(shape), np.full(points.shape[:-1], -np.inf)
    for here, there in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = there - here
        found = np.maximum(found, (points - here) @ np.array([along[1], -along[0]]) / np.hypot(*along))
    return found - radius


def body_distance(shape: Shape, footprint: Floats, places: Floats, headings: Floats) -> Floats:
    """Of bodies at poses, (..., 2) and (...), from a shape; minus the depth where they overlap."""
    core = _corners(shape)
    turn = np.stack([np.cos(headings), np.sin(headings), -np.sin(headings), np.cos(headings)], axis=-1)
    turn = turn.reshape(*headings.shape, 2, 2)
    body = places[..., None, :] + footprint @ turn
    gap = np.full(headings.shape, -np.inf)
    apart = np.full(headings.shape, np.inf)
    count = len(footprint)
    for k in range(count):
        side = body[..., (k + 1) % count, :] - body[..., k, :]
        normal = np.stack([side[..., 1], -side[..., 0]], axis=-1) / np.linalg.norm(side, axis=-1)[..., None]
        away = core - body[..., k, None, :]
        gap = np.maximum(gap, (away @ normal[..., None])[..., 0].min(axis=-1))
        share = np.clip((away @ side[..., None])[..., 0] / (side**2).sum(axis=-1)[..., None], 0, 1)
        rest = away - share[..., None] * side[..., None, :]
        apart = np.minimum(apart, np.linalg.norm(rest, axis=-1).min(axis=-1))
    if len(core) > 1:
        for k, here in enumerate(core):
            along = core[(k + 1) % len(core)] - here
            normal = np.array([along[1], -along[0]]) / np.hypot(*along)
            gap = np.maximum(gap, ((body - here) @ normal).min(axis=-1))
        apart = np.minimum(apart, np.abs(distance(shape, body)).min(axis=-1))
    found = np.where(gap > 0, apart, gap)
    return found - (shape[2] if is_disc(shape) else 0.0)
