"""Discs as obstacles and as regions: exact by the distance from the centre, beside polygons for what needs sides."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.constraints.obstacle import Obstacle, rectangle_distance
from ensemble_ctrl.constraints.polygon import LARGEST
from ensemble_ctrl.constraints.polyhedron import Polyhedron
from ensemble_ctrl.constraints.solid import Solid
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import number, numbers

Array = NDArray[np.float64]

SIDES = 32
"""Sides of the polygons around and inside a disc: they differ from it by 0.5 % of its radius."""
SPARE = 8 * float(np.finfo(float).eps)
"""Share of the largest coordinate by which these polygons are moved to the safe side of rounding."""


class Disc(Obstacle):
    """All points within a radius of a centre, in the plane.

    Parameters
    ----------
    center : array_like, shape (2,)
        Metres.
    radius : float
        Metres, above 0.

    Raises
    ------
    ProblemError
        For other shapes, or numbers that are not finite.

    Notes
    -----
    Distances are exact. Its rows and its `vertices` are those of a polygon of `SIDES` sides around it.
    *Guarantee*: every point of the disc satisfies the rows.

    Examples
    --------
    >>> tree = Disc([2.0, 1.0], 0.5)
    >>> tree.distance([[5.0, 5.0], [2.0, 1.0]])
    array([ 4.5, -0.5])
    """

    center: Array
    radius: float
    _half: Array

    def __init__(self, center: ArrayLike, radius: float) -> None:
        place, size = numbers("Disc.center", center, "[x, y]"), number("Disc.radius", radius)
        if place.shape != (2,) or not (np.abs(place) <= LARGEST).all():
            raise ProblemError(f"Disc.center: expected [x, y] in metres, at most {LARGEST:g}, got {place.tolist()}")
        if not 0 < size <= LARGEST:
            raise ProblemError(f"Disc.radius: expected a number of metres above 0, got {size}")
        self._set_round(place, np.zeros(2), size)

    def _set_round(self, center: Array, half: Array, radius: float) -> None:
        """Keep the box ``center +- half`` grown by a radius, with the polygon around it."""
        # tangents n x <= n c + |n| half + r at even angles; corners between two of them at r / cos(pi / SIDES)
        normals = _circle()
        spare = SPARE * (float(np.abs(center).max() + half.max()) + radius)
        self._set_rows(-normals, -(normals @ center + np.abs(normals) @ half + radius + spare), 2)
        between = _circle(0.5)
        self._set_corners(center + np.sign(between) * half + between * (radius + spare) / np.cos(np.pi / SIDES))
        for name, value in (("center", center), ("_half", half), ("radius", radius)):
            object.__setattr__(self, name, value)

    @property
    def rounding(self) -> float:
        """The radius, metres."""
        return self.radius

    @cached_property
    def core(self) -> Array:
        """The centre, shape (1, 2); of a disc that was widened the corners of its box, shape (4, 2)."""
        ways = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        return self.center + (ways * self._half if self._half.any() else np.zeros((1, 2)))

    @cached_property
    def edges(self) -> Array:
        """Both ends of every side of the core, shape (sides, 2, 2), metres."""
        return np.stack([self.core, np.roll(self.core, -1, axis=0)], axis=1)

    def widened(self, shift: Array) -> Disc:
        """The Minkowski sum with the box ``[-shift, shift]``, rounded outwards: a box with round corners."""
        made = Disc.__new__(Disc)
        spare = SPARE * float(np.abs(self.center).max() + shift.max())
        made._set_round(self.center, self._half + shift + spare, self.radius)
        return made

    def _distance(self, x: Array, y: Array) -> Array:
        """Signed distance of one block: that from the core, less the radius."""
        return rectangle_distance(x, y, self.center, np.array([1.0, 0.0]), self._half) - self.radius

    def inner_rows(self) -> tuple[Array, Array]:
        """``G x <= h`` of a polygon inside the disc."""
        return DiscRegion(self).unit_rows()


class DiscRegion(Polyhedron):
    """A disc as a region: the rows are those of a polygon of `SIDES` corners inside it.

    Parameters
    ----------
    disc : Disc

    Notes
    -----
    *Guarantee*: every point that satisfies the rows is in the disc; `outer_rows` hold throughout the disc.
    """

    disc: Disc

    def __init__(self, disc: Disc) -> None:
        spare = SPARE * (float(np.abs(disc.center).max()) + disc.radius)
        corners: Array = disc.center + _circle() * max(disc.radius - spare, 0.0)
        inside = Polyhedron.polygon(corners)
        super().__init__(inside.A, inside.lower, inside.upper)
        object.__setattr__(self, "disc", disc)

    def outer_rows(self) -> tuple[Array, Array]:
        """``G x <= h`` of a polygon around the disc."""
        return self.disc.unit_rows()


def obstacle_of(region: Polyhedron) -> Obstacle:
    """A bounded region of the plane or of space as an obstacle."""
    if isinstance(region, DiscRegion):
        return region.disc
    return (Solid.hull if region.A.shape[1] == 3 else Obstacle.polygon)(region.vertices)


def corners_around(region: Polyhedron) -> Array:
    """Corners of a bounded polygon that contains a region: its own, or those of the polygon around a disc."""
    disc = disc_of(region)
    return region.vertices if disc is None else disc.vertices


def disc_of(shape: Any) -> Disc | None:
    """The disc that an obstacle's piece or a region is, if it is one."""
    return getattr(shape, "disc", shape if isinstance(shape, Disc) else None)


def _circle(first: float = 0.0) -> Array:
    """Points of the unit circle, `SIDES` of them, from so many sides on, shape (SIDES, 2)."""
    angle = 2 * np.pi * (first + np.arange(SIDES)) / SIDES
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
