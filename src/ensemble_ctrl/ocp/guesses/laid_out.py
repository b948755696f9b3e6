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
from ensemble_ctrl.constraints.stl.rewrite import ALL_OBSTACLES
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.guesses.driven import needed, turning
from ensemble_ctrl.ocp.guesses.itinerary import Journey, Stop, itinerary
from ensemble_ctrl.ocp.guesses.pivoting import pivoted_trip
from ensemble_ctrl.ocp.guesses.registry import Guess, Request
from ensemble_ctrl.ocp.guesses.registry import Stop as Ended
from ensemble_ctrl.ocp.guesses.roadmap import Legs, Trip, place_in, roadmap_guesses
from ensemble_ctrl.ocp.guesses.routes import Route
from ensemble_ctrl.ocp.guesses.skeleton import Visit
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.specification import named_pieces

Floats = NDArray[np.float64]
Pace = tuple[float, float]

BINARIES = 2000
"""Stays and journeys in the integer program, about: the coarse grid has as many steps as that allows."""
STEPS = 12, 60
"""Fewest and most steps of the coarse grid."""
PACES = ((0.75, np.pi / 2), (0.9, np.pi / 4), (0.9, 0.0))
"""At what share of the top speed journeys are made, and by how much robots that turn on the spot turn before each, in
radians: first what leaves more time to spare."""
ORDERED = 6
"""Visits whose orders are all tried without it."""
SECONDS = 20.0
"""For each of the searches, at most."""
PART = 0.25
"""Of the time that is left, for each of the searches, at most."""


class RoutedGuesses:
    """One itinerary, where the order of visits is no matter of reading; else, or without one, the routes."""

    at_once = True

    def accepts(self, problem: Problem) -> bool:
        """Robots on arcs."""
        return problem.fleet.system.transcription == "positions"

    def propose(self, request: Request) -> Iterator[list[Guess]]:
        """All of them together; an itinerary takes seconds, and is not made where there is little time."""
        problem = request.problem
        found = laid_out(request) if repeats(problem) and not request.quick else []
        yield found or roadmap_guesses(problem, request.steps, problem.solve.routes)


def repeats(problem: Problem) -> bool:
    """Whether the task asks for visits again and again or under a condition, or for more than `ORDERED`."""
    task = _remaining(problem)
    if not any(isinstance(leaf, Inside) for leaf in leaves(task)):
        return False
    return _nests(task) or sum(isinstance(part, Eventually) for part in _parts(task)) > ORDERED


def laid_out(request: Request) -> list[Guess]:
    """The guess, if an itinerary is found; shorter journeys where the first ones are too slow.

    Routes are searched once. Each of the searches is made where it can be ended, in a part of the time that is left.
    """
    problem, where = request.problem, _map(request.problem)
    for pace in PACES:
        seconds = min(SECONDS, PART * request.left())
        if seconds <= 0:
            break

        def work(stop: Ended, _: int, pace: Pace = pace, seconds: float = seconds) -> Trip | None:
            return _trip(where, pace, seconds)

        (trip,) = request.side_by_side("guess", work, 1)
        if trip is not None:
            return [pivoted_trip(problem, trip, request.steps, "laid out in time", "itinerary")]
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


@dataclass(frozen=True, eq=False)
class _Map:
    """Where a task is done.

    Attributes
    ----------
    problem : Problem
    task : Formula
        What routes do not keep anyway.
    visits : list of Visit
        The regions.
    places : ndarray, shape (places, 2)
        The start, the regions' middles and the target, metres.
    routes : list of (int, int, Route)
        Between each two places.
    """

    problem: Problem
    task: Formula
    visits: list[Visit]
    places: Floats
    routes: list[tuple[int, int, Route]]

    @property
    def last(self) -> int | None:
        """The place to end at."""
        return None if self.problem.objective.place is None else len(self.places) - 1


def _map(problem: Problem) -> _Map:
    """The places of a task and the routes between them."""
    task, start, target = _remaining(problem), problem.fleet.start_place, problem.objective.place
    names = {leaf.name for leaf in leaves(task) if isinstance(leaf, Inside)} & set(problem.regions)
    visits = [Visit(name, problem.regions[name], 0.0, problem.duration) for name in sorted(names)]
    middles = [place_in(problem, visit, start) for visit in visits]
    places = np.array([start, *middles, *([] if target is None else [target])])
    return _Map(problem, task, visits, places, list(_routes(problem, task, places)))


def _trip(where: _Map, pace: Pace, seconds: float) -> Trip | None:
    """Visits in time with the routes between them, at some pace."""
    problem = where.problem
    # the coarse grid has about BINARIES arcs
    coarse = int(np.clip(BINARIES // max(len(where.places) + len(where.routes), 1), *STEPS))
    step = problem.duration / coarse
    journeys = [(_journey(problem, i, j, route, pace, step), route) for i, j, route in where.routes]
    possible = [(way, route) for way, route in journeys if way.steps <= coarse]
    stops = itinerary(
        where.task,
        where.places,
        [way for way, _ in possible],
        coarse,
        step,
        lambda formula, points: _holds(problem, formula, points),
        where.last,
        seconds,
    )
    return None if stops is None else _as_trip(where, stops, [route for _, route in possible], step)


def _as_trip(where: _Map, stops: Sequence[Stop], routes: Sequence[Route], step: float) -> Trip | None:
    """The visits and the routes of an itinerary; None where it goes nowhere, or by the start."""
    reached: list[Visit] = []
    for stop in stops[1:]:
        arrive, dwell = stop.arrive * step, (stop.leave - stop.arrive) * step
        if 0 < stop.place <= len(where.visits):
            region = where.visits[stop.place - 1]
            reached.append(Visit(region.name, region.region, arrive, arrive, dwell))
    ways = tuple(routes[stop.journey] for stop in stops[1:])
    return Trip(tuple(reached), ways) if ways and len(reached) >= len(ways) - 1 else None


def _routes(problem: Problem, task: Formula, places: Floats) -> Iterator[tuple[int, int, Route]]:
    """The shortest route between each two places, and one around what the task does not always allow, if longer."""
    legs = Legs(problem, 1)
    refused = {part.child.name for part in _parts(task) if isinstance(part, Not) and isinstance(part.child, Inside)}
    refused |= {part.name for part in _parts(task) if isinstance(part, Avoid) and part.name != ALL_OBSTACLES}
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


def _journey(problem: Problem, begin: int, end: int, route: Route, pace: Pace, step: float) -> Journey:
    """A route driven at some pace, with the places at the coarse grid's times."""
    # steps of the coarse grid at this pace, and where the robot is at the grid times between
    along = np.concatenate([[0.0], np.linalg.norm(np.diff(route.corners, axis=0), axis=1).cumsum()])
    headings = np.arctan2(*np.diff(route.corners, axis=0).T[::-1])
    poses = np.column_stack([route.corners, np.append(headings, headings[-1])])
    seconds = (float(needed(problem, poses).sum()) + turning(problem, pace[1])) / pace[0]
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
