"""Poses in a problem file: regions with headings, and a pose to end in, as parts of the task."""

from __future__ import annotations

import math
from typing import Any

from ensemble_ctrl.constraints.stl import And, Formula, Inside, Within, conjuncts
from ensemble_ctrl.constraints.stl.rewrite import map_leaves
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config.schema import ProblemFile
from ensemble_ctrl.problem.checks import Finding
from ensemble_ctrl.problem.target import Pose
from ensemble_ctrl.systems import System

Path = tuple[str | int, ...]


def with_poses(file: ProblemFile, system: System) -> Formula:
    """The task of a file, with the headings of its regions and the pose of its target.

    Raises
    ------
    ProblemError
        For robots without a heading, ranges of a whole turn or more, and an earliest passage of such a region.
    """
    ranges = {name: shape.heading for name, shape in file.regions.items() if shape.heading is not None}
    headings = {name: _within(name, given, system) for name, given in ranges.items()}
    earliest = file.objective.earliest
    if earliest in headings:
        wrong = f"the earliest passage is of a place, and region {earliest!r} has a heading"
        raise _refused(("objective", "earliest"), wrong, "take the heading out, or give the visit a window in the task")

    def change(leaf: Formula) -> Formula:
        if not isinstance(leaf, Inside) or leaf.name not in headings:
            return leaf
        half, centre = headings[leaf.name]
        return And((leaf, Within(system.heading_state, half, centre, column=leaf.column)))

    task = map_leaves(file.task, change) if headings else file.task
    target: Any = None if file.objective.terminal is None else file.objective.terminal.target
    if not isinstance(target, Pose):
        return task
    path = ("objective", "terminal", "target", "heading")
    _require_heading(path, system)
    return And((*conjuncts(task), target.reached(system.positions, system.heading_state)))


def _within(name: str, given: tuple[float, float], system: System) -> tuple[float, float]:
    """Half the width of a range of headings, and its middle from -pi to pi."""
    path = ("regions", name, "heading")
    _require_heading(path, system)
    low, high = given
    if not 0 < high - low < 2 * math.pi:
        came = f"[{math.degrees(low):g} deg, {math.degrees(high):g} deg]"
        raise _refused(path, f"expected a range above 0 deg and below 360 deg, got {came}", "")
    return (high - low) / 2, math.remainder((low + high) / 2, 2 * math.pi)


def _require_heading(path: Path, system: System) -> None:
    """Refuse robots without a heading."""
    if not system.heading_state:
        raise _refused(path, f"expected none, since the {system.name} has no heading", "")


def _refused(path: Path, message: str, hint: str) -> ProblemError:
    """An error at its place in the file."""
    wrong = ProblemError(f"{'.'.join(map(str, path))}: {message}")
    wrong.findings = (Finding(path, message, hint),)
    return wrong
