"""First guesses of states: for each way of doing the task a way through the map, driven smoothly."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice, pairwise

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.guesses.registry import Guess, Request
from ensemble_ctrl.ocp.guesses.skeleton import Skeleton, skeletons
from ensemble_ctrl.ocp.guesses.ways import resampled, ways
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]

MOST = 6
"""Guesses where all routes are asked for."""


class StateGuesses:
    """Ways through the map for any system, as many as ``solve.routes`` says."""

    at_once = True

    def accepts(self, problem: Problem) -> bool:
        """Systems that are solved in full states."""
        return problem.fleet.system.transcription == "states"

    def propose(self, request: Request) -> Iterator[list[Guess]]:
        """All of them together."""
        yield guesses(request.problem, request.steps)


def guesses(problem: Problem, steps: int) -> list[Guess]:
    """As many guesses as `solve.routes` says: the ways of doing the task, then other routes around obstacles."""
    most = MOST if problem.solve.routes == "all" else int(problem.solve.routes)
    tasks = list(islice(itineraries(problem), most))
    found: list[Guess] = []
    routed = [(name, stops, _legs(problem, stops, -(-most // len(tasks)))) for name, stops in tasks]
    for choice in range(most):
        for name, stops, legs in routed:
            if len(found) < most and (choice == 0 or any(choice < len(ways) for ways in legs)):
                taken = [ways[min(choice, len(ways) - 1)] for ways in legs]
                found.append(_driven(problem, steps, f"{name} {choice + 1}" if choice else name, stops, taken))
    return found


def _legs(problem: Problem, stops: list[Place], count: int) -> list[list[Floats]]:
    """Up to `count` ways from each stop to the next."""
    pieces = [piece for avoid in problem.specification.avoid for piece in avoid.pieces]
    keep = max((avoid.radius for avoid in problem.specification.avoid), default=0.0) + problem.solve.margin
    places = [problem.fleet.start_place, *(stop.place for stop in stops)]
    return [ways(a, b, pieces, keep, count) for a, b in pairwise(places)]


@dataclass(frozen=True, eq=False)
class Place:
    """Be at a place at a time, and stay there until another, seconds."""

    place: Floats
    early: float
    late: float
    dwell: float = 0.0
    room: float = 0.0
    """Distance to the nearest corner of its region, metres."""


def itineraries(problem: Problem) -> Iterator[tuple[str, list[Place]]]:
    """Places to be at, one list for each way of doing the task."""
    seen: set[str] = set()
    for skeleton in skeletons(problem):
        for order in islice(skeleton.orders(), 2):
            name = " ".join(skeleton.visits[i].name for i in order) or "straight"
            if name not in seen:
                seen.add(name)
                yield name, _stops(problem, skeleton, order)


def _stops(problem: Problem, skeleton: Skeleton, order: Sequence[int]) -> list[Place]:
    """The middles of the regions to be visited, and the target."""
    stops = []
    for i in order:
        visit = skeleton.visits[i]
        if visit.region.is_bounded:
            middle = visit.region.vertices.mean(axis=0)
            room = float(np.linalg.norm(visit.region.vertices - middle, axis=1).min())
            stops.append(Place(middle, visit.early, visit.late, visit.dwell, room))
    target = problem.objective.target
    if isinstance(target, np.ndarray) and not stops:
        stops.append(Place(target, problem.duration, problem.duration))
    return stops


def _driven(problem: Problem, steps: int, name: str, stops: list[Place], legs: list[Floats]) -> Guess:
    """The middle member's states along a way through the stops, from rest to rest between them."""
    fleet, times = problem.fleet, np.linspace(0.0, problem.duration, steps + 1)
    path = np.tile(fleet.start_place, (steps + 1, 1))
    whole = sum(float(np.linalg.norm(np.diff(leg, axis=0), axis=1).sum()) for leg in legs)
    left, gone = 0.0, 0.0
    for leg, stop in zip(legs, stops, strict=True):
        gone += float(np.linalg.norm(np.diff(leg, axis=0), axis=1).sum())
        share = gone / whole if whole > 0 else 1.0
        arrive = max(left + 1e-6, min(stop.late, max(stop.early, share * problem.duration)))
        # from rest to rest: the share 3 s^2 - 2 s^3 of the way at the share s of the time
        shares = np.clip((times - left) / (arrive - left), 0.0, 1.0)
        moving = times >= left
        path[moving] = resampled(leg, shares**2 * (3 - 2 * shares))[moving]
        left = arrive + stop.dwell
    member = fleet.center[None]
    states = np.tile(fleet.start_states(member)[None], (steps + 1, 1, 1))
    # velocities by finite differences, where a state is the rate of a coordinate
    speed = np.gradient(path, times, axis=0)
    for axis, (place, rate) in enumerate(_velocities(fleet)):
        states[1:, place, 0] = path[1:, axis]
        if rate is not None:
            states[1:, rate, 0] = speed[1:, axis]
    controls = np.tile(fleet.rest(fleet.center), (steps, 1))
    corners = np.concatenate(legs) if legs else fleet.start_place[None]
    length = float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum())
    return Guess(controls, corners, length, name=name, states=states)


def _velocities(fleet: Fleet) -> list[tuple[int, int | None]]:
    """For each coordinate of the position its state, and the state that is its rate, if there is one."""
    # a state that equals the rate of a coordinate at five random states is its velocity
    generator = np.random.default_rng(0)
    members = np.tile(fleet.center, (5, 1))
    x = fleet.start_states(members) + 0.1 * generator.standard_normal((len(fleet.states), 5))
    with np.errstate(all="ignore"):
        rates = fleet.system.derivatives(x, fleet.rest(fleet.center), fleet.psi(members))
    found: list[tuple[int, int | None]] = []
    for name in fleet.places:
        place = fleet.states.index(name)
        same = [k for k in range(len(x)) if np.allclose(rates[place], x[k], rtol=1e-9, atol=1e-12)]
        found.append((place, same[0] if same else None))
    return found
