"""What a loop is given of obstacles that come on the way, read and checked before the map changes."""

from __future__ import annotations

from typing import Any

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl._tokens import RESERVED
from ensemble_ctrl.constraints.stl.rewrite import ALL_OBSTACLES
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import expect
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.arguments.readers import pieces_of


def require_new(problem: Problem, name: Any) -> None:
    """Refuse what is no name, is taken, or means something else in a task, as `obstacles` does: all of them."""
    if not expect("obstacle", name, str, "a name"):
        raise ProblemError("obstacle: expected a name, got an empty one")
    if name in RESERVED or name == ALL_OBSTACLES:
        raise ProblemError(f"obstacle: expected another name, {name!r} is a word of the task language")
    if name in problem.obstacles or name in problem.regions:
        raise ProblemError(f"obstacle: expected a new name, got {name!r}")


def pieces_in_plane(pieces: Any) -> tuple[Obstacle, ...]:
    """The convex pieces of an obstacle, at least one."""
    found = pieces_of("obstacle", pieces)
    if not found or any(piece.vertices.shape[1] != 2 for piece in found):
        got = "one in space" if found else "none"
        raise ProblemError(f"obstacle: expected one or more convex pieces in the plane, got {got}")
    return found


def motion_in_plane(motion: Any) -> Motion:
    """How an obstacle moves."""
    found = expect("obstacle", motion, Motion, "a Motion")
    if found.offsets.shape[1] != 2:
        raise ProblemError("obstacle: expected a motion with displacements [x, y], got [x, y, z]")
    return found
