"""What the task refers to: names, windows, and parts of the map that it leaves out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ensemble_ctrl.constraints.stl import (
    Avoid,
    FormulaError,
    Inside,
    check_windows,
    conjuncts,
    kept_out,
    leaves,
    name_errors,
    resolve,
)
from ensemble_ctrl.constraints.stl.rewrite import ALL_OBSTACLES
from ensemble_ctrl.constraints.stl.robustness import fits_grid
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.problem.checks.finding import Finding
from ensemble_ctrl.problem.checks.members_apart import members_apart_findings

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem

STATES = ("x", "y")
"""The coordinates of the plane."""
MORE_STEPS = 1000
"""Numbers of steps tried for one with which every window can be planned."""


def task_findings(problem: Problem) -> Iterator[Finding]:
    """Unknown names, and windows that end after the plan."""
    yield from members_apart_findings(problem)
    known = (*problem.fleet.states, *problem.fleet.system.signals)
    for error in name_errors(problem.task, problem.regions, (*problem.obstacles, *problem.zones), known):
        yield _from_formula(error)
    try:
        check_windows(problem.task, problem.duration)
    except FormulaError as error:
        yield _from_formula(error, "lengthen horizon.duration or end the window earlier")
    except ProblemError as error:
        yield Finding(("task",), str(error).partition(": ")[2])
    else:
        yield from _between_steps(problem)


def _between_steps(problem: Problem) -> Iterator[Finding]:
    """A window within one step: a plan may do the task, but the planner samples the ends of steps."""
    if problem.least_duration is not None:  # the duration is chosen to fit
        return
    for part in conjuncts(problem.task):
        formula = resolve(part, problem.duration)
        if kept_out(part) or fits_grid(formula, problem.step):
            continue
        more = (
            n for n in range(problem.steps + 1, problem.steps + MORE_STEPS) if fits_grid(formula, problem.duration / n)
        )
        hint = f"horizon.steps: {steps} would do" if (steps := next(more, None)) else "widen it"
        message = f"a window of {part} holds no end of a step ({problem.step:.3g} s): it can be proven, but not planned"
        yield Finding(("task",), message, hint, "warning")


def _from_formula(error: FormulaError, hint: str = "") -> Finding:
    """A formula's error as a finding."""
    offset = error.column - 1 if error.column else None
    return Finding(("task",), f"expected {error.expected}, got {error.came}", hint or error.hint, offset=offset)


def mentioned(problem: Problem) -> tuple[set[str], set[str]]:
    """Names in ``in(...)`` and names in ``avoid(...)``."""
    found = list(leaves(problem.task))
    inside = {leaf.name for leaf in found if isinstance(leaf, Inside)} | {problem.objective.earliest or ""}
    return inside, {leaf.name for leaf in found if isinstance(leaf, Avoid)}


def are_known(problem: Problem) -> bool:
    """Whether every place that the task names is there."""
    inside, avoided = mentioned(problem)
    return (inside | avoided) - {"", ALL_OBSTACLES} <= {*problem.regions, *problem.obstacles, *problem.zones}


def unused_findings(problem: Problem) -> Iterator[Finding]:
    """Regions and obstacles that the task does not mention."""
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
