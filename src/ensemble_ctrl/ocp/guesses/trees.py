"""Guesses that keep several members free of obstacles: commands found by trees in the space of commands.

Where members part so far that the way of the middle one is no help, the way has to be found for all of them: a tree
grows for members spread over the parameters' ranges together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.guesses import ompl_paths
from ensemble_ctrl.ocp.guesses.curved import along_legs, surroundings
from ensemble_ctrl.ocp.guesses.ompl_paths import Surroundings
from ensemble_ctrl.ocp.guesses.ompl_trees import Growth, Planner, State, tree
from ensemble_ctrl.ocp.guesses.passages import connected
from ensemble_ctrl.ocp.guesses.registry import Guess, Request, Stop
from ensemble_ctrl.ocp.guesses.roadmap import Trip, trips
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

Grown = tuple[Planner, int, int, int]
"""How a tree grows, its seed, iterations and members."""
BATCHES: tuple[tuple[Grown, ...], ...] = (
    (("RRT", 1, 8000, 5), ("KPIECE1", 2, 5000, 5)),
    (("RRT", 3, 8000, 5), ("RRT", 4, 8000, 7)),
)
"""Trees that are grown side by side, and then if that is no help. Their iterations until they arrive are heavy-tailed:
several short ones are worth more than a long one."""
SLOWEST = 0.6
"""Share of the top speed at which robots drive at least: a way found at some speed is one at any."""
NEAR = 0.5
"""Share of the distance from a region's middle to its nearest corner within which it counts as reached."""
UNBOUNDED = 0.1
"""The same for regions without a middle, and for targets, metres."""
CORNERS = 16
"""Members at corners of the ranges, at most, for several parameters."""


class TreeGuesses:
    """Trees for robots on arcs, where OMPL is installed."""

    at_once = False

    def accepts(self, problem: Problem) -> bool:
        """Robots on arcs."""
        return ompl_paths.available() and problem.fleet.system.transcription == "positions"

    def propose(self, request: Request) -> Iterator[list[Guess]]:
        """Those of each batch."""
        problem = request.problem
        ways = [trip for trip in trips(problem, 1) if trip.legs and _is_open(problem, trip)]
        for batch in BATCHES if ways else ():

            def work(stop: Stop, k: int, batch: tuple[Grown, ...] = batch) -> Guess | None:
                planner, seed, iterations, count = batch[k]
                return grown(problem, ways[0], request.steps, seed, iterations, count, stop, planner)

            found = [guess for guess in request.side_by_side("trees", work, len(batch)) if guess is not None]
            if found:
                yield found


def _is_open(problem: Problem, trip: Trip) -> bool:
    """Whether a passage leads to where each leg ends, with the room that trees keep."""
    import shapely

    blocked, place = surroundings(problem, 0.0).blocked, problem.fleet.start_place
    ends = [leg.corners[-1] for leg in trip.legs]
    goals = [shapely.Point(end).buffer(_near(trip, k)) for k, end in enumerate(ends)]
    starts = [place, *ends[:-1]]
    return all(connected(blocked, start, goal) for start, goal in zip(starts, goals, strict=True))


def _near(trip: Trip, k: int) -> float:
    """How near the end of a leg counts as reached, metres."""
    region = trip.visits[k].region if k < len(trip.visits) else None
    if region is None or not region.is_bounded:
        return UNBOUNDED
    return NEAR * float(np.linalg.norm(region.vertices - trip.legs[k].corners[-1], axis=1).min())


def grown(
    problem: Problem,
    trip: Trip,
    steps: int,
    seed: int,
    iterations: int,
    count: int,
    stop: Callable[[], bool],
    planner: Planner = "RRT",
) -> Guess | None:
    """A guess on a grid of `steps` along a trip, free for `count` members over the range, or those at its corners."""
    members = _Members.of(problem, count)
    growth, legs = members.growth(surroundings(problem, 0.0)), list[Floats]()
    state: State = members.start
    for k, leg in enumerate(trip.legs):
        place = leg.corners[-1]
        found = tree(growth, state, place, _near(trip, k), iterations, problem.solve.seed + seed, stop, planner)
        if not found:
            return None
        states = list(members.driven(state, found, growth.step))
        legs.append(np.array([each[:3] for each in states]))
        state = states[-1]
    return along_legs(problem, trip, legs, steps, f"commands for {len(members.linear)} members, {seed}", "tree")


@dataclass(frozen=True, eq=False)
class _Members:
    """Members on arcs; a state is the pose of each, the middle one first, and the seconds that have passed."""

    problem: Problem
    linear: list[float]
    angular: list[float]
    start: list[float]

    @classmethod
    def of(cls, problem: Problem, count: int) -> _Members:
        """The middle member, and members over the range or at the corners of several ranges."""
        fleet = problem.fleet
        others = fleet.corners[:CORNERS]
        if len(fleet.names) == 1:
            others = np.linspace(fleet.lower, fleet.upper, count)
        found = fleet.coefficients(np.vstack([fleet.center, others]))
        turned = found[:, 2] - fleet.own_heading
        poses = np.column_stack([np.tile(fleet.start_place, (len(found), 1)), fleet.heading + turned])
        return cls(problem, found[:, 0].tolist(), found[:, 1].tolist(), [*poses.ravel().tolist(), 0.0])

    def growth(self, around: Surroundings) -> Growth:
        """Where the tree grows: the first command is the speed, as a share of what is possible."""
        fleet = self.problem.fleet
        first = (-1.0 if fleet.input_lower[0] < 0 else 0.0, 1.0)
        bounds = np.array([first, (fleet.input_lower[1], fleet.input_upper[1])])
        step = min(self.problem.step, self.problem.duration / 60)
        return Growth(self.after, lambda state: self.free(around, state), around.low, around.high, bounds, step)

    def free(self, around: Surroundings, state: State) -> bool:
        """Whether there is time left, and every member is free."""
        in_time = state[-1] <= self.problem.duration + 1e-9
        return in_time and all(around.free(*state[3 * j : 3 * j + 3]) for j in range(len(self.linear)))

    def after(self, state: State, command: State, seconds: float) -> list[float]:
        """The state after a command: exact arcs."""
        fleet, share = self.problem.fleet, SLOWEST + (1 - SLOWEST) * abs(command[0])
        top = float(fleet.input_upper[0] if command[0] >= 0 else fleet.input_lower[0])
        v, omega = fleet.arcs.rates(share * top, command[1])
        sign = 1.0 if fleet.arcs.heading_from == "x" else -1.0
        found = []
        for j, (linear, angular) in enumerate(zip(self.linear, self.angular, strict=True)):
            x, y, heading = state[3 * j : 3 * j + 3]
            # the arc's chord, at the heading in its middle
            half = sign * angular * float(omega) * seconds / 2
            chord = linear * float(v) * seconds * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
            found += [x + chord * math.cos(heading + half), y + chord * math.sin(heading + half), heading + 2 * half]
        return [*found, state[-1] + seconds]

    def driven(self, state: State, commands: list[tuple[list[float], int]], step: float) -> Iterator[State]:
        """The states along commands."""
        yield state
        for command, steps in commands:
            for _ in range(steps):
                state = self.after(state, command, step)
                yield state


__all__ = ["TreeGuesses", "grown"]
