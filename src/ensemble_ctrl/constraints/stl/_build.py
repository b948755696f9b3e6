"""Build formulas while their text is read: one operator on its operands at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from ensemble_ctrl.constraints.stl._tokens import FormulaError
from ensemble_ctrl.constraints.stl.formula import (
    Always,
    And,
    Eventually,
    Formula,
    Mean,
    Not,
    Or,
    Share,
    Until,
)
from ensemble_ctrl.constraints.stl.leaves import Predicate
from ensemble_ctrl.errors import ProblemError


@dataclass(slots=True)
class Sum:
    """A linear expression while it is read."""

    terms: dict[str, float]
    offset: float
    column: int

    def add(self, other: Sum, factor: float) -> None:
        """Add a multiple of another expression in place."""
        for name, value in other.terms.items():
            self.terms[name] = self.terms.get(name, 0.0) + factor * value
        self.offset += factor * other.offset


Operand = Formula | Sum


@dataclass(slots=True)
class Operator:
    """An operator, or an open bracket, that waits for its last operand.

    Attributes
    ----------
    kind : str
        As of a token.
    level : int
        How tightly it binds; 0 for a bracket.
    column : int
        1-based place of what an error is about.
    count : int
        Number of operands.
    text : str
        As it was written.
    window : tuple of float, optional
        Seconds.
    share : float
        Share of the members.
    """

    kind: str
    level: int
    column: int
    count: int = 2
    text: str = ""
    window: tuple[float, float] | None = None
    share: float = 0.0


def built(operator: Operator, operands: list[Operand]) -> Operand:
    """The operator on its operands, which are of the right kinds."""
    if operator.kind == "sign":
        return _sum(operator, cast(list[Sum], operands))
    if operator.kind == "times":
        left, right = cast(list[Sum], operands)
        return _divided(left, right) if operator.text == "/" else _multiplied(left, right)
    if operator.kind in ("(", "sum(", "end"):
        return operands[0]
    try:
        if operator.kind == "compare":
            return _predicate(operator, *cast(list[Sum], operands))
        return _formula(operator, cast(list[Formula], operands))
    except ProblemError as error:
        wanted, _, came = str(error).partition(": expected ")[2].rpartition(", got ")
        raise FormulaError(operator.column, wanted, came) from None


def _formula(operator: Operator, parts: list[Formula]) -> Formula:
    """An operator on formulas."""
    a, b = operator.window or (None, None)
    match operator.kind:
        case "=>":  # f => g => h
            return Or((*map(Not, parts[:-1]), parts[-1]))
        case "or":
            return Or(tuple(parts))
        case "and":
            return And(tuple(parts))
        case "U":
            return Until(parts[0], parts[1], a, b, column=operator.column)
        case "not":
            return Not(parts[0])
        case "F":
            return Eventually(parts[0], a, b, column=operator.column)
        case "G":
            return Always(parts[0], a, b, column=operator.column)
        case "mean":
            return Mean(parts[0])
        case "share":
            return Share(operator.share, parts[0])
    raise AssertionError(operator)


def _predicate(operator: Operator, left: Sum, right: Sum) -> Formula:
    """``left >= right``."""
    sign = 1.0 if operator.text.startswith(">") else -1.0
    total = Sum({}, 0.0, left.column)
    total.add(left, sign)
    total.add(right, -sign)
    return Predicate(tuple(total.terms.items()), total.offset, column=left.column)


def _sum(operator: Operator, operands: list[Sum]) -> Sum:
    """``left + right``, or ``+ right``, or with minus."""
    left = operands[0] if operator.count == 2 else Sum({}, 0.0, operator.column)
    left.add(operands[-1], -1.0 if operator.text == "-" else 1.0)
    return left


def _multiplied(left: Sum, right: Sum) -> Sum:
    """The product, if it is linear."""
    if left.terms and right.terms:
        raise FormulaError(right.column, "a number, as predicates are linear", "a product of states")
    linear, factor = (left, right.offset) if left.terms else (right, left.offset)
    total = Sum({}, 0.0, left.column)
    total.add(linear, factor)
    return total


def _divided(left: Sum, right: Sum) -> Sum:
    """The quotient, if it is linear."""
    if right.terms or right.offset == 0:
        raise FormulaError(right.column, "a number that is not zero", "a state" if right.terms else "0")
    scaled = {name: value / right.offset for name, value in left.terms.items()}
    return Sum(scaled, left.offset / right.offset, left.column)
