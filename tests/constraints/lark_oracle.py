"""The task language read by lark from ``grammar.lark``: the oracle for the parser."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from lark import Lark, Token, Transformer, v_args
from lark.exceptions import UnexpectedCharacters, UnexpectedToken

from ensemble_ctrl.constraints.stl import (
    Always,
    And,
    Avoid,
    Eventually,
    Formula,
    FormulaError,
    Inside,
    Mean,
    Not,
    Or,
    Predicate,
    Share,
    Until,
)
from ensemble_ctrl.constraints.stl._text import BeforeEnd
from ensemble_ctrl.core.errors import ProblemError

Window = tuple[float, float] | None
WORDS = {
    "NUMBER": "a number",
    "TIME": "T",
    "NAME": "a state",
    "PLACE": "a name",
    "_LPAR": "'('",
    "_OPEN": "'['",
    "_RSQB": "']'",
    "_COMMA": "','",
    "COMPARE": "'>=', '<='",
    "SIGN": "'+'",
    "TIMES": "'*'",
    "_AND": "'and'",
    "_OR": "'or'",
    "IMPLIES": "'=>'",
    "UNTIL": "'U'",
    "_RPAR": "')'",
    "$END": "the end",
}
OPERAND = frozenset({"NOT", "EVENTUALLY", "ALWAYS", "IN", "AVOID", "MEAN", "SHARE"})


class SyntaxProblem(FormulaError):
    """The text is not in the grammar."""


def parse(text: str) -> Formula:
    """What `ensemble_ctrl.constraints.stl.parse` should return."""
    if not text.strip():
        raise SyntaxProblem(1, "a formula", "an empty text")
    try:
        result = _parser().parse(text)
    except UnexpectedToken as error:
        at_end = error.token.type == "$END"
        column = len(text.rstrip()) + 1 if at_end else (error.token.start_pos or 0) + 1
        came = "the end of the text" if at_end else repr(str(error.token))
        raise SyntaxProblem(column, _in_words(error.accepts or error.expected), came) from None
    except UnexpectedCharacters as error:
        place = error.pos_in_stream or 0
        raise SyntaxProblem(place + 1, _in_words(error.allowed or set()), repr(text[place])) from None
    assert isinstance(result, Formula)
    return result


@cache
def _parser() -> Lark:
    grammar = Path(__file__).with_name("grammar.lark").read_text(encoding="utf-8")
    return Lark(grammar, parser="lalr", start="formula", transformer=Builder(), maybe_placeholders=True)


def _in_words(terminals: set[str]) -> str:
    names = set(terminals) or {"$END"}
    words = []
    if names >= OPERAND:
        words.append("a formula")
        names -= OPERAND | {"NUMBER", "NAME", "SIGN", "_LPAR"}
    words += [word for name, word in WORDS.items() if name in names]
    return " or ".join(words) if len(words) < 3 else ", ".join(words[:-1]) + " or " + words[-1]


UNITS = {"s": 1.0, "ms": 1000.0, "min": 1 / 60, "h": 1 / 3600}
"""How many there are in a second."""


class End(NamedTuple):
    """One end of a window: seconds or, with `before`, seconds before the plan's end; its text, unit and column."""

    seconds: float
    before: float | None
    text: str
    unit: str
    column: int

    @property
    def value(self) -> float:
        return BeforeEnd(self.before) if self.before else self.seconds


@dataclass(slots=True)
class _Sum:
    """A linear expression while it is read."""

    terms: dict[str, float]
    offset: float
    column: int

    def add(self, other: _Sum, factor: float) -> None:
        """Add a multiple of another expression in place."""
        for name, value in other.terms.items():
            self.terms[name] = self.terms.get(name, 0.0) + factor * value
        self.offset += factor * other.offset


@v_args(inline=True)
class Builder(Transformer[Token, Formula]):
    """Callbacks of the parser; a ProblemError becomes a FormulaError with a column."""

    def disjunction(self, *children: Formula) -> Formula:
        """``f or g or ...``."""
        with _at(0):
            return Or(children)

    def conjunction(self, *children: Formula) -> Formula:
        """``f and g and ...``."""
        with _at(0):
            return And(children)

    def implies(self, left: Formula, arrow: Token, right: Formula) -> Formula:
        """``f => g``."""
        with _at(_column(arrow)):
            return left.implies(right)

    def equivalence(self, left: Formula, word: Token, right: Formula) -> Formula:
        """``f iff g`` and ``f xor g``."""
        with _at(_column(word)):
            if word == "xor":
                return (left | right) & (~left | ~right)
            return (~left | right) & (left | ~right)

    def until_(self, left: Formula, word: Token, window: Window, right: Formula) -> Formula:
        """``f U[a,b] g``."""
        with _at(_column(word)):
            a, b = window or (None, None)
            return Until(left, right, a, b, column=_column(word))

    def not_(self, word: Token, child: Formula) -> Formula:
        """``not f``."""
        with _at(_column(word)):
            return Not(child)

    def eventually(self, word: Token, window: Window, child: Formula) -> Formula:
        """``F[a,b] f``."""
        with _at(_column(word)):
            a, b = window or (None, None)
            return Eventually(child, a, b, column=_column(word))

    def always(self, word: Token, window: Window, child: Formula) -> Formula:
        """``G[a,b] f``."""
        with _at(_column(word)):
            a, b = window or (None, None)
            return Always(child, a, b, column=_column(word))

    def inside(self, word: Token, name: Token) -> Formula:
        """``in(region)``."""
        return Inside(str(name), column=_column(name))

    def avoid(self, word: Token, name: Token) -> Formula:
        """``avoid(obstacle)``."""
        return Avoid(str(name), column=_column(name))

    def mean(self, word: Token, child: Formula) -> Formula:
        """``mean(f)``."""
        with _at(_column(word)):
            return Mean(child)

    def share(self, word: Token, p: Token, child: Formula) -> Formula:
        """``share(p, f)``."""
        if not 0 < float(p) <= 1:
            raise FormulaError(_column(p), "a share above 0 and up to 1", str(p))
        with _at(_column(word)):
            return Share(float(p), child)

    def time(self, first: Token, *rest: Token | None) -> End:
        """A number with a unit, or T minus one."""
        sign, number, unit = (None, first, rest[0]) if first.type == "NUMBER" else rest
        if number is None:
            return End(math.inf, None, "T", "", _column(first))
        if sign is not None and sign != "-":
            raise FormulaError(_column(sign), "'-' or the window's end", "'+'")
        if math.isinf(float(number)):
            raise FormulaError(_column(number), "a finite number", str(number))
        seconds = float(number) / UNITS[unit or "s"]
        if first.type == "NUMBER":
            return End(seconds, None, str(number), unit or "", _column(first))
        return End(math.inf, seconds, f"T-{seconds:g}", unit or "", _column(first))

    def window(self, a: End, b: End) -> Window:
        """``[a,b]``."""
        ends = (a.before or 0.0, b.before or 0.0)
        if (
            ends[1] > ends[0]
            if a.seconds == b.seconds == math.inf
            else b.seconds < a.seconds < math.inf or (a.seconds == math.inf and not a.before)
        ):
            raise FormulaError(b.column, f"a window's end of {a.text} or later", b.text)
        bare, other = (a, b.unit) if not a.unit else (b, a.unit)
        if other not in ("", "s") and not bare.unit and 0 < bare.seconds < math.inf:
            raise FormulaError(bare.column, "a unit at both ends", bare.text)
        return a.value, b.value

    def predicate(self, first: _Sum, *rest: Any) -> Formula:
        """``a x + b >= c``, or a chain of such."""
        if len({comparison[0] for comparison in rest[::2]}) > 1:
            raise FormulaError(first.column, "comparisons that run one way", "both")
        sums, sign = (first, *rest[1::2]), 1.0 if rest[0].startswith(">") else -1.0
        parts = []
        for left, right in pairwise(sums):
            total = _Sum({}, 0.0, left.column)
            total.add(left, sign)
            total.add(right, -sign)
            with _at(first.column):
                parts.append(Predicate(tuple(total.terms.items()), total.offset, column=left.column))
        return parts[0] if len(parts) == 1 else And(tuple(parts))

    def sum(self, sign: Token | None, first: _Sum, *rest: Any) -> _Sum:
        """``[+-] term +- term ...``."""
        total = _Sum({}, 0.0, first.column if sign is None else _column(sign))
        total.add(first, -1.0 if sign == "-" else 1.0)
        for operator, term in zip(rest[::2], rest[1::2], strict=True):
            total.add(term, -1.0 if operator == "-" else 1.0)
        return total

    def product(self, first: _Sum, *rest: Any) -> _Sum:
        """``factor * factor / factor ...``, of which one at most has states in it."""
        total = first
        for operator, factor in zip(rest[::2], rest[1::2], strict=True):
            total = _divided(total, factor) if operator == "/" else _multiplied(total, factor)
        return total

    def constant(self, value: Token) -> _Sum:
        """A number."""
        if math.isinf(float(value)):
            raise FormulaError(_column(value), "a finite number", str(value))
        return _Sum({}, float(value), _column(value))

    def state(self, name: Token) -> _Sum:
        """A state."""
        return _Sum({str(name): 1.0}, 0.0, _column(name))


def _multiplied(left: _Sum, right: _Sum) -> _Sum:
    """The product, if it is linear."""
    if left.terms and right.terms:
        raise FormulaError(right.column, "a number, as predicates are linear", "a product of states")
    linear, factor = (left, right.offset) if left.terms else (right, left.offset)
    total = _Sum({}, 0.0, left.column)
    total.add(linear, factor)
    return total


def _divided(left: _Sum, right: _Sum) -> _Sum:
    """The quotient, if it is linear."""
    if right.terms or right.offset == 0:
        raise FormulaError(right.column, "a number that is not zero", "a state" if right.terms else "0")
    scaled = {name: value / right.offset for name, value in left.terms.items()}
    return _Sum(scaled, left.offset / right.offset, left.column)


def _column(token: Token) -> int:
    """1-based place of a token in the text."""
    return (token.start_pos or 0) + 1


@contextmanager
def _at(column: int) -> Iterator[None]:
    """Give a constructor's error the column of its operator."""
    try:
        yield
    except FormulaError:
        raise
    except ProblemError as error:
        wanted, _, came = str(error).partition(": expected ")[2].rpartition(", got ")
        raise FormulaError(column, wanted, came) from None
