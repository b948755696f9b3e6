"""The shape of a robot: a convex polygon that moves and turns with it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.constraints.obstacle import Obstacle
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyArrays
from ensemble_ctrl.core.values import numbers

Floats = NDArray[np.float64]

MOST_CORNERS = 16
"""Corners that a footprint may have: rows of the program and of the proof grow with them."""
LONGEST = 1e3
"""Metres from the reference point to a corner, at most."""
BLOCK = 4096
"""Poses at a time."""


@dataclass(frozen=True, eq=False)
class Footprint(ReadOnlyArrays):
    """A convex polygon in the robot's frame: x forwards, y to the left, from the point whose position is planned.

    Parameters
    ----------
    corners : array_like, shape (corners, 2)
        Metres, in either direction; three to `MOST_CORNERS`.

    Raises
    ------
    ProblemError
        If it is not convex, has no area, or too many corners or too distant ones.

    Examples
    --------
    >>> car = Footprint.rectangle(length=4.6, width=1.9, rear_overhang=1.0)
    >>> car.corners.round(9).tolist()
    [[-1.0, -0.95], [3.6, -0.95], [3.6, 0.95], [-1.0, 0.95]]
    >>> wall = Obstacle.box([[5, 6], [-9, 9]])
    >>> car.distance(wall, np.array([[0.0, 0.0], [0.0, 0.0]]), np.array([0.0, np.pi])).round(3)
    array([1.4, 4. ])
    """

    corners: Floats

    def __post_init__(self) -> None:
        try:
            shape = Obstacle.polygon(numbers("footprint", self.corners, "corners [[x, y], ...]"))
        except ProblemError as error:
            why = str(error).partition(": ")[2].partition(", got another; use")[0]
            raise ProblemError(f"footprint: {why}") from None
        corners = np.array(shape.vertices)
        if len(corners) > MOST_CORNERS:
            raise ProblemError(f"footprint: expected at most {MOST_CORNERS} corners, got {len(corners)}")
        if np.abs(corners).max() > LONGEST:
            raise ProblemError(f"footprint: expected corners within {LONGEST:g} m, got {np.abs(corners).max():g} m")
        corners.setflags(write=False)
        object.__setattr__(self, "corners", corners)

    @classmethod
    def rectangle(cls, length: float, width: float, rear_overhang: float | None = None) -> Footprint:
        """A body of a length and a width, so far behind the planned point; half its length if not given."""
        behind = length / 2 if rear_overhang is None else rear_overhang
        for name, value in (("length", length), ("width", width)):
            if not (np.isfinite(value) and value > 0):
                raise ProblemError(f"footprint.{name}: expected metres above 0, got {value}")
        if not 0 <= behind <= length:
            raise ProblemError(f"footprint.rear_overhang: expected 0 to {length:g} m, the length, got {behind:g} m")
        low, high, half = 0.0 - behind, length - behind, width / 2
        return cls(np.array([[low, -half], [high, -half], [high, half], [low, half]]))

    @cached_property
    def shape(self) -> Obstacle:
        """The polygon itself, in the robot's frame."""
        return Obstacle.polygon(self.corners)

    @cached_property
    def reach(self) -> float:
        """Metres from the planned point to the farthest corner, rounded up."""
        return float(np.hypot(*self.corners.T).max() * (1 + 1e-15))

    @cached_property
    def narrow(self) -> float:
        """Metres from the planned point to the nearest side; 0 if it is outside."""
        return max(0.0, -float(self.shape.distance(np.zeros(2))))

    @cached_property
    def holds_point(self) -> bool:
        """Whether the planned point is part of the body, the border included; else it may be inside of obstacles."""
        return bool(self.shape.distance(np.zeros(2)) <= 0)

    def __str__(self) -> str:
        """Length and width, or the number of corners of another polygon."""
        low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        length, width = (high - low).tolist()
        ends = np.stack([low, high])
        box = len(self.corners) == 4 and bool((self.corners[:, None] == ends).any(axis=1).all())
        return f"{length:g} m by {width:g} m" + ("" if box else f" with {len(self.corners)} corners")

    def at(self, places: ArrayLike, headings: ArrayLike) -> Floats:
        """Corners at poses, (..., 2) and (...) to (..., corners, 2); headings in radians from +x, counter-clockwise."""
        angle = np.asarray(headings, dtype=float)[..., None]
        c, s = np.cos(angle), np.sin(angle)
        x, y = self.corners.T
        return np.asarray(np.stack([c * x - s * y, s * x + c * y], axis=-1) + np.asarray(places)[..., None, :])

    def distance(self, obstacle: Obstacle, places: Floats, headings: Floats) -> Floats:
        """Signed distance of the body from an obstacle at poses, (..., 2) and (...) to (...); minus the depth inside.

        Notes
        -----
        Convex polygons that are apart have a corner of one among their nearest points; of two that overlap, the depth
        is along the normal of a side of one.
        """
        flat, angles = places.reshape(-1, 2), np.broadcast_to(headings, places.shape[:-1]).reshape(-1)
        found = np.empty(len(flat))
        for some in (slice(i, i + BLOCK) for i in range(0, len(flat), BLOCK)):
            found[some] = self._distance(obstacle, flat[some], angles[some])
        return found.reshape(places.shape[:-1])

    def _distance(self, obstacle: Obstacle, places: Floats, angles: Floats) -> Floats:
        """The same of one block."""
        corners, core = self.at(places, angles), obstacle.core
        # the obstacle's core in the robot's frame
        c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
        dx, dy = (core[None] - places[:, None]).transpose(2, 0, 1)
        seen = np.stack([c * dx + s * dy, c * dy - s * dx], axis=-1)
        # gaps along the normals of the body's sides, and along those of the core's
        G, h = self.shape.unit_rows()
        gap = ((seen @ G.T).min(axis=1) - h).max(axis=1)
        if len(core) > 2:
            along = np.roll(core, -1, axis=0) - core
            out = np.stack([along[:, 1], -along[:, 0]], axis=1)
            out = out / np.maximum(np.hypot(*out.T), 1e-300)[:, None]
            gap = np.maximum(gap, ((corners @ out.T).min(axis=1) - (core @ out.T).max(axis=0)).max(axis=1))
        # apart: the nearest of the corners of both
        own = obstacle.distance(corners).min(axis=1) + obstacle.rounding
        apart = np.minimum(own, self.shape.distance(seen).min(axis=1))
        return np.asarray(np.where(gap > 0, apart, gap) - obstacle.rounding)
