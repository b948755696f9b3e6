"""Patches of ground in which parameters of the robots may differ from their own values, such as mud."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyMapping
from ensemble_ctrl.core.values import numbers
from ensemble_ctrl.problem.arguments.readers import mapping_of, pieces_of

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Patch:
    """An area in which some parameters may be anything between a robot's own values and the ends of given ranges.

    A robot is inside when its position is, on the border included. There each of the parameters may be any function of
    time with values in the hull of the robot's own value and the range; the ground may also be as good as elsewhere.
    Where patches overlap, the hull is that of all their ranges.

    Parameters
    ----------
    pieces : Obstacle, Polyhedron, box, or a sequence of them
        The area, in metres; a union of convex pieces.
    parameters : mapping of str to (float, float)
        The range of each parameter of the system, smallest value first.

    Raises
    ------
    ProblemError
        For an area without pieces, no parameters, and ranges that are not two finite numbers in order.

    Examples
    --------
    >>> mud = Patch([[1, 2], [0, 3]], {"traction": (0.6, 0.8)})
    >>> mud.contains(np.array([[1.0, 2.0], [2.5, 2.0]]))
    array([ True, False])
    >>> mud.between("traction", np.array([0.7, 1.0]))
    (array([0.6, 0.6]), array([0.8, 1. ]))
    """

    pieces: tuple[Obstacle, ...]
    parameters: Mapping[str, tuple[float, float]]

    def __post_init__(self) -> None:
        object.__setattr__(self, "pieces", pieces_of("Patch.pieces", self.pieces))
        given = mapping_of("Patch.parameters", self.parameters, object, "a range (low, high)")
        read = {name: _range(f"Patch.parameters[{name!r}]", value) for name, value in given.items()}
        if not self.pieces or not read:
            raise ProblemError(f"Patch: expected an area and a parameter, got {len(self.pieces)} and {len(read)}")
        object.__setattr__(self, "parameters", ReadOnlyMapping(read))

    def between(self, name: str, own: Floats) -> tuple[Floats, Floats]:
        """Smallest and largest value that a parameter may have inside, for robots with these values elsewhere."""
        low, high = self.parameters[name]
        return np.minimum(own, low), np.maximum(own, high)

    def contains(self, places: Floats) -> Bools:
        """Whether places of shape (..., 2), metres, are inside or on the border."""
        return np.asarray(self.distance(places) <= 0)

    def distance(self, places: Floats) -> Floats:
        """Distance of places of shape (..., 2) from the area, metres; negative inside."""
        return np.asarray(np.minimum.reduce([piece.distance(places) for piece in self.pieces]))

    def data(self) -> dict[str, Any]:
        """Corners of the pieces, and the ranges, as plain data."""
        corners = [
            {"corners": piece.core.tolist()} | ({"grown": piece.rounding} if piece.rounding else {})
            for piece in self.pieces
        ]
        return {
            "pieces": corners,
            "parameters": {name: list(self.parameters[name]) for name in sorted(self.parameters)},
        }


def terrain_data(terrain: Mapping[str, Patch]) -> dict[str, Any]:
    """Patches as plain data under their key; nothing where there are none."""
    return {"terrain": {name: terrain[name].data() for name in sorted(terrain)}} if terrain else {}


def _range(name: str, value: Any) -> tuple[float, float]:
    """Two finite numbers in order."""
    ends = numbers(name, value, "a range (low, high)")
    if ends.shape != (2,) or not np.isfinite(ends).all() or ends[0] > ends[1]:
        raise ProblemError(f"{name}: expected a range (low, high), got {ends.tolist()}")
    return float(ends[0]), float(ends[1])
