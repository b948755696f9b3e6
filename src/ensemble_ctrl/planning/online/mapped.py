"""A problem on another map."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from types import MappingProxyType

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.problem import Problem


def with_map(problem: Problem, obstacles: Mapping[str, tuple[Obstacle, ...]], motions: Mapping[str, Motion]) -> Problem:
    """The problem with other obstacles, unchecked: what is seen on the way is so, whatever is left to do then."""
    changed = copy(problem)
    object.__setattr__(changed, "obstacles", MappingProxyType(dict(obstacles)))
    object.__setattr__(changed, "motions", MappingProxyType(dict(motions)))
    return changed
