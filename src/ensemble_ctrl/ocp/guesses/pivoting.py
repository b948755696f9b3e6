"""Routes for robots that turn on the spot: a turn at each corner, straight ways, backwards where that is nearer."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.guesses.driven import driven, needed, reverses
from ensemble_ctrl.ocp.guesses.registry import Guess, Request
from ensemble_ctrl.ocp.guesses.roadmap import Trip, driven_trip, schedule, trip_name, trips
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]


TRIPS = 2
"""Trips with the widest routes, and so many with the narrowest ones."""


class PivotedGuesses:
    """The routes of the roadmap, and those through narrow gaps, corner by corner."""

    at_once = False

    def accepts(self, problem: Problem) -> bool:
        """Robots on arcs that turn on the spot."""
        return problem.fleet.system.transcription == "positions" and problem.fleet.arcs.turns_in_place

    def propose(self, request: Request) -> Iterator[list[Guess]]:
        """All of them together."""
        problem = request.problem
        found = [*trips(problem, TRIPS, narrow=True)[::-1], *trips(problem, TRIPS)[::-1]]
        # the widest of those that pass everything on the same sides
        named = {trip_name(problem, trip): trip for trip in found}
        yield [pivoted_trip(problem, trip, request.steps, name, "pivot") for name, trip in named.items()]


def pivoted_trip(problem: Problem, trip: Trip, steps: int, name: str, kind: str) -> Guess:
    """Controls that follow a trip in time corner by corner, on a grid of `steps`.

    Robots that can't turn on the spot follow it as `driven_trip` says.
    """
    followed = driven_trip(problem, trip, steps, name, kind)
    if not problem.fleet.arcs.turns_in_place:
        return followed
    poses, times = (np.concatenate(part) for part in zip(*_timed(problem, trip), strict=True))
    controls = driven(problem, poses, times, steps)
    return Guess(controls, followed.corners, trip.length, followed.visits, name, kind)


def _timed(problem: Problem, trip: Trip) -> Iterator[tuple[Floats, Floats]]:
    """The poses of a trip with the times to be at them: turns as fast as they may be, ways in the time that is left."""
    fleet, now = problem.fleet, 0.0
    heading = fleet.heading + float(fleet.coefficients(fleet.center[None])[0, 2] - fleet.own_heading)
    pose = np.array([*fleet.start_place, heading])
    yield pose[None], np.zeros(1)
    for arrival, dwell, leg in zip(*schedule(problem, trip), trip.legs, strict=True):
        poses = np.array(list(_poses(problem, pose, leg.corners[1:])))
        seconds = _seconds(problem, np.vstack([pose, poses]), arrival - now)
        times = now + np.cumsum(seconds)
        yield poses, times
        now, pose = max(arrival, float(times[-1])) + dwell, poses[-1]
        yield pose[None], np.array([now])


def _poses(problem: Problem, pose: Floats, corners: Floats) -> Iterator[Floats]:
    """At each corner two poses: turned towards the next one, and there."""
    place, heading = pose[:2], float(pose[2])
    for corner in corners:
        way = corner - place
        turn = (np.arctan2(way[1], way[0]) - heading + np.pi) % (2 * np.pi) - np.pi if way.any() else 0.0
        # backwards where that is the smaller turn
        if reverses(problem) and abs(turn) > np.pi / 2:
            turn -= np.sign(turn) * np.pi
        heading += turn
        yield np.array([*place, heading])
        yield np.array([*corner, heading])
        place = corner


def _seconds(problem: Problem, poses: Floats, available: float) -> Floats:
    """Time of each move: turns take what they need, ways share what is left; where it is too little, all alike."""
    least = np.maximum(needed(problem, poses), 1e-6)
    turns = np.arange(len(least)) % 2 == 0
    left = available - float(least[turns].sum())
    ways = float(least[~turns].sum())
    if left >= ways:
        return np.where(turns, least, least * left / ways)
    return np.asarray(least * max(available, 1e-3) / float(least.sum()))


__all__ = ["PivotedGuesses", "pivoted_trip"]
