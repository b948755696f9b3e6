"""A convex polygon as an obstacle, its distances and its big-M rows in moment space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.constraints import exact
from ensemble_ctrl.constraints._rows import checked_rows
from ensemble_ctrl.constraints.polygon import check_size, facets, is_convex, ring
from ensemble_ctrl.constraints.polyhedron import SignedMoments
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyArrays
from ensemble_ctrl.core.values import numbers

Array = NDArray[np.float64]
_Kernel = Callable[[Array, Array], Array]
BLOCK = 8192  # points at a time: the temporaries of one block stay in the cache


@dataclass(frozen=True, eq=False)
class BigMBounds:
    """Rows ``lower <= A m_k + switch[k] z <= upper``, one for each order k and facet, switches z.

    Attributes
    ----------
    lower, upper : ndarray, shape (order + 1, facets)
        In the unit of ``A x``.
    switch : ndarray, shape (order + 1,)
        Coefficient of every facet's switch, in the unit of ``A x``.
    """

    lower: Array
    upper: Array
    switch: Array


@dataclass(frozen=True, eq=False, init=False)
class Obstacle(ReadOnlyArrays):
    r"""The bounded polygon ``A x >= b``; the free side of facet i is ``a_i x <= b_i``.

    Parameters
    ----------
    A : array_like, shape (facets, 2)
        Dimensionless, pointing into the obstacle; kept as given.
    b : array_like, shape (facets,)
        Metres, when the rows of `A` have length one.

    Raises
    ------
    ProblemError
        If a shape is wrong, a number is not finite, or the set is empty, flat or unbounded.

    Notes
    -----
    Before ``eq:setPolyObsArr`` of Arias et al., One Ring to Rule Them All.

    Examples
    --------
    >>> block = Obstacle.box([[2, 6], [1, 3]])
    >>> block.b
    array([ 2., -3., -6.,  1.])
    >>> block.distance([[9.0, 7.0], [3.0, 1.5]])
    array([ 5. , -0.5])
    """

    A: Array
    b: Array
    _corners: Array = field(init=False, repr=False)

    def __init__(self, A: ArrayLike, b: ArrayLike) -> None:
        self._set_rows(A, b, 2)
        corners, bounded = exact.intersection(-self.A, -self.b)
        if not bounded:
            raise ProblemError("Obstacle: expected a bounded polygon, got an unbounded set")
        corners = exact.hull(corners)
        if len(corners) < 3:
            raise ProblemError("Obstacle: expected a polygon with an area, got an empty or flat set")
        self._set_corners(corners)

    def _set_corners(self, corners: Array) -> None:
        """Keep the corners."""
        check_size(corners, type(self).__name__)
        corners.setflags(write=False)
        object.__setattr__(self, "_corners", corners)

    def _set_rows(self, A: ArrayLike, b: ArrayLike, dimension: int) -> None:
        """Keep the rows, checked to be finite and of the right shape."""
        name = type(self).__name__
        A = checked_rows(A, f"{name}.A")
        b = numbers("Obstacle.b", b)
        if A.shape[1] != dimension or b.shape != (len(A),):
            wanted = f"A (facets, {dimension}) and b (facets,)"
            raise ProblemError(f"{name}: expected {wanted}, got {A.shape} and {b.shape}")
        if not np.isfinite(b).all():
            raise ProblemError(f"{name}.b: expected finite numbers, got {b.tolist()}")
        b.setflags(write=False)
        object.__setattr__(self, "A", A)
        object.__setattr__(self, "b", b)

    @classmethod
    def _of(cls, A: ArrayLike, b: ArrayLike, corners: Array) -> Self:
        """The set of some rows, with its corners as they were given."""
        made = cls.__new__(cls)
        made._set_rows(A, b, corners.shape[1])
        made._set_corners(corners)
        return made

    @classmethod
    def box(cls, bounds: ArrayLike) -> Obstacle:
        """Rectangle ``[[x low, x high], [y low, y high]]``, metres; rows as in the paper's Example 2."""
        pairs = numbers("Obstacle.box", bounds, "[[x low, x high], [y low, y high]]")
        if pairs.shape != (2, 2):
            raise ProblemError(f"Obstacle.box: expected [[x low, x high], [y low, y high]], got shape {pairs.shape}")
        if not (pairs[:, 0] < pairs[:, 1]).all():
            raise ProblemError(f"Obstacle.box: expected low < high, got {pairs.tolist()}")
        (x0, x1), (y0, y1) = pairs
        rows = np.array([[1, 0], [0, -1], [-1, 0], [0, 1]], float)
        return cls._of(rows, np.array([x0, -y1, -x1, y0]), np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))

    @classmethod
    def polygon(cls, vertices: ArrayLike) -> Obstacle:
        """Convex polygon by its corners, shape (corners, 2), metres, either direction; unit rows.

        Notes
        -----
        *Guarantee*: it may only grow. Its `vertices` are the corners of the hull of those given, to the last bit, and
        all of them satisfy its rows exactly.

        Raises
        ------
        ProblemError
            If it is not convex (use `convex_pieces`), crosses itself or has no area.
        """
        corners = ring(vertices, "Obstacle.polygon")
        if not is_convex(corners):
            raise ProblemError("Obstacle.polygon: expected a convex polygon, got another; use convex_pieces(vertices)")
        if (exact.corner_turns(corners) < 0).any():
            corners = exact.hull(corners)
        return cls._of(*facets(corners, inwards=False), corners)

    @property
    def vertices(self) -> Array:
        """Corners, counter-clockwise, shape (corners, 2), in metres; as given, where corners were given."""
        return self._corners

    @property
    def rounding(self) -> float:
        """Metres by which `core` grows to be the obstacle: above 0 for a disc."""
        return 0.0

    @property
    def core(self) -> Array:
        """Corners of the convex polygon that makes the obstacle when it is grown by `rounding`, shape (corners, d)."""
        return self.vertices

    @cached_property
    def edges(self) -> Array:
        """Both ends of every side, shape (sides, 2, 2), metres."""
        return np.stack([self.vertices, np.roll(self.vertices, -1, axis=0)], axis=1)

    def widened(self, shift: Array) -> Obstacle:
        """The Minkowski sum with the box ``[-shift, shift]``, rounded outwards: the hull of its corners."""
        # the sum's corners are among vertices + (+-shift_x, +-shift_y)
        low, high = (self.vertices + way * shift for way in (-1, 1))
        low, high = np.nextafter(low, -np.inf), np.nextafter(high, np.inf)
        corners = [np.column_stack([x, y]) for x in (low[:, 0], high[:, 0]) for y in (low[:, 1], high[:, 1])]
        return Obstacle.polygon(exact.hull(np.concatenate(corners)))

    def outer_rows(self) -> tuple[Array, Array]:
        """``G x <= h``, which holds throughout the set: shapes (facets, 2), (facets,)."""
        return self.unit_rows()

    def inner_rows(self) -> tuple[Array, Array]:
        """``G x <= h``, which holds nowhere outside: shapes (facets, 2), (facets,)."""
        return self.unit_rows()

    def facet_clearance(self, points: ArrayLike) -> Array:
        """``max_i (b_i - a_i x)`` with unit rows: (..., 2) to (...), metres.

        Notes
        -----
        *Guarantee*: positive exactly outside, and there a lower bound of the Euclidean distance; inside it is
        minus the exact depth.
        """
        return self._blockwise(points, self._clearance)

    def distance(self, points: ArrayLike) -> Array:
        """Exact signed Euclidean distance: (..., 2) to (...), metres; minus the depth inside.

        Notes
        -----
        Outside, the nearest point is inside a side, whose facet line then gives the distance, or it is a
        corner.
        """
        return self._blockwise(points, self._distance)

    def distance_along(self, coordinates: Array) -> Array:
        """`distance` of points given by their coordinates one after the other, (2, ...) to (...), in one block."""
        x, y = coordinates
        return self._distance(x, y)

    def unit_rows(self) -> tuple[Array, Array]:
        """The polygon as ``G x <= h`` with unit normals pointing out: shapes (facets, 2), (facets,)."""
        length = np.linalg.norm(self.A, axis=1)
        return -self.A / length[:, None], -self.b / length

    def big_m_bounds(self, basis: SignedMoments, M: float) -> BigMBounds:
        r"""The disjunction ``a_i x <= b_i for some i`` as rows over moments and switches.

        .. math:: -M m_k^+ - \xi m_k^- \le a_i m_k + M (m_k^+ - m_k^-) z_i \le \xi m_k^+ + M m_k^-,
                  \quad \xi = b_i + M, \quad \sum_i z_i \ge 1

        Parameters
        ----------
        basis : object with ``signed_moments()``
        M : float
            In the unit of ``A x``; larger than ``|a_i x|`` and ``a_i x - b_i`` anywhere in the workspace.

        Notes
        -----
        ``eq:setPolyObsArr`` of Arias et al., One Ring to Rule Them All, with the upper bound's second term
        and the place of ``z_i`` corrected.
        *Guarantee*: **necessary, not sufficient** for every member to avoid the obstacle on one facet's side.
        """
        if not (np.isfinite(M) and M > 0):
            raise ProblemError(f"M: expected a positive number, got {M}")
        positive, negative = basis.signed_moments()
        # eq:setPolyObsArr: -M <= a p(s) + M z <= b + M, bounded as in eq:polyhedron_moment; int phi_k = m_k+ - m_k-
        xi = self.b + M
        lower = -M * positive[:, None] - np.outer(negative, xi)
        upper = np.outer(positive, xi) + M * negative[:, None]
        return BigMBounds(lower, upper, M * (positive - negative))

    @cached_property
    def _sides(self) -> list[tuple[Array, Array, float]]:
        """Each side's first corner, unit direction and length."""
        # unit directions of the sides, for projections onto them
        along = np.roll(self.vertices, -1, axis=0) - self.vertices
        lengths = np.linalg.norm(along, axis=1)
        return list(zip(self.vertices, along / lengths[:, None], lengths.tolist(), strict=True))

    def _blockwise(self, points: ArrayLike, function: _Kernel) -> Array:
        """Apply a function of (x, y) block by block."""
        p = np.asarray(points, dtype=float)
        if p.ndim == 0 or p.shape[-1] != 2:
            raise ProblemError(f"points: expected shape (..., 2), got {p.shape}")
        flat = p.reshape(-1, 2)
        result = np.empty(len(flat))
        for start in range(0, len(flat), BLOCK):
            # contiguous coordinates of a block that fits in the cache
            x, y = flat[start : start + BLOCK].T.copy()
            result[start : start + BLOCK] = function(x, y)
        return result.reshape(p.shape[:-1])

    def _clearance(self, x: Array, y: Array) -> Array:
        """Facet clearance of one block."""
        worst = np.full(x.shape, -np.inf)
        for (gx, gy), offset in zip(*self.unit_rows(), strict=True):
            np.maximum(worst, gx * x + gy * y - offset, out=worst)
        return worst

    @cached_property
    def _rectangle(self) -> tuple[Array, Array, Array] | None:
        """Centre, unit axis and half sides of a rectangle, whose distance has a shorter formula."""
        v = self.vertices
        first, second = v[1] - v[0], v[2] - v[1]
        lengths = np.hypot(*np.stack([first, second], axis=1))
        # a parallelogram with a right angle, to rounding
        square = abs(first @ second) <= 1e-14 * lengths.prod()
        if len(v) != 4 or not square or np.abs(v[0] + v[2] - v[1] - v[3]).max() > 1e-14 * lengths.max():
            return None
        return v.mean(axis=0), first / lengths[0], lengths / 2

    def _distance(self, x: Array, y: Array) -> Array:
        """Signed distance of one block."""
        if self._rectangle is not None:
            return rectangle_distance(x, y, *self._rectangle)
        clearance, square = self._clearance(x, y), np.zeros(x.shape)
        # a corner is nearest past the end of one side and before the start of the next; else facet clearance
        *_, (corner, along, length) = self._sides
        past = (x - corner[0]) * along[0] + (y - corner[1]) * along[1] > length
        for corner, along, length in self._sides:
            # position along this side; `past` is about the side before
            dx, dy = x - corner[0], y - corner[1]
            position = dx * along[0] + dy * along[1]
            np.copyto(square, dx * dx + dy * dy, where=past & (position < 0))
            past = position > length
        return np.where(square > 0, np.sqrt(square), clearance)


def rectangle_distance(x: Array, y: Array, centre: Array, axis: Array, half: Array) -> Array:
    """Signed distance to a rectangle: clamp in its own frame."""
    dx, dy = x - centre[0], y - centre[1]
    # excess over the half sides in the rectangle's frame
    u = np.abs(axis[0] * dx + axis[1] * dy) - half[0]
    v = np.abs(axis[0] * dy - axis[1] * dx) - half[1]
    inside = np.minimum(np.maximum(u, v), 0.0)
    return np.asarray(np.sqrt(np.maximum(u, 0.0) ** 2 + np.maximum(v, 0.0) ** 2) + inside)
