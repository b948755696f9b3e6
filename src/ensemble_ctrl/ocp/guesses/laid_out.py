"""A guess for a task with repeated or conditional visits: laid out in time first, then driven along routes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import (
    Always,
    And,
    Avoid,
    Eventually,
    Formula,
    Inside,
    Not,
    Or,
    Predicate,
    leaves,
    negation_normal_form,
)
from ensemble_ctrl.ocp.guesses.driven import needed
from ensemble_ctrl.ocp.guesses.itinerary import Journey, itinerary
from ensemble_ctrl.ocp.guesses.registry import Guess, Request
from ensemble_ctrl.ocp.guesses.roadmap import Legs, Trip, driven_trip, place_in
from ensemble_ctrl.ocp.guesses.routes import Route
from ensemble_ctrl.ocp.guesses.skeleton import Visit
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.specification import named_pieces

Floats = NDArray[np.float64]

BINARIES = 2000
"""Stays and journeys in the integer program, about: the coarse grid has as many steps as that allows."""
STEPS = 12, 60
"""Fewest and most steps of the coarse grid."""
SHARES = (0.75, 0.9)
"""Shares of the top speed at which journeys are made, first the one that leaves more time to spare."""
ORDERED = 6
"""Visits whose orders are all tried without it."""
SECONDS = 20.0
"""For each of the searches."""


class LaidOutGuesses:
    """One itinerary, where the order of visits is no matter of reading."""

    at_once = True

    def accepts(self, problem: Problem) -> bool:
        """Robots on arcs."""
        return problem.fleet.system.transcription == "positions"

    def propose(self, request: Request) -> Iterator[list[Guess]]:
        """The one, which takes seconds."""
        if not request.quick and repeats(request.problem):
            yield laid_out(request.problem, request.steps)


def repeats(problem: Problem) -> bool:
    """Whether the task asks for visits again and again or under a condition, or for more than `ORDERED`."""
    task = _remaining(problem)
    if not any(isinstance(leaf, Inside) for leaf in leaves(task)):
        return False
    return _nests(task) or sum(isinstance(part, Eventually) for part in _parts(task)) > ORDERED


def laid_out(problem: Problem, steps: int) -> list[Guess]:
    """The guess on a grid of `steps`, if an itinerary is found; shorter journeys where the first ones are too slow."""
    for share in SHARES:
        trip = _trip(problem, share)
        if trip is not None:
            return [driven_trip(problem, trip, steps, "laid out in time", "itinerary")]
    return []


def _remaining(problem: Problem) -> Formula:
    """The task in negation normal form, without what routes avoid anyway."""
    parts = tuple(part.resolved for part in problem.specification.parts)
    return negation_normal_form(parts[0] if len(parts) == 1 else And(parts) if parts else problem.specification.task)


def _nests(formula: Formula, below: bool = False) -> bool:
    """Whether a visit is asked for again and again, or under a condition."""
    if isinstance(formula, Or) and any(isinstance(part, Not) for part in formula.children):
        return True
    if isinstance(formula, Eventually) and below:
        return True
    below = below or isinstance(formula, Always)
    return any(_nests(part, below) for part in formula.parts)


def _trip(problem: Problem, share: float) -> Trip | None:
    """Visits in time with the routes between them, at a share of the top speed."""
    task, legs = _remaining(problem), Legs(problem, 1)
    # places: start, regions to be visited, target; the coarse grid has about BINARIES arcs
    names = sorted({leaf.name for leaf in leaves(task) if isinstance(leaf, Inside)} & set(problem.regions))
    start, target = problem.fleet.start_place, problem.objective.place
    visits = [Visit(name, problem.regions[name], 0.0, problem.duration) for name in names]
    places = [start, *(place_in(problem, visit, start) for visit in visits)] + ([] if target is None else [target])
    routes = list(_routes(problem, legs, task, places))
    count = len(places) + len(routes)
    coarse = int(np.clip(BINARIES // max(count, 1), *STEPS))
    step = problem.duration / coarse
    journeys = [_journey(problem, i, j, route, share, step) for i, j, route in routes]
    possible = [(way, route) for way, (_, _, route) in zip(journeys, routes, strict=True) if way.steps <= coarse]
    stops = itinerary(
        task,
        np.array(places),
        [way for way, _ in possible],
        coarse,
        step,
        lambda formula, points: _holds(problem, formula, points),
        None if target is None else len(places) - 1,
        SECONDS,
    )
    if stops is None or len(stops) < 2:
        return None
    reached, ways = [], []
    for stop in stops[1:]:
        ways.append(possible[stop.journey][1])
        arrive, dwell = stop.arrive * step, (stop.leave - stop.arrive) * step
        region = visits[stop.place - 1] if 0 < stop.place <= len(visits) else None
        if region is not None:
            reached.append(Visit(region.name, region.region, arrive, arrive, dwell))
    if len(reached) < len(ways) - 1:
        return None
    return Trip(tuple(reached), tuple(ways))


def _routes(problem: Problem, legs: Legs, task: Formula, places: Sequence[Floats]) -> Iterator[tuple[int, int, Route]]:
    """The shortest route between each two places, and one around what the task does not always allow, if longer."""
    refused = {part.child.name for part in _parts(task) if isinstance(part, Not) and isinstance(part.child, Inside)}
    refused |= {part.name for part in _parts(task) if isinstance(part, Avoid) and part.name != "obstacles"}
    for i, j in permutations(range(len(places)), 2):
        if j == 0 or np.linalg.norm(places[i] - places[j]) < 1e-9:
            continue
        around = frozenset(name for name in refused if not _touches(problem, name, (places[i], places[j])))
        short = legs.leg(places[i], places[j], frozenset())[0]
        yield i, j, short
        wide = legs.leg(places[i], places[j], around)[0] if around else short
        if wide.length > short.length + 1e-6:
            yield i, j, wide


def _parts(formula: Formula) -> Iterator[Formula]:
    """A formula and everything within it."""
    yield formula
    for part in formula.parts:
        yield from _parts(part)


def _touches(problem: Problem, name: str, points: Sequence[Floats]) -> bool:
    """Whether a named region or obstacle holds one of some points."""
    return any(bool(np.any(piece.facet_clearance(np.array(points)) < 0)) for piece in named_pieces(problem, name))


def _journey(problem: Problem, begin: int, end: int, route: Route, share: float, step: float) -> Journey:
    """A route driven at a share of the top speed, with the places at the coarse grid's times."""
    # steps of the coarse grid at a share of the top speed, and where the robot is at the grid times between
    along = np.concatenate([[0.0], np.linalg.norm(np.diff(route.corners, axis=0), axis=1).cumsum()])
    headings = np.arctan2(*np.diff(route.corners, axis=0).T[::-1])
    poses = np.column_stack([route.corners, np.append(headings, headings[-1])])
    seconds = float(needed(problem, poses).sum()) / share
    steps = max(math.ceil(seconds / step - 1e-9), 1)
    at = along[-1] * np.arange(1, steps) / steps
    passed = np.stack([np.interp(at, along, route.corners[:, axis]) for axis in (0, 1)], axis=1)
    return Journey(begin, end, steps, passed)


def _holds(problem: Problem, formula: Formula, points: Floats) -> NDArray[np.bool_]:
    """Whether a formula without temporal operators holds at places; what reads other states is taken to hold."""
    match formula:
        case Inside(name=name):
            return np.asarray(problem.regions[name].contains(points))
        case Avoid(name=name):
            inside = [piece.facet_clearance(points) < 0 for piece in named_pieces(problem, name)]
            return np.asarray(~np.logical_or.reduce([*inside, np.zeros(len(points), bool)]))
        case Predicate(coefficients=coefficients, offset=offset):
            # coefficients . place + offset >= 0, where the predicate is about the place alone
            columns = dict(zip(problem.fleet.states[:2], points.T, strict=True))
            if any(name not in columns for name, _ in coefficients):
                return np.ones(len(points), bool)
            return np.asarray(sum(value * columns[name] for name, value in coefficients) + offset >= 0)
        case Not(child=child):
            return ~_holds(problem, child, points)
        case And(children=children):
            return np.asarray(np.logical_and.reduce([_holds(problem, child, points) for child in children]))
        case Or(children=children):
            return np.asarray(np.logical_or.reduce([_holds(problem, child, points) for child in children]))
    return np.ones(len(points), bool)


__all__ = ["laid_out", "repeats"]
