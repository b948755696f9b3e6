"""A convex region bounded by linear inequalities, in state space and in moment space."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.constraints import exact
from ensemble_ctrl.constraints._rows import checked_rows, is_cone_trivial, is_feasible
from ensemble_ctrl.constraints._sides import closed, joined
from ensemble_ctrl.constraints.exact import space_corners
from ensemble_ctrl.constraints.polygon import facets, is_convex, ring
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyArrays
from ensemble_ctrl.core.values import numbers

Array = NDArray[np.float64]


class SignedMoments(Protocol):
    """The part of a basis that the moment bounds need."""

    def signed_moments(self) -> tuple[Array, Array]:
        """Integrals of the positive and negative parts, each of shape (order + 1,)."""
        ...


@dataclass(frozen=True, eq=False, init=False)
class Polyhedron(ReadOnlyArrays):
    r"""The set ``lower <= A x <= upper``.

    Parameters
    ----------
    A : array_like, shape (rows, n)
        Dimensionless; every row finite and not zero.
    lower, upper : array_like, shape (rows,)
        In the unit of ``A x`` (metres for positions and unit rows). ``-inf`` and ``inf`` leave a side open.

    Raises
    ------
    ProblemError
        If a shape is wrong, a number is NaN, a row is zero or ``lower > upper`` somewhere.

    Notes
    -----
    ``S = {x : b <= A x <= c}`` of Arias et al., One Ring to Rule Them All, before ``eq:polyhedron_moment``.

    Examples
    --------
    >>> goal = Polyhedron.box([[6.0, 7.0], [5.0, 6.0]])
    >>> goal.margin([6.5, 5.2]).round(3)
    np.float64(0.2)
    """

    A: Array
    lower: Array
    upper: Array

    def __init__(self, A: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> None:
        A = checked_rows(A, "Polyhedron.A")
        lower = _checked_bound(lower, "Polyhedron.lower", len(A), forbidden=np.inf)
        upper = _checked_bound(upper, "Polyhedron.upper", len(A), forbidden=-np.inf)
        wrong = np.flatnonzero(lower > upper)
        if wrong.size:
            i = int(wrong[0])
            raise ProblemError(f"Polyhedron.lower: expected lower <= upper, got {lower[i]} > {upper[i]} in row {i}")
        for name, value in (("A", A), ("lower", lower), ("upper", upper)):
            object.__setattr__(self, name, value)

    @classmethod
    def box(cls, bounds: ArrayLike) -> Polyhedron:
        """Axis-aligned box ``[[x low, x high], [y low, y high], ...]``, shape (n, 2)."""
        pairs = numbers("Polyhedron.box", bounds, "[[low, high], ...]")
        if pairs.ndim != 2 or pairs.shape[1] != 2 or not len(pairs):
            raise ProblemError(f"Polyhedron.box: expected [[low, high], ...], got shape {pairs.shape}")
        return cls(np.eye(len(pairs)), pairs[:, 0], pairs[:, 1])

    @classmethod
    def polygon(cls, vertices: ArrayLike) -> Polyhedron:
        """Convex polygon by its corners, shape (corners, 2), metres, either direction; unit rows.

        Raises
        ------
        ProblemError
            If it is not convex, crosses itself or has no area.

        Notes
        -----
        *Guarantee*: it may only shrink, by rounding: every point that satisfies its rows exactly is in the polygon. Its
        `vertices` are those given.
        """
        corners = ring(vertices, "Polyhedron.polygon")
        if not is_convex(corners):
            raise ProblemError("Polyhedron.polygon: expected a convex polygon, got one that is not")
        A, lower = facets(corners, inwards=True)
        made = cls(A, lower, np.full(len(lower), np.inf))
        # the given corners are the vertices, unless the rounding inwards left no inside
        if made.contains(corners.mean(axis=0)):
            corners.setflags(write=False)
            vars(made)["_plane"] = corners, True
        return made

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Whether each point is inside or on the boundary: (..., n) to (...)."""
        values = self._points(points) @ self.A.T
        return np.asarray(np.all((values >= self.lower) & (values <= self.upper), axis=-1))

    def margin(self, points: ArrayLike) -> Array:
        """Signed distance to the nearest face plane, positive inside.

        Parameters
        ----------
        points : array_like, shape (..., n)
            Metres, for positions.

        Returns
        -------
        ndarray, shape (...)
            Metres; infinite when no row has a finite bound.

        Notes
        -----
        *Guarantee*: inside it is the exact distance to the boundary; outside, minus it is a lower bound of
        the distance to the polyhedron.
        """
        x = self._points(points)
        G, h = self.unit_rows()
        # min_i (h_i - g_i x)
        least = np.full(x.shape[:-1], np.inf)
        for normal, offset in zip(G, h, strict=True):
            np.minimum(least, offset - x @ normal, out=least)
        return least

    def unit_rows(self) -> tuple[Array, Array]:
        """Finite sides as ``G x <= h``, unit normals: shapes (sides, n), (sides,); uppers first."""
        # rows over their norms: bounds become distances; l <= a x is -a x <= -l
        length = np.linalg.norm(self.A, axis=1)
        A, upper, lower = self.A / length[:, None], self.upper / length, self.lower / length
        above, below = np.isfinite(upper), np.isfinite(lower)
        return np.vstack([A[above], -A[below]]), np.concatenate([upper[above], -lower[below]])

    def outer_rows(self) -> tuple[Array, Array]:
        """``G x <= h``, which holds throughout the set: shapes (sides, n), (sides,)."""
        return self.unit_rows()

    def inner_rows(self) -> tuple[Array, Array]:
        """``G x <= h``, which holds nowhere outside: shapes (sides, n), (sides,)."""
        return self.unit_rows()

    def moment_bounds(self, basis: SignedMoments) -> tuple[Array, Array]:
        r"""Bounds on ``A m_k`` for every order k.

        .. math:: b\,m_k^+ - c\,m_k^- \le A m_k \le c\,m_k^+ - b\,m_k^-

        Parameters
        ----------
        basis : object with ``signed_moments()``
            The basis that the moments belong to.

        Returns
        -------
        lower, upper : ndarray, shape (order + 1, rows)
            In the unit of ``A x``. An open side has the bound that the other rows imply. Where they imply none, the
            moment bound is infinite, unless ``m_k^- = 0`` removes it.

        Notes
        -----
        ``eq:polyhedron_moment`` of Arias et al., One Ring to Rule Them All.
        *Guarantee*: **necessary, not sufficient**. An ensemble inside the polyhedron satisfies them; an
        ensemble that satisfies them may have members outside.

        Examples
        --------
        A triangle has no opposite sides, and yet bounds of every order:

        >>> from ensemble_ctrl.moments import LegendreBasis
        >>> triangle = Polyhedron([[1, 0], [0, 1], [-1, -1]], [0, 0, -1], [np.inf] * 3)
        >>> triangle.moment_bounds(LegendreBasis(1))[1][1].round(3)
        array([0.612, 0.612, 0.612])
        """
        _, low, high, line, scale = self._lines
        # bounds b <= a p(s) <= c of each row; a negative scale exchanges the ends of its line
        ends = scale * np.stack([low[line], high[line]])
        positive, negative = basis.signed_moments()
        smallest, largest = ends.min(axis=0), ends.max(axis=0)
        # eq:polyhedron_moment: b m_k+ - c m_k- <= a m_k <= c m_k+ - b m_k-
        lower = _outer(positive, smallest) - _outer(negative, largest)
        upper = _outer(positive, largest) - _outer(negative, smallest)
        return lower, upper

    def two_sided(self) -> Polyhedron:
        """The same set with every line's rows as one of unit length, both of its sides closed where the set is.

        Raises
        ------
        ProblemError
            If opposite rows leave nothing between them.
        """
        normals, low, high, _, _ = self._lines
        return Polyhedron(normals, low, high)

    @cached_property
    def _lines(self) -> tuple[Array, Array, Array, NDArray[np.int64], Array]:
        """Unit normals of the rows' lines with both bounds, and each row's line and scale."""
        normals, low, high, line, scale = joined(self.A, self.lower, self.upper)
        return normals, *closed(normals, low, high), line, scale

    @cached_property
    def is_empty(self) -> bool:
        """Whether no point satisfies every row; exact in the plane, else to 1e-9 of the largest bound."""
        if self.A.shape[1] == 2:
            return not len(self._plane[0])
        return not is_feasible(*self.unit_rows())

    @cached_property
    def is_bounded(self) -> bool:
        """Whether the set fits in some ball; an empty set does."""
        if self.A.shape[1] == 2:
            return self._plane[1]
        return self.is_empty or is_cone_trivial(self.unit_rows()[0])

    @cached_property
    def vertices(self) -> Array:
        """Corners of a bounded polyhedron, n up to 3, counter-clockwise in the plane, shape (corners, n), metres."""
        if self.A.shape[1] > 3:
            raise ProblemError(f"Polyhedron.vertices: expected at most 3 dimensions, got {self.A.shape[1]}")
        if self.is_empty or not self.is_bounded:
            state = "an empty" if self.is_empty else "an unbounded"
            raise ProblemError(f"Polyhedron.vertices: expected a bounded set with points in it, got {state} one")
        if self.A.shape[1] == 2:
            return self._plane[0]
        G, h = self.unit_rows()
        if self.A.shape[1] == 1:
            # h / g is an upper bound where g > 0, a lower one where g < 0
            ends = np.array([[(h / G[:, 0])[G[:, 0] < 0].max()], [(h / G[:, 0])[G[:, 0] > 0].min()]])
            ends.setflags(write=False)
            return ends
        return space_corners(G, h)

    @cached_property
    def _plane(self) -> tuple[Array, bool]:
        """Corners in the plane, those of a frame far away included, and whether there are none of these."""
        above, below = np.isfinite(self.upper), np.isfinite(self.lower)
        G, h = np.vstack([self.A[above], -self.A[below]]), np.concatenate([self.upper[above], -self.lower[below]])
        corners, bounded = exact.intersection(G, h)
        corners.setflags(write=False)
        return corners, bounded

    def _points(self, points: ArrayLike) -> Array:
        """The points as an array whose last axis is checked."""
        x = np.asarray(points, dtype=float)
        if x.ndim == 0 or x.shape[-1] != self.A.shape[1]:
            raise ProblemError(f"points: expected shape (..., {self.A.shape[1]}), got {x.shape}")
        return x


def _checked_bound(value: ArrayLike, name: str, rows: int, forbidden: float) -> Array:
    """A read-only copy of one side's bounds."""
    bound = numbers(name, value)
    if bound.shape != (rows,):
        raise ProblemError(f"{name}: expected shape ({rows},) as A has {rows} rows, got {bound.shape}")
    if np.isnan(bound).any() or (bound == forbidden).any():
        raise ProblemError(f"{name}: expected numbers, none of them NaN or {forbidden}, got {bound.tolist()}")
    bound.setflags(write=False)
    return bound


def _outer(moments: Array, bounds: Array) -> Array:
    """Products ``moments[k] * bounds[i]`` with ``0 * inf = 0``: a part that is zero bounds nothing."""
    # m_k+- times each bound, with 0 * inf = 0
    product = np.zeros((len(moments), len(bounds)))
    used = moments != 0
    product[used] = moments[used, None] * bounds
    return product
