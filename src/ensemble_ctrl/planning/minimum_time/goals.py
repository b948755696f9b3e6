"""What is to be least: the plan's duration, or the time of the last member's passage."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import ceil
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import And, Eventually, Inside, conjuncts, kept_out, resolve
from ensemble_ctrl.constraints.stl.robustness import fits_grid
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.planning.planner.grids import windows
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

BEYOND = 2.0
"""Plans up to so many times as long as allowed are looked for, to be driven faster."""
EVEN = 200
"""Durations spread evenly among those where the task's windows hold the end of a step."""


class Goal(Protocol):
    """One number to make least."""

    @property
    def problem(self) -> Problem:
        """What was asked."""

    @property
    def of(self) -> str:
        """What it is called."""

    @property
    def most(self) -> float:
        """The largest value allowed."""

    @property
    def beyond(self) -> Goal:
        """The same with larger values, at which a solution may lead to one that is allowed."""

    @property
    def least(self) -> float:
        """The smallest value allowed."""

    def at(self, value: float) -> Problem:
        """The problem with this value."""

    def nearest(self, value: float, above: float, below: float) -> float | None:
        """The value that can be planned, between two others (neither of them), nearest to another; None without any."""

    def carried(self, controls: Floats, value: float, to: float) -> Floats:
        """Controls of a plan for one value as a guess for another."""


@dataclass(frozen=True, eq=False)
class Duration:
    """The plan's duration, between the bounds that its problem allows."""

    problem: Problem
    of: str = "duration"

    @property
    def most(self) -> float:
        """The longest."""
        return self.problem.duration

    @property
    def beyond(self) -> Goal:
        """Slower plans are driven faster."""
        return replace(self, problem=self.problem.with_(duration=BEYOND * self.problem.duration))

    @property
    def least(self) -> float:
        """The shortest."""
        return self.problem.least_duration or 0.0

    def at(self, value: float) -> Problem:
        """As it is, in a given time."""
        return self.problem.with_(duration=value, least_duration=None)

    def nearest(self, value: float, above: float, below: float) -> float | None:
        """A duration in milliseconds, or one at which a window of the task begins or ends with a step."""
        # candidates: whole milliseconds spread evenly, and durations that put a window on the grid
        low, high = max(above, self.least), min(below, self.most)
        # the wanted value itself, and EVEN values between the bounds
        even = [round(t, 3) for t in (value, *np.linspace(low, high, EVEN).tolist())]
        tried = sorted({*even, *self._with_windows(), self.most}, key=lambda t: abs(t - value))
        return next((t for t in tried if above < t < below and low <= t <= high and self._fits(t)), None)

    def _fits(self, value: float) -> bool:
        """Whether each window of the task holds the end of a step, so that it can be planned."""
        parts = [part for part in conjuncts(self.problem.task) if not kept_out(part)]
        return all(fits_grid(resolve(part, value), value / self.problem.steps) for part in parts)

    def _with_windows(self) -> Iterator[float]:
        """Durations at which a window's begin, middle or end is the end of a step; windows in seconds only."""
        n = self.problem.steps
        for a, b in windows(self.problem.task):
            for t in (a, (a + b) / 2, b):
                # t = k T / n, so T = t n / k
                yield from (t * n / k for k in range(1, n + 1))

    def carried(self, controls: Floats, value: float, to: float) -> Floats:
        """The same arcs in another time, as far as the input bounds allow; the same commands for other systems."""
        fleet = self.problem.fleet
        if not fleet.system.on_arcs:
            return controls
        # v and omega scale with 1 / T: the same path
        return np.clip(controls * (value / to), fleet.input_lower, fleet.input_upper)


@dataclass(frozen=True, eq=False)
class Passage:
    """The time by which every member has been in a region; the task goes on to hold."""

    problem: Problem
    region: str

    @property
    def of(self) -> str:
        """With the region's name."""
        return f"passage of {self.region}"

    @property
    def most(self) -> float:
        """Any time of the plan."""
        return self.problem.duration

    @property
    def beyond(self) -> Goal:
        """No time is after the plan."""
        return self

    @property
    def least(self) -> float:
        """Any time of the plan."""
        return 0.0

    def at(self, value: float) -> Problem:
        """The task with a visit up to a deadline."""
        visit = Eventually(Inside(self.region), 0.0, round(value, 9))  # 0.6, not the rounded sum of steps
        objective = replace(self.problem.objective, earliest=None)
        return self.problem.with_(task=And((*conjuncts(self.problem.task), visit)), objective=objective)

    def nearest(self, value: float, above: float, below: float) -> float | None:
        """The end of a step."""
        step = self.problem.step
        # the nearest multiple of a step below `below`, the 1e-6 for rounded quotients
        multiple = min(round(value / step), ceil(min(below, self.most + step) / step - 1e-6) - 1)
        return multiple * step if multiple * step > above else None

    def carried(self, controls: Floats, value: float, to: float) -> Floats:
        """The same."""
        return controls


def goal_of(problem: Problem) -> Goal | None:
    """What a problem asks to make least, if anything."""
    if problem.least_duration is not None:
        return Duration(problem)
    if problem.objective.earliest is not None:
        return Passage(problem, problem.objective.earliest)
    return None


def bound(goal: Goal) -> float:
    """The least value whose problem passes its checks, rounded down by a millionth.

    Where the largest value passes, every one between it and another that does passes, too: windows begin and end at
    linear functions of the duration, and a region's deadline is the least of some. Whether a window holds the end of a
    step is no such matter, and no check: `Goal.nearest` sees to it.
    """
    low, high = goal.least, goal.most
    if low > 0 and is_sound(goal, low):
        return low
    # bisection: soundness is monotone below the largest value
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (low, middle) if middle > 0 and is_sound(goal, middle) else (middle, high)
    return low * (1 - 1e-6)


def is_sound(goal: Goal, value: float) -> bool:
    """Whether the problem of a value passes its checks."""
    try:
        goal.at(value)
    except ProblemError:
        return False
    return True
