"""What a problem may ask of a fleet that follows a differential equation, and what such a fleet needs of its map."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import Avoid, Inside, Not, Share, conjuncts
from ensemble_ctrl.constraints.stl.formula import Formula
from ensemble_ctrl.problem.checks.coverage import coverage_findings
from ensemble_ctrl.problem.checks.finding import SLACK, Finding
from ensemble_ctrl.problem.checks.numbers import name_findings, number_findings
from ensemble_ctrl.problem.checks.task import task_findings, unused_findings
from ensemble_ctrl.problem.checks.work import work_findings

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import OdeProblem, Problem

Floats = NDArray[np.float64]


def ode_findings(problem: OdeProblem) -> Iterator[Finding]:
    """Everything wrong or odd; where a number makes no sense, only such numbers are reported."""
    numbers = [*number_findings(problem), *name_findings(problem), *_options(problem), *_target(problem)]
    if numbers:
        yield from numbers
        return
    shapes = [*_dimensions(problem)]
    yield from shapes
    yield from task_findings(problem)
    if not shapes:
        yield from _start(problem)
    yield from unused_findings(problem)
    yield from coverage_findings(problem)
    yield from work_findings(problem)


def _options(problem: Problem) -> Iterator[Finding]:
    """What is for robots on arcs alone."""
    model = problem.fleet.system.name
    if problem.solve.guarantee == "moment":
        yield Finding(("solve", "guarantee"), f"moment is not for the {model}", "use nodes or hull")
    if problem.solve.method == "minlp":
        yield Finding(("solve", "method"), f"minlp is not for the {model}", "use nlp")
    if problem.solve.cells != 1:
        yield Finding(("solve", "cells"), f"cells are not for the {model}", "leave them out")
    if problem.report.twin:
        yield Finding(("report", "twin"), f"the twin is not for the {model}", "leave it out")
    aim = problem.objective
    if aim.cvar is not None:
        yield Finding(("objective", "cvar"), f"a risk penalty is not for the {model}", "leave it out")
    if aim.earliest is not None:
        yield Finding(("objective", "earliest"), f"the earliest passage is not for the {model}", "leave it out")
    if problem.least_duration is not None:
        yield Finding(("horizon", "duration"), f"a free duration is not for the {model}", "give one, 4 s say")
    for name in problem.motions:
        yield Finding(("motions", name), f"moving obstacles are not for the {model}", on_key=True)


def _target(problem: Problem) -> Iterator[Finding]:
    """The target is a place of as many coordinates as the position has."""
    target, places = problem.objective.target, problem.fleet.places
    path = ("objective", "terminal", "target")
    if target is None:
        return
    if not isinstance(target, np.ndarray):
        yield Finding(path, f"only a place can be the target of a {problem.fleet.system.name}", "for example [1, 0]")
    elif len(target) != len(places):
        yield Finding(path, f"expected one number for each of {', '.join(places)}, got {target.tolist()}")


def _dimensions(problem: Problem) -> Iterator[Finding]:
    """Regions and obstacles are of the position's dimension, and have points."""
    places = problem.fleet.places
    wanted = f"expected {len(places)} dimension{'s' * (len(places) > 1)} ({', '.join(places)})"
    for name, region in problem.regions.items():
        if region.A.shape[1] != len(places):
            yield Finding(("regions", name), f"{wanted}, got {region.A.shape[1]}", on_key=True)
        elif region.is_empty:
            message = "this region is empty: no point satisfies all of its inequalities"
            yield Finding(("regions", name), message, on_key=True)
    for name, pieces in problem.obstacles.items():
        if len(places) == 1:
            yield Finding(("obstacles", name), "expected none: a position of one coordinate has regions only")
        for piece in pieces:
            if piece.A.shape[1] != len(places) > 1:
                yield Finding(("obstacles", name), f"{wanted}, got {piece.A.shape[1]}", on_key=True)
                break
    if len(places) == 1 and _keeps_out(problem.task):
        yield Finding(("task",), "a position of one coordinate can't be kept out of places", "write x <= 1 or the like")


def _keeps_out(formula: Formula) -> bool:
    """Whether a formula keeps out of a place."""
    outside = isinstance(formula, Not) and isinstance(formula.child, Inside)
    return isinstance(formula, Avoid) or outside or any(_keeps_out(part) for part in formula.parts)


def _start(problem: OdeProblem) -> Iterator[Finding]:
    """The start, or that of a member at a corner of the ranges, is in an obstacle, or closer to it than the radius."""
    starts = _starts(problem)
    for name, pieces in problem.obstacles.items():
        moved = problem.motions[name].at(0.0) if name in problem.motions else 0.0
        depths = problem.fleet.radius - np.min([piece.distance(starts - moved) for piece in pieces], axis=0)
        if depths.max() > SLACK:
            place = ", ".join(f"{x:g}" for x in starts[int(depths.argmax())])
            message = f"the start ({place}) is {depths.max():.3g} m deep inside obstacle {name!r}, grown by the radius"
            yield Finding(("fleet", "start"), message, "move the start or the obstacle")


def _starts(problem: OdeProblem) -> Floats:
    """Where members start, shape (starts, d): the middle one, and those at the corners unless a share is enough."""
    fleet = problem.fleet
    enough = any(isinstance(part, Share) for part in conjuncts(problem.task))
    members = fleet.center[None] if enough else np.concatenate([fleet.center[None], fleet.corners])
    return np.asarray(fleet.start_states(members)[fleet.place_columns].T)
