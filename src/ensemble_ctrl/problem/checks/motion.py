"""Motions of obstacles that don't fit the problem."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ensemble_ctrl.constraints.stl import Avoid, Formula, conjuncts, kept_out, leaves
from ensemble_ctrl.constraints.stl.rewrite import ALL_OBSTACLES
from ensemble_ctrl.problem.checks.finding import SLACK, Finding

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem


def motion_findings(problem: Problem) -> Iterator[Finding]:
    """Motions of nothing, for a part of the horizon only, or of what the planner can't follow."""
    for name, motion in problem.motions.items():
        path = ("motions", name)
        if name not in problem.obstacles:
            known = ", ".join(problem.obstacles) or "none"
            yield Finding(path, f"expected the name of an obstacle ({known}), got {name!r}", on_key=True)
        elif motion.times[0] > SLACK or motion.times[-1] < problem.duration - SLACK:
            times = f"{motion.times[0]:g} to {motion.times[-1]:g} s"
            yield Finding(path, f"expected times from 0 to {problem.duration:g} s, got {times}", on_key=True)
    if problem.motions and problem.solve.method == "minlp" and problem.fleet.system.transcription == "positions":
        yield Finding(("solve", "method"), "minlp is for obstacles that stand still", "use nlp")
    yield from moving_elsewhere(problem)


def moving_elsewhere(problem: Problem) -> Iterator[Finding]:
    """Moving obstacles that the task avoids otherwise than throughout a window."""
    for part in conjuncts(problem.task):
        if not kept_out(part):
            yield from _inside(problem, part)


def _inside(problem: Problem, part: Formula) -> Iterator[Finding]:
    """Moving obstacles that a part of the task avoids at some times only."""
    for leaf in leaves(part):
        if isinstance(leaf, Avoid):
            names = list(problem.obstacles) if leaf.name == ALL_OBSTACLES else [leaf.name]
            for name in names:
                if name in problem.motions:
                    message = f"{name!r} moves, and a moving obstacle can only be avoided throughout a window"
                    offset = leaf.column - 1 if leaf.column else None
                    yield Finding(("task",), message, f"write G[a,b] avoid({name}) as a part of its own", offset=offset)
