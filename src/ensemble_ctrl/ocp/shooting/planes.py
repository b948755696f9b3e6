"""Separating planes between the fleet and convex obstacles, fixed for a round as hyperplanes are in the plane.

A plane with unit normal `n` keeps points clear of an obstacle by ``min n.p - max n.vertex``.  The best plane is along
the shortest way between both convex hulls (Gilbert's algorithm on their difference); where they overlap, along the
facet that is left soonest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.problem.specification import AvoidConstraint

Floats = NDArray[np.float64]

ITERATIONS = 60
"""Of Gilbert's algorithm; the plane is valid after any number of them."""


@dataclass(frozen=True, eq=False)
class Planes:
    """For each pair of a convex piece and a step, the best plane found.

    Attributes
    ----------
    radius : ndarray, shape (pieces,)
        Metres by which each piece grows.
    active : ndarray of bool, shape (pieces, steps)
        Whether the piece is to be kept out of during the step.
    normal : ndarray, shape (pieces, steps, d)
        Unit normals, pointing to the fleet's side.
    support : ndarray, shape (pieces, steps)
        Largest ``n . vertex`` of the piece, metres.
    gap : ndarray, shape (pieces, steps)
        Distance in metres, beyond the radius, between the points of the step and the piece along the normal; negative
        where no plane was found, infinite where the pair is not active.  *Guarantee*: never above the true distance
        between their convex hulls.
    """

    radius: Floats
    active: NDArray[np.bool_]
    normal: Floats
    support: Floats
    gap: Floats


def separate(points: Floats, avoid: Sequence[AvoidConstraint], duration: float) -> Planes:
    """Best separating planes for every step, points at both its ends together.

    Parameters
    ----------
    points : ndarray, shape (steps + 1, points, d)
        Metres.
    avoid : sequence of AvoidConstraint
        What to keep out of, and when.
    duration : float
        Seconds from the first point to the last.
    """
    steps, d = len(points) - 1, points.shape[2]
    pieces = [(piece, each) for each in avoid for piece in each.pieces]
    both = np.concatenate([points[:-1], points[1:]], axis=1)
    found = [_best(both, piece) for piece, _ in pieces]
    radius = np.array([each.radius for _, each in pieces])
    active = np.array([each.steps(steps, duration) for _, each in pieces], dtype=bool).reshape(-1, steps)
    normal = np.array([n for n, _, _ in found]).reshape(-1, steps, d)
    support = np.array([s for _, s, _ in found]).reshape(-1, steps)
    gap = np.array([g for _, _, g in found]).reshape(-1, steps)
    return Planes(radius, active, normal, support, np.where(active, gap - radius[:, None], np.inf))


def _best(points: Floats, piece: Obstacle) -> tuple[Floats, Floats, Floats]:
    """Best normal, support and gap for one convex piece at every step."""
    steps, rows, vertices = len(points), np.arange(len(points)), piece.vertices
    facets, _ = piece.unit_rows()
    gaps = np.stack([_gap(points, vertices, np.broadcast_to(n, (steps, len(n)))) for n in facets])
    which = gaps.argmax(axis=0)
    normal, gap = facets[which], gaps[which, rows]
    nearest = points.mean(axis=1) - vertices.mean(axis=0)
    for _ in range(ITERATIONS):
        length = np.linalg.norm(nearest, axis=1, keepdims=True)
        tried = np.where(length > 1e-12, nearest / np.maximum(length, 1e-12), normal)
        here = _gap(points, vertices, tried)
        better = here > gap
        normal, gap = np.where(better[:, None], tried, normal), np.where(better, here, gap)
        far = points[rows, np.einsum("tpd,td->tp", points, tried).argmin(axis=1)]
        far = far - vertices[(tried @ vertices.T).argmax(axis=1)]
        along = far - nearest
        share = -np.einsum("td,td->t", nearest, along) / np.maximum(np.einsum("td,td->t", along, along), 1e-18)
        nearest = nearest + np.clip(share, 0.0, 1.0)[:, None] * along
    return normal, (normal @ vertices.T).max(axis=1), gap


def _gap(points: Floats, vertices: Floats, normal: Floats) -> Floats:
    """Distance of the points of every step from the piece along normals of shape (steps, d)."""
    near = np.einsum("tpd,td->tp", points, normal).min(axis=1)
    return np.asarray(near - (normal @ vertices.T).max(axis=1))
