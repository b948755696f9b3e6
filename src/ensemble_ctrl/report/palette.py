"""Colours that pictures, pages and animations share: distinct for colour-blind readers, and in print without colour."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.problem.ensemble import Ensemble

Floats = NDArray[np.float64]

OBSTACLE, OBSTACLE_EDGE, REGION, CONTRAST = "#8a8f98", "#5a5f68", "#2166ac", "#b2182b"
SLOW, KEEP_OUT = "#8a5a00", "#b2182b"
"""Of zones with a speed limit, and of those that robots keep out of."""
ON_OBSTACLE = "#000000"
"""Of names on obstacles: 6.4 times as dark as they are."""
PATCH, PATCH_EDGE = "#d9c3a0", "#7a5c2e"
"""Of patches of terrain, and of their outlines and names: 5.6 times as dark as white."""
OUTLINE, INSIDE = "#33373d", "#dfe8f2"
"""Of robots, and of regions that are filled."""
INSIDE_SLOW, INSIDE_KEEP_OUT = "#f3eadb", "#f6e3e4"
"""Of zones that are filled."""
GRID, SOFT = "#e2e5ea", "#5b6470"
"""Of lines behind what is drawn, and of their numbers."""
LINES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
"""Okabe and Ito's colours, for different lines; pair them with `DASHES`."""
DASHES = ("", "6 3", "2 2", "8 2 2 2", "10 4", "4 1", "1 3")
"""Dash patterns as in SVG: line k is recognised by its pattern as well as by its colour."""
VIRIDIS = np.array(
    [
        [68, 1, 84],
        [72, 24, 106],
        [71, 45, 123],
        [66, 64, 134],
        [59, 82, 139],
        [51, 99, 141],
        [44, 114, 142],
        [38, 130, 142],
        [33, 145, 140],
        [31, 160, 136],
        [40, 174, 128],
        [63, 188, 115],
        [94, 201, 98],
        [132, 212, 75],
        [173, 220, 48],
        [216, 226, 25],
        [253, 231, 37],
    ],
    dtype=float,
)
"""Viridis (S. van der Walt and N. Smith, 2015) at 17 equal steps: as light as it is far along."""


def viridis(share: ArrayLike) -> NDArray[np.uint8]:
    """Colours from dark (0) to light (1), shape (..., 3)."""
    # linear interpolation of each channel
    at = np.clip(np.asarray(share, dtype=float), 0.0, 1.0) * (len(VIRIDIS) - 1)
    channels = [np.interp(at, np.arange(len(VIRIDIS)), VIRIDIS[:, k]) for k in range(3)]
    return np.stack(channels, axis=-1).round().astype(np.uint8)


def hexadecimal(colour: NDArray[np.uint8]) -> str:
    """``#rrggbb`` of one colour."""
    return "#" + "".join(f"{int(c):02x}" for c in colour)


def shades(fleet: Ensemble, members: Floats) -> Floats:
    """Where members are in the range of the fleet's first parameter, 0 to 1, shape (members,); 0.3 if there is none."""
    if not fleet.names or fleet.upper[0] <= fleet.lower[0]:
        return np.full(len(members), 0.3)
    return np.asarray((members[:, 0] - fleet.lower[0]) / (fleet.upper[0] - fleet.lower[0]))
