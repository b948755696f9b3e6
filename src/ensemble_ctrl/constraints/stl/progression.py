"""What is left to do of a formula once the first part of a signal is known.

*Progression* rewrites a formula step by step: what the present decides becomes a number (`Known`), what it does not
decide waits with its window moved by one step::

    F[a,b] f  ->  F[a-1,b-1] f                              while a > 0
              ->  now(f) or F[0,b-1] f                      at a = 0, without the second part at b = 0
    G[a,b] f      the same with `and`
    f U[a,b] g  ->  now(f) and f U[a-1,b-1] g
                ->  now(f) and (now(g) or f U[0,b-1] g)     at a = 0

*Guarantee*: at the grid times the robustness of the progressed formula over the rest of a signal is that of the whole
formula over the whole signal.  Between grid times the past is not evaluated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

from ensemble_ctrl.constraints.stl.formula import Always, And, Eventually, Formula, Mean, Or, Release, Share, Until
from ensemble_ctrl.constraints.stl.leaves import Known
from ensemble_ctrl.constraints.stl.rewrite import negation_normal_form, resolve
from ensemble_ctrl.constraints.stl.robustness import Temporal, reach
from ensemble_ctrl.core.errors import UnsupportedError

Reading = Callable[[Formula, int], float]
"""Robustness of a leaf (a predicate, or a named place or its negation) at a grid time of the past."""
NEAR = 1e-9
"""Share of a step by which a window's end may miss a grid time: both are rounded, of a time of thousands of steps too.

That is a reading of what was meant, in no direction.  A claim rests on windows that were moved to the grid exactly and
so that nothing rises (`ensemble_ctrl.planning.online.remaining.gridded`): of these, this only undoes the rounding.
"""


def progressed(formula: Formula, reading: Reading, past: int, horizon: int, step: float) -> Formula:
    """The formula that the rest of a signal has to satisfy.

    Parameters
    ----------
    formula : Formula
        Read at grid time 0.
    reading : callable
        ``reading(leaf, k)`` for the grid times ``0 .. past - 1``, metres for places. A lower bound of the truth gives
        a progressed formula whose robustness is a lower bound, since leaves never stand under a negation here.
    past : int
        How many grid times are known; up to ``horizon + 1``, when nothing is left.
    horizon : int
        Steps of the whole signal.
    step : float
        Seconds.

    Returns
    -------
    Formula
        In negation normal form, to be read at grid time `past`; a `Known` where nothing is left to do.

    Raises
    ------
    UnsupportedError
        For ``mean`` and ``share``, which the past of one robot does not determine.

    Notes
    -----
    F. Bacchus and F. Kabanza, Planning for temporally extended goals, 1998, with numbers in place of truth values.

    Examples
    --------
    A visit that has been made stays made, and a deadline comes closer:

    >>> from ensemble_ctrl.constraints.stl import parse
    >>> task = parse("F[0, 4] x >= 1 and F[2, 4] x <= 0")
    >>> seen = [0.0, 1.5]
    >>> str(settled(progressed(task, lambda p, k: p.coefficients[0][1] * seen[k] + p.offset, 2, 4, 1.0)))
    'F[0,2] -x >= 0'
    """
    left = negation_normal_form(resolve(formula, horizon * step))
    # f, then what is left of it after each grid time of the past
    for k in range(past):
        left = _Step(reading, k, horizon, step).of(left)
    return left


def settled(formula: Formula) -> Formula:
    """A progressed formula without what has been decided: what was satisfied stays so, and is not evaluated again.

    Notes
    -----
    *Guarantee*: satisfied (robustness at or above 0) exactly where `formula` is.
    """
    if not isinstance(formula, And | Or):
        return formula
    parts = [settled(part) for part in formula.parts]
    known = [part for part in parts if isinstance(part, Known)]
    for part in known:
        if (part.value < 0) == isinstance(formula, And):
            return part
    return _joined(type(formula), [part for part in parts if not isinstance(part, Known)] or known)


class _Step:
    """One grid time becomes past."""

    def __init__(self, reading: Reading, now: int, horizon: int, step: float) -> None:
        self.reading, self.now, self.horizon, self.step = reading, now, horizon, step

    def of(self, formula: Formula) -> Formula:
        """What is left of a formula that is read now."""
        match formula:
            case Known():
                return formula
            case And() | Or():
                return _joined(type(formula), [self.of(part) for part in formula.parts])
            case Mean() | Share():
                raise UnsupportedError(f"task: the past of one robot does not tell {formula}")
            case Eventually(child=child):
                return self._due(Or, formula, child)
            case Always(child=child):
                return self._due(And, formula, child)
            case Until():
                return self._held(And, Or, formula)
            case Release():
                return self._held(Or, And, formula)
        return Known(self.reading(formula, self.now))

    def _due(self, kind: type[And | Or], formula: Eventually | Always, child: Formula) -> Formula:
        """``F`` joins by `or`, ``G`` by `and`."""
        # F f = f or next F f, G f = f and next G f, where f counts once the window has begun (Bacchus and Kabanza 1998)
        later = self._later(formula)
        parts = [self.of(child)] if self._begun(formula) else []
        return _joined(kind, parts + ([] if later is None else [later]))

    def _held(self, hold: type[And | Or], reach_: type[And | Or], formula: Until | Release) -> Formula:
        """``left`` is held until ``right`` comes; a release is the same with `and` and `or` exchanged."""
        # f U g = f and (g or next (f U g))
        later = self._later(formula)
        cases = [self.of(formula.right)] if self._begun(formula) else []
        waiting = _joined(reach_, cases + ([] if later is None else [later]))
        return _joined(hold, [self.of(formula.left), waiting])

    def _begun(self, formula: Temporal) -> bool:
        """Whether the window holds the present."""
        return formula.a is None or formula.a <= NEAR * self.step

    def _later(self, formula: Temporal) -> Formula | None:
        """The same operator read at the next grid time; None if its window ends now."""
        if formula.a is None or formula.b is None:
            below = max(reach(part, self.step) for part in formula.parts)
            return formula if self.now < self.horizon - below else None
        if formula.b < self.step * (1 - NEAR):
            return None
        # the window one step nearer, unless no grid time is left in it
        a, b = self._earlier(formula.a), self._earlier(formula.b)
        if math.ceil(a / self.step - NEAR) > math.floor(b / self.step + NEAR):
            return None
        return replace(formula, a=a, b=b)

    def _earlier(self, end: float) -> float:
        """A window's end seen from the next grid time; one that is on the grid stays there, however often it moves."""
        # ends on the grid are kept as whole steps, so that rounding does not add up
        near = round(end / self.step)
        on_grid = abs(end / self.step - near) <= NEAR
        return max((near - 1) * self.step if on_grid else end - self.step, 0.0)


def _joined(kind: type[And | Or], parts: Iterable[Formula]) -> Formula:
    """A conjunction or disjunction, with numbers put together and nothing twice."""
    best = min if kind is And else max
    # numbers fold by min or max, nested operators of the kind are flattened
    flat = [inner for part in parts for inner in (part.parts if isinstance(part, kind) else (part,))]
    values = [part.value for part in flat if isinstance(part, Known)]
    rest = list(dict.fromkeys(part for part in flat if not isinstance(part, Known)))
    joined = ([Known(best(values))] if values else []) + rest
    return joined[0] if len(joined) == 1 else kind(tuple(joined))
