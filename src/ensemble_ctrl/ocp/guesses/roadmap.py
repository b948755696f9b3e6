"""First guesses: geometric routes through the places that a skeleton visits, driven by a nominal robot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.guesses.drive import follow, smoothed
from ensemble_ctrl.ocp.guesses.homotopy import distinct, homotopy
from ensemble_ctrl.ocp.guesses.registry import Guess
from ensemble_ctrl.ocp.guesses.routes import LONGEST, Route, corridor_route, routes
from ensemble_ctrl.ocp.guesses.skeleton import Skeleton, Visit, skeletons
from ensemble_ctrl.problem import Problem, Routes
from ensemble_ctrl.problem.specification import named_pieces

Floats = NDArray[np.float64]

CLEARANCES = (0.3, 0.15, 0.05, 0.01)
"""Clearances beyond radius and margin that a route tries to keep, in tenths of the map's size, widest first."""
LONGER = 4.0
"""Routes longer than this many times the shortest are not tried."""
ALL = 64
"""Largest number of routes that ``all`` stands for, the shortest ones."""
FEW = 2
"""Routes, loops allowed, that ``all`` always includes: where every way to the goal winds, there are no others."""


@dataclass(frozen=True, eq=False)
class Trip:
    """An order of visits with a route for each leg."""

    visits: tuple[Visit, ...]
    legs: tuple[Route, ...]

    @property
    def length(self) -> float:
        """Metres."""
        return sum(leg.length for leg in self.legs)


def roadmap_guesses(problem: Problem, steps: int, wanted: Routes) -> list[Guess]:
    """Guesses on a grid of `steps`, shortest route first; a straight line where there is no route.

    Parameters
    ----------
    problem : Problem
        Map, fleet and task.
    steps : int
        Of each guess.
    wanted : int or "all"
        So many guesses, with the shortest routes of different kinds; or every kind without loops, at most `ALL` and at
        most `LONGEST` times as long as the shortest.
    """
    found = trips(problem, wanted)
    names = distinct(trip_name(problem, trip) for trip in found)
    return [driven_trip(problem, trip, steps, name) for trip, name in zip(found, names, strict=True)]


def trips(problem: Problem, wanted: Routes, *, narrow: bool = False) -> list[Trip]:
    """Orders of visits with their routes, shortest first; as for `roadmap_guesses`.

    Of each kind the route with the widest clearance; if `narrow`, the shortest routes whatever their clearance.
    """
    every = wanted == "all"
    most, longest = (ALL, LONGEST) if wanted == "all" else (wanted, LONGER)
    planner = Legs(problem, most, every, CLEARANCES[::-1] if narrow else CLEARANCES)
    found = sorted((trip for s in skeletons(problem) for trip in planner.trips(s)), key=lambda t: t.length)
    return [trip for trip in found if trip.length <= longest * found[0].length + 1e-9][:most]


@dataclass(eq=False)
class Legs:
    """Finds trips; legs are searched once."""

    problem: Problem
    most: int
    every: bool = False
    clearances: tuple[float, ...] = CLEARANCES
    _legs: dict[tuple[bytes, bytes, frozenset[str], tuple[str, ...]], list[Route]] = field(default_factory=dict)

    def trips(self, skeleton: Skeleton) -> list[Trip]:
        """The shortest trips of one skeleton: every order with its best legs, and other legs for the best order(s)."""
        firsts = [self._trip(skeleton, order) for order in skeleton.orders()]
        best = sorted(firsts, key=lambda t: t[0].length)[: self.most]
        if not best:
            return []
        # other routes for the legs of the best order, or of each of the best
        varied = best if self.every else best[:1]
        others = [Trip(trip.visits, legs) for trip, choices in varied for legs in combined(choices, self.most)[1:]]
        whole = [trip for trip, _ in best] + others
        return sorted(whole, key=lambda t: t.length)[: self.most]

    def _trip(self, skeleton: Skeleton, order: tuple[int, ...]) -> tuple[Trip, list[list[Route]]]:
        """One order of visits with its shortest legs, and every choice for each leg."""
        place, legs = self.problem.fleet.start_place, []
        for k, index in enumerate(order):
            closed = frozenset(door.name for door in skeleton.doors if door.until not in order[:k])
            goal = place_in(self.problem, skeleton.visits[index], place)
            legs.append(self.leg(place, goal, closed, skeleton.corridor))
            place = goal
        target = self.problem.objective.place
        if target is not None and np.linalg.norm(place - target) > 1e-6:
            closed = frozenset(door.name for door in skeleton.doors if door.until not in order)
            legs.append(self.leg(place, target, closed, skeleton.corridor))
        visits = tuple(skeleton.visits[i] for i in order)
        return Trip(visits, tuple(choices[0] for choices in legs)), legs

    def leg(self, start: Floats, goal: Floats, closed: frozenset[str], corridor: tuple[str, ...] = ()) -> list[Route]:
        """Routes of different kinds for one leg."""
        key = (start.tobytes(), goal.tobytes(), closed, corridor)
        if key not in self._legs:
            self._legs[key] = self._search(start, goal, closed, corridor)
        return self._legs[key]

    def _search(self, start: Floats, goal: Floats, closed: frozenset[str], corridor: tuple[str, ...]) -> list[Route]:
        """Each kind with the first clearance that admits it; a straight line, at a price, where there is none."""
        straight = Route(np.stack([start, goal]), 10 * float(np.linalg.norm(goal - start)) + 1e-9, ())
        if corridor:
            found = corridor_route(start, goal, [self.problem.regions[name] for name in corridor])
            return [found or straight]
        static = [each for each in self.problem.specification.avoided_by_anyone if each.motion is None]
        pieces = [piece for avoid in static for piece in avoid.pieces]
        pieces += [piece for name in sorted(closed) for piece in named_pieces(self.problem, name)]
        return self._kinds(start, goal, pieces) or [straight]

    def _kinds(self, start: Floats, goal: Floats, pieces: Sequence[Obstacle]) -> list[Route]:
        """Up to `most` routes of different kinds, shortest first."""
        corners = np.concatenate([[start, goal], *(piece.vertices for piece in pieces)])
        scale = float(np.ptp(corners, axis=0).max()) / 10
        fleet = self.problem.fleet
        # a kind keeps the route of the first clearance that admits it, usually the widest
        own = fleet.radius + (0.0 if fleet.footprint is None else fleet.footprint.narrow)
        base = own + self.problem.solve.margin + float(np.linalg.norm(fleet.shift))
        kinds: dict[tuple[int, ...], Route] = {}
        searches = [(FEW, True), (self.most, False)] if self.every else [(self.most, True)]
        for most, loops in searches:
            for share in self.clearances:
                for route in routes(start, goal, pieces, base + share * scale, most, loops):
                    kinds.setdefault(route.word, route)
                if len(kinds) >= most:
                    break
        return sorted(kinds.values(), key=lambda route: route.length)


def combined(choices: Sequence[Sequence[Route]], most: int) -> list[tuple[Route, ...]]:
    """The `most` combinations of one route for each leg with the smallest total length, shortest first.

    Parameters
    ----------
    choices : sequence of sequences of Route
        For each leg its routes, shortest first.
    most : int
        Largest number of combinations.
    """
    # best-first search over the indices of routes: a successor takes the next longer route of one leg
    first = (0,) * len(choices)
    queue, seen = [(0.0, first)], {first}
    found: list[tuple[Route, ...]] = []
    while queue and len(found) < most:
        longer, picks = heappop(queue)
        found.append(tuple(routes[pick] for routes, pick in zip(choices, picks, strict=True)))
        for leg, pick in enumerate(picks):
            after = (*picks[:leg], pick + 1, *picks[leg + 1 :])
            if pick + 1 < len(choices[leg]) and after not in seen:
                seen.add(after)
                heappush(queue, (longer + choices[leg][pick + 1].length - choices[leg][pick].length, after))
    return found


def trip_name(problem: Problem, trip: Trip) -> str:
    """What a trip is called: the sides of its one leg, or those of each leg with where it leads to."""
    obstacles = {avoid.name: avoid.pieces for avoid in problem.specification.avoided_by_anyone}
    told = [homotopy(leg.corners, obstacles) for leg in trip.legs]
    if len(told) <= 1:
        return "".join(told) or "straight"
    targets = [visit.name for visit in trip.visits] + ["target"]
    return "; ".join(f"to {target}: {text}" for target, text in zip(targets, told, strict=False))


def place_in(problem: Problem, visit: Visit, come_from: Floats) -> Floats:
    """Where in a region to go: the terminal target if it is there, else its middle, or for half-planes the way in."""
    target = problem.objective.place
    if target is not None and bool(visit.region.contains(target)):
        return np.asarray(target)
    if visit.region.is_bounded:
        return np.asarray(visit.region.vertices.mean(axis=0))
    return _projected(visit.region, come_from)


def _projected(region: Polyhedron, point: Floats) -> Floats:
    """A point inside an unbounded region near `point`, by cyclic projection a little past each face."""
    G, h = region.unit_rows()
    point = np.array(point, dtype=float)
    for _ in range(100):
        for g, bound in zip(G, h, strict=True):
            # projection on each violated half-plane, 0.1 m past it
            point -= max(0.0, float(g @ point) - bound + 0.1) * g
    return point


def driven_trip(problem: Problem, trip: Trip, steps: int, name: str, kind: str = "route") -> Guess:
    """Controls that follow a trip in time, on a grid of `steps`."""
    # the trip as a polyline in time, at the grid times
    grid = np.linspace(0.0, problem.duration, steps + 1)
    times, corners = (np.concatenate(part) for part in zip(*_timed(problem, trip), strict=True))
    path = np.stack([np.interp(grid, times, corners[:, axis]) for axis in (0, 1)], axis=1)
    names = tuple(visit.name for visit in trip.visits)
    return Guess(follow(problem, smoothed(path)), corners, trip.length, names, name, kind)


def _timed(problem: Problem, trip: Trip) -> Iterator[tuple[Floats, Floats]]:
    """The corners of a trip with the times to be at them."""
    start = problem.fleet.start_place
    yield np.zeros(1), start[None, :]
    now = 0.0
    for arrival, dwell, leg in zip(*schedule(problem, trip), trip.legs, strict=True):
        # times at the corners in proportion to the way
        along = np.linalg.norm(np.diff(leg.corners, axis=0), axis=1).cumsum()
        share = along / max(float(along[-1]), 1e-12)
        yield now + share * max(arrival - now, 1e-6), leg.corners[1:]
        now = max(arrival, now + 1e-6)
        if dwell > 0:
            now += dwell
            yield np.array([now]), leg.corners[-1:]


def schedule(problem: Problem, trip: Trip) -> tuple[list[float], list[float]]:
    """Arrival and dwelling time of each leg: an even speed, moved into the visits' windows."""
    windows = [(v.early, v.late, v.dwell) for v in trip.visits]
    windows += [(problem.duration, problem.duration, 0.0)] * (len(trip.legs) - len(windows))
    # when to be at each place: the middle of a short window, near the end of a long one
    ends = [
        (early + late) / 2 if late - early < 0.5 * problem.duration else min(late, 0.92 * problem.duration - dwell)
        for early, late, dwell in windows
    ]
    # an even speed over all legs, each arrival moved into its window
    total = max(sum(leg.length for leg in trip.legs), 1e-12)
    moving = max(ends[-1] - sum(dwell for _, _, dwell in windows[:-1]), 0.1 * problem.duration) if ends else 1.0
    arrivals, now = [], 0.0
    for (early, late, dwell), leg in zip(windows, trip.legs, strict=True):
        now = min(max(now + moving * leg.length / total, early), max(late, now))
        arrivals.append(now)
        now += dwell
    if ends:
        arrivals[-1] = max(arrivals[-1], min(ends[-1], windows[-1][1]))
    return arrivals, [dwell for _, _, dwell in windows]
