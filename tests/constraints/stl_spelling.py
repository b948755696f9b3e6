"""Formulas written as other people write them: every spelling, every window, more brackets and blanks than needed."""

from __future__ import annotations

import math

from hypothesis import strategies as st

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
    Predicate,
    Share,
    Until,
)
from ensemble_ctrl.constraints.stl._text import BeforeEnd
from ensemble_ctrl.constraints.stl._tokens import SPELLINGS


class Writer:
    """Writes a formula with spellings that are drawn."""

    def __init__(self, draw: st.DrawFn) -> None:
        self._draw = draw

    def pick(self, *words: str) -> str:
        return self._draw(st.sampled_from(words))

    def word(self, kind: str) -> str:
        """A token in any spelling, with the blanks that keep it apart."""
        text = self.pick(*SPELLINGS[kind].split())
        if text.isalpha() and len(text) > 1:
            text = self.pick(text, text.upper(), text.capitalize())
        return f" {text}{self.pick(' ', '  ', chr(10))}" if text[-1].isalpha() else self.pick(text, f" {text} ")

    def formula(self, formula: Formula) -> str:
        text = self._plain(formula)
        return self.pick(text, f"( {text} )", f"(({text}))")

    def _plain(self, formula: Formula) -> str:
        match formula:
            case Predicate(coefficients=terms, offset=offset):
                return self.comparison(terms, offset)
            case Inside(name=name):
                return self.pick(f"in({name})", f"in ( {name} )")
            case Avoid(name=name):
                return self.pick(f"avoid({name})", f"avoid\t( {name})")
            case Not(child=child):
                return f"{self.word('not')}({self.formula(child)})"
            case And(children=parts) | Or(children=parts):
                kind = "and" if isinstance(formula, And) else "or"
                return self.word(kind).join(f"({self.formula(part)})" for part in parts)
            case Eventually(child=child) | Always(child=child):
                kind = "F" if isinstance(formula, Eventually) else "G"
                return f"{self.word(kind).rstrip()}{self.window(formula.a, formula.b)} ({self.formula(child)})"
            case Until(left=left, right=right):
                until = self.word("U").rstrip() + self.window(formula.a, formula.b)
                return f"({self.formula(left)}) {until} ({self.formula(right)})"
            case Mean(child=child):
                return f"mean({self.formula(child)})"
            case Share(p=p, child=child):
                return f"share( {p!r}, {self.formula(child)})"
        raise AssertionError(formula)

    def comparison(self, terms: tuple[tuple[str, float], ...], offset: float) -> str:
        """``sum + offset >= 0`` with what is negative on the other side or not."""
        left = " + ".join(f"{value!r}{self.pick('*', ' * ', '·', ' × ')}{name}" for name, value in terms if value > 0)
        right = " + ".join(f"{-value!r}{self.pick('*', ' * ', '·', ' × ')}{name}" for name, value in terms if value < 0)
        bound = f"{-offset!r}" if offset <= 0 else f"-{offset!r}"
        right = f"{right} + ({bound})" if right else f"({bound})"
        return self.pick(
            f"{left or '0'} {self.pick('>=', '>', '≥')}{right}",
            f"{right} {self.pick('<=', '<', '≤')} {left or '0'}",
        )

    def window(self, a: float | None, b: float | None) -> str:
        if a is None or b is None:
            return self.pick("", "[0, inf)", "_[0,inf]")
        opening, closing = self.pick("[ ]", "[ ]", "_[ ]", "_{[ ]}").split()
        return f"{opening}{self.time(a)}{self.pick(',', ' : ', ', ')}{self.time(b)}{closing}"

    def time(self, time: float) -> str:
        if isinstance(time, BeforeEnd):
            return f"T{self.pick('-', ' - ')}{self.seconds(time.before)}"
        return "T" if time == math.inf else self.seconds(time)

    def seconds(self, time: float) -> str:
        """With a unit; milliseconds where they give the same number exactly."""
        exact = time * 1000 / 1000 == time
        return self.pick(f"{time!r} s", f"{time!r}s", f"{time * 1000!r} ms" if exact else f"{time!r} s")


@st.composite
def spelled(draw: st.DrawFn, formulas: st.SearchStrategy[Formula]) -> tuple[Formula, str]:
    """A formula and a text that says it."""
    formula = draw(formulas)
    return formula, Writer(draw).formula(formula)
