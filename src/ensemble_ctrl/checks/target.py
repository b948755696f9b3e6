"""Targets that don't fit the fleet, or that no control can reach."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.checks.finding import Finding
from ensemble_ctrl.target import Formation, MomentTarget, SpreadTarget

if TYPE_CHECKING:
    from ensemble_ctrl.problem import Problem

PATH = ("objective", "terminal", "target")
SLACK = 1e-9


def target_findings(problem: Problem) -> Iterator[Finding]:
    """What is wrong with the terminal target, and with a price of risk."""
    yield from _risk(problem)
    match problem.objective.target:
        case Formation() as target:
            yield from _formation(problem, target)
        case MomentTarget() as target:
            yield from _moments(problem, target)
        case SpreadTarget() as target:
            yield from _spread(problem, target)


def _risk(problem: Problem) -> Iterator[Finding]:
    """Distances need places to be away from; clearances are those that separating lines leave the fleet."""
    risk, target = problem.objective.cvar, problem.objective.target
    if risk is None:
        return
    path = ("objective", "cvar", "of")
    if risk.of == "terminal" and (target is None or isinstance(target, MomentTarget | SpreadTarget)):
        came = "none" if target is None else "moments of the whole fleet"
        message = f"expected a place, or a place for each member, in objective.terminal.target, got {came}"
        yield Finding(path, message, "a distance at the end is that from a member's place")
    if risk.of == "clearance" and (problem.solve.method == "minlp" or problem.solve.guarantee == "moment"):
        chosen = "method minlp" if problem.solve.method == "minlp" else "guarantee moment"
        yield Finding(path, f"expected no price on clearance with {chosen}", "use nlp, and nodes or hull")


def _formation(problem: Problem, target: Formation) -> Iterator[Finding]:
    """The parameter bends trajectories, the table covers its range, and each place is within reach."""
    fleet, path = problem.fleet, (*PATH, target.parameter)
    bent = [fleet.names[k] for k in fleet.bent]
    if target.parameter not in bent:
        known = ", ".join(bent) or "none"
        yield Finding(PATH, f"expected a parameter that bends trajectories ({known}), got {target.parameter!r}")
        return
    law = fleet.parameters[target.parameter]
    first, last = target.values[0], target.values[-1]
    if first > law.lower + SLACK or last < law.upper - SLACK:
        message = f"expected places for {law.lower:g} to {law.upper:g}, got them for {first:g} to {last:g} only"
        yield Finding(path, message, "add the ends of the range")
        return
    for value, place in zip(target.values, target.places, strict=True):
        if law.lower - SLACK <= value <= law.upper + SLACK:
            yield from _reach(problem, target, float(value), place)


def _reach(problem: Problem, target: Formation, value: float, place: NDArray[np.float64]) -> Iterator[Finding]:
    """A member can drive to its place."""
    fleet = problem.fleet
    members = np.array(fleet.corners)
    members[:, fleet.names.index(target.parameter)] = value
    speed = float(fleet.drives(members)[:, 0].max()) * float(np.abs([fleet.input_lower[0], fleet.input_upper[0]]).max())
    away = float(np.linalg.norm(place - fleet.start)) - float(np.linalg.norm(fleet.shift))
    if away > speed * problem.duration + SLACK:
        message = (
            f"({place[0]:g}, {place[1]:g}) is {away:.3g} m from the start, but at top speed a member with "
            f"{target.parameter} {value:g} drives {speed * problem.duration:.3g} m"
        )
        yield Finding((*PATH, target.parameter), message, "move the place, or allow more time")


def _moments(problem: Problem, target: MomentTarget) -> Iterator[Finding]:
    """Moments are of one parameter, and of no higher order than its law has."""
    laws = problem.fleet.bent_laws
    if len(laws) != 1:
        yield Finding(
            (*PATH, "moments"), f"expected a fleet with one parameter that bends trajectories, got {len(laws)}"
        )
    elif len(target.moments) - 1 > min(laws[0].max_order, problem.order or 50):
        most = min(laws[0].max_order, problem.order or 50) + 1
        yield Finding((*PATH, "moments"), f"expected at most {most} moments, got {len(target.moments)}")


def _spread(problem: Problem, target: SpreadTarget) -> Iterator[Finding]:
    """A start that is spread stays spread: one control shifts all members alike."""
    start = problem.fleet.shift_covariance
    missing = float(np.linalg.eigvalsh(target.covariance - start)[0])
    if missing < -SLACK:
        message = (
            f"no control can reach it: start positions alone have the covariance {start.round(6).tolist()}, "
            f"{-missing:.3g} m^2 more than this in some direction"
        )
        yield Finding((*PATH, "covariance"), message, "one control moves all starts alike; ask for at least as much")
