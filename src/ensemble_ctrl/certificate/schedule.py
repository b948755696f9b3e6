r"""A formula over bounds that are constant on pieces of time, evaluated exactly.

The bound of a predicate is a *step function*: one number for each of the instants ``t_0 < t_1 < .. < t_n`` and one for
each open interval between them, in turn: its *elements*.  The operators turn step functions into step functions.  With
``[a, b]`` the window, what ``[t + a, t + b]`` meets of a step function changes only at the instants ``t_i - a`` and
``t_i - b``; between two of these the first and the last element that it meets stay the same.  So ``F`` is the largest
and ``G`` the smallest of a range of elements, and

.. math:: f\, U_{[a,b]}\, g = G_{[0,a]} f \wedge F_{[a,b]} g \wedge F_{[a,a]} (f\, U g)

(Donze, Ferrere and Maler, 2013), where the untimed until is one pass from the end.  Instants are whole numbers of a
*tick* that divides all windows and the steps, so nothing is rounded and no window is moved to a grid.

Step functions with more instants than `MOST` lose some: an interval then has the smallest number of those that it
replaces, or the largest for upper bounds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from math import lcm
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.instants import Mesh
from ensemble_ctrl.constraints.stl.formula import Always, And, Eventually, Formula, Mean, Or, Release, Share, Until
from ensemble_ctrl.constraints.stl.leaves import Known, Predicate
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import exact

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Ticks = NDArray[Any]
"""Instants: whole numbers, of 64 bits where these do, else of Python."""
Temporal = Eventually | Always | Until | Release

MOST = 20_000
"""Instants of one step function beyond which some are dropped."""
OVERRUN = Fraction(1, 10**9)
"""Seconds after the end that a formula may speak of, for sums of windows that were rounded; robots stand there."""


class Bounds(Protocol):
    """Bounds of predicates over the elements of a mesh."""

    @property
    def members(self) -> int:
        """How many rows."""

    @property
    def upper(self) -> bool:
        """Whether bounds are upper bounds."""

    def leaf(self, predicate: Predicate, first: int, last: int) -> Floats:
        """Bounds of a predicate on the elements first..last, shape (members, last - first + 1)."""

    def mean(self) -> Bounds:
        """The same for the mean member."""

    def ranked(self, value: Floats, share: Share) -> Floats:
        """For each element the value that a share of the members reaches, shape (1, elements)."""


@dataclass(frozen=True, eq=False)
class Node(ABC):
    """A part of a formula over the instants at which it is needed."""

    times: Ticks

    @abstractmethod
    def value(self, bounds: Bounds) -> Floats:
        """The step function, shape (members, 2 instants - 1)."""


@dataclass(frozen=True, eq=False)
class Leaf(Node):
    """A predicate."""

    predicate: Predicate
    first: int

    def value(self, bounds: Bounds) -> Floats:
        """Elements of the mesh."""
        return bounds.leaf(self.predicate, self.first, self.first + 2 * len(self.times) - 2)


@dataclass(frozen=True, eq=False)
class Constant(Node):
    """A number that is known."""

    number: float

    def value(self, bounds: Bounds) -> Floats:
        """The number for all."""
        return np.full((bounds.members, 2 * len(self.times) - 1), self.number)


@dataclass(frozen=True, eq=False)
class Joined(Node):
    """The smallest or the largest of several."""

    parts: Sequence[Node]
    pick: np.ufunc

    def value(self, bounds: Bounds) -> Floats:
        """Instant by instant."""
        return np.asarray(reduce(self.pick, (_resampled(part, bounds, self.times) for part in self.parts)))


@dataclass(frozen=True, eq=False)
class Window(Node):
    """The smallest or the largest of a child's elements first..last."""

    child: Node
    pick: np.ufunc
    first: Ints
    last: Ints

    def value(self, bounds: Bounds) -> Floats:
        """Range by range."""
        return extremes(self.child.value(bounds), self.first, self.last, self.pick)


@dataclass(frozen=True, eq=False)
class UntimedUntil(Node):
    """``left U right`` to the end of both, which have the same instants."""

    left: Node
    right: Node
    dual: bool

    def value(self, bounds: Bounds) -> Floats:
        """One pass from the end; the dual with smallest and largest exchanged."""
        hold, reach = (np.maximum, np.minimum) if self.dual else (np.minimum, np.maximum)
        # r_k = min(l_k, max(g_k, r_{k+1})), backwards from r_last = min(l, g)
        held, goal = (np.ascontiguousarray(_resampled(p, bounds, self.times).T) for p in (self.left, self.right))
        result = hold(held, goal)
        for k in range(len(result) - 2, -1, -1):
            hold(held[k], reach(goal[k], result[k + 1]), out=result[k])
        return np.asarray(result.T)


@dataclass(frozen=True, eq=False)
class MeanNode(Node):
    """A part of the mean member."""

    child: Node

    def value(self, bounds: Bounds) -> Floats:
        """The same for all."""
        return np.repeat(self.child.value(bounds.mean()), bounds.members, axis=0)


@dataclass(frozen=True, eq=False)
class ShareNode(Node):
    """A part that a share of the members reaches."""

    child: Node
    share: Share

    def value(self, bounds: Bounds) -> Floats:
        """The same for all."""
        return np.repeat(bounds.ranked(self.child.value(bounds), self.share), bounds.members, axis=0)


@dataclass(frozen=True, eq=False)
class Coarse(Node):
    """A child on some of its instants."""

    child: Node

    def value(self, bounds: Bounds) -> Floats:
        """The number of an interval bounds all that it replaces."""
        # elements between two kept instants become one: their least value, or their largest for upper bounds
        place = 2 * np.searchsorted(self.child.times, self.times)
        starts = np.ravel(np.column_stack([place, place + 1]))[:-1]
        pick = np.maximum if bounds.upper else np.minimum
        return np.asarray(pick.reduceat(self.child.value(bounds), starts, axis=1))


@dataclass(frozen=True, eq=False)
class Schedule:
    """A formula at time 0, ready for bounds over a mesh.

    Attributes
    ----------
    root : Node
    mesh : Mesh
    """

    root: Node
    mesh: Mesh

    @classmethod
    def of(cls, formula: Formula, duration: float, parts: Ints) -> Schedule | None:
        """The schedule of a formula in negation normal form, ``T`` resolved.

        Parameters
        ----------
        formula : Formula
            With predicates as its leaves.
        duration : float
            Seconds.
        parts : ndarray of int, shape (steps,)
            Into how many pieces each step is cut where the formula looks.

        Returns
        -------
        Schedule or None
            None if the formula looks past the end.
        """
        steps = len(parts)
        if horizon(formula) > exact(duration) + OVERRUN:
            return None
        # one tick divides the steps, their parts and every window's end: all instants are whole numbers
        per_step = lcm(*(int(n) for n in set(parts.tolist())))
        step = exact(duration) / steps
        unit = Fraction(1, lcm(*(Fraction(time / step).denominator for time in (*_windows(formula), step)), per_step))
        clock = _Clock(unit * step, steps, int(1 / unit))
        spans = list(clock.looks(formula, 0, 0))
        low, high = min(a for a, _ in spans), max(b for _, b in spans)
        inside = range(low // clock.per_step, min(-(-high // clock.per_step), steps))
        # the mesh: grid times, ends of windows, and the parts of steps that the formula needs
        cuts = {k * clock.per_step for k in range(steps + 1)} | {time for span in spans for time in span}
        for k in inside:
            each = clock.per_step // int(parts[k])
            cuts.update(range(k * clock.per_step, (k + 1) * clock.per_step, each))
        times = sorted(cuts)
        root = clock.node(formula, 0, 0, _ticks(times))
        return cls(root, Mesh.of(duration, steps, times, clock.per_step))

    def value(self, bounds: Bounds) -> Floats:
        """Bounds of the formula at time 0, shape (members,)."""
        return self.root.value(bounds)[:, 0]


@dataclass(frozen=True)
class _Clock:
    """Time in ticks: `tick` in seconds, `per_step` of them in each of `steps` steps."""

    tick: Fraction
    steps: int
    per_step: int

    def window(self, formula: Temporal, low: int, high: int) -> tuple[int, int, int]:
        """A window's ends in ticks, and where what it looks at ends for instants low..high.

        Without a window, an operator looks to the last time at which its parts still fit.
        """
        if formula.a is None or formula.b is None:
            below = max(int(horizon(part) / self.tick) for part in formula.parts)
            return 0, -1, max(self.steps * self.per_step - below, high)
        a, b = (int(exact(end) / self.tick) for end in (formula.a, formula.b))
        return a, b, high + b

    def looks(self, formula: Formula, low: int, high: int) -> Iterator[tuple[int, int]]:
        """From when to when each leaf is looked at."""
        if not formula.parts:
            yield low, high
        if isinstance(formula, Temporal):
            a, _, end = self.window(formula, low, high)
            *held, last = formula.parts
            yield from self.looks(last, low + a, end)
            low, high, parts = low, end, held
        else:
            parts = list(formula.parts)
        for part in parts:
            yield from self.looks(part, low, high)

    def node(self, formula: Formula, low: int, high: int, mesh: Ticks) -> Node:
        """A formula for the instants low..high; with not too many of them."""
        found = self._node(formula, low, high, mesh)
        if len(found.times) <= MOST:
            return found
        kept = np.linspace(0, len(found.times) - 1, MOST).astype(np.int64)
        return Coarse(found.times[kept], found)

    def _node(self, formula: Formula, low: int, high: int, mesh: Ticks) -> Node:
        """A formula for the instants low..high."""
        match formula:
            case Predicate():
                first, last = np.searchsorted(mesh, low), np.searchsorted(mesh, high)
                return Leaf(mesh[first : last + 1], formula, 2 * int(first))
            case Known(value=value):
                return Constant(_ticks(sorted({low, high})), value)
            case And() | Or():
                parts = [self.node(part, low, high, mesh) for part in formula.parts]
                return Joined(_union(*(p.times for p in parts)), parts, _picked(formula))
            case Mean(child=child):
                inner = self.node(child, low, high, mesh)
                return MeanNode(inner.times, inner)
            case Share(child=child):
                inner = self.node(child, low, high, mesh)
                return ShareNode(inner.times, inner, formula)
            case Eventually() | Always():
                a, b, end = self.window(formula, low, high)
                inner = self.node(formula.child, low + a, end, mesh)
                return _window(inner, a, b, low, high, _picked(formula))
            case Until() | Release():
                return self._until(formula, low, high, mesh)
        raise ProblemError(f"formula: expected predicates as its leaves, got {formula}; use ground(formula, ...)")

    def _until(self, formula: Until | Release, low: int, high: int, mesh: Ticks) -> Node:
        """Until or its dual, by the identity on top of this file."""
        a, b, end = self.window(formula, low, high)
        left = self.node(formula.left, low, end, mesh)
        right = self.node(formula.right, low + a, end, mesh)
        dual = isinstance(formula, Release)
        hold, reach = (np.maximum, np.minimum) if dual else (np.minimum, np.maximum)
        # left U[a,b] right = G[0,a] left and F[a,b] right and F[a,a] (left U right)
        later = _within(_union(left.times, right.times), low + a, end)
        untimed = UntimedUntil(later, left, right, dual)
        if b < 0:
            return _window(untimed, 0, 0, low, high, hold)
        parts = [
            _window(left, 0, a, low, high, hold),
            _window(right, a, b, low, high, reach),
            _window(untimed, a, a, low, high, hold),
        ]
        return Joined(_union(*(part.times for part in parts)), parts, hold)


def horizon(formula: Formula) -> Fraction:
    """How many seconds after its time of evaluation a formula looks, exactly."""
    below = max(map(horizon, formula.parts), default=Fraction(0))
    return below + exact(formula.b) if isinstance(formula, Temporal) and formula.b is not None else below


def at(times: Ticks, instants: Ticks) -> Ints:
    """The elements of a step function over `times` at some instants and between them, shape (2 instants - 1,)."""
    # element 2 k is instant k, element 2 k + 1 the interval after it
    place = np.searchsorted(times, instants, side="right") - 1
    points = 2 * place + (times[place] != instants)
    return np.ravel(np.column_stack([points, points | 1]))[:-1]


def extremes(value: Floats, first: Ints, last: Ints, pick: np.ufunc) -> Floats:
    """`pick` over the columns first..last of a matrix, shape (rows, ranges), by ranges of powers of two."""
    if len(first) == 1:
        return np.asarray(pick.reduce(value[:, first[0] : last[0] + 1], axis=1, keepdims=True))
    # sparse table: a range is the union of two of length 2^k (Bender and Farach-Colton 2000)
    level = np.frexp(last - first + 1)[1] - 1
    out = np.empty((len(value), len(first)))
    for k in range(int(level.max()) + 1):
        some = np.flatnonzero(level == k)
        out[:, some] = pick(value[:, first[some]], value[:, last[some] + 1 - 2**k])
        if k < level.max():
            value = pick(value[:, : -(2**k)], value[:, 2**k :])
    return out


def _resampled(part: Node, bounds: Bounds, instants: Ticks) -> Floats:
    """A part's step function over other instants, which are within its own."""
    value = part.value(bounds)
    return value if np.array_equal(part.times, instants) else value[:, at(part.times, instants)]


def _window(child: Node, a: int, b: int, low: int, high: int, pick: np.ufunc) -> Node:
    """`pick` of a child over ``[t + a, t + b]``, to the child's end for negative `b`, for t from low to high."""
    # a sliding extremum changes only where an end of [t + a, t + b] meets an instant of the child
    changes = [child.times - a] if b < 0 else [child.times - a, child.times - b]
    times = _within(_union(*changes), low, high)
    first = at(child.times, times + a)
    last = at(child.times, times + b) if b >= 0 else np.full(len(first), 2 * len(child.times) - 2)
    return Window(times, child, pick, first, last)


def _picked(formula: Formula) -> np.ufunc:
    """Smallest for what has to hold for all, largest for what has to hold for one."""
    return np.minimum if isinstance(formula, And | Always) else np.maximum


def _windows(formula: Formula) -> Iterator[Fraction]:
    """Ends of every window, seconds."""
    if isinstance(formula, Temporal) and formula.a is not None and formula.b is not None:
        yield from (exact(formula.a), exact(formula.b))
    for part in formula.parts:
        yield from _windows(part)


def _ticks(times: Sequence[int]) -> Ticks:
    """Instants as an array that holds them, and their sums with windows, exactly."""
    return np.array(times, dtype=np.int64 if max(times) < 2**60 else object)


def _union(*times: Ticks) -> Ticks:
    """All instants in order, each once."""
    return np.unique(np.concatenate(times)) if len(times) > 1 else times[0]


def _within(times: Ticks, low: int, high: int) -> Ticks:
    """Instants from low to high, with both."""
    ends = np.array(sorted({low, high}), dtype=times.dtype)
    return _union(ends, times[(times > low) & (times < high)])
