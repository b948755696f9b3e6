"""A share of the fleet: which members do what only a share of them has to do.

For ``share(p, f)`` the program asks `f` of the members in a box of parameters whose mass is at least `p` under the
distributions. Any such box is enough; which one is cheapest depends on the map, so some are tried: the middle of the
distribution, and its lower and upper ends.

*Guarantee*: sufficient. The same members do all of `f`; a plan in which other members do different parts is not found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.bodies import body_hyperplanes
from ensemble_ctrl.ocp.disturbance import growth
from ensemble_ctrl.ocp.hyperplanes import REACH, Hyperplanes, separate
from ensemble_ctrl.ocp.truncation import Range, Truncation
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.specification import TaskPart

Floats = NDArray[np.float64]
Sides = tuple[Callable[[float], tuple[float, float]], ...]

MANY = 50
"""Convex pieces beyond which only those close by are constrained from the start."""
AHEAD = 0.04
"""Share of the horizon in which a robot drives from where a pair is constrained from the start to its obstacle."""
SPARE = 0.03
"""Part of the remaining share that the box takes in addition, so that a proof has room."""


def ranges(problem: Problem) -> tuple[Range | None, ...]:
    """The boxes to try, in scaled dynamic parameters; only None where the whole fleet has to do everything."""
    found = problem.specification.chance
    if not found or problem.solve.guarantee == "moment" or problem.solve.method == "minlp" or not problem.fleet.dynamic:
        return (None,)
    share = max(chance.share.p for chance in found)
    share += SPARE * (1 - share)
    boxes = (_box(problem, sides, share) for sides in _choices(len(problem.fleet.dynamic)))
    return tuple(dict.fromkeys(boxes))


def _choices(dynamic: int) -> Iterator[Sides]:
    """For each dynamic parameter which part of its distribution is kept, as shares below its ends."""

    def low(mass: float) -> tuple[float, float]:
        return 0.0, mass

    def middle(mass: float) -> tuple[float, float]:
        return (1 - mass) / 2, (1 + mass) / 2

    def high(mass: float) -> tuple[float, float]:
        return 1 - mass, 1.0

    def whole(mass: float) -> tuple[float, float]:
        return 0.0, 1.0

    if dynamic > 1:
        # the same part of every distribution, or all of every distribution but one
        yield (middle,) * dynamic
    for k in range(dynamic):
        for side in (middle, low, high):
            yield tuple(side if k == other else whole for other in range(dynamic))


def _box(problem: Problem, sides: Sides, share: float) -> Range:
    """The smallest box of this kind with at least a share of the fleet."""
    fleet = problem.fleet
    lower, upper = np.array(fleet.lower), np.array(fleet.upper)

    def ends(mass: float) -> tuple[Floats, Floats]:
        for k, distribution, side in zip(fleet.dynamic, fleet.dynamic_distributions, sides, strict=True):
            a, b = side(mass)
            # ends of the side as quantiles of the distribution
            lower[k] = distribution.lower if a <= 0 else float(distribution.quantile(a))
            upper[k] = distribution.upper if b >= 1 else float(distribution.quantile(b))
        return lower, upper

    # bisection on the mass that each side keeps, until the box, whose mass is a product or a count, has the share
    few, many = share, 1.0
    if fleet.mass(*ends(few)) >= share:
        many = few
    for _ in range(30):
        mass = (few + many) / 2
        few, many = (few, mass) if fleet.mass(*ends(mass)) >= share else (mass, many)
    ends(many)
    # in scaled parameters s, clipped to [-1, 1]
    pairs = zip(fleet.dynamic, fleet.dynamic_distributions, strict=True)
    scaled = (
        [float(np.clip(distribution.to_scaled(end[k]), -1.0, 1.0)) for end in (lower, upper)]
        for k, distribution in pairs
    )
    return tuple((low, high) for low, high in scaled)


def members_within(scaled: Floats, within: Range) -> Floats:
    """Scaled points of the dynamic parameters moved from all of their ranges into a box."""
    low, high = np.array(within).T
    # affine map from [-1, 1] to [low, high]
    return np.asarray(low + (scaled + 1) / 2 * (high - low))


def required_parts(problem: Problem, within: Range | None) -> tuple[tuple[TaskPart, ...], tuple[TaskPart, ...]]:
    """Parts of the task with a robustness: those for everybody, and those for the members in a box alone."""
    specification = problem.specification
    if within is None:
        return specification.parts, ()
    return specification.rest, tuple(part for chance in specification.chance for part in chance.rest)


def map_size(problem: Problem, curve: Floats) -> float:
    """Larger side of the box around the fleet's way and the obstacles, metres."""
    pieces = (piece for avoid in problem.specification.avoided_by_anyone for piece in avoid.pieces)
    corners = [curve.reshape(-1, 2), *(piece.vertices for piece in pieces)]
    return float(np.ptp(np.concatenate(corners), axis=0).max())


def reach(problem: Problem, curve: Floats) -> float:
    """Distance in metres within which pairs of a piece and a step are constrained from the start.

    Among many obstacles it is no more than what robots drive in a short part of the horizon: pairs that a solution
    violates all the same are added.
    """
    far = REACH * map_size(problem, curve)
    if sum(len(avoid.pieces) for avoid in problem.specification.avoided_by_anyone) <= MANY:
        return far
    fleet = problem.fleet
    fastest = max(abs(float(fleet.input_lower[0])), abs(float(fleet.input_upper[0])))
    return min(far, AHEAD * fastest * problem.duration)


@dataclass(eq=False)
class _Last:
    """The hyperplanes that were looked for last: a round begins at the controls that the one before it evaluated."""

    problem: Problem | None = None
    truncation: Truncation | None = None
    arrays: tuple[Floats | None, ...] = ()
    near: float = np.inf
    found: Hyperplanes | None = None

    def of(
        self, problem: Problem, truncation: Truncation, near: float, arrays: tuple[Floats | None, ...]
    ) -> Hyperplanes | None:
        """They, if they were looked for with the same arguments."""
        same = self.problem is problem and self.truncation is truncation and self.near == near
        return self.found if same and all(_alike(a, b) for a, b in zip(self.arrays, arrays, strict=True)) else None


def _alike(a: Floats | None, b: Floats | None) -> bool:
    """Whether both are the same numbers, or both are missing."""
    return a is b if a is None or b is None else np.array_equal(a, b)


_LAST = _Last()


def all_hyperplanes(
    problem: Problem, truncation: Truncation, curve: Floats, near: float = np.inf, controls: Floats | None = None
) -> Hyperplanes:
    """Separating hyperplanes for what the fleet, and a share of it, avoids; beyond `near` metres any will do.

    Errors of the model under `controls` are in their supports and gaps.
    """
    found = _LAST.of(problem, truncation, near, (curve, controls))
    if found is None:
        found = _all_hyperplanes(problem, truncation, curve, near, controls)
        copies = (curve.copy(), None if controls is None else controls.copy())
        vars(_LAST).update(problem=problem, truncation=truncation, near=near, arrays=copies, found=found)
    return found


def _all_hyperplanes(
    problem: Problem, truncation: Truncation, curve: Floats, near: float, controls: Floats | None
) -> Hyperplanes:
    """The same, looked for anew."""
    errors = None if controls is None else growth(problem, controls)
    if errors is not None:
        return _all_hyperplanes(problem, truncation, curve, near + float(errors.within.max()), None).grown(
            errors.within
        )
    shift = problem.fleet.shift
    found = body_hyperplanes(problem, curve, problem.specification.avoid, truncation.parts, near)
    if truncation.within is None:
        return found
    some = [avoid for chance in problem.specification.chance for avoid in chance.avoid]
    return found.joined(separate(curve, some, problem.duration, shift, (truncation.inner,), near)) if some else found
