"""What is left of a problem, for one robot that has been measured on the way."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import pairwise
from math import ceil, floor
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import (
    And,
    Eventually,
    ExactOps,
    Formula,
    Known,
    Predicate,
    Signals,
    Until,
    ground,
    negation_normal_form,
    progressed,
    robustness,
    settled,
)
from ensemble_ctrl.constraints.stl.rewrite import rebuilt
from ensemble_ctrl.constraints.stl.robustness import Temporal
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError, UnsupportedError
from ensemble_ctrl.core.values import exact
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.findings import loop_findings
from ensemble_ctrl.planning.online.propagation import PoseSet
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.specification import AvoidThroughout, TaskPart
from ensemble_ctrl.problem.starts import by_start
from ensemble_ctrl.problem.uncertainty import Uncertainty

Floats = NDArray[np.float64]

EVERYWHERE = Known(float("inf"))
"""The task of a robot that has nothing left to do."""


def of_one_robot(problem: Problem) -> Problem:
    """The problem without parameters of the start, which is measured, and without joint samples.

    Raises
    ------
    UnsupportedError
        For what is not for a loop (`loop_findings`).
    """
    wrong = next(loop_findings(problem), None)
    if wrong is not None:
        raise UnsupportedError(str(wrong))
    if problem.fleet.starts:
        raise UnsupportedError(f"fleet.starts: expected one start, got {', '.join(problem.fleet.starts)}")
    fleet = problem.fleet
    distributions = {
        name: distribution for name, distribution in fleet.parameters.items() if name in fleet.system.parameters
    }
    distributions = {
        name: Interval(distribution.lower, distribution.upper) for name, distribution in distributions.items()
    }
    return problem.with_(fleet=fleet.with_(parameters=distributions, samples=None, position=fleet.start_place))


def of_each(problem: Problem, names: Sequence[str]) -> dict[str, Problem]:
    """The problem of each robot, by name: of those that start alike, or of the start of that name.

    Raises
    ------
    UnsupportedError
        For what is not for a loop.
    ProblemError
        For names other than those of the starts.
    """
    if not problem.fleet.starts:
        return dict.fromkeys(names, of_one_robot(problem))
    if wrong := next(loop_findings(problem), None):
        raise UnsupportedError(str(wrong))
    if set(names) != set(problem.fleet.starts):
        starts = ", ".join(problem.fleet.starts)
        raise ProblemError(f"robots: expected one for each start ({starts}), got {', '.join(names)}")
    return {name: of_one_robot(one) for name, one in by_start(problem).items()}


def with_ranges(fleet: Fleet, ranges: Floats) -> Fleet:
    """The fleet with other ranges of its parameters, shape (parameters, 2)."""
    distributions = {name: Interval(*map(float, ends)) for name, ends in zip(fleet.names, ranges, strict=True)}
    return replace(fleet, parameters=distributions)


def _standing(fleet: Fleet, pose: PoseSet, ranges: Floats, uncertainty: Uncertainty | None) -> Fleet:
    """The fleet at the middle of a set of poses, with other ranges and bounds of its errors."""
    bounds = fleet.uncertainty if uncertainty is None else uncertainty
    return with_ranges(fleet, ranges).with_(position=pose.position, heading=pose.heading, uncertainty=bounds)


@dataclass(frozen=True, eq=False)
class _Element:
    """Lower bounds of predicates at a grid time, or throughout the time to the next one, as signals of one time."""

    poses: tuple[PoseSet, ...]
    bulge: float
    step: float
    members: int = 1
    steps: int = 0

    def leaf(self, predicate: Predicate, first: int, last: int) -> Floats:
        """The lowest value in the sets at the ends, and how much lower it may be in between, shape (1, 1)."""
        coefficients, offset = predicate.normalised()
        row = np.array([dict(coefficients).get(name, 0.0) for name in ("x", "y")])
        # min of mu over the box of places at both ends, less the bulge in between
        ends = [float(row @ pose.position + offset - np.abs(row) @ pose.half) for pose in self.poses]
        return np.array([[min(ends) - self.bulge]])

    def mean(self) -> Signals:
        """One robot is its own mean."""
        return self


@dataclass(frozen=True, eq=False)
class BoxElement:
    """The same of a robot whose states are in a box throughout."""

    names: tuple[str, ...]
    low: Floats
    high: Floats
    step: float
    members: int = 1
    steps: int = 0

    def leaf(self, predicate: Predicate, first: int, last: int) -> Floats:
        """The lowest value in the box, shape (1, 1)."""
        coefficients, offset = predicate.normalised()
        row = np.array([dict(coefficients).get(name, 0.0) for name in self.names])
        used = row != 0  # nothing may be known of the others
        ends = np.where(row > 0, self.low, self.high)
        return np.array([[float(row[used] @ ends[used]) + offset]])

    def mean(self) -> Signals:
        """One robot is its own mean."""
        return self


Element = _Element | BoxElement


class Progress:
    """What is left of the parts of a task with a robustness, along a past that is a tube.

    Time is cut into the grid times and the open intervals between them, and windows are moved to the grid so that
    nothing rises.

    Parameters
    ----------
    problem : Problem
        On its whole horizon.

    Attributes
    ----------
    at : int
        The first grid time that is not past.
    left : tuple of Formula
        What is left of each part, read then.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.at = problem, 0
        self.left: tuple[Formula, ...] = tuple(map(self._on_grid, problem.specification.parts))

    def advance(self, poses: Sequence[PoseSet], bulge: Callable[[int], float]) -> None:
        """Some more time is past.

        Parameters
        ----------
        poses : sequence of PoseSet
            Where the robot was at the grid times from `at` on; all times before the last of them are past then.
        bulge : callable
            Metres by which it may have left the segment between two places at a grid time and the next.
        """
        for here, there in pairwise(poses):
            half = self.problem.step / 2
            self.take(_Element((here,), 0.0, half), _Element((here, there), bulge(self.at), half))

    def take(self, here: Element, between: Element) -> None:
        """One more step is past: what was so at its beginning, and throughout."""
        if self.left:
            self._pass(here, 2 * self.at)
            self._pass(between, 2 * self.at + 1)
        self.at += 1

    def copied(self) -> Progress:
        """The same, to be taken further."""
        later = Progress(self.problem)
        later.left, later.at = self.left, self.at
        return later

    def after(self, poses: Sequence[PoseSet], bulge: Callable[[int], float]) -> Progress:
        """The progress of a robot that is in these sets of poses at the grid times that come next."""
        later = self.copied()
        later.advance(poses, bulge)
        return later

    def _pass(self, element: Element, k: int) -> None:
        """An element of time, of which there are two a step, is past."""
        # two elements a step: the grid time, and the open interval after it
        left = max(2 * self.problem.steps - k, 0)
        read = partial(self._reading, element)
        self.left = tuple(progressed(part, read, 1, left, element.step) for part in self.left)

    def _reading(self, element: Element, leaf: Formula, k: int) -> float:
        """A lower bound of a leaf's robustness throughout an element."""
        problem = self.problem
        plain = negation_normal_form(leaf)
        places, radius = problem.fleet.places, problem.fleet.radius
        formula = ground(plain, problem.regions, problem.obstacles, position=places, radius=radius)
        return float(robustness(formula, element, ExactOps()))

    def _on_grid(self, part: TaskPart) -> Formula:
        """A part with its windows on the grid."""
        plain = negation_normal_form(part.resolved)
        moved = gridded(plain, exact(self.problem.duration) / self.problem.steps)
        return Known(-np.inf) if moved is None else moved

    @property
    def value(self) -> float:
        """Robustness once everything is decided, metres; minus infinity before."""
        return min((part.value if isinstance(part, Known) else -np.inf for part in self.left), default=np.inf)


def gridded(formula: Formula, step: Fraction) -> Formula | None:
    """A formula in negation normal form with every window moved to grid times, so that its value never rises.

    Parameters
    ----------
    formula : Formula
        With windows in seconds.
    step : Fraction
        Seconds between grid times.

    Returns
    -------
    Formula or None
        None if a window that has to shrink holds no grid time.
    """
    parts = [gridded(part, step) for part in formula.parts]
    if any(part is None for part in parts):
        return None
    same = rebuilt(formula, (part for part in parts if part is not None))
    if not isinstance(same, Temporal) or same.a is None or same.b is None:
        return same
    # existential windows shrink to grid times, universal ones grow: the value never rises
    low, high = exact(same.a) / step, exact(same.b) / step
    shrinks = isinstance(same, Eventually | Until)
    first, last = (ceil(low), floor(high)) if shrinks else (floor(low), ceil(high))
    return replace(same, a=float(first * step), b=float(last * step)) if first <= last else None


def remaining(
    problem: Problem,
    begin: int,
    parts: Iterable[Formula],
    pose: PoseSet,
    ranges: Floats,
    uncertainty: Uncertainty | None = None,
) -> Problem:
    """What is left of a problem from a grid time on.

    Parameters
    ----------
    problem : Problem
        Of one robot, on its whole horizon.
    begin : int
        The grid time.
    parts : iterable of Formula
        What is left of the parts with a robustness (`Progress.left`), read at `begin`.
    pose : PoseSet
        Where the robot is; its middle becomes the start.
    ranges : ndarray, shape (parameters, 2)
    uncertainty : Uncertainty, optional
        What the robot may do beside its model from then on; the fleet's if not given.

    Notes
    -----
    Unchecked: it may not be possible any more, as where a region is too far, or the robot inside an obstacle.
    """
    return left_over(problem, begin, parts, _standing(problem.fleet, pose, ranges, uncertainty))


def left_over(problem: Problem, begin: int, parts: Iterable[Formula], fleet: Fleet) -> Problem:
    """As `remaining`, of a fleet that stands where the robot is."""
    gone = begin * problem.step
    past = exact(problem.duration) / problem.steps * begin
    avoided = [_later(part, past) for part in problem.specification.always]
    task = _all_of([*avoided, *(settled(part) for part in parts)])
    return _placed(problem, fleet, gone, task, problem.duration - gone, problem.steps - begin)


def read_anew(
    problem: Problem, begin: int, pose: PoseSet, ranges: Floats, uncertainty: Uncertainty | None = None
) -> Problem:
    """With a receding horizon, the whole task read at a grid time; else as `remaining`."""
    fleet = _standing(problem.fleet, pose, ranges, uncertainty)
    return _placed(problem, fleet, begin * problem.step, problem.task, problem.duration, problem.steps)


def on_plain_ground(problem: Problem) -> Problem:
    """The problem without terrain, which a loop counts by itself, unchecked."""
    if not problem.terrain:
        return problem
    changed = copy(problem)
    object.__setattr__(changed, "terrain", MappingProxyType({}))
    return changed


def for_a_while(problem: Problem, steps: int) -> Problem:
    """Only what must be kept out of during the first steps."""
    end = steps * problem.step
    task = _all_of(_later(part, Fraction(0), end) for part in problem.specification.always)
    return replace(problem, task=task, duration=end, steps=steps)


def _placed(problem: Problem, fleet: Fleet, gone: float, task: Formula, duration: float, steps: int) -> Problem:
    """Another task for another fleet, from another time on; unchecked: a proof refuses what is wrong."""
    motions = {name: motion.later(gone) for name, motion in problem.motions.items()}
    changed = copy(problem)
    other = {"fleet": fleet, "motions": MappingProxyType(motions), "task": task, "duration": duration, "steps": steps}
    for name, value in other.items():
        object.__setattr__(changed, name, value)
    return changed


def _all_of(parts: Iterable[Formula | None]) -> Formula:
    """The conjunction of what is still open."""
    open_ = [part for part in parts if part is not None and not (isinstance(part, Known) and part.value >= 0)]
    return EVERYWHERE if not open_ else open_[0] if len(open_) == 1 else And(tuple(open_))


def _later(part: AvoidThroughout, gone: Fraction, end: float = np.inf) -> Formula | None:
    """An avoidance read `gone` seconds later, and no longer than to `end`; None if nothing of it is left."""
    # the window on the later clock, its ends rounded outwards to decimals
    begin, last = exact(part.begin) - gone, exact(part.end) - gone
    if last < 0 or begin > end:
        return None
    return replace(part.written, a=_down(max(begin, Fraction(0))), b=min(-_down(-last), end))


def _down(time: Fraction) -> float:
    """The largest number of seconds whose decimal is no later than a time."""
    near = float(time)
    return near if exact(near) <= time else float(np.nextafter(near, -np.inf))
