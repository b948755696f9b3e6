"""The fewest channels: groups of a fleet, each with one broadcast control that is certified for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.constraints.stl.rewrite import reads_fleet
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.planning.planner import Progress
from ensemble_ctrl.planning.ranges.bound import apart
from ensemble_ctrl.planning.ranges.cover import Cover
from ensemble_ctrl.planning.ranges.oracle import Found, Oracle, Tell
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet


@dataclass(frozen=True, eq=False)
class Grouped:
    """What was found.

    Attributes
    ----------
    groups : tuple of Found
        A certified plan for each, in the order of the parameters; together they are the fleet, if it is covered.
    missed : Fleet or None
        A part of the fleet that no plan was found for, or that more groups would be needed for than allowed.
    apart : tuple of dict of str to float
        Members of which no two can share a control: at least as many groups are needed.
    tried : int
        Parts of the fleet tried.
    limited : bool
        Whether the fleet is not covered because no more groups are allowed.
    """

    groups: tuple[Found, ...]
    missed: Fleet | None
    apart: tuple[dict[str, float], ...]
    tried: int
    limited: bool = False

    @property
    def clearance(self) -> float:
        """The least clearance proven of any group, metres; minus infinity without groups."""
        proofs = [group.solution.certificate for group in self.groups]
        return min((-np.inf if proof is None else proof.clearance for proof in proofs), default=-np.inf)


def fewest(
    problem: Problem,
    most: int,
    ticks: int,
    clearance: float = 0.0,
    *,
    both_ends: bool = True,
    progress: Progress | None = None,
    tell: Tell | None = None,
) -> Grouped:
    """As few groups as the search finds; see `ensemble_ctrl.api.channels.channels`.

    Parameters
    ----------
    problem : Problem
    most : int
        Groups allowed.
    ticks : int
        Even steps of each range between which it may be cut.
    clearance : float
        What every group keeps of every obstacle beyond the radius, metres.
    both_ends : bool
        Whether a range is covered from its high end, too.

    Raises
    ------
    ProblemError
        For a task of the fleet as a whole: a group's mean, or share, is another.
    """
    if reads_fleet(problem.task):
        raise ProblemError("task: expected one of every member by itself, got mean() or share(), which groups change")
    fleet, members = problem.fleet, apart(problem)
    try:  # with radii grown by it, a clearance of 0 is enough
        grown = problem.with_(fleet=fleet.with_(radius=fleet.radius + clearance)) if clearance > 0 else problem
    except ProblemError:  # the checks refuse it: no plan keeps so much
        return Grouped((), fleet, members, 0)
    if len(members) > most:
        return Grouped((), fleet, members, 0, limited=True)
    oracle = Oracle(grown, progress, tell)
    cover = Cover(oracle, ticks, most).run()
    groups, missed = tuple(cover.parts), cover.missed
    if len(_wide(fleet)) == 1 and both_ends and missed is None and len(groups) > len(members) and not oracle.stopped:
        groups = _reduced(oracle, fleet, groups, ticks)
    return Grouped(tuple(_of(fleet, group) for group in groups), missed, members, oracle.tried, cover.limited)


def _reduced(oracle: Oracle, fleet: Fleet, groups: tuple[Found, ...], ticks: int) -> tuple[Found, ...]:
    """Fewer groups along one parameter, if they are found from the other end: greedy is optimal for an exact search."""
    if len(groups) == 2:
        whole = oracle.certified(fleet, [group.solution.controls for group in groups], "screen")
        return groups if whole is None else (whole,)
    back = Cover(oracle, ticks, len(groups) - 1, downwards=True).run()
    return tuple(reversed(back.parts)) if back.missed is None else _fewer(groups, back.parts, _wide(fleet)[0])


def _wide(fleet: Fleet) -> list[str]:
    """The parameters that differ between members."""
    return [name for name, distribution in fleet.parameters.items() if distribution.upper > distribution.lower]


def _fewer(upwards: Sequence[Found], downwards: Sequence[Found], axis: str) -> tuple[Found, ...]:
    """The first few of one greedy choice and the first few of the other, if they meet and are fewer than `upwards`."""
    best = tuple(upwards)
    for i in range(1, len(upwards)):
        for j in range(1, len(downwards) + 1):
            if i + j < len(best) and _meet(upwards[i - 1], downwards[j - 1], axis):
                best = (*upwards[:i], *reversed(downwards[:j]))
    return best


def _meet(low: Found, high: Found, axis: str) -> bool:
    """Whether no member lies between two groups."""
    ends = low.solution.problem.fleet.parameters[axis].upper, high.solution.problem.fleet.parameters[axis].lower
    return ends[0] >= ends[1]


def _of(fleet: Fleet, group: Found) -> Found:
    """A group of a fleet as it is, without a greater radius."""
    own = group.solution.problem
    if own.fleet.radius == fleet.radius:
        return group
    problem = own.with_(fleet=own.fleet.with_(radius=fleet.radius))
    solution = replace(group.solution, problem=problem, certificate=certify(problem, group.solution.controls))
    return replace(group, solution=solution)
