"""The discrete choices that a task offers: which regions to visit, in what order, through which doors.

A *skeleton* is one way of doing the task: visits with their windows, an order among them, doors that stay closed until
a visit, and a corridor to stay in.  ``or`` gives alternatives, ``and`` combines, ``F`` and ``G`` shift windows.
Skeletons only make first guesses; whatever they miss, the program still holds the whole formula.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import field, replace
from itertools import islice, permutations, product

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.constraints.stl import (
    Always,
    And,
    Avoid,
    Eventually,
    Formula,
    Inside,
    Mean,
    Not,
    Or,
    Share,
    Until,
    conjuncts,
)
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.specification import avoided

Floats = NDArray[np.float64]

MOST = 200
"""Largest number of skeletons, and of orders of one skeleton, that are considered."""


@dataclass(frozen=True, eq=False)
class Visit:
    """Be in a region at some time of a window (seconds), for `dwell` seconds from then."""

    name: str
    region: Polyhedron
    early: float
    late: float
    dwell: float = 0.0


@dataclass(frozen=True)
class Door:
    """A region or obstacle, by name, that is closed until a visit, by its place in the skeleton."""

    name: str
    until: int


@dataclass(frozen=True, eq=False)
class Skeleton:
    """One way of doing the task.

    Attributes
    ----------
    visits : tuple of Visit
        In no order but that of `order`.
    order : tuple of (int, int)
        The first visit comes before the second.
    doors : tuple of Door
        What is closed until when.
    corridor : tuple of str
        Regions of which one must always be occupied; empty if none must.
    """

    visits: tuple[Visit, ...] = ()
    order: tuple[tuple[int, int], ...] = ()
    doors: tuple[Door, ...] = ()
    corridor: tuple[str, ...] = ()

    def joined(self, other: Skeleton) -> Skeleton:
        """Both ways together."""
        n = len(self.visits)
        return Skeleton(
            self.visits + other.visits,
            self.order + tuple((i + n, j + n) for i, j in other.order),
            self.doors + tuple(replace(door, until=door.until + n) for door in other.doors),
            self.corridor or other.corridor,
        )

    def orders(self) -> Iterator[tuple[int, ...]]:
        """Orders of the visits that respect `order` and the windows; at most `MOST`."""
        before = {(j, i) for i, j in self.order}

        def allowed(order: tuple[int, ...]) -> bool:
            # every pair in its order: no visit before one that must precede it, none too late
            pairs = [(a, b) for k, a in enumerate(order) for b in order[k + 1 :]]
            return not any(pair in before or self._too_late(*pair) for pair in pairs)

        indices = range(len(self.visits))
        if len(self.visits) > 6:
            return iter([tuple(sorted(indices, key=lambda i: (self.visits[i].late, self.visits[i].early)))])
        return islice((order for order in permutations(indices) if allowed(order)), MOST)

    def _too_late(self, first: int, second: int) -> bool:
        """Whether the first visit can't come before the second one's window closes."""
        return self.visits[first].early + self.visits[first].dwell > self.visits[second].late


@dataclass(frozen=True)
class _Reader:
    """Reads skeletons off a formula."""

    problem: Problem
    none: tuple[Skeleton, ...] = field(default=(Skeleton(),))

    def read(self, formula: Formula, early: float, late: float) -> list[Skeleton]:
        """The skeletons of a formula that is evaluated at some time within [early, late]."""
        match formula:
            case Inside(name=name):
                return [Skeleton((Visit(name, self.problem.regions[name], early, late),))]
            case And(children=children):
                return self._all(children, early, late)
            case Or(children=children):
                return [s for child in children for s in self.read(child, early, late)][:MOST]
            case Eventually(child=child):
                a, b = self._window(formula)
                return [_nested(s, child) for s in self.read(child, early + a, late + b)]
            case Always():
                return self._always(formula, early, late)
            case Until(left=left, right=right):
                a, b = self._window(formula)
                # doors close until the first visit of the right side
                found = self.read(right, early + a, late + b)
                return [replace(s, doors=s.doors + self._doors(left)) if s.visits else s for s in found]
            case Mean(child=child) | Share(child=child):
                return self.read(child, early, late)
        return [*self.none]

    def _all(self, children: Iterable[Formula], early: float, late: float) -> list[Skeleton]:
        """Every combination of the children's ways."""
        ways = [self.read(child, early, late) for child in children]
        combined = []
        for combination in islice(product(*ways), MOST):
            whole = Skeleton()
            for way in combination:
                whole = whole.joined(way)
            combined.append(whole)
        return combined

    def _always(self, formula: Always, early: float, late: float) -> list[Skeleton]:
        """A stay: a dwelling visit, or from the start a corridor."""
        a, b = self._window(formula)
        names = _stays(formula.child)
        if not names:
            return [*self.none]
        if early + a <= 0 and late <= 0:
            return [Skeleton(corridor=names)]
        stays = [Visit(name, self.problem.regions[name], early + a, late + a, b - a) for name in names]
        return [Skeleton((stay,)) for stay in stays]

    def _doors(self, left: Formula) -> tuple[Door, ...]:
        """What the left side of an until keeps closed until the first visit of its right side."""
        parts = conjuncts(left)
        names = [p.child.name for p in parts if isinstance(p, Not) and isinstance(p.child, Inside)]
        names += [name for p in parts if isinstance(p, Avoid) for name in avoided(self.problem, p)]
        return tuple(Door(name, 0) for name in names)

    def _window(self, formula: Always | Eventually | Until) -> tuple[float, float]:
        """The window in seconds; without one, the horizon."""
        a, b = formula.a, formula.b
        return (0.0, self.problem.duration) if a is None or b is None else (a, b)


def skeletons(problem: Problem) -> list[Skeleton]:
    """Every way of doing the problem's task that its operators spell out, at most `MOST`."""
    found = _Reader(problem).read(problem.specification.task, 0.0, 0.0)
    return [_within(s, problem.duration) for s in found] or [Skeleton()]


def _within(skeleton: Skeleton, duration: float) -> Skeleton:
    """The same with every window inside the horizon."""
    visits = tuple(replace(v, late=min(v.late, duration - v.dwell)) for v in skeleton.visits)
    return replace(skeleton, visits=visits)


def _nested(skeleton: Skeleton, child: Formula) -> Skeleton:
    """Under ``F (in(a) and F in(b))``, a comes before b."""
    if not isinstance(child, And):
        return skeleton
    first = {part.name for part in child.children if isinstance(part, Inside)}
    here = [i for i, v in enumerate(skeleton.visits) if v.name in first and v.dwell == 0]
    there = [i for i in range(len(skeleton.visits)) if i not in here]
    return replace(skeleton, order=skeleton.order + tuple(product(here, there)))


def _stays(child: Formula) -> tuple[str, ...]:
    """The regions of ``in(a)`` or of ``in(a) or in(b) or ...``."""
    parts = child.children if isinstance(child, Or) else (child,)
    return tuple(p.name for p in parts if isinstance(p, Inside)) if all(isinstance(p, Inside) for p in parts) else ()
