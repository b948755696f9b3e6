"""A small drawing of a plan for notebooks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.drawing import map_svg
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.replay import trajectories

Floats = NDArray[np.float64]

MEMBERS = 7
"""Members drawn, spread over the parameter's range."""


def plan_svg(problem: Problem, controls: Floats) -> str:
    """The map and the paths of a few members, as one SVG element.

    Parameters
    ----------
    problem : Problem
        Map and fleet.
    controls : ndarray, shape (steps, n_u)
        Broadcast commands.
    """
    paths = trajectories(problem, controls, problem.fleet.spread(MEMBERS))
    return map_svg(problem, list(paths))
