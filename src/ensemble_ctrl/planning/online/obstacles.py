"""A map that changes while robots drive: obstacles that are seen, move as predicted, and go."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import Formula, Not, leaves, negation_normal_form
from ensemble_ctrl.constraints.stl.leaves import Avoid
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import expect, number
from ensemble_ctrl.planning.online.apart import met
from ensemble_ctrl.planning.online.arguments import motion_in_plane, pieces_in_plane, require_new
from ensemble_ctrl.planning.online.evidence import Evidence
from ensemble_ctrl.planning.online.group import RobotGroup
from ensemble_ctrl.planning.online.mapped import with_map
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.propagation import PoseSet
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.checks.motion import moving_elsewhere
from ensemble_ctrl.problem.specification import AvoidConstraint


@dataclass(frozen=True, eq=False)
class _Past:
    """What had to be kept out of from one time to another, seconds, and does not count any more."""

    avoid: AvoidConstraint
    begin: float
    end: float


class ChangingMap(RobotGroup, ABC):
    """Robots on a map that obstacles come to and leave."""

    def __init__(self, problem: Problem, options: OnlineOptions, names: Sequence[str]) -> None:
        super().__init__(problem, options, names)
        self._added: dict[str, float] = {}
        self._past: list[_Past] = []
        self._unproven_since: float | None = None
        self._unwatched = False

    @abstractmethod
    def stop(self, reason: str, for_good: bool = False) -> None:
        """Let all robots stand."""

    @abstractmethod
    def _replaced(self, event: str, harmless: bool) -> None:
        """The map is another; a harmless change only takes something away."""

    def add_obstacle(self, name: str, pieces: Sequence[Obstacle], motion: Motion | None = None) -> None:
        """Put an obstacle on the map, wherever it is; the task has to avoid all ``obstacles`` for it to count.

        It counts from now on, that is from `elapsed` or the newest measurement, whichever is later. What is planned
        is proven anew at once, as far as that is possible. Where a robot may be in it, all are stopped; else the next
        step lets them stand if no way is proven.

        Parameters
        ----------
        name : str
            A new one.
        pieces : sequence of Obstacle
            Convex.
        motion : Motion, optional
            How it is predicted to move from where the pieces are, on the loop's time, with how far it may be from that
            (`Motion.uncertainty` and `Motion.growth`): proofs count it as if it were everywhere there. After the
            last time of the prediction it is taken to stand, no better known than before.

        Raises
        ------
        ProblemError
            For a name that is taken or means something else in a task, for what is no obstacle in the plane or no
            motion in it, and for a motion where the task avoids obstacles otherwise than throughout.
        """
        now = self._clock()
        require_new(self.problem, name)
        obstacles = {**self.problem.obstacles, name: pieces_in_plane(pieces)}
        motions = dict(self.problem.motions)
        self._place(name, obstacles, motions if motion is None else {**motions, name: self._lasting(motion)})
        self._enter(name, now, f"an obstacle was added to the map: {name}")

    def update_obstacle(self, name: str, motion: Motion) -> None:
        """Predict the motion of an obstacle anew, from where its pieces were when it was added.

        As where it is added, it counts from now on, and what is planned is proven anew.

        Raises
        ------
        ProblemError
            For an obstacle that there is not, and as `add_obstacle`.
        """
        now = self._clock()
        self._require(name)
        past = list(self._until_now(name))
        self._place(name, self.problem.obstacles, {**self.problem.motions, name: self._lasting(motion)})
        self._past += past
        self._enter(name, now, f"the motion of {name} is predicted anew")

    def remove_obstacle(self, name: str) -> None:
        """Take an obstacle from the map: what is proven stays so, and the next plan may pass where it was.

        It is proven anew where the task is to be in an obstacle (``not avoid(obstacles)``).

        Raises
        ------
        ProblemError
            For an obstacle that there is not, or that the task names.
        """
        self._require(name)
        self._unwatched |= self._unproven_since is not None
        if any(isinstance(leaf, Avoid) and leaf.name == name for leaf in leaves(self.problem.task)):
            raise ProblemError(f"obstacle: expected one that the task does not name, got {name!r}")
        self._past += self._until_now(name)
        obstacles, motions = dict(self.problem.obstacles), dict(self.problem.motions)
        del obstacles[name]
        motions.pop(name, None)
        self._take(with_map(self.problem, obstacles, motions))
        self._added.pop(name, None)
        harmless = not _wanted(negation_normal_form(self.problem.task))
        self._replaced(f"an obstacle was removed from the map: {name}", harmless)

    def entered(self) -> str:
        """Which robot must have been in an obstacle, or too close to another, by the measurements; empty for none."""
        for name, tracker in self.trackers.items():
            for k, pose in enumerate(tracker.past):
                time = k * self.problem.step
                kept = [avoid for avoid in self.problem.specification.avoid if self._counts(avoid, time)]
                kept += [past.avoid for past in self._past if past.begin <= time <= past.end]
                for avoid in kept:
                    if _distance(avoid, pose, time, self.problem.fleet.radius) + _loose(avoid, time) < -pose.away:
                        return f"{self._called(name)} was in {avoid.name}"
        lasting = [replace(each, end=np.inf) for each in self._apart] if self.options.run_for else self._apart
        return met({name: tracker.past for name, tracker in self.trackers.items()}, self.problem.step, lasting)

    def _watch(self, evidence: Evidence) -> None:
        """Note whether something that moves, or has come since, was on the map while nothing was proven.

        Standing still is not safe from moving obstacles, nor in areas to avoid from a later time on, and what has come
        while robots still drive is not proven.
        """
        began, proven = (self.base + self._now()[0]) * self.problem.step, evidence.proof != "none"
        if not self._standing_helps or self._unproven_since is not None:
            late = self._unproven_since is not None and began > self._unproven_since + 1e-9
            self._unwatched |= late or not proven
        if proven:
            self._unproven_since = None

    @property
    def _standing_helps(self) -> bool:
        """Whether a robot that stands on a way that is clear stays so: nothing moves, or counts only later."""
        now = 0.0 if self.options.horizon == "receding" else self._clock()
        return not self.problem.motions and all(avoid.begin <= now for avoid in self.problem.specification.avoid)

    def _require(self, name: str) -> None:
        """Refuse an obstacle that is not on the map."""
        if expect("obstacle", name, str, "a name") not in self.problem.obstacles:
            known = ", ".join(self.problem.obstacles) or "none"
            raise ProblemError(f"obstacle: expected one that is on the map ({known}), got {name!r}")

    def _lasting(self, motion: Motion) -> Motion:
        """A motion for all times that a plan may reach."""
        return motion_in_plane(motion).covering(0.0, self.steps * self.problem.step + self.problem.duration)

    def _clock(self) -> float:
        """When a change of the map counts from, seconds."""
        elapsed = number("elapsed", self.elapsed)
        if not np.isfinite(elapsed):
            raise ProblemError(f"elapsed: expected finite seconds since the plan began, got {elapsed}")
        return max(elapsed, *(tracker.time for tracker in self.trackers.values()))

    def _place(self, name: str, obstacles: Mapping[str, tuple[Obstacle, ...]], motions: Mapping[str, Motion]) -> None:
        """Take another map if the task can be judged on it."""
        changed = with_map(self.problem, obstacles, motions)
        if name in motions and (wrong := next(moving_elsewhere(changed), None)) is not None:
            raise ProblemError(f"obstacle: {wrong.message}")
        self._take(changed)

    def _enter(self, name: str, now: float, event: str) -> None:
        """Something counts from now on; stop the robots where one may be in it."""
        self._added[name] = now
        if self._unproven_since is None:
            self._unproven_since = self._added[name]
        self._replaced(event, harmless=False)
        if reached := self._reached(name):
            self.stop(f"{reached} may be in {name}")

    def _until_now(self, name: str) -> Iterator[_Past]:
        """What an obstacle has been so far."""
        begin, now = self._added.get(name, 0.0), self._clock()
        for avoid in self.problem.specification.avoid:
            if avoid.name == name:
                first, last = (avoid.begin, now) if self.options.horizon == "receding" else (avoid.begin, avoid.end)
                yield _Past(avoid, max(begin, first), min(now, last))

    def _reached(self, name: str) -> str:
        """Which robot may be in an obstacle that has just come and has to be avoided; empty for none."""
        time, radius = self._added[name], self.problem.fleet.radius
        avoided = self.problem.specification.avoid
        new = [avoid for avoid in avoided if avoid.name == name and self._counts(avoid, time)]
        for robot, tracker in self.trackers.items():
            pose = tracker.pose(time)
            if pose is not None and any(_distance(a, pose, time, radius) - _loose(a, time) < pose.away for a in new):
                return self._called(robot)
        return ""

    def _counts(self, avoid: AvoidConstraint, time: float) -> bool:
        """Whether something must be kept out of at a time; what came later need not be."""
        if time < self._added.get(avoid.name, 0.0):
            return False
        if self.options.horizon == "receding":
            return time >= avoid.begin  # the window begins anew at every present
        return bool(avoid.during(np.array([time]))[0])


def _wanted(formula: Formula) -> bool:
    """Whether a formula in negation normal form is to be in an obstacle."""
    if isinstance(formula, Not):
        return isinstance(formula.child, Avoid)
    return any(map(_wanted, formula.parts))


def _distance(avoid: AvoidConstraint, pose: PoseSet, time: float, radius: float) -> float:
    """How far a robot in the middle of a set is from where something to keep out of is predicted, metres."""
    # places relative to where the obstacle is
    here = pose.position - avoid.offsets(np.array([time]))[0]
    # the radius of a moving obstacle includes its uncertainty
    return min(float(piece.distance(here)) for piece in avoid.pieces) - (
        avoid.radius if avoid.motion is None else radius
    )


def _loose(avoid: AvoidConstraint, time: float) -> float:
    """How far it may be from that, metres."""
    return 0.0 if avoid.motion is None else avoid.motion.loose(time)
