"""One walk over a formula, for any number system.

The walk evaluates only the times that it needs: at time 0, ``F[14,16] f`` on a 0.1 s grid evaluates f at 21
times. Windows on a grid: [a, b] at step k covers the steps ``k + ceil(a/step - 1e-9) .. k + floor(b/step +
1e-9)``.
"""

from __future__ import annotations

import math
from typing import Any

from ensemble_ctrl.constraints.stl.formula import (
    Always,
    And,
    Eventually,
    Formula,
    Mean,
    Or,
    Release,
    Share,
    Until,
)
from ensemble_ctrl.constraints.stl.leaves import Known, Predicate
from ensemble_ctrl.constraints.stl.operations import Ops, Value
from ensemble_ctrl.constraints.stl.rewrite import negation_normal_form, resolve
from ensemble_ctrl.constraints.stl.signals import Signals, StateSignals
from ensemble_ctrl.core.errors import ProblemError

Temporal = Eventually | Always | Until | Release
BLOCK = 32_768
"""Values of a state walked over at once, where members don't depend on each other: arrays of this size stay in the
cache, and the allocator reuses them."""


def robustness(formula: Formula, signals: Signals, ops: Ops, time: int = 0) -> Any:
    """How well the whole fleet satisfies a formula: its worst member's robustness.

    Parameters
    ----------
    formula : Formula
        With predicates as its only leaves (`ground`).
    signals : Signals
        The leaves' values.
    ops : Ops
        `ExactOps` or `SmoothOps`.
    time : int
        Step at which the formula is evaluated.

    Returns
    -------
    scalar
        In the unit of the predicates, metres for places; positive if satisfied, negative if not.

    Raises
    ------
    ProblemError
        If the formula reaches past the last time, or a window holds no time of the grid.

    Notes
    -----
    *Guarantee*: with `SmoothOps` a lower bound of the value with `ExactOps` for the same leaves.
    """
    return ops.worst_member(member_robustness(formula, signals, ops, time, time))[0, 0]


def member_robustness(formula: Formula, signals: Signals, ops: Ops, first: int = 0, last: int = 0) -> Value:
    """Robustness of each member at the steps first..last.

    Parameters
    ----------
    formula, signals, ops
        As for `robustness`.
    first, last : int
        Steps.

    Returns
    -------
    matrix, shape (members, last - first + 1)
        A fleet reading has the same value in every row.
    """
    if not 0 <= first <= last <= signals.steps:
        raise ProblemError(f"time: expected steps within 0..{signals.steps}, got {first}..{last}")
    formula = negation_normal_form(resolve(formula, signals.steps * signals.step))
    end = last + reach(formula, signals.step)
    if end > signals.steps:
        span = f"{signals.steps} steps of {signals.step:g} s"
        raise ProblemError(f"formula: expected windows within {span}, got one that ends at step {end}")
    if not isinstance(signals, StateSignals) or _reads_fleet(formula):
        return _walk(formula, signals, ops, first, last)
    # members do not depend on each other: one block at a time
    values = [_walk(formula, block, ops, first, last) for block in signals.blocks(BLOCK)]
    return values[0] if len(values) == 1 else ops.members(values)


def _reads_fleet(formula: Formula) -> bool:
    """Whether a member's robustness depends on other members."""
    return isinstance(formula, Mean | Share) or any(map(_reads_fleet, formula.parts))


def reach(formula: Formula, step: float) -> int:
    """How many steps after its time of evaluation a formula depends on, with ``T`` resolved."""
    below = max((reach(part, step) for part in formula.parts), default=0)
    if not isinstance(formula, Temporal) or formula.a is None:
        return below
    return below + _window_steps(formula, step)[1]


def _walk(formula: Formula, signals: Signals, ops: Ops, first: int, last: int) -> Value:
    """Values of a formula in negation normal form, shape (members, last - first + 1)."""
    match formula:
        case Predicate():
            return signals.leaf(formula, first, last)
        case Known(value=value):
            return ops.known(value, signals.members, last - first + 1)
        # min over a conjunction, max over a disjunction (Donze and Maler 2010)
        case And(children=children):
            return ops.all_of(_walk(child, signals, ops, first, last) for child in children)
        case Or(children=children):
            return ops.any_of(_walk(child, signals, ops, first, last) for child in children)
        # mean(f): robustness of the mean state, the same for every member
        case Mean(child=child):
            return _repeated(_walk(child, signals.mean(), ops, first, last), signals, ops)
        # share(p, f): the value that a share p of the members reaches
        case Share(child=child):
            value = _walk(child, signals, ops, first, last)
            return _repeated(ops.ranked(value, formula), signals, ops)
        case Eventually() | Always() | Until() | Release():
            if formula.a is None:
                return _open_window(formula, signals, ops, first, last)
            return _window(formula, signals, ops, first, last)
    raise ProblemError(f"formula: expected predicates as its leaves, got {formula}; use ground(formula, ...)")


def _window(formula: Temporal, signals: Signals, ops: Ops, first: int, last: int) -> Value:
    """A temporal operator with a window."""
    low, high = _window_steps(formula, signals.step)
    # operands at every step of [t + low, t + high] for t = first .. last
    right = _walk(formula.parts[-1], signals, ops, first + low, last + high)
    match formula:
        case Eventually():
            return ops.eventually(right, high - low + 1, last - first + 1)
        case Always():
            return ops.always(right, high - low + 1, last - first + 1)
    left = _walk(formula.left, signals, ops, first, last + high)
    operator = ops.until if isinstance(formula, Until) else ops.release
    return operator(left, right, low, high)


def _open_window(formula: Temporal, signals: Signals, ops: Ops, first: int, last: int) -> Value:
    """A temporal operator up to the last time at which its operands still fit in the horizon."""
    # without a window: up to the last step at which the operands still end within the horizon
    end = signals.steps - max(reach(part, signals.step) for part in formula.parts)
    count = last - first + 1
    right = _walk(formula.parts[-1], signals, ops, first, end)
    match formula:
        case Eventually():
            return ops.eventually(right, 0, count)
        case Always():
            return ops.always(right, 0, count)
    left = _walk(formula.left, signals, ops, first, end)
    operator = ops.until_end if isinstance(formula, Until) else ops.release_end
    return operator(left, right, count)


def fits_grid(formula: Formula, step: float) -> bool:
    """Whether every window of a formula, with ``T`` resolved, holds a time of a grid."""
    if isinstance(formula, Temporal) and formula.b is not None:
        low, high = _grid_ends(formula, step)
        if low > high:
            return False
    return all(fits_grid(part, step) for part in formula.parts)


def _grid_ends(formula: Temporal, step: float) -> tuple[int, int]:
    """First and last step of a window; the first is after the last where there is none."""
    return math.ceil((formula.a or 0.0) / step - 1e-9), math.floor((formula.b or 0.0) / step + 1e-9)


def _window_steps(formula: Temporal, step: float) -> tuple[int, int]:
    """First and last step of a window."""
    low, high = _grid_ends(formula, step)
    if low > high:
        raise ProblemError(f"formula: expected windows that hold a time of the {step:g} s grid, got {formula}")
    return low, high


def _repeated(row: Value, signals: Signals, ops: Ops) -> Value:
    """A fleet's value in every member's row."""
    return row if signals.members == 1 else ops.members([row] * signals.members)
