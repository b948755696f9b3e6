"""Occupied cells of a grid as few convex polygons that cover them all."""

from __future__ import annotations

from itertools import product
from math import cos, floor, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.cover import CORNERS, joined, with_fewer_corners, within
from ensemble_ctrl.constraints.polygon import facets, ring
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_RECTANGLES = 20_000
"""Largest number of rectangles that polygons are made of."""
DECIMALS = 9
"""Corners are given to a nanometre."""
GROWN = 1e-7
"""Metres by which a corner may be moved outwards for that."""


@dataclass(frozen=True, eq=False)
class Cells:
    """A grid of square cells on the plane; what lies outside of it counts as occupied.

    Parameters
    ----------
    occupied : ndarray of bool, shape (rows, columns)
        Row 0 is the lowest, column 0 the leftmost, before the grid is turned.
    size : float
        Side of a cell in metres.
    origin : tuple of float
        Place of the lower left corner of the grid, metres.
    yaw : float
        Angle in radians, counter-clockwise, by which the grid is turned about its origin.
    """

    occupied: Mask
    size: float
    origin: tuple[float, float] = (0.0, 0.0)
    yaw: float = 0.0

    @property
    def outline(self) -> Array:
        """Corners of the grid, counter-clockwise from its origin, shape (4, 2), metres."""
        rows, columns = self.occupied.shape
        return self._placed(np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], dtype=float))

    def pieces(self, tolerance: float) -> list[Array]:
        """Convex polygons that cover every occupied cell, and a frame around the grid.

        Parameters
        ----------
        tolerance : float
            Metres by which the occupied area may grow, so that there are fewer pieces.

        Returns
        -------
        list of ndarray, shape (corners, 2)
            Counter-clockwise, metres. They may overlap.

        Raises
        ------
        ProblemError
            If the cells are too many and too scattered for the tolerance.

        Notes
        -----
        *Guarantee*: every occupied cell lies in one of the pieces, to roundings of floats, and no point of a piece is
        further than `tolerance` from an occupied cell, or from the outside of the grid.

        Examples
        --------
        >>> stairs = Cells(np.tri(6, dtype=bool), 0.1)
        >>> len(stairs.pieces(0.0)), len(stairs.pieces(0.1))
        (8, 4)
        """
        import shapely

        # squares of `merge` cells exceed an occupied cell by sqrt(2) (merge - 1); 1.5 squares of tolerance stay
        reach = tolerance / self.size + 1e-9
        merge = max(1, floor((reach + sqrt(2)) / (sqrt(2) + 1.5)))
        mask = np.pad(_coarse(self.occupied, merge), 1, constant_values=True)
        reach = (reach - sqrt(2) * (merge - 1)) / merge
        # what pieces may cover: squares within reach of an occupied one, or of the frame
        area = shapely.union_all(_boxes(_spread(mask, reach)))
        shapes = joined(_boxes(mask), within(area), min(reach, 1.0))
        found = []
        for shape in shapes:
            corners = with_fewer_corners(ring(shapely.get_coordinates(shape), "Cells"), area, CORNERS)
            found.append(_rounded(self._placed((corners - 1) * merge)))
        return found

    def _placed(self, corners: Array) -> Array:
        """Columns and rows as places in the plane."""
        # origin + size R(yaw) (column, row)
        c, s = cos(self.yaw), sin(self.yaw)
        return np.asarray(self.origin + self.size * corners @ np.array([[c, s], [-s, c]]))


def _rounded(corners: Array) -> Array:
    """A convex polygon with corners of few decimals, grown by a nanometre on each side where rounding takes some away.

    Roundings of floats are not counted: three cells of 0.05 m are 0.15 m. Corners too sharp, or too far from the
    origin, for so many decimals stay as they are.
    """
    # corners that rounding to DECIMALS moves by float noise only are just rounded
    near, noise = np.round(corners, DECIMALS) + 0.0, 4 * float(np.spacing(np.abs(corners).max()))
    unit = 0.1**DECIMALS
    if noise > unit / 10:
        return corners
    if np.abs(near - corners).max() <= noise:
        return near
    # scaled about the middle so that each side moves outwards by a unit at least
    middle = corners.mean(axis=0)
    A, b = facets(corners, inwards=True)
    factor = unit / float((A @ middle - b).min())
    if not 0.0 < factor * np.abs(corners - middle).max() <= GROWN:
        return corners
    return np.asarray(np.round(corners + factor * (corners - middle), DECIMALS) + 0.0)


def _coarse(mask: Mask, merge: int) -> Mask:
    """Squares of `merge` by `merge` cells, occupied where any of them is, or lies outside of the grid."""
    rows, columns = (-n % merge for n in mask.shape)
    whole = np.pad(mask, ((0, rows), (0, columns)), constant_values=True)
    # a square is occupied if any of its merge x merge cells is
    blocks = whole.reshape(whole.shape[0] // merge, merge, whole.shape[1] // merge, merge)
    return np.asarray(blocks.any(axis=(1, 3)))


def _spread(mask: Mask, reach: float) -> Mask:
    """The cells of which no point is further than `reach` cells from an occupied one."""
    rows, columns = mask.shape
    found = mask.copy()
    # dilation by a disk: union of the mask's shifts by whole cells of length up to reach
    whole = range(-floor(reach), floor(reach) + 1)
    for up, right in product(whole, whole):
        if 0 < up**2 + right**2 <= reach**2:
            found[_part(up, rows), _part(right, columns)] |= mask[_part(-up, rows), _part(-right, columns)]
    return found


def _part(shift: int, length: int) -> slice:
    """The indices that are in range after a shift, which may be longer than the whole."""
    return slice(max(shift, 0), max(length + min(shift, 0), 0))


def _boxes(mask: Mask) -> Any:
    """Rectangles that the cells are made of: runs of a row, joined with the same run of the next rows."""
    import shapely

    # runs of each row: where the mask rises and where it falls
    edges = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (row, left), right = np.nonzero(edges == 1), np.nonzero(edges == -1)[1]
    # equal runs in successive rows are one rectangle
    order = np.lexsort((row, right, left))
    row, left, right = row[order], left[order], right[order]
    first = np.ones(len(row), dtype=bool)
    first[1:] = (np.diff(left) != 0) | (np.diff(right) != 0) | (np.diff(row) != 1)
    starts = np.flatnonzero(first)
    if len(starts) > MAX_RECTANGLES:
        raise ProblemError(f"Cells: expected at most {MAX_RECTANGLES} rectangles of cells, got {len(starts)}")
    ends = np.append(starts[1:], len(row)) - 1
    return np.atleast_1d(shapely.box(left[starts], row[starts], right[starts], row[ends] + 1))
