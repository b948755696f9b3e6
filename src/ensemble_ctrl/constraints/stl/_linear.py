"""Linear expressions over the states while they are read, with absolute values of others in them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ensemble_ctrl.constraints.stl._tokens import FormulaError
from ensemble_ctrl.constraints.stl.formula import And, Formula, Or
from ensemble_ctrl.constraints.stl.leaves import Predicate

MOST_BARS = 6
"""Absolute values in one comparison: n of them make 2^n predicates."""


@dataclass(slots=True)
class Sum:
    """A linear expression.

    Attributes
    ----------
    terms : dict of str to float
        Coefficient of each state.
    offset : float
        The constant.
    column : int
        1-based place in the text.
    bars : list of (float, Sum)
        Absolute values that are added to it, each with its factor.
    """

    terms: dict[str, float]
    offset: float
    column: int
    bars: list[tuple[float, Sum]] = field(default_factory=list)

    @property
    def constant(self) -> bool:
        """Whether no state is in it."""
        return not self.terms and not self.bars

    def add(self, other: Sum, factor: float) -> None:
        """Add a multiple of another expression in place."""
        for name, value in other.terms.items():
            self.terms[name] = self.terms.get(name, 0.0) + factor * value
        self.offset += factor * other.offset
        self.bars += [(factor * weight, inside) for weight, inside in other.bars]

    def times(self, factor: float) -> Sum:
        """A multiple of it."""
        total = Sum({}, 0.0, self.column)
        total.add(self, factor)
        return total


def absolute(inside: Sum, column: int) -> Sum:
    """``abs(inside)``.

    Raises
    ------
    FormulaError
        For an absolute value inside another.
    """
    if inside.bars:
        raise FormulaError(column, "abs of a linear expression", "one with another abs in it")
    if inside.constant:
        return Sum({}, abs(inside.offset), column)
    return Sum({}, 0.0, column, [(1.0, inside)])


def multiplied(left: Sum, right: Sum) -> Sum:
    """The product, if it is linear."""
    if not left.constant and not right.constant:
        hint = "for a shape draw a region and write  in(region)"
        raise FormulaError(right.column, "a number, as predicates are linear", "a product of states", hint)
    product = left.times(right.offset) if right.constant else right.times(left.offset)
    product.column = left.column
    return product


def divided(left: Sum, right: Sum) -> Sum:
    """The quotient, if it is linear."""
    if not right.constant or right.offset == 0:
        raise FormulaError(right.column, "a number that is not zero", "0" if right.constant else "a state")
    scaled = {name: value / right.offset for name, value in left.terms.items()}
    bars = [(weight / right.offset, inside) for weight, inside in left.bars]
    return Sum(scaled, left.offset / right.offset, left.column, bars)


def compared(left: Sum, right: Sum, direction: str) -> Formula:
    """``left >= right``, or ``left <= right`` where the direction is ``<``.

    Notes
    -----
    An absolute value is the larger one of an expression and its negation. So ``e - abs(a) >= 0`` holds where both
    ``e - a >= 0`` and ``e + a >= 0`` do, and ``e + abs(a) >= 0`` where one of them does.
    """
    sign = 1.0 if direction == ">" else -1.0
    total = Sum({}, 0.0, left.column)
    total.add(left, sign)
    total.add(right, -sign)
    bars = [(weight, inside) for weight, inside in total.bars if weight]
    if len(bars) > MOST_BARS:
        raise FormulaError(left.column, f"at most {MOST_BARS} absolute values in a comparison", str(len(bars)))
    return _unfolded(total, sorted(bars, key=lambda bar: bar[0]))


def _unfolded(total: Sum, bars: list[tuple[float, Sum]]) -> Formula:
    """``total + sum of weight * abs(inside) >= 0``; those with a negative weight come first."""
    if not bars:
        return Predicate(tuple(total.terms.items()), total.offset, column=total.column)
    (weight, inside), *rest = bars
    # w |e| = max(w e, -w e) for w > 0, a disjunction; min for w < 0, a conjunction
    cases = []
    for sign in (1.0, -1.0):
        case = replace(total, terms=dict(total.terms), bars=[])
        case.add(inside, sign * weight)
        cases.append(_unfolded(case, rest))
    return (And if weight < 0 else Or)(tuple(cases))
