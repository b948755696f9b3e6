"""A convex polyhedron in space as an obstacle, with its corners, edges and exact distances."""

from __future__ import annotations

from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.constraints._rows import TOLERANCE, is_cone_trivial
from ensemble_ctrl.constraints.exact import space_corners
from ensemble_ctrl.constraints.obstacle import Obstacle
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import numbers

Array = NDArray[np.float64]
BLOCK = 8192
"""Points at a time: the temporaries of one block stay in the cache."""


class Solid(Obstacle):
    r"""The bounded polyhedron ``A x >= b`` in space; the free side of facet i is ``a_i x <= b_i``.

    Parameters
    ----------
    A : array_like, shape (facets, 3)
        Dimensionless, pointing into the solid.
    b : array_like, shape (facets,)
        Metres, when the rows of `A` have length one.

    Raises
    ------
    ProblemError
        If a shape is wrong, a number is not finite, or the set is empty, flat or unbounded.

    Examples
    --------
    >>> wall = Solid.box([[0, 1], [-2, 2], [0, 3]])
    >>> wall.distance([[-3.0, 0.0, 7.0], [0.5, 0.0, 1.0]])
    array([ 5. , -0.5])
    """

    def __init__(self, A: ArrayLike, b: ArrayLike) -> None:
        self._set_rows(A, b, 3)
        G, h = self.unit_rows()
        if not is_cone_trivial(G):
            raise ProblemError("Solid: expected a bounded polyhedron, got an unbounded set")
        corners = space_corners(-self.A, -self.b)
        # distance of the corners' mean from the nearest facet: positive where there is a volume
        depth = (h - G @ corners.mean(axis=0)).min() if len(corners) else 0.0
        if len(corners) < 4 or depth <= TOLERANCE * np.ptp(corners, axis=0).max():
            raise ProblemError("Solid: expected a polyhedron with a volume, got an empty or flat set")
        self._set_corners(corners)

    @classmethod
    def box(cls, bounds: ArrayLike) -> Solid:
        """Box ``[[x low, x high], [y low, y high], [z low, z high]]``, metres."""
        pairs = numbers("Solid.box", bounds, "[[low, high], ...]")
        if pairs.shape != (3, 2):
            wanted = "[[x low, x high], [y low, y high], [z low, z high]]"
            raise ProblemError(f"Solid.box: expected {wanted}, got shape {pairs.shape}")
        if not (pairs[:, 0] < pairs[:, 1]).all():
            raise ProblemError(f"Solid.box: expected low < high, got {pairs.tolist()}")
        levels = np.concatenate([pairs[:, 0], 0.0 - pairs[:, 1]])
        return cls._of(np.vstack([np.eye(3), 0.0 - np.eye(3)]), levels, np.array(list(product(*pairs))))

    @classmethod
    def hull(cls, points: ArrayLike) -> Solid:
        """Convex hull of points in space, shape (points, 3), metres.

        Notes
        -----
        *Guarantee*: it may only grow. Its `vertices` are some of the points, and all of them satisfy its rows.
        """
        from scipy.spatial import ConvexHull, QhullError

        corners = numbers("Solid.hull", points, "points [[x, y, z], ...]")
        if corners.ndim != 2 or corners.shape[1] != 3 or not np.isfinite(corners).all():
            raise ProblemError(f"Solid.hull: expected finite points of shape (points, 3), got shape {corners.shape}")
        try:
            found = ConvexHull(corners)
        except (QhullError, ValueError):
            raise ProblemError("Solid.hull: expected points with a volume, got too few or flat ones") from None
        # Qhull's facet normals, coplanar triangles once; levels rounded outwards
        normals = np.unique(np.round(found.equations[:, :3], 12), axis=0)
        levels = (normals @ corners.T).max(axis=1) + 8 * np.finfo(float).eps * np.abs(corners).max()
        return cls._of(-normals, -levels, corners[found.vertices])

    @cached_property
    def edges(self) -> Array:
        """Both ends of every edge, shape (edges, 2, 3), metres."""
        G, h = self.unit_rows()
        # two corners that share two facets are the ends of an edge
        near = 1e-7 * np.ptp(self.vertices, axis=0).max() + 64 * np.finfo(float).eps * np.abs(self.vertices).max()
        on = np.abs(self.vertices @ G.T - h) <= near
        shared = on.astype(int) @ on.T.astype(int)
        first, second = np.nonzero(np.triu(shared >= 2, 1))
        return np.stack([self.vertices[first], self.vertices[second]], axis=1)

    def facet_clearance(self, points: ArrayLike) -> Array:
        """``max_i (b_i - a_i x)`` with unit rows: (..., 3) to (...), metres.

        Notes
        -----
        *Guarantee*: positive exactly outside, and there a lower bound of the Euclidean distance; inside it is
        minus the exact depth.
        """
        G, h = self.unit_rows()
        return np.asarray((self._points(points) @ G.T - h).max(axis=-1))

    def distance(self, points: ArrayLike) -> Array:
        """Exact signed Euclidean distance: (..., 3) to (...), metres; minus the depth inside.

        Notes
        -----
        Outside, the nearest point is in a facet, on an edge or a corner: the smallest distance to a facet whose plane's
        nearest point is in it, and to every edge.
        """
        p = self._points(points)
        flat = p.reshape(-1, 3)
        parts = [self._distance_of(flat[i : i + BLOCK]) for i in range(0, len(flat), BLOCK)]
        return (np.concatenate(parts) if parts else np.zeros(0)).reshape(p.shape[:-1])

    def distance_along(self, coordinates: Array) -> Array:
        """`distance` of points given by their coordinates one after the other, (3, ...) to (...)."""
        return self.distance(np.moveaxis(coordinates, 0, -1))

    def _points(self, points: ArrayLike) -> Array:
        """The points as an array whose last axis is checked."""
        p = np.asarray(points, dtype=float)
        if p.ndim == 0 or p.shape[-1] != 3:
            raise ProblemError(f"points: expected shape (..., 3), got {p.shape}")
        return p

    def _distance_of(self, p: Array) -> Array:
        """Signed distance of points of shape (points, 3)."""
        G, h = self.unit_rows()
        # inside: minus the distance from the nearest facet, max_i (g_i x - h_i)
        heights = p @ G.T - h
        result = heights.max(axis=1)
        outside = np.flatnonzero(result > 0)
        if not len(outside):
            return np.asarray(result)
        # outside: the foot on a facet's plane, where it lies on the solid, or the nearest point of an edge
        q, least = p[outside], np.full(len(outside), np.inf)
        slack = 1e-9 * max(1.0, float(np.abs(h).max()))
        for k, normal in enumerate(G):
            height = heights[outside, k]
            foot = q - height[:, None] * normal
            within = (height > 0) & (foot @ G.T <= h + slack).all(axis=1)
            np.minimum(least, height, out=least, where=within)
        for start, end in self.edges:
            # foot on the segment, clipped to its ends
            along = end - start
            share = np.clip((q - start) @ along / (along @ along), 0.0, 1.0)
            np.minimum(least, np.linalg.norm(q - start - share[:, None] * along, axis=1), out=least)
        result[outside] = least
        return np.asarray(result)
