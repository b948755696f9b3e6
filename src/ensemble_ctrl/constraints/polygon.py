"""Simple polygons given by their corners: checks, and a cover by convex pieces."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.constraints import exact
from ensemble_ctrl.constraints.cover import CORNERS, joined, with_fewer_corners, within
from ensemble_ctrl.constraints.partition import STRAIGHT, convex_parts
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import numbers

if TYPE_CHECKING:
    from shapely import Polygon

Array = NDArray[np.float64]

LARGEST = 1e8
"""Metres: no map has larger coordinates."""


def convex_pieces(vertices: ArrayLike, holes: Iterable[ArrayLike] = ()) -> list[Array]:
    """Cut a simple polygon into convex ones that meet only along their sides.

    Parameters
    ----------
    vertices : array_like, shape (corners, 2)
        Metres; either direction, the first corner not repeated (a repeated one is dropped).
    holes : iterable of array_like, shape (corners, 2)
        Simple polygons inside of it that are cut out.

    Returns
    -------
    list of ndarray, shape (corners, 2)
        Counter-clockwise; a convex polygon comes back as one piece. The number of pieces is at most four
        times the smallest possible (Hertel and Mehlhorn 1983). Their corners are corners of the polygon, to the last
        bit, and together they cover it.

    Raises
    ------
    ProblemError
        If the polygon or a hole crosses or touches itself or has no area, or a hole is not inside.

    Examples
    --------
    >>> corner = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]
    >>> len(convex_pieces(corner))
    2
    """
    corners = ring(vertices, "convex_pieces")
    inner = [ring(hole, "convex_pieces") for hole in holes]
    if not inner and is_convex(corners):
        return [corners]
    polygon = _valid(corners, inner, "convex_pieces")
    return convex_parts(_triangles(polygon))


def convex_cover(vertices: ArrayLike, holes: Iterable[ArrayLike], tolerance: float) -> list[Array]:
    """Few convex polygons that cover a simple polygon and may grow by a tolerance.

    Parameters
    ----------
    vertices, holes
        As for `convex_pieces`.
    tolerance : float
        Metres, above 0.

    Returns
    -------
    list of ndarray, shape (corners, 2)
        Counter-clockwise; they may overlap. Those with more than 8 corners lose some where the tolerance allows it.

    Notes
    -----
    *Guarantee*: together they cover the polygon, and no point of them is further than `tolerance` from it.

    Examples
    --------
    >>> bent = [[0, 0], [2, 0], [4, 0.1], [4, 0.6], [2, 0.5], [0, 0.5]]
    >>> len(convex_pieces(bent)), len(convex_cover(bent, [], 0.1))
    (2, 1)
    """
    import shapely

    name = "convex_cover"
    polygon = _valid(ring(vertices, name), [ring(hole, name) for hole in holes], name)
    # pieces may grow into the polygon offset by the tolerance
    area = polygon.buffer(tolerance)
    # convex parts, joined to hulls inside of that area, then with few corners
    parts = np.array([shapely.Polygon(part) for part in convex_parts(_triangles(polygon))], dtype=object)
    pieces = [ring(shapely.get_coordinates(piece), name) for piece in joined(parts, within(area))]
    return [with_fewer_corners(piece, area, CORNERS) for piece in pieces]


def _triangles(polygon: Polygon) -> Array:
    """A polygon cut along diagonals, shape (triangles, 3, 2)."""
    import shapely

    cut = shapely.constrained_delaunay_triangles(polygon).geoms
    return np.asarray(shapely.get_coordinates(list(cut)).reshape(-1, 4, 2)[:, :3])


def _valid(corners: Array, inner: list[Array], name: str) -> Polygon:
    """A polygon with holes that are inside of it and apart."""
    from shapely import Polygon

    polygon = Polygon(corners, inner)
    if inner:
        _check_valid(polygon, name, "holes that are inside of the polygon and apart")
    return polygon


def ring(vertices: ArrayLike, name: str) -> Array:
    """The corners of a simple polygon, counter-clockwise, without repeats and those exactly on a straight side."""
    corners = numbers(name, vertices, "corners [[x, y], ...]")
    if corners.ndim != 2 or corners.shape[1] != 2:
        raise ProblemError(f"{name}: expected corners of shape (corners, 2), got {corners.shape}")
    check_size(corners, name)
    corners = _without_straight_corners(corners[(corners != np.roll(corners, 1, axis=0)).any(axis=1)])
    if len(corners) < 3:
        raise ProblemError(f"{name}: expected a polygon with an area, got corners on one line")
    _check_simple(corners, name)
    return corners if signed_area(corners) > 0 else corners[::-1].copy()


def check_size(corners: Array, name: str) -> None:
    """Refuse coordinates that are not finite, or that no robot will ever see."""
    wrong = np.flatnonzero(~(np.abs(corners) <= LARGEST).all(axis=1))
    if wrong.size:
        place = ", ".join(f"{value:g}" for value in corners[wrong[0]])
        raise ProblemError(f"{name}: expected finite numbers of at most {LARGEST:g} m, got [{place}]")


def facets(corners: Array, inwards: bool) -> tuple[Array, Array]:
    """The sides of a convex counter-clockwise polygon as ``A x >= b``, with unit rows, rounded to one side.

    Parameters
    ----------
    corners : ndarray, shape (corners, 2)
        Metres.
    inwards : bool
        Whether the set of the rows may only lose points by rounding, or only gain some.

    Returns
    -------
    A, b : ndarray, shapes (corners, 2) and (corners,)
        Row k is the side from corner k to the next one.

    Notes
    -----
    *Guarantee*: outwards, every corner satisfies every row exactly; inwards, every point that satisfies all rows
    exactly is in the polygon. Sides along the axes are exact. The allowance for the others is 8 roundings of the
    largest coordinate: 2 for the products, 3 for the normal, times a diameter of at most 2.83 coordinates.
    """
    along = directions(corners)
    # inward normals: counter-clockwise directions turned left
    A = np.stack([-along[:, 1], along[:, 0]], axis=1)
    ends = np.stack([np.einsum("ij,ij->i", A, corners), np.einsum("ij,ij->i", A, np.roll(corners, -1, axis=0))])
    allowance = 8 * np.finfo(float).eps * np.abs(corners).max() * A.all(axis=1)
    return A, ends.max(axis=0) + allowance if inwards else ends.min(axis=0) - allowance


def directions(corners: Array) -> Array:
    """Unit vector from each corner to the next one."""
    along = np.roll(corners, -1, axis=0) - corners
    along /= np.abs(along).max(axis=1, keepdims=True)  # so that no square of a tiny side is zero
    return np.asarray(along / np.hypot(*along.T)[:, None])


def signed_area(corners: Array) -> float:
    """Area of a polygon in square metres, positive when its corners run counter-clockwise."""
    # shoelace formula relative to the first corner: no cancellation far from the origin
    x, y = (corners - corners[0]).T
    return float(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def is_convex(corners: Array) -> bool:
    """Whether a simple counter-clockwise polygon turns left, or straight on to rounding, at every corner."""
    along = directions(corners)
    # sine of the turn at each corner from unit directions
    before = np.roll(along, 1, axis=0)
    return bool((before[:, 0] * along[:, 1] - before[:, 1] * along[:, 0] > -STRAIGHT).all())


def _without_straight_corners(corners: Array) -> Array:
    """Drop corners exactly on a straight side; a spike that turns back is left for `_check_simple`."""
    while len(corners) > 2:
        before = corners - np.roll(corners, 1, axis=0)
        after = np.roll(corners, -1, axis=0) - corners
        # exactly collinear with both neighbours, and between them
        middle = (exact.corner_turns(corners) == 0) & (np.einsum("ij,ij->i", before, after) > 0)
        if not middle.any():
            break
        corners = corners[~middle]
    return corners


def _check_simple(corners: Array, name: str) -> None:
    """Refuse a polygon that crosses or touches itself."""
    if not _clearly_convex(corners):
        from shapely import Polygon

        _check_valid(Polygon(corners), name, "a polygon that does not cross itself")
    area, scale = abs(signed_area(corners)), float(np.ptp(corners, axis=0).max())
    if area <= 1e-12 * scale**2:
        raise ProblemError(f"{name}: expected a polygon with an area, got area {area:g}")


def _clearly_convex(corners: Array) -> bool:
    """Whether a ring turns one way at every corner, by more than a nanoradian, and once around altogether."""
    edges = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edges, -1, axis=0)
    cross = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    # exterior angles: of one sign and 2 pi in all for a convex ring
    turns = np.arctan2(cross, (edges * following).sum(axis=1))
    one_way = bool((turns > 1e-9).all() or (turns < -1e-9).all())
    return one_way and abs(float(turns.sum())) < 3 * np.pi


def _check_valid(polygon: Polygon, name: str, wanted: str) -> None:
    """Refuse rings that cross or touch themselves or each other."""
    from shapely.validation import explain_validity

    if not polygon.is_valid:
        raise ProblemError(f"{name}: expected {wanted}, got {_fault(explain_validity(polygon))}")


def _fault(reason: str) -> str:
    """What GEOS finds wrong, with the place as a person writes it.

    >>> _fault("Self-intersection[2.66666666666667 -1]"), _fault("Too few points in geometry component")
    ('self-intersection at (2.66667, -1)', 'too few points in geometry component')
    """
    kind, _, place = reason.rstrip("]").partition("[")
    words = kind.lower()
    return f"{words} at ({', '.join(f'{float(value):.6g}' for value in place.split())})" if place else words
