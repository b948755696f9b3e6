"""Robots that hear the same commands: where each is and was, what is left for it, and what is proven for all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.remaining import SetCertificate, certify_set, together
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.ocp.online import InitialCondition, OnlineProgram
from ensemble_ctrl.ocp.terrain import crossed
from ensemble_ctrl.planning.online.apart import certify_apart
from ensemble_ctrl.planning.online.evidence import NOTHING, Evidence
from ensemble_ctrl.planning.online.followed import Followed
from ensemble_ctrl.planning.online.mapped import with_map
from ensemble_ctrl.planning.online.measurement import Measurement, Seen
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.propagation import PoseSet
from ensemble_ctrl.planning.online.remaining import for_a_while, of_each, on_plain_ground
from ensemble_ctrl.planning.online.step import Work
from ensemble_ctrl.planning.online.tracker import Tracker
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.planning.planner.patches import kept_out
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.checks import require_sound
from ensemble_ctrl.problem.specification import ApartConstraint, AvoidConstraint

Floats = NDArray[np.float64]
Poses = dict[str, PoseSet]
"""Where each robot may be."""


class RobotGroup:
    """Robots that hear the same commands; all that a loop knows of them, and can prove of commands for them.

    Parameters
    ----------
    problem : Problem
        Of robots that start alike, or with a start for each of them.
    options : OnlineOptions
    names : sequence of str
        Of the robots.

    Attributes
    ----------
    robots : dict of str to Followed
        Where each robot is and has been.
    base : int
        The control step at which the grid of plans begins.
    elapsed : float
        Seconds since the plan began, for whoever has a clock to set; the map changes then.
    """

    def __init__(self, problem: Problem, options: OnlineOptions, names: Sequence[str]) -> None:
        if not names or len(set(names)) < len(names) or not all(names):
            raise ProblemError(f"robots: expected different names, at least one, got {list(names)}")
        each = of_each(problem, names)
        self.problem, self.options = next(iter(each.values())), options
        self._planned = self.problem  # what the program is of
        self.robots = {name: Followed(one, options) for name, one in each.items()}
        self._apart = problem.specification.apart
        self.base, self.elapsed = 0, 0.0
        self._events: list[str] = []

    @property
    def trackers(self) -> dict[str, Tracker]:
        """The past of each robot."""
        return {name: robot.tracker for name, robot in self.robots.items()}

    @property
    def sent(self) -> int:
        """Control steps whose commands have been returned; the next ones begin there."""
        return len(next(iter(self.robots.values())).tracker.sent)

    @property
    def time(self) -> float:
        """Up to which every robot has been measured, seconds."""
        return min(tracker.time for tracker in self.trackers.values())

    @property
    def seen(self) -> bool:
        """Whether every robot has been measured."""
        return all(tracker.last is not None for tracker in self.trackers.values())

    @property
    def holds(self) -> bool:
        """False once measurements of any robot contradicted what was assumed; it stays so."""
        return all(tracker.holds for tracker in self.trackers.values())

    @property
    def steps(self) -> int:
        """Control steps of the whole loop."""
        run_for = self.options.run_for
        return self.problem.steps if run_for is None else max(1, round(run_for / self.problem.step))

    def named(self, measurement: Seen | None) -> dict[str, Measurement]:
        """Measurements by the names of their robots.

        Raises
        ------
        ProblemError
            For a robot that there is not, and for one without a name where there are several.
        """
        if measurement is None:
            return {}
        if isinstance(measurement, Mapping):
            strange = [name for name in measurement if name not in self.robots]
            if strange:
                raise ProblemError(f"measurement: expected of {', '.join(self.robots)}, got one of {strange[0]!r}")
            return dict(measurement)
        if len(self.robots) > 1:
            raise ProblemError(f"measurement: expected by name, of {', '.join(self.robots)}, got one without")
        return {next(iter(self.robots)): measurement}

    def recall(self, begin: int) -> None:
        """Take commands back that were returned for the control steps from `begin` on, none of which is past."""
        if begin < self.sent:
            for tracker in self.trackers.values():
                tracker.recall(begin)

    def _take(self, problem: Problem) -> None:
        """Take another map, for all robots."""
        self.problem = problem
        for robot in self.robots.values():
            robot.take(with_map(robot.tracker.problem, problem.obstacles, problem.motions))

    def label(self, name: str, parameter: str) -> str:
        """What a step calls a parameter of a robot."""
        return parameter if len(self.robots) == 1 else f"{name}.{parameter}"

    def _called(self, name: str) -> str:
        """A robot in a sentence."""
        return name if len(self.robots) > 1 else "the robot"

    def _send(self, controls: Floats) -> None:
        """Some more commands were given out, to all robots."""
        for tracker in self.trackers.values():
            tracker.send(controls)

    def _ranges(self) -> dict[str, tuple[float, float]]:
        """What is known of every parameter."""
        return {
            self.label(name, parameter): (float(low), float(high))
            for name, tracker in self.trackers.items()
            for parameter, (low, high) in zip(tracker.sets.names, tracker.ranges, strict=True)
        }

    def _program(self, plan: Floats) -> OnlineProgram:
        """The program of the loop, which keeps out of patches of terrain that the plan does not cross."""
        names = frozenset(self.problem.terrain) - frozenset(crossed(self.problem, plan))
        around = kept_out(self.problem, names) if names else None
        self._planned = self.problem if around is None else around
        for tracker in self.trackers.values():
            tracker.kept_out = frozenset() if around is None else names
        return OnlineProgram.of(self._planned, plan, self.options.order)

    # --- where things stand; grid times count from the base

    def _now(self) -> tuple[int, Poses]:
        """The first grid time from the newest measurement of any robot on, and the sets of poses then.

        There are no sets while one robot is unknown.
        """
        # sets of poses of all robots at one grid time, by measurements before and after it
        k = max(tracker.at for tracker in self.trackers.values())
        found = {name: robot.tracker.onset(k) for name, robot in self.robots.items()}
        poses = {name: pose for name, pose in found.items() if pose is not None}
        return k - self.base, poses if len(poses) == len(found) else {}

    def _initial(self, nodes: Floats, at: int, poses: Poses, plan: Floats, free: int, spare: float) -> InitialCondition:
        """What a solve starts from at a grid time: all robots' members, the largest growth and `spare` metres."""
        ahead, base = plan[at:], self.base
        soon = free - at + 2 * self.options.applied_steps
        coefficients, paths, grown = [], [], []
        for name, pose in poses.items():
            robot = self.robots[name]
            coefficients.append(robot.coefficients(nodes, pose))
            middle = self._middle(coefficients[-1], ahead)
            paths.append(robot.path(base, base + at))
            grown.append(robot.growth(middle, ahead, base + at, pose, soon))
        # node robots of all robots side by side, grown by the largest of their sets
        growth = np.zeros(len(plan) + 1)
        growth[at:] = np.max(grown, axis=0) + spare
        return InitialCondition(
            at, free, np.concatenate(coefficients), np.stack(paths, axis=1), growth, plan, self._avoided()
        )

    def _avoided(self) -> tuple[AvoidConstraint, ...]:
        """What to keep out of, on the grid's clock."""
        gone = self.base * self.problem.step
        planned = self._planned
        motions = {name: motion.later(gone) for name, motion in planned.motions.items()}
        problem = with_map(planned, planned.obstacles, motions) if gone and motions else planned
        return problem.specification.avoid

    def _middle(self, coefficients: Floats, controls: Floats) -> Floats:
        """Where the middle one of some members goes, shape (steps + 1, 2), metres."""
        # the path of the middle node robot, by exact arcs
        middle = coefficients[len(coefficients) // 2][None]
        return np.asarray(self.problem.fleet.arcs.paths(controls, middle, self.problem.step)[0])

    # --- what is proven, and what could be done instead

    def _proof(self, controls: Floats, work: Work, begin: int | None = None) -> Evidence:
        """What can be proven of commands, some of which have been sent, from the last measurement on."""
        at, poses = self._now()
        if not poses:
            return NOTHING
        begin = self.sent - self.base if begin is None else begin
        # a period: up to the first unsent step, the steps applied then, and the deadline of the next plan
        span = begin - at + self.options.applied_steps + self.options.lead(self.problem.step)
        try:
            rests = self._rests(at, poses)
            whole = self._shown(rests, controls[at:], at, poses)
            work.certify_seconds += whole.seconds
            if whole.proven:
                return Evidence.whole(whole, self.base + len(controls) if self.problem.motions else math.inf)
            span = min(span, len(controls) - at)
            soon = {name: for_a_while(rest, span) for name, rest in rests.items()}
            short = self._shown(soon, controls[at:][:span], at, poses)
        except ProblemError as error:
            self._events.append(str(error).splitlines()[0])
            return NOTHING
        work.certify_seconds += short.seconds
        return Evidence.period(short, self.base + at + span, whole) if short.proven else Evidence(tried=short)

    def _certified(self, controls: Floats, at: int, poses: Poses) -> SetCertificate:
        """What is proven from a grid time on, of every robot."""
        return self._shown(self._rests(at, poses), controls[at:], at, poses)

    def _rests(self, at: int, poses: Poses) -> dict[str, Problem]:
        """What is left for each robot from a grid time on."""
        return {name: self.robots[name].rest(self.base + at, pose) for name, pose in poses.items()}

    def _shown(self, rests: Mapping[str, Problem], ahead: Floats, at: int, poses: Poses) -> SetCertificate:
        """What is proven of commands from a grid time on for what is left."""
        departures = {
            name: self.robots[name].tracker.departures(ahead, self.base + at, pose) for name, pose in poses.items()
        }
        found = {
            name: certify_set(on_plain_ground(rests[name]), ahead, pose.away, pose.turn, departures[name])
            for name, pose in poses.items()
        }
        if self._apart:  # on terrain nothing is proven of distances
            found |= certify_apart(rests, ahead, poses, departures, self._distances(at))
        return together(found)

    def _distances(self, at: int) -> list[ApartConstraint]:
        """How far robots keep from each other, on the clock of a grid time."""
        gone = 0.0 if self.options.horizon == "receding" else (self.base + at) * self.problem.step
        return [replace(each, begin=each.begin - gone, end=each.end - gone) for each in self._apart]

    def _from_here(self, begin: int, plan: Floats, work: Work) -> Floats | None:
        """`plan` with other commands, from the planner, that start at step `begin`; None if it finds none."""
        poses = self._now()[1]
        if not poses:
            return None
        # planned for the robot nearest to the middle of all
        midst = np.mean([pose.position for pose in poses.values()], axis=0)
        name = min(poses, key=lambda each: float(np.linalg.norm(poses[each].position - midst)))
        try:
            rest = self.robots[name].rest(self.base + begin, poses[name])
            require_sound(rest)
            limits = replace(rest.solve, time_limit=0.8 * self.options.recovery)
            found = solve(rest.with_(solve=limits, verify=replace(rest.verify, certificate=False)))
        except ProblemError as error:
            self._events.append(f"no way from here: {str(error).splitlines()[0]}")
            return None
        work.solve_seconds, work.status = sum(found.seconds.values()), found.status
        return np.concatenate([plan[:begin], found.controls])[: len(plan)]
