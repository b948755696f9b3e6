"""Simple polygons given by their corners: checks, and a cover by convex pieces."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.errors import ProblemError

Array = NDArray[np.float64]


def convex_pieces(vertices: ArrayLike) -> list[Array]:
    """Cut a simple polygon into convex ones that meet only along their sides.

    Parameters
    ----------
    vertices : array_like, shape (corners, 2)
        Metres; either direction, the first corner not repeated (a repeated one is dropped).

    Returns
    -------
    list of ndarray, shape (corners, 2)
        Counter-clockwise; a convex polygon comes back as one piece. The number of pieces is at most four
        times the smallest possible (Hertel and Mehlhorn 1983).

    Raises
    ------
    ProblemError
        If the polygon crosses or touches itself, or has no area.

    Examples
    --------
    >>> corner = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]
    >>> len(convex_pieces(corner))
    2
    """
    corners = ring(vertices, "convex_pieces")
    if is_convex(corners):
        return [corners]
    pieces = _merged(corners, _triangles(corners))
    return [_without_straight_corners(corners[piece]) for piece in pieces]


def ring(vertices: ArrayLike, name: str) -> Array:
    """The corners of a simple polygon, counter-clockwise, without repeated or needless ones."""
    corners = np.array(vertices, dtype=float)
    if corners.ndim != 2 or corners.shape[1] != 2:
        raise ProblemError(f"{name}: expected corners of shape (corners, 2), got {corners.shape}")
    if not np.isfinite(corners).all():
        raise ProblemError(f"{name}: expected finite numbers, got {corners.tolist()}")
    corners = _without_straight_corners(corners[(corners != np.roll(corners, 1, axis=0)).any(axis=1)])
    if len(corners) < 3:
        raise ProblemError(f"{name}: expected a polygon with an area, got corners on one line")
    _check_simple(corners, name)
    return corners if signed_area(corners) > 0 else corners[::-1].copy()


def signed_area(corners: Array) -> float:
    """Area of a polygon in square metres, positive when its corners run counter-clockwise."""
    x, y = (corners - corners[0]).T
    return float(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def is_convex(corners: Array) -> bool:
    """Whether a simple counter-clockwise polygon turns left at every corner."""
    return bool((_turns(corners) > 0).all())


def _turns(corners: Array) -> Array:
    """Sine of the turn at every corner, zero where it is straight to rounding."""
    before = corners - np.roll(corners, 1, axis=0)
    after = np.roll(corners, -1, axis=0) - corners
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    sine = cross / (np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1))
    return np.asarray(np.where(np.abs(sine) > 1e-10, sine, 0.0))


def _without_straight_corners(corners: Array) -> Array:
    """Drop corners in the middle of a straight side; a spike that turns back is left for `_check_simple`."""
    while len(corners) > 2:
        before = corners - np.roll(corners, 1, axis=0)
        after = np.roll(corners, -1, axis=0) - corners
        middle = (_turns(corners) == 0) & (np.einsum("ij,ij->i", before, after) > 0)
        if not middle.any():
            break
        corners = np.delete(corners, np.flatnonzero(middle)[0], axis=0)
    return corners


def _check_simple(corners: Array, name: str) -> None:
    """Refuse a polygon that crosses or touches itself."""
    from shapely import Polygon
    from shapely.validation import explain_validity

    polygon = Polygon(corners)
    scale = float(np.ptp(corners, axis=0).max())
    if polygon.area <= 1e-12 * scale**2:
        raise ProblemError(f"{name}: expected a polygon with an area, got area {polygon.area:g}")
    if not polygon.is_valid:
        raise ProblemError(f"{name}: expected a polygon that does not cross itself, got {explain_validity(polygon)}")


def _triangles(corners: Array) -> list[list[int]]:
    """Ear clipping: indices of the triangles of a simple counter-clockwise polygon."""
    left = list(range(len(corners)))
    ears: list[list[int]] = []
    while len(left) > 3:
        place = _best_ear(corners, left)
        ears.append([left[place - 1], left[place], left[(place + 1) % len(left)]])
        del left[place]
    return [ear for ear in [*ears, left] if signed_area(corners[ear]) > 0]


def _best_ear(corners: Array, left: list[int]) -> int:
    """Place of the ear with the sharpest corner; a straight corner if no ear is left."""
    turns = _turns(corners[left])
    for place in np.argsort(-turns, kind="stable"):
        ear = [left[place - 1], left[place], left[(place + 1) % len(left)]]
        if turns[place] > 0 and not _any_inside(corners, ear, left):
            return int(place)
    return int(np.argmin(np.abs(turns)))


def _any_inside(corners: Array, ear: list[int], left: list[int]) -> bool:
    """Whether another corner lies in the ear or on its border."""
    others = corners[[i for i in left if i not in ear]]
    start = corners[ear]
    side = np.roll(start, -1, axis=0) - start
    offset = others[:, None, :] - start
    return bool((side[:, 0] * offset[..., 1] - side[:, 1] * offset[..., 0] >= 0).all(axis=1).any())


def _merged(corners: Array, pieces: list[list[int]]) -> list[list[int]]:
    """Remove every cut whose two pieces together are convex."""
    merged = True
    while merged:
        merged = False
        for i, j in combinations(range(len(pieces)), 2):
            union = _union(pieces[i], pieces[j])
            if union and (_turns(corners[union]) >= 0).all():
                pieces = [piece for k, piece in enumerate(pieces) if k not in (i, j)] + [union]
                merged = True
                break
    return pieces


def _union(first: list[int], second: list[int]) -> list[int]:
    """The polygon of two that share one side; empty if they share none."""
    for k, start in enumerate(first):
        end = first[(k + 1) % len(first)]
        if end in second and second[(second.index(end) + 1) % len(second)] == start:
            at = second.index(start)
            return first[k + 1 :] + first[: k + 1] + (second[at:] + second[:at])[1:-1]
    return []
