"""Build formulas while their text is read: one operator on its operands at a time."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, islice, pairwise
from typing import cast

from ensemble_ctrl.constraints.stl._constants import simplified
from ensemble_ctrl.constraints.stl._linear import Sum, absolute, compared, divided, multiplied
from ensemble_ctrl.constraints.stl._tokens import FormulaError, Token
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
from ensemble_ctrl.constraints.stl.rewrite import leaves
from ensemble_ctrl.core.errors import ProblemError

MOST_TWICE = 1000
"""Leaves that ``iff`` and ``xor`` may hold: each stands in the formula twice, and so again for each one around."""

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

    def chain(self, token: Token) -> None:
        """Take one more operand, after the same operator again.

        Raises
        ------
        FormulaError
            For comparisons that don't run one way.
        """
        if self.kind == "compare" and token.text[0] != self.text[0]:
            hint = "write the two comparisons with 'and' between them"
            raise FormulaError(token.column, f"'{self.text[0]}' again", repr(token.text), hint)
        self.count += 1


def built(operator: Operator, operands: list[Operand]) -> Operand:
    """The operator on its operands, which are of the right kinds."""
    match operator.kind:
        case "sign":
            return _signed(operator, cast(list[Sum], operands))
        case "times":
            left, right = cast(list[Sum], operands)
            return divided(left, right) if operator.text == "/" else multiplied(left, right)
        case "abs":
            return absolute(cast(Sum, operands[0]), operator.column)
        case "(" | "sum(" | "end":
            return operands[0]
    try:
        if operator.kind == "compare":
            sums = cast(list[Sum], operands)
            parts = [compared(left, right, operator.text[0]) for left, right in pairwise(sums)]
            return parts[0] if len(parts) == 1 else And(tuple(parts))
        return _formula(operator, cast(list[Formula], operands))
    except FormulaError:
        raise
    except ProblemError as error:
        wanted, _, came = str(error).partition(": expected ")[2].rpartition(", got ")
        raise FormulaError(operator.column, wanted, came) from None


def _formula(operator: Operator, parts: list[Formula]) -> Formula:
    """An operator on formulas."""
    a, b = operator.window or (None, None)
    match operator.kind:
        case "iff":
            _bounded(operator, parts)
            left, right = parts
            return _both(And, _both(Or, _not(left), right), _both(Or, left, _not(right)))
        case "xor":
            _bounded(operator, parts)
            left, right = parts
            return _both(And, _both(Or, left, right), _both(Or, _not(left), _not(right)))
        case "=>":  # f => g => h
            return _both(Or, *map(_not, parts[:-1]), parts[-1])
        case "or":
            return _both(Or, *parts)
        case "and":
            return _both(And, *parts)
        case "U":
            return simplified(Until(parts[0], parts[1], a, b, column=operator.column))
        case "not":
            return _not(parts[0])
        case "F":
            return simplified(Eventually(parts[0], a, b, column=operator.column))
        case "G":
            return simplified(Always(parts[0], a, b, column=operator.column))
        case "mean":
            return simplified(Mean(parts[0]))
        case "share":
            return simplified(Share(operator.share, parts[0]))
    raise AssertionError(operator)


def _not(part: Formula) -> Formula:
    """``not f``."""
    return simplified(Not(part))


def _both(kind: type[And] | type[Or], *parts: Formula) -> Formula:
    """A conjunction or disjunction."""
    return simplified(kind(parts))


def _bounded(operator: Operator, parts: list[Formula]) -> None:
    """Refuse to write long formulas twice."""
    found = chain.from_iterable(map(leaves, parts))
    if len(list(islice(found, MOST_TWICE + 1))) > MOST_TWICE:
        wanted = f"at most {MOST_TWICE} predicates and places around {operator.kind!r}, which stand in it twice"
        raise FormulaError(operator.column, wanted, "more")


def _signed(operator: Operator, operands: list[Sum]) -> Sum:
    """``left + right``, or ``+ right``, or with minus."""
    left = operands[0] if operator.count == 2 else Sum({}, 0.0, operator.column)
    left.add(operands[-1], -1.0 if operator.text == "-" else 1.0)
    return left


__all__ = ["MOST_TWICE", "Operand", "Operator", "Sum", "built"]
