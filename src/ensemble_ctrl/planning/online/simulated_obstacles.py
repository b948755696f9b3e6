"""Simulated obstacles that come, stray from where they are predicted as far as that is allowed, and go."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.planning.online.mapped import with_map
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.specification import AvoidConstraint

Floats = NDArray[np.float64]
Straying = Literal["towards", "away", "random", "none"]

NEAR = 1e-9
"""Seconds within which a time has come."""


class Mapped(Protocol):
    """A loop whose map can be changed."""

    def add_obstacle(self, name: str, pieces: Sequence[Obstacle], motion: Motion | None = None) -> None:
        """Put an obstacle on the map."""

    def update_obstacle(self, name: str, motion: Motion) -> None:
        """Predict its motion anew."""

    def remove_obstacle(self, name: str) -> None:
        """Take it from the map."""


@dataclass(frozen=True, eq=False)
class ObstacleSettings:
    """An obstacle that comes while a loop runs.

    Parameters
    ----------
    pieces : tuple of Obstacle
        Where it is predicted to be when it appears.
    appears : float
        When it is seen first, seconds after the plan began.
    vanishes : float or None
        When it is gone; None for never.
    motion : Motion or None
        As it is predicted when it appears, at time 0 of its own; None for an obstacle that stands.
    seen_every : float or None
        Seconds after which it is measured, and predicted, anew; None for never.
    strays : {"towards", "away", "random", "none"}
        How it leaves what is predicted within the motion's uncertainty, as fast as that grows: towards the nearest
        robot, away from it, in a direction that is drawn for each step, or not at all.
    seed : int
        Of all that is drawn.
    """

    pieces: tuple[Obstacle, ...]
    appears: float
    vanishes: float | None = None
    motion: Motion | None = None
    seen_every: float | None = None
    strays: Straying = "towards"
    seed: int = 0

    def __post_init__(self) -> None:
        if self.vanishes is not None and not self.vanishes > self.appears:
            raise ProblemError(f"vanishes: expected after {self.appears:g} s, got {self.vanishes:g} s")


class SimulatedObstacle:
    """One of them, whose truth is known.

    Attributes
    ----------
    times, offsets : list
        When it was where, from its appearance on: seconds, and true displacements, shape (2,), metres.
    """

    def __init__(self, settings: ObstacleSettings) -> None:
        self.settings = settings
        self.times: list[float] = []
        self.offsets: list[Floats] = []
        self._random = np.random.default_rng(settings.seed)
        self._stray = np.zeros(2)
        self._seen = -np.inf

    @property
    def present(self) -> bool:
        """Whether it has come."""
        return bool(self.times)

    @property
    def truth(self) -> Motion:
        """How it has moved."""
        stood = len(self.times) < 2
        times = [self.times[0], self.times[0] + 1.0] if stood else self.times
        return Motion(np.array(times), np.array(self.offsets * 2 if stood else self.offsets))

    def gone(self, now: float) -> bool:
        """Whether it is not there any more."""
        vanishes = self.settings.vanishes
        return vanishes is not None and now >= vanishes - NEAR

    def appear(self, now: float, robots: Floats) -> Motion | None:
        """It comes; returns how it is predicted."""
        motion = self.settings.motion
        if motion is not None:
            self._stray = motion.uncertainty * self._direction(robots)
        self._note(now)
        self._seen = now
        return None if motion is None else motion.later(-now)

    def move(self, now: float, robots: Floats) -> None:
        """Let the time up to `now` pass; `robots` of shape (robots, 2) are where they were before, metres."""
        if self.settings.motion is not None:
            passed = now - self.times[-1]
            self._stray = self._stray + self.settings.motion.growth * passed * self._direction(robots)
        self._note(now)

    def seen_again(self, now: float) -> Motion | None:
        """What is predicted from a new measurement, which is off by no more than the first; None if it is not due."""
        motion, every = self.settings.motion, self.settings.seen_every
        if motion is None or every is None or now < self._seen + every - NEAR:
            return None
        self._seen = now
        gone = now - self.settings.appears
        # an error that is uniform in the disc of the uncertainty
        angle, share = self._random.uniform(-np.pi, np.pi), np.sqrt(self._random.random())
        error = motion.uncertainty * share * np.array([np.cos(angle), np.sin(angle)])
        ahead = motion.covering(gone, max(gone, float(motion.times[-1])) + 1.0)
        kept = ahead.times > gone
        times = np.append(gone, ahead.times[kept])
        offsets = motion.at(times) + self._stray + error
        return replace(motion, times=times, offsets=offsets, since=gone).later(-self.settings.appears)

    def _note(self, now: float) -> None:
        """Where it is."""
        motion = self.settings.motion
        nominal = np.zeros(2) if motion is None else motion.at(now - self.settings.appears)
        self.times.append(now)
        self.offsets.append(nominal + self._stray)

    def _direction(self, robots: Floats) -> Floats:
        """Where it strays to, shape (2,): of length 1, or zero."""
        if self.settings.strays == "none":
            return np.zeros(2)
        if self.settings.strays == "random":
            angle = self._random.uniform(-np.pi, np.pi)
            return np.array([np.cos(angle), np.sin(angle)])
        offset = self.offsets[-1] if self.offsets else np.zeros(2)
        middle = np.mean([piece.vertices.mean(axis=0) for piece in self.settings.pieces], axis=0) + offset
        ways = robots - middle
        way = ways[np.linalg.norm(ways, axis=1).argmin()]
        length = float(np.linalg.norm(way))
        sign = 1.0 if self.settings.strays == "towards" else -1.0
        return sign * way / length if length else np.zeros(2)


class SimulatedScene:
    """All of them, beside simulated robots.

    Parameters
    ----------
    settings : mapping of str to ObstacleSettings
    """

    def __init__(self, settings: Mapping[str, ObstacleSettings]) -> None:
        self.obstacles = {name: SimulatedObstacle(each) for name, each in settings.items()}
        self._over: set[str] = set()

    def advance(self, loop: Mapped, now: float, robots: Floats) -> None:
        """Change the map of a loop as it is at a time.

        Parameters
        ----------
        loop : Mapped
        now : float
            Seconds since the plan began.
        robots : ndarray, shape (robots, 2)
            Where they truly are, metres.
        """
        for name, obstacle in self.obstacles.items():
            if name in self._over:
                continue
            if not obstacle.present:
                if now >= obstacle.settings.appears - NEAR and not obstacle.gone(now):
                    loop.add_obstacle(name, obstacle.settings.pieces, obstacle.appear(now, robots))
                continue
            obstacle.move(now, robots)
            if obstacle.gone(now):
                self._over.add(name)
                loop.remove_obstacle(name)
            elif (motion := obstacle.seen_again(now)) is not None:
                loop.update_obstacle(name, motion)

    def avoided(self, problem: Problem) -> tuple[AvoidConstraint, ...]:
        """What robots truly had to keep out of while it was there: no more than the task says."""
        came = {name: each for name, each in self.obstacles.items() if each.present}
        pieces = {name: each.settings.pieces for name, each in came.items()}
        moved = {name: each.truth for name, each in came.items()}
        real = with_map(problem, {**problem.obstacles, **pieces}, {**problem.motions, **moved})
        spans = {name: (each.times[0], each.times[-1]) for name, each in came.items()}
        return tuple(
            replace(avoid, begin=max(avoid.begin, spans[avoid.name][0]), end=min(avoid.end, spans[avoid.name][1]))
            for avoid in real.specification.avoid
            if avoid.name in spans
        )
