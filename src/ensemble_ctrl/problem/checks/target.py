"""Targets that don't fit the fleet, or that no control can reach."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem.checks.finding import SLACK, Finding
from ensemble_ctrl.problem.checks.spread import apart, furthest, top_speed, widest
from ensemble_ctrl.problem.target import Formation, MomentTarget, SpreadTarget

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem

PATH = ("objective", "terminal", "target")
Floats = NDArray[np.float64]


def target_findings(problem: Problem) -> Iterator[Finding]:
    """What is wrong with the terminal target, and with a risk penalty."""
    yield from _risk(problem)
    place, names = problem.objective.place, problem.fleet.places
    if place is not None and len(place) != len(names):
        if not isinstance(problem.objective.target, np.ndarray):
            yield Finding(PATH, f"expected a number for each of {', '.join(names)} in every place, got {len(place)}")
        return
    match problem.objective.target:
        case Formation() as target:
            yield from _formation(problem, target)
        case MomentTarget() as target:
            yield from _moments(problem, target)
        case SpreadTarget() as target:
            yield from _spread(problem, target)


def _risk(problem: Problem) -> Iterator[Finding]:
    """Distances need places to be away from; clearances are those that separating hyperplanes leave the fleet."""
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
        yield Finding(path, f"expected no penalty on clearance with {chosen}", "use nlp, and nodes or hull")


def _formation(problem: Problem, target: Formation) -> Iterator[Finding]:
    """The parameter bends trajectories, the table covers its range, and each place is within reach."""
    fleet, path = problem.fleet, (*PATH, target.parameter)
    dynamic = [fleet.names[k] for k in fleet.dynamic]
    if target.parameter not in dynamic:
        known = ", ".join(dynamic) or "none"
        yield Finding(PATH, f"expected a parameter that bends trajectories ({known}), got {target.parameter!r}")
        return
    distribution = fleet.parameters[target.parameter]
    first, last = target.values[0], target.values[-1]
    if first > distribution.lower + SLACK or last < distribution.upper - SLACK:
        wanted = f"{distribution.lower:g} to {distribution.upper:g}"
        message = f"expected places for {wanted}, got them for {first:g} to {last:g} only"
        yield Finding(path, message, "add the ends of the range")
        return
    inside = [
        (float(value), place)
        for value, place in zip(target.values, target.places, strict=True)
        if distribution.lower - SLACK <= value <= distribution.upper + SLACK
    ]
    far = [finding for value, place in inside for finding in _reach(problem, target, value, place)]
    yield from far
    if not far:
        for (value, place), (other, there) in combinations(inside, 2):
            yield from _apart(problem, target, (value, place), (other, there))


def _reach(problem: Problem, target: Formation, value: float, place: NDArray[np.float64]) -> Iterator[Finding]:
    """A member can drive to its place."""
    fleet = problem.fleet
    members = np.array(fleet.corners)
    members[:, fleet.names.index(target.parameter)] = value
    if not fleet.system.on_arcs:
        return
    speed = float(fleet.coefficients(members)[:, 0].max()) * top_speed(problem)
    # ||place - start|| less the shift of the start, against psi v_max T
    away = float(np.linalg.norm(place - fleet.start_place)) - float(np.linalg.norm(fleet.shift))
    if away > speed * problem.duration + SLACK:
        message = (
            f"({place[0]:g}, {place[1]:g}) is {away:.3g} m from the start, but at top speed a member with "
            f"{target.parameter} {value:g} drives {speed * problem.duration:.3g} m"
        )
        yield Finding((*PATH, target.parameter), message, "move the place, or allow more time")


def _apart(
    problem: Problem, target: Formation, one: tuple[float, Floats], other: tuple[float, Floats]
) -> Iterator[Finding]:
    """One control can drive two members as far apart as their places are."""
    column = problem.fleet.names.index(target.parameter)
    members = np.tile(problem.fleet.center, (2, 1))
    members[:, column] = one[0], other[0]
    wanted = float(np.linalg.norm(one[1] - other[1]))
    most = _most_apart(problem, target.parameter, members)
    if wanted > most + SLACK:
        message = (
            f"no control can reach it: members with {target.parameter} {one[0]:g} and {other[0]:g} should end "
            f"{wanted:.3g} m apart, {wanted - most:.3g} m more than one control can bring them"
        )
        yield Finding((*PATH, target.parameter), message, "they differ too little: move the places closer together")


def _most_apart(problem: Problem, parameter: str, members: Floats) -> float:
    """How far apart two members can end that share all other parameters, whatever these are."""
    column, found = problem.fleet.names.index(parameter), []
    # the bound is affine in the shared factor on speed: largest at a corner
    for corner in problem.fleet.corners:
        pair = np.tile(corner, (2, 1))
        pair[:, column] = members[:, column]
        found.append(apart(problem, *pair))
    return max(found)


def _mean(problem: Problem, mean: Floats, field: str) -> Iterator[Finding]:
    """The mean of the fleet ends no further from the start than members can drive."""
    away, most = float(np.linalg.norm(mean - problem.fleet.start_place)), furthest(problem)
    away -= float(np.linalg.norm(problem.fleet.shift))
    if away > most + SLACK:
        message = (
            f"no control can reach it: the mean should end {away:.3g} m from the start, {away - most:.3g} m more than "
            f"any member can drive in {problem.duration:g} s"
        )
        yield Finding((*PATH, field), message, "move it, or allow more time")


def place_findings(problem: Problem) -> Iterator[Finding]:
    """A place that is out of reach still draws the fleet, but no member gets there."""
    target = problem.objective.target
    if target is None or isinstance(target, Formation | MomentTarget | SpreadTarget) or not problem.objective.terminal:
        return
    away, most = float(np.linalg.norm(target - problem.fleet.start_place)), furthest(problem)
    away -= float(np.linalg.norm(problem.fleet.shift))
    if away > most + SLACK:
        message = f"the target is {away:.3g} m from the start, {away - most:.3g} m more than any member can drive"
        yield Finding(PATH, message, "it only draws the fleet that way", "warning")


def _moments(problem: Problem, target: MomentTarget) -> Iterator[Finding]:
    """Moments are of one parameter, and of no higher order than its distribution has."""
    distributions = problem.fleet.dynamic_distributions
    if len(distributions) != 1:
        yield Finding(
            (*PATH, "moments"), f"expected a fleet with one parameter that bends trajectories, got {len(distributions)}"
        )
    elif len(target.moments) - 1 > min(distributions[0].max_order, problem.order or 50):
        most = min(distributions[0].max_order, problem.order or 50) + 1
        yield Finding((*PATH, "moments"), f"expected at most {most} moments, got {len(target.moments)}")
    else:
        yield from _mean(problem, target.middle, "moments")
        # |m_k| <= sqrt(2) max_s |p(s) - p(0)| for k >= 1, by Cauchy and Schwarz
        size = np.sqrt((target.moments[1:] ** 2).sum(axis=1)) * (np.asarray(target.weights)[1:] > 0)
        limit = float(np.sqrt(2.0) * widest(problem))
        for k in np.flatnonzero(size > limit + SLACK).tolist():
            message = (
                f"no control can reach it: moment {k + 1} should have the size {size[k]:.3g}, {size[k] - limit:.3g} "
                f"more than one control can bring about: members end within {widest(problem):.3g} m of the middle one"
            )
            yield Finding((*PATH, "moments", k + 1), message, "the members differ too little for it")


def _spread(problem: Problem, target: SpreadTarget) -> Iterator[Finding]:
    """A start that is spread stays spread: one control shifts all members alike."""
    start = problem.fleet.shift_covariance
    # C minus the starts' covariance has to be positive semidefinite
    missing = float(np.linalg.eigvalsh(target.covariance - start)[0])
    if missing < -SLACK:
        message = (
            f"no control can reach it: start positions alone have the covariance {start.round(6).tolist()}, "
            f"{-missing:.3g} m^2 more than this in some direction"
        )
        yield Finding((*PATH, "covariance"), message, "one control moves all starts alike; ask for at least as much")
    yield from _mean(problem, np.asarray(target.mean), "mean")
    # tr C <= max_s |p(s) - p(0)|^2 + tr of the starts' covariance
    wanted, most = float(np.trace(target.covariance)), widest(problem) ** 2 + float(np.trace(start))
    if wanted > most + SLACK:
        message = (
            f"no control can reach it: the deviation sqrt(trace) should be {np.sqrt(wanted):.3g} m, "
            f"{np.sqrt(wanted) - np.sqrt(most):.3g} m more than one control can spread the fleet"
        )
        yield Finding((*PATH, "covariance"), message, "the members differ too little for it")
