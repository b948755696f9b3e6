"""Guesses that drive curves: the trips of `ensemble_ctrl.ocp.guesses.roadmap` along Reeds-Shepp or Dubins paths.

Routes have corners, and the robot that follows them drives forwards. Where it has to back out, or to arrive with some
heading, a path by OMPL is a guess from which the program finds a plan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.guesses import ompl_paths
from ensemble_ctrl.ocp.guesses.aimed import final_heading
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
INWARDS = 0.6
"""Places in a region where a path may end, besides its middle: so far from there to each of its corners."""
CURVES = 4
"""Curves of a batch that are solved."""
SPARE = 1.1
"""Share of the tightest turn by which guesses turn less, so that they start inside the bounds."""
CORRIDOR = 1.5, 0.06
"""Half the width of a corridor, in radii of the turns, and at least in sizes of the map."""
BARRIER = 1.5
"""Radius of what is put into the narrowest place of a path for another one to be found, in its distances from there."""


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
    corridor : bool
        Whether paths stay near that trip's routes.
    iterations : int
        Of the search for each path.
    """

    radius: float
    clearance: float
    trip: int = 0
    corridor: bool = False
    iterations: int = 300


BATCHES = (
    (Curves(1.0, 0.05, corridor=True), Curves(1.0, 0.05)),
    (
        Curves(1.7, 0.05, iterations=500),
        Curves(1.0, 0.0, 1, corridor=True),
        Curves(0.5, 0.05, corridor=True),
        Curves(1.0, 0.0, 2, corridor=True),
        Curves(1.0, 0.01, iterations=1000),
        Curves(1.0, 0.0, corridor=True, iterations=1000),
    ),
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
    """The most promising curves of a batch as they are: the best few by how far they fall short, and the quickest."""
    problem = request.problem
    ways = trips(problem, 1 + max(curves.trip for curves in batch), narrow=True)
    wanted = [curves for curves in batch if curves.trip < len(ways)]
    wanted = [curves for curves in wanted if curves.radius >= 1 or problem.fleet.arcs.turns_in_place]

    def work(stop: Stop, candidate: int) -> list[Guess]:
        curves = wanted[candidate]
        return curved(problem, curves, ways[curves.trip], request.steps, stop)

    every = [guess for some in request.side_by_side("curves", work, len(wanted)) for guess in some or ()]
    found = list({(guess.name, round(guess.length, 6)): guess for guess in every}.values())
    # the best by what they fall short as they are, and the shortest
    ranks = [rank(start(problem, guess.controls, coarse(problem))) for guess in found]
    ranked = sorted(range(len(found)), key=lambda i: ranks[i])
    shortest = sorted(range(len(found)), key=lambda i: found[i].length)
    return [found[i] for i in dict.fromkeys([*ranked[: CURVES - 1], *shortest[:1]])]


def curved(problem: Problem, curves: Curves, trip: Trip, steps: int, stop: Callable[[], bool]) -> list[Guess]:
    """Guesses on a grid of `steps` along a trip: a short curve, and one that avoids the narrowest place of that."""
    if not trip.legs:
        return []
    around = surroundings(problem, curves.clearance)
    if curves.corridor:
        around = _within(around, trip, _radius(problem, curves))
    found = [_driven_legs(problem, trip, around, curves, stop)]
    if found[0] and not curves.corridor:
        found.append(_driven_legs(problem, trip, _barred(around, found[0]), curves, stop))
    return [_guess(problem, trip, legs, curves, steps) for legs in found if legs]


def _guess(problem: Problem, trip: Trip, legs: list[Floats], curves: Curves, steps: int) -> Guess:
    """Commands along the curves of a trip."""
    way = "Reeds-Shepp" if reverses(problem) else "Dubins"
    end = round(float(np.rad2deg(legs[-1][-1, 2]))) % 360
    name = f"{way} path of radius {_radius(problem, curves):.2g} m that ends at {end} deg"
    return along_legs(problem, trip, legs, steps, name, "curve")


def along_legs(problem: Problem, trip: Trip, legs: list[Floats], steps: int, name: str, kind: str) -> Guess:
    """Commands on a grid of `steps` along the legs of a trip, each poses of shape (poses, 3)."""
    length = sum(float(np.linalg.norm(np.diff(leg[:, :2], axis=0), axis=1).sum()) for leg in legs)
    poses, times = _timed(problem, trip, legs)
    names = tuple(visit.name for visit in trip.visits)
    corners = poses[:: max(len(poses) // 60, 1), :2]
    return Guess(driven(problem, poses, times, steps), corners, length, names, name, kind)


def _radius(problem: Problem, curves: Curves) -> float:
    """Of turns, metres."""
    return max(SPARE * curves.radius * tightest(problem), 1e-3)


def surroundings(problem: Problem, clearance: float) -> Surroundings:
    """What a robot keeps out of, standing, at a clearance."""
    import shapely

    fleet = problem.fleet
    static = [avoid for avoid in problem.specification.avoided_by_anyone if avoid.motion is None]
    pieces = [(piece, avoid.radius) for avoid in static for piece in avoid.pieces]
    places = [fleet.start_place[None], *(piece.vertices for piece, _ in pieces)]
    places += [region.vertices for region in problem.regions.values() if region.is_bounded]
    corners = np.concatenate(places)
    size = float(np.ptp(corners, axis=0).max())
    # obstacles grown by radius, margin, the box of starts and the clearance (a Minkowski sum with a disc)
    more = problem.solve.margin + float(np.linalg.norm(fleet.shift)) + clearance * size / 10
    blocked = shapely.union_all(
        [shapely.MultiPoint(piece.core).convex_hull.buffer(piece.rounding + own + more) for piece, own in pieces]
    )
    shapely.prepare(blocked)
    pad = 2 * (fleet.radius + tightest(problem))
    return Surroundings(blocked, corners.min(axis=0) - pad, corners.max(axis=0) + pad, body=fleet.footprint)


def _within(around: Surroundings, trip: Trip, radius: float) -> Surroundings:
    """The same near the routes of a trip alone, with more room at the places where they end."""
    import shapely

    ends = np.array([trip.legs[0].corners[0], *(leg.corners[-1] for leg in trip.legs)])
    turns, size = CORRIDOR
    half = max(turns * radius, size * float(np.max(around.high - around.low)))
    ways = [shapely.LineString(leg.corners).buffer(half) for leg in trip.legs]
    corridor = shapely.union_all([*ways, *(shapely.Point(end).buffer(2 * half) for end in ends)])
    shapely.prepare(corridor)
    left, down, right, up = corridor.bounds
    low, high = np.maximum(around.low, [left, down]), np.minimum(around.high, [right, up])
    return replace(around, low=low, high=high, corridor=corridor)


def _barred(around: Surroundings, legs: list[Floats]) -> Surroundings:
    """The same with something in the narrowest place of a way, far enough from its ends."""
    import shapely

    places = np.concatenate([leg[:, :2] for leg in legs])
    room = shapely.distance(shapely.points(places), around.blocked)
    # a disc of BARRIER times the distance from obstacles bars the gap there; ends of legs stay free
    ends = np.array([legs[0][0, :2], *(leg[-1, :2] for leg in legs)])
    away = np.linalg.norm(places[:, None] - ends[None], axis=2).min(axis=1)
    room = np.maximum(room, 1e-2 * float(np.ptp(places, axis=0).max()))
    far = away > 2 * BARRIER * room
    if not far.any():
        return around
    narrowest = np.flatnonzero(far)[int(np.argmin(room[far]))]
    blocked = around.blocked.union(shapely.Point(places[narrowest]).buffer(BARRIER * room[narrowest]))
    shapely.prepare(blocked)
    return replace(around, blocked=blocked)


def _driven_legs(
    problem: Problem, trip: Trip, around: Surroundings, curves: Curves, stop: Callable[[], bool]
) -> list[Floats]:
    """Paths for the legs of a trip, each from the pose where the one before ended; none if one was not found."""
    fleet, legs = problem.fleet, list[Floats]()
    turned = float(fleet.coefficients(fleet.center[None])[0, 2] - fleet.own_heading)
    pose = np.array([*fleet.start_place, fleet.heading + turned])
    for k, leg in enumerate(trip.legs):
        last = k == len(trip.legs) - 1 and k < len(trip.visits)
        places = _ends(problem, trip, leg.corners[-1]) if last else leg.corners[-1:]
        # headings at each place: straight ahead first, then in equal turns
        ahead = float(np.arctan2(*(leg.corners[-1] - pose[:2])[::-1]))
        wanted = final_heading(problem) if k == len(trip.legs) - 1 else None
        headings = ahead + 2 * np.pi * np.arange(HEADINGS) / HEADINGS if wanted is None else np.array([wanted])
        goals = np.array([(*place, heading) for place in places for heading in headings])
        radius, seed = _radius(problem, curves), problem.solve.seed + k + 1
        found = curve(around, radius, reverses(problem), pose, goals, curves.iterations, seed, stop)
        if found is None:
            return []
        legs.append(found)
        pose = found[-1]
    return legs


def _ends(problem: Problem, trip: Trip, middle: Floats) -> Floats:
    """Where the last leg may end: the middle of the last region, or towards its corners; the target if there is one."""
    region = trip.visits[-1].region
    if not region.is_bounded or problem.objective.place is not None:
        return middle[None]
    return np.vstack([middle, middle + INWARDS * (region.vertices - middle)])


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


__all__ = ["BATCHES", "Curves", "along_legs", "curved", "promising", "surroundings"]
