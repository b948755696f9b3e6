"""Guesses that drive curves: the trips of `ensemble_ctrl.ocp.guesses.roadmap` along Reeds-Shepp or Dubins paths.

Routes have corners, and the robot that follows them drives forwards. Where it has to back out, or to arrive with some
heading, a path by OMPL is a guess from which the program finds a plan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiPoint
from shapely.ops import unary_union

from ensemble_ctrl.ocp.guesses import ompl_paths
from ensemble_ctrl.ocp.guesses.driven import driven, needed, reverses, tightest
from ensemble_ctrl.ocp.guesses.ompl_paths import Surroundings, curve
from ensemble_ctrl.ocp.guesses.registry import Guess, Request, Stop
from ensemble_ctrl.ocp.guesses.roadmap import Trip, schedule, trips
from ensemble_ctrl.ocp.rounds import rank, start
from ensemble_ctrl.ocp.truncation import coarse
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

HEADINGS = 8
"""Headings in which a place may be reached."""
MISSES = 3
"""Headings without a path after which no other is tried."""
CURVES = 3
"""Curves of a batch that are solved."""
SPARE = 1.1
"""Share of the tightest turn by which guesses turn less, so that they start inside the bounds."""


@dataclass(frozen=True)
class Curves:
    """What paths are looked for.

    Attributes
    ----------
    radius : float
        Of turns, in tightest turns.
    clearance : float
        Beyond radius and margin, in tenths of the map's size.
    trip : int
        Which order of visits, shortest first.
    """

    radius: float
    clearance: float
    trip: int = 0


BATCHES = (
    (Curves(1.0, 0.05), Curves(1.7, 0.05)),
    (Curves(1.0, 0.01), Curves(0.5, 0.05), Curves(1.0, 0.05, 1), Curves(1.0, 0.0)),
)
"""What is looked for side by side, and then if that is no help."""


class CurvedGuesses:
    """Batches of curves, where OMPL is installed."""

    at_once = False

    def accepts(self, problem: Problem) -> bool:
        """Robots on arcs."""
        return ompl_paths.available() and problem.fleet.system.transcription == "positions"

    def propose(self, request: Request) -> Iterator[list[Guess]]:
        """The most promising of each batch."""
        for batch in BATCHES:
            if found := promising(request, batch):
                yield found


def promising(request: Request, batch: Sequence[Curves]) -> list[Guess]:
    """The most promising curves of a batch as they are: the best few by how far they fall short, and the shortest."""
    problem = request.problem

    def work(stop: Stop, candidate: int) -> list[Guess]:
        return curved(problem, batch[candidate], request.steps, stop)

    every = [guess for some in request.side_by_side("curves", work, len(batch)) for guess in some or ()]
    found = list({(guess.name, round(guess.length, 6)): guess for guess in every}.values())
    # the best by what they fall short as they are, and the shortest
    ranks = [rank(start(problem, guess.controls, coarse(problem))) for guess in found]
    ranked = sorted(range(len(found)), key=lambda i: ranks[i])
    shortest = sorted(range(len(found)), key=lambda i: found[i].length)
    return [found[i] for i in dict.fromkeys([*ranked[: CURVES - 1], *shortest[:1]])]


def curved(problem: Problem, curves: Curves, steps: int, stop: Callable[[], bool]) -> list[Guess]:
    """Guesses on a grid of `steps`, one for each heading at the end that a path was found for; shortest first."""
    ways = trips(problem, curves.trip + 1)
    if len(ways) <= curves.trip or (curves.radius < 1 and not problem.fleet.arcs.turns_in_place):
        return []
    trip, around = ways[curves.trip], _surroundings(problem, curves.clearance)
    radius = max(SPARE * curves.radius * tightest(problem), 1e-3)
    found = []
    for legs in _driven_legs(problem, trip, around, radius, stop):
        length = sum(float(np.linalg.norm(np.diff(leg[:, :2], axis=0), axis=1).sum()) for leg in legs)
        poses, times = _timed(problem, trip, legs)
        names = tuple(visit.name for visit in trip.visits)
        way = "Reeds-Shepp" if reverses(problem) else "Dubins"
        end = round(float(np.rad2deg(poses[-1, 2]))) % 360
        name = f"{way} path of radius {radius:.2g} m that ends at {end} deg"
        corners = poses[:: max(len(poses) // 60, 1), :2]
        found.append(Guess(driven(problem, poses, times, steps), corners, length, names, name, "curve"))
    return sorted(found, key=lambda guess: guess.length)


def _surroundings(problem: Problem, clearance: float) -> Surroundings:
    """What a robot keeps out of, standing, at a clearance."""
    fleet = problem.fleet
    static = [avoid for avoid in problem.specification.avoided_by_anyone if avoid.motion is None]
    pieces = [(piece, avoid.radius) for avoid in static for piece in avoid.pieces]
    places = [fleet.start_place[None], *(piece.vertices for piece, _ in pieces)]
    places += [region.vertices for region in problem.regions.values() if region.is_bounded]
    corners = np.concatenate(places)
    size = float(np.ptp(corners, axis=0).max())
    # obstacles grown by radius, margin, the box of starts and the clearance (a Minkowski sum with a disc)
    more = problem.solve.margin + float(np.linalg.norm(fleet.shift)) + clearance * size / 10
    blocked = unary_union([MultiPoint(piece.vertices).convex_hull.buffer(own + more) for piece, own in pieces])
    shapely.prepare(blocked)
    pad = 2 * (fleet.radius + tightest(problem))
    return Surroundings(blocked, corners.min(axis=0) - pad, corners.max(axis=0) + pad)


def _driven_legs(
    problem: Problem, trip: Trip, around: Surroundings, radius: float, stop: Callable[[], bool]
) -> Iterator[list[Floats]]:
    """The legs of a trip, the last one in several headings; the others in the heading that is reached first."""
    fleet, legs = problem.fleet, []
    turned = float(fleet.coefficients(fleet.center[None])[0, 2] - fleet.own_heading)
    pose = np.array([*fleet.start_place, fleet.heading + turned])

    def paths(start: Floats, place: Floats) -> Iterator[Floats]:
        ahead, found = float(np.arctan2(*(place - start[:2])[::-1])), 0
        for k in range(HEADINGS):
            if stop() or (k == MISSES and not found):
                return
            # headings at the place: straight ahead first, then in equal turns
            goal = np.array([*place, ahead + 2 * np.pi * k / HEADINGS])
            path = curve(around, radius, reverses(problem), start, goal, problem.solve.seed + k + 1, stop)
            if path is not None:
                found += 1
                yield path

    for leg in trip.legs[:-1]:
        found = next(paths(pose, leg.corners[-1]), None)
        if found is None:
            return
        legs.append(found)
        pose = found[-1]
    if trip.legs:
        for last in paths(pose, trip.legs[-1].corners[-1]):
            yield [*legs, last]


def _timed(problem: Problem, trip: Trip, legs: list[Floats]) -> tuple[Floats, Floats]:
    """All poses with the times to be at them: as the routes' arrivals, at an even share of what is possible."""
    now, poses, times = 0.0, [legs[0][:1]], [np.zeros(1)]
    for arrival, dwell, leg in zip(*schedule(problem, trip), legs, strict=True):
        # times along a leg in proportion to the least seconds that it needs
        along = np.cumsum(needed(problem, leg))
        times.append(now + along / max(float(along[-1]), 1e-9) * max(arrival - now, 1e-6))
        poses.append(leg[1:])
        now = max(arrival, now + 1e-6) + dwell
        times.append(np.array([now + 1e-9]))
        poses.append(leg[-1:])
    return np.concatenate(poses), np.concatenate(times)


__all__ = ["BATCHES", "Curves", "curved"]
