"""Regions that every member has to be in before the slowest one can be there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ensemble_ctrl.checks.finding import Finding
from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import Always, And, Eventually, Formula, Inside, Until
from ensemble_ctrl.errors import ProblemError

if TYPE_CHECKING:
    from ensemble_ctrl.problem import Problem

SLACK = 1e-9


def reach_findings(problem: Problem) -> Iterator[Finding]:
    """Regions that have to be reached before the slowest member can be there."""
    for leaf, deadline in required(problem.task, 0.0, problem.duration):
        region = problem.regions.get(leaf.name)
        if region is None or region.A.shape[1] != 2 or region.is_empty:
            continue
        distance = _distance(region, problem)
        if deadline <= 0.0 and distance > SLACK:
            yield _wrong_start(leaf, distance, problem)
        elif distance > _top_speed(problem) * min(deadline, problem.duration) + SLACK:
            yield _out_of_reach(leaf, distance, min(deadline, problem.duration), problem)


def required(formula: Formula, latest: float, duration: float) -> Iterator[tuple[Inside, float]]:
    """Every region that all members have to be in at some time up to a latest one."""

    def end(time: float | None) -> float:
        return duration if time is None else time

    match formula:
        case Inside():
            yield formula, latest
        case And():
            for part in formula.parts:
                yield from required(part, latest, duration)
        case Always(child=child, a=a):
            yield from required(child, latest + (a or 0.0), duration)
        case Eventually(child=child, b=b):
            yield from required(child, latest + end(b), duration)
        case Until(right=right, b=b):
            yield from required(right, latest + end(b), duration)


def _distance(region: Polyhedron, problem: Problem) -> float:
    """Distance from the start to a region; a lower bound of it where the region is flat or unbounded."""
    start = problem.fleet.position
    try:
        G, h = region.unit_rows()
        return float(Obstacle(-G, -h).distance(start))
    except ProblemError:
        return -float(region.margin(start))


def _top_speed(problem: Problem) -> float:
    """Speed that the slowest member can't exceed, in m/s."""
    fastest = max(abs(float(problem.fleet.input_lower[0])), abs(float(problem.fleet.input_upper[0])))
    return problem.fleet.slowest * fastest


def _wrong_start(leaf: Inside, distance: float, problem: Problem) -> Finding:
    """A finding for a region that has to hold from the start."""
    x, y = problem.fleet.position
    message = f"members have to be in {leaf.name!r} from the start, but ({x:g}, {y:g}) is {distance:.3g} m outside"
    return Finding(("task",), message, "move the start, or let the window begin later", offset=_offset(leaf))


def _out_of_reach(leaf: Inside, distance: float, deadline: float, problem: Problem) -> Finding:
    """A finding for a region that is too far."""
    speed = _top_speed(problem)
    message = (
        f"region {leaf.name!r} is {distance:.3g} m from the start, but at top speed the slowest member "
        f"(traction {problem.fleet.slowest:g}) drives {speed * deadline:.3g} m by {deadline:g} s"
    )
    hint = "raise fleet.input_bounds.v"
    if speed > 0:
        needed = f"{distance / speed:.3g} s at {speed:.3g} m/s"
        hint = f"it needs {needed}: allow more time or raise fleet.input_bounds.v"
    return Finding(("task",), message, hint, offset=_offset(leaf))


def _offset(leaf: Inside) -> int | None:
    """Place of a leaf in its text."""
    return leaf.column - 1 if leaf.column else None
