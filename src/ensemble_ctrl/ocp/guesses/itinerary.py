r"""A task laid out in time: which place to be at when, as a small integer program.

Repeated and conditional visits have no order that could be read off the formula. Here the robot is a point that stays
at places, or travels between two of them in a known time, on a coarse grid of times :math:`k = 0 \dots K`:

.. math:: \min \sum_a c_a y_a \quad \text{with} \quad
    \sum_{a \text{ ends at } (p, k)} y_a = \sum_{a \text{ begins at } (p, k)} y_a, \qquad z_\varphi(0) = 1.

:math:`y_a \in \{0, 1\}` says whether a stay or a journey is made; what holds of the place at a time is linear in these.
The truth :math:`z_\varphi(k) \in [0, 1]` of a formula is bounded by those of its parts, as for mixed-integer STL (Raman
et al., CDC 2014), with disjunctions by sums. Solved by HiGHS through SciPy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import Always, And, Eventually, Formula, Known, Mean, Or, Release, Share, Until
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.quiet import quietly

Floats = NDArray[np.float64]
Holds = Callable[[Formula, Floats], NDArray[np.bool_]]

GAP = 0.5
"""Relative gap to the shortest way at which the search may end."""
WAITING = 1e-3
"""Cost of a stay, of that of a journey of the same time: less than nothing is gained by going to and fro."""


LATER = 0.1
"""By how much more a journey costs at the end than at the beginning: what can be done early is."""


@dataclass(frozen=True, eq=False)
class Journey:
    """A way from one place to another.

    Attributes
    ----------
    begin, end : int
        Places.
    steps : int
        Of the coarse grid, at least 1.
    passed : ndarray, shape (steps - 1, 2)
        Where the robot is at the times in between, metres.
    """

    begin: int
    end: int
    steps: int
    passed: Floats


@dataclass(frozen=True)
class Stop:
    """A place with the steps of arrival and departure, and the journey that led there (-1 for the first place)."""

    place: int
    arrive: int
    leave: int
    journey: int


def itinerary(
    task: Formula,
    places: Floats,
    journeys: Sequence[Journey],
    steps: int,
    step: float,
    holds: Holds,
    last: int | None = None,
    seconds: float = 5.0,
) -> list[Stop] | None:
    """The shortest itinerary from the first place that does a task, if one is found.

    Parameters
    ----------
    task : Formula
        In negation normal form, with ``T`` resolved.
    places : ndarray, shape (places, 2)
        Metres.
    journeys : sequence of Journey
    steps : int
        Of the coarse grid.
    step : float
        Seconds.
    holds : callable
        Whether a part of the task without temporal operators holds at places, shape (places, 2).
    last : int, optional
        The place to end at.
    seconds : float
        Limit of the search.

    Returns
    -------
    list of Stop, or None
    """
    model = _Model(places, journeys, steps, step, holds)
    model.at_least(model.truth(task, 0), 1.0)
    chosen = model.solve(last, seconds)
    return None if chosen is None else _stops(chosen)


@dataclass(frozen=True)
class _Arc:
    """A stay of one step (`journey` is -1) or a journey, from a place at a step."""

    begin: int
    end: int
    leave: int
    arrive: int
    journey: int


@dataclass(eq=False)
class _Model:
    """The integer program, row by row."""

    places: Floats
    journeys: Sequence[Journey]
    steps: int
    step: float
    holds: Holds
    arcs: list[_Arc] = field(default_factory=list)
    columns: int = 0
    rows: list[dict[int, float]] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    _known: dict[tuple[Formula, int], int] = field(default_factory=dict)
    _facts: dict[Formula, tuple[NDArray[np.bool_], list[NDArray[np.bool_]]]] = field(default_factory=dict)
    _busy: list[list[int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        n = len(self.places)
        # y_a: a stay of one step at each place, and each journey from each step at which it still fits
        self.arcs = [_Arc(p, p, k, k + 1, -1) for p in range(n) for k in range(self.steps)]
        self.arcs += [
            _Arc(way.begin, way.end, k, k + way.steps, j)
            for j, way in enumerate(self.journeys)
            for k in range(self.steps - way.steps + 1)
        ]
        self.columns = len(self.arcs)
        # arcs under way at each step: those that leave at it or before, and arrive after it
        self._busy = [[] for _ in range(self.steps + 1)]
        for i, arc in enumerate(self.arcs):
            for k in range(arc.leave, arc.arrive):
                self._busy[k].append(i)

    def truth(self, formula: Formula, k: int) -> int:
        """The column of a formula's truth at a step; its rows are added once."""
        if (formula, k) not in self._known:
            column = self._known[formula, k] = self._new()
            self._bound(formula, k, column)
        return self._known[formula, k]

    def at_least(self, column: int, value: float) -> None:
        """A row: a column is at least a value."""
        self._row({column: 1.0}, value)

    def _new(self) -> int:
        self.columns += 1
        return self.columns - 1

    def _row(self, entries: dict[int, float], least: float = 0.0) -> None:
        """``sum of entries >= least``."""
        self.rows.append(entries)
        self.lower.append(least)

    def _below(self, column: int, other: int) -> None:
        """``z <= other``."""
        self._row({other: 1.0, column: -1.0})

    def _below_sum(self, column: int, others: Sequence[int]) -> None:
        """``z <= sum of others``."""
        self._row({**dict.fromkeys(others, 1.0), column: -1.0})

    def _bound(self, formula: Formula, k: int, column: int) -> None:
        """The rows that bound a formula's truth at a step by that of its parts."""
        if _is_static(formula):
            self._bound_fact(formula, k, column)
            return
        match formula:
            case And(children=children):
                for child in children:
                    self._below(column, self.truth(child, k))
            case Or(children=children):
                self._below_sum(column, [self.truth(child, k) for child in children])
            case Mean(child=child) | Share(child=child):
                self._below(column, self.truth(child, k))
            case Eventually(child=child):
                self._below_sum(column, [self.truth(child, j) for j in self._window(formula, k, inwards=True)])
            case Always(child=child) | Release(right=child):
                for j in self._window(formula, k, inwards=False):
                    self._below(column, self.truth(child, j))
            case Until(left=left, right=right):
                self._bound_until(left, right, self._window(formula, k, inwards=True), k, column)

    def _bound_until(self, left: Formula, right: Formula, window: Sequence[int], k: int, column: int) -> None:
        """``z <= sum of w_j``, where ``w_j`` is at most the right side at j, and the left side from k to j."""
        ends, held = [], None
        # held_j <= left_j and held_j <= held_(j-1); w_j <= held_j and w_j <= right_j
        for j in range(k, window[-1] + 1 if window else k):
            so_far = self._new()
            self._below(so_far, self.truth(left, j))
            if held is not None:
                self._below(so_far, held)
            held = so_far
            if j in window:
                ends.append(self._new())
                self._below(ends[-1], held)
                self._below(ends[-1], self.truth(right, j))
        self._below_sum(column, ends)

    def _bound_fact(self, formula: Formula, k: int, column: int) -> None:
        """What has no temporal operator: ``z <= sum of y`` over what is under way where it holds."""
        if isinstance(formula, Known):
            self._row({column: -1.0}, -float(formula.value >= 0))
            return
        if formula not in self._facts:
            passing = [
                self.holds(formula, way.passed) if len(way.passed) else np.zeros(0, bool) for way in self.journeys
            ]
            self._facts[formula] = self.holds(formula, self.places), passing
        at_places, passing = self._facts[formula]
        good = []
        # at the last step everything has arrived: what counts is where the last arcs end
        for i in self._busy[k] if k < self.steps else self._busy[k - 1]:
            arc = self.arcs[i]
            if k == self.steps:
                fine = bool(at_places[arc.end]) if arc.arrive == k else False
            elif k == arc.leave:
                fine = bool(at_places[arc.begin])
            else:
                fine = bool(passing[arc.journey][k - arc.leave - 1])
            if fine:
                good.append(i)
        self._below_sum(column, good)

    def _window(self, formula: Eventually | Always | Until | Release, k: int, *, inwards: bool) -> range:
        """The steps of a window from k on, rounded to fewer or to more of them; never none."""
        if formula.a is None or formula.b is None:
            return range(k, self.steps + 1)
        # an existential window shrinks to grid times, a universal one grows
        a, b = formula.a / self.step, formula.b / self.step
        first, last = (math.ceil(a - 1e-9), math.floor(b + 1e-9)) if inwards else (math.floor(a), math.ceil(b))
        if first > last:
            first = last = round((a + b) / 2)
        return range(min(k + first, self.steps), min(k + last, self.steps) + 1)

    def solve(self, last: int | None, seconds: float) -> list[_Arc] | None:
        """The arcs of the shortest way, in time."""
        from scipy.optimize import Bounds, LinearConstraint, milp
        from scipy.sparse import coo_array

        self._flow(last)
        count = len(self.arcs)
        cost, whole = np.zeros(self.columns), np.zeros(self.columns, np.uint8)
        for i, arc in enumerate(self.arcs):
            # c_a: steps of a journey, a little more the later it is; WAITING of that for a stay
            cost[i] = (arc.arrive - arc.leave) * (WAITING if arc.journey < 0 else 1.0 + LATER * arc.leave / self.steps)
        whole[:count] = 1
        # rows of z >= and flow as one sparse matrix: A y >= lower, 0 <= y <= 1
        entries = [(r, c, v) for r, row in enumerate(self.rows) for c, v in row.items()]
        r, c, v = zip(*entries, strict=True)
        matrix = coo_array((v, (r, c)), shape=(len(self.rows), self.columns)).tocsr()
        with quietly():
            found = milp(
                cost,
                integrality=whole,
                bounds=Bounds(0, 1),
                constraints=LinearConstraint(matrix, np.array(self.lower), np.inf),
                options={"time_limit": seconds, "mip_rel_gap": GAP},
            )
        if found.x is None:
            return None
        # y_a = 1 up to the solver's tolerance
        taken = [arc for arc, y in zip(self.arcs, found.x[:count], strict=True) if y > 0.5]
        return sorted(taken, key=lambda arc: arc.leave)

    def _flow(self, last: int | None) -> None:
        """The robot begins at the first place and leaves every place where and when it comes there."""
        balance: dict[tuple[int, int], dict[int, float]] = {}
        for i, arc in enumerate(self.arcs):
            balance.setdefault((arc.end, arc.arrive), {})[i] = 1.0
            balance.setdefault((arc.begin, arc.leave), {})[i] = -1.0
        for (place, k), entries in balance.items():
            if k == self.steps:
                if last is not None and place != last:
                    self._row({i: -v for i, v in entries.items()})
                continue
            # arrivals - departures = 0 at every place and step, -1 where the robot begins
            known = -1.0 if (place, k) == (0, 0) else 0.0
            self._row(entries, known)
            self._row({i: -v for i, v in entries.items()}, -known)


def _is_static(formula: Formula) -> bool:
    """Whether a formula has no temporal operator, and speaks of one member."""
    if isinstance(formula, Eventually | Always | Until | Release | Mean | Share):
        return False
    return all(map(_is_static, formula.parts))


def _stops(arcs: Sequence[_Arc]) -> list[Stop]:
    """Stays joined."""
    found = [Stop(arcs[0].begin, 0, 0, -1)]
    for arc in arcs:
        before = found[-1]
        if arc.journey < 0:
            found[-1] = Stop(before.place, before.arrive, arc.arrive, before.journey)
        else:
            found.append(Stop(arc.end, arc.arrive, arc.arrive, arc.journey))
    return found


__all__ = ["Journey", "Stop", "itinerary"]
