"""What the task speaks of: names, windows, and parts of the map that it leaves out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ensemble_ctrl.checks.finding import Finding
from ensemble_ctrl.constraints.stl import Avoid, FormulaError, Inside, check_windows, leaves, name_errors
from ensemble_ctrl.constraints.stl.rewrite import ALL_OBSTACLES
from ensemble_ctrl.errors import ProblemError

if TYPE_CHECKING:
    from ensemble_ctrl.problem import Problem

STATES = ("x", "y")
"""The coordinates of the plane."""


def task_findings(problem: Problem) -> Iterator[Finding]:
    """Unknown names, and windows that end after the plan."""
    for error in name_errors(problem.task, problem.regions, problem.obstacles, problem.fleet.states):
        yield _from_formula(error)
    try:
        check_windows(problem.task, problem.duration)
    except FormulaError as error:
        yield _from_formula(error, "lengthen horizon.duration or end the window earlier")
    except ProblemError as error:
        yield Finding(("task",), str(error).partition(": ")[2])


def _from_formula(error: FormulaError, hint: str = "") -> Finding:
    """A formula's error as a finding."""
    offset = error.column - 1 if error.column else None
    return Finding(("task",), f"expected {error.expected}, got {error.came}", hint or error.hint, offset=offset)


def mentioned(problem: Problem) -> tuple[set[str], set[str]]:
    """Names in ``in(...)`` and names in ``avoid(...)``."""
    found = list(leaves(problem.task))
    inside = {leaf.name for leaf in found if isinstance(leaf, Inside)} | {problem.objective.earliest or ""}
    return inside, {leaf.name for leaf in found if isinstance(leaf, Avoid)}


def unused_findings(problem: Problem) -> Iterator[Finding]:
    """Regions and obstacles that the task doesn't speak of."""
    inside, avoided = mentioned(problem)
    for name in problem.regions:
        if name not in inside | avoided:
            hint = f"add in({name}) or avoid({name}), or remove it"
            yield Finding(("regions", name), "the task never mentions this region", hint, "warning", on_key=True)
    if ALL_OBSTACLES in avoided or not problem.obstacles:
        return
    ignored = [name for name in problem.obstacles if name not in {*avoided, *problem.ignore}]
    if len(ignored) == len(problem.obstacles):
        message = "the task never mentions the obstacles, so robots may drive through them"
        hint = "add `and G avoid(obstacles)`, or list them under `ignore`"
        yield Finding(("obstacles",), message, hint, "warning", on_key=True)
        return
    for name in ignored:
        message = "the task never mentions this obstacle, so robots may drive through it"
        hint = f"add `and G avoid({name})`, or list it under `ignore`"
        yield Finding(("obstacles", name), message, hint, "warning", on_key=True)
