"""Where every member has to be, and when: what a task certainly requires, for each way of doing it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import count, islice, product
from typing import TYPE_CHECKING

from ensemble_ctrl.constraints.stl import (
    Always,
    And,
    Eventually,
    Formula,
    Inside,
    Or,
    Release,
    Until,
    negation_normal_form,
    resolve,
)
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem

Window = tuple[float, float]

MOST = 64
"""Ways of doing a task that are looked at; with more of them, what they differ in counts as not required."""


@dataclass(frozen=True, eq=False)
class Presence:
    """Every member is in a region throughout ``[t + hold[0], t + hold[1]]``.

    Here t is the sum of some instants that a plan chooses, each for itself within its bounds.

    Attributes
    ----------
    leaf : Inside
    chosen : dict of int to (float, float)
        Bounds of each such instant by its number, seconds; parts of a task that share an instant share its number.
    hold : (float, float)
        Seconds.
    """

    leaf: Inside
    chosen: dict[int, Window]
    hold: Window

    @property
    def latest(self) -> float:
        """When members have to be there at last, seconds."""
        return sum(high for _, high in self.chosen.values()) + self.hold[0]

    def longest_gap(self, other: Presence) -> float:
        """Seconds that lie between being in both regions at most; 0 where they have to be in both at one time."""
        # d = t - t' in [low, high]: instants that both share cancel
        own = [window for k, window in self.chosen.items() if k not in other.chosen]
        others = [window for k, window in other.chosen.items() if k not in self.chosen]
        low = sum(a for a, _ in own) - sum(b for _, b in others)
        high = sum(b for _, b in own) - sum(a for a, _ in others)
        # the gap between the intervals t + hold and t' + hold', largest at an end of d's range
        after, before = high + self.hold[0] - other.hold[1], other.hold[0] - self.hold[1] - low
        return max(0.0, after, before)


def alternatives(problem: Problem) -> list[list[Presence]]:
    """What has to hold of where members are, one list for each way of doing the task; any plan does one of them.

    Notes
    -----
    *Guarantee*: nothing is in a list that a plan of this kind may do without. Parts of the task about a share of the
    fleet, its mean, or anything but regions are left out.
    """
    try:
        task = negation_normal_form(resolve(problem.task, problem.duration))
    except ProblemError:  # a window that runs backwards has a finding of its own
        return [[]]
    return _Reader(problem.duration, count()).read(task, {}, (0.0, 0.0))


@dataclass(frozen=True, eq=False)
class _Reader:
    """Reads presences off a formula in negation normal form."""

    duration: float
    numbers: Iterator[int]

    def read(self, formula: Formula, chosen: dict[int, Window], hold: Window) -> list[list[Presence]]:
        """Those of a formula that holds throughout ``t + hold``."""
        match formula:
            case Inside():
                return [[Presence(formula, chosen, hold)]]
            case And():
                return _together(self.read(part, chosen, hold) for part in formula.parts)
            case Or():
                return _together(self._either(formula, chosen, at) for at in sorted({*hold}))
            case Always(child=child, a=a, b=b):
                return self.read(child, chosen, self._held(child, chosen, hold, a or 0.0, b))
            case Eventually(child=child, a=a, b=b):
                return _together(self._once(child, chosen, at, a or 0.0, b) for at in sorted({*hold}))
            case Until(left=left, right=right, a=a, b=b):
                # the left side holds from now until the right side does, not before a
                first = self.read(left, chosen, (hold[0], hold[1] + (a or 0.0)))
                return _together([first, *(self._once(right, chosen, at, a or 0.0, b) for at in sorted({*hold}))])
        return [[]]

    def _held(self, child: Formula, chosen: dict[int, Window], hold: Window, a: float, b: float | None) -> Window:
        """The window in which the operand of an always holds; its begin alone where its end is not known."""
        if b is not None:
            return hold[0] + a, hold[1] + b
        # without a window: as long as the operand ends within the horizon
        known = not chosen and not _is_temporal(child)
        return (hold[0], max(hold[0], self.duration)) if known else hold

    def _once(
        self, child: Formula, chosen: dict[int, Window], at: float, a: float, b: float | None
    ) -> list[list[Presence]]:
        """A formula that holds at an instant of the plan's choice."""
        window = at + a, self.duration if b is None else at + b
        return self.read(child, {**chosen, next(self.numbers): window}, (0.0, 0.0))

    def _either(self, formula: Or, chosen: dict[int, Window], at: float) -> list[list[Presence]]:
        """The ways of each operand at an instant."""
        found = [way for part in formula.parts for way in self.read(part, chosen, (at, at))]
        return found if len(found) <= MOST else [[]]


def _is_temporal(formula: Formula) -> bool:
    """Whether there is a temporal operator in a formula."""
    return isinstance(formula, Always | Eventually | Until | Release) or any(map(_is_temporal, formula.parts))


def _together(parts: Iterable[list[list[Presence]]]) -> list[list[Presence]]:
    """Every combination of the ways of some parts, as long as there are few; the others are left out."""
    ways: list[list[Presence]] = [[]]
    for part in parts:
        if len(ways) * len(part) <= MOST:
            ways = [[*way, *more] for way, more in islice(product(ways, part), MOST)]
    return ways


__all__ = ["Presence", "alternatives"]
