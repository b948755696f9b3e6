"""One robot of a loop: where it may be, and what is left for it to do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.disturbance import growth_on_arcs
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.propagation import PoseSet, swung
from ensemble_ctrl.planning.online.remaining import Progress, on_plain_ground, read_anew, remaining, with_ranges
from ensemble_ctrl.planning.online.tracker import Tracker
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]


class Followed:
    """A robot that is measured.

    Parameters
    ----------
    problem : Problem
        Of one robot.
    options : OnlineOptions

    Attributes
    ----------
    tracker : Tracker
    progress : Progress
        Along the measured past.
    """

    def __init__(self, problem: Problem, options: OnlineOptions) -> None:
        self.options = options
        self.tracker = Tracker(problem, options.errors, options.learn)
        self.progress = Progress(problem)

    def take(self, problem: Problem) -> None:
        """Another map."""
        self.tracker.problem = self.progress.problem = problem

    @property
    def fleet(self) -> Fleet:
        """The fleet with what is known of this robot's parameters."""
        return with_ranges(self.tracker.problem.fleet, self.tracker.ranges)

    def advance(self, end: int) -> None:
        """All times before the grid time `end` are past; where the robot was is known."""
        if self.progress.at >= end:
            return
        poses = [self.pose(k) for k in range(self.progress.at, end + 1)]
        known = [pose for pose in poses if pose is not None]
        if len(known) == len(poses):
            self.progress.advance(known, self.tracker.bulge)

    def pose(self, k: int) -> PoseSet | None:
        """The set of poses at a grid time, of the past or to come; None if it is not known."""
        tracker = self.tracker
        return tracker.past[k] if k < len(tracker.past) else tracker.pose(k * tracker.problem.step)

    def path(self, begin: int, end: int) -> Floats:
        """Where it was, and must be by now, at grid times before `end`, shape (times, 2), metres."""
        places: list[Floats] = []
        last = self.tracker.problem.fleet.position
        for pose in map(self.pose, range(begin, end)):
            last = last if pose is None else pose.position
            places.append(last)
        return np.array(places).reshape(-1, 2)

    def rest(self, begin: int, pose: PoseSet) -> Problem:
        """What is left from a grid time on, where it is in `pose`, unchecked; what was not sent is spent standing."""
        problem, ranges = self.tracker.problem, self.tracker.ranges
        if self.options.horizon == "receding":
            return read_anew(problem, begin, pose, ranges, self.tracker.onwards)
        sent, at = len(self.tracker.sent), self.progress.at
        # sets at the grid times up to `begin`; after the commands that were sent it stands in `pose`
        late = self.tracker.delay > 0
        until = [(self.pose(k) if k <= sent or late else None) or pose for k in range(at, begin + 1)]
        left = self.progress.after(until, self.tracker.bulge).left
        return remaining(problem, begin, left, pose, ranges, self.tracker.onwards)

    def coefficients(self, nodes: Floats, pose: PoseSet) -> Floats:
        """Drives of its node robots in the middle of a set of poses, shape (nodes, 5)."""
        fleet = self.fleet
        coefficients = fleet.coefficients(fleet.dynamic_members(nodes))
        # g and p_0 of every node robot are those of the middle of the set
        coefficients[:, 2] = pose.heading if fleet.arcs.heading_from == "x" else np.pi / 2 - pose.heading
        coefficients[:, 3:] = pose.position
        return coefficients

    def growth(self, middle: Floats, controls: Floats, begin: int, pose: PoseSet, soon: int) -> Floats:
        """Metres by which its set of states is larger than its node robots' curve, shape (steps + 1,).

        Parameters
        ----------
        middle : ndarray, shape (steps + 1, 2)
            Where the middle member goes from `pose` on, metres.
        controls : ndarray, shape (steps, n_u)
            From the grid time `begin` on, at which it is in `pose`.
        soon : int
            Step after which what errors and drift may add is measured before it matters.
        """
        slip = self.tracker.departures(controls, begin, pose, planned=True)
        if self.tracker.onwards:
            # terrain is in the departures
            problem, fleet = on_plain_ground(self.tracker.problem), self.fleet.with_(uncertainty=self.tracker.onwards)
            slip = slip + growth_on_arcs(problem, fleet, controls, problem.step).within
        # away + 2 sin(turn / 2) |p(t) - p(0)|, and what errors and drift add until they are measured
        grown = pose.away + swung(pose.turn) * np.linalg.norm(middle - pose.position, axis=1)
        grown[1:] += np.minimum(slip, slip[min(soon, len(slip) - 1)])
        return np.asarray(grown)
