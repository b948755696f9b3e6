"""A plan seen from above: what every drawing of a map is made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.drawing import frame, outlines, target_lines
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.replay import trajectories

Floats = NDArray[np.float64]

LOOKS = 21
"""Times at which moving obstacles count for what a map has to show."""


def ways(problem: Problem, controls: Floats, members: Floats, substeps: int = 1) -> Floats:
    """Ways of members on the map, shape (members, steps * substeps + 1, 2), metres."""
    return trajectories(problem, controls, members, substeps)[..., :2]


def window(problem: Problem, paths: list[Floats]) -> tuple[Floats, Floats]:
    """Lower left corner and size of what a map has to show, metres: everything, wherever obstacles go."""
    shapes = [problem.fleet.position[None, :], *paths]
    for name, piece in problem.pieces:
        motion = problem.motions.get(name)
        offsets = np.zeros((1, 2)) if motion is None else motion.at(np.linspace(0.0, problem.duration, LOOKS))
        shapes += [piece.vertices + offset for offset in offsets]
    return frame([*shapes, *outlines(problem, paths).values(), *target_lines(problem)])


def some(count: int, most: int) -> NDArray[np.int64]:
    """At most `most` about evenly spaced indices below `count`, both ends included, shape (indices,)."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(np.int64))
