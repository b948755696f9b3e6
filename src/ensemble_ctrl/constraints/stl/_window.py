"""Read the window of a temporal operator."""

from __future__ import annotations

import math
from typing import NamedTuple

from ensemble_ctrl.constraints.stl._text import BeforeEnd, backwards
from ensemble_ctrl.constraints.stl._tokens import TIME_UNITS, FormulaError, Token, Tokens
from ensemble_ctrl.core.errors import shortened

Window = tuple[float, float]

_CLOSED = "windows have their ends in them: write  [a,b]"
_FROM_END = "a time is a number, T, or T minus a number of seconds"


class Time(NamedTuple):
    """One end of a window: seconds, the text that it was written as, its unit, and its place."""

    seconds: float
    text: str
    unit: str
    column: int


def read_window(tokens: Tokens) -> Window | None:
    """The window that comes next; None without one, and for ``[0, inf)``, which is the whole horizon.

    Raises
    ------
    FormulaError
        For what is no window, or one that runs backwards.
    """
    brace = tokens.window()
    if brace is None:
        return None
    low = _time(tokens, "a number or T")
    between = tokens.next()
    if between.kind not in (",", ":"):
        raise between.refused("','", _FROM_END if low.text == "T" else "")
    high = _time(tokens, "a number or T", endless=True)
    closing = tokens.next()
    if closing.kind != "]" and not (closing.kind == ")" and high.text == "inf"):
        raise closing.refused("']'", _CLOSED if closing.kind == ")" else _FROM_END if high.text == "T" else "")
    if brace:
        tokens.take(brace, f"'{brace}'")
    return _checked(low, high)


def _checked(low: Time, high: Time) -> Window | None:
    """The two ends as a window."""
    if high.text == "inf" and low.seconds == 0:
        return None
    if backwards(low.seconds, high.seconds):
        raise FormulaError(high.column, f"a window's end of {low.text} or later", high.text)
    bare, other = (low, high.unit) if not low.unit else (high, low.unit)
    if other not in ("", "s") and not bare.unit and 0 < bare.seconds < math.inf:
        raise FormulaError(bare.column, "a unit of time at both ends of the window, or at none", bare.text)
    return low.seconds, high.seconds


def _time(tokens: Tokens, wanted: str, endless: bool = False) -> Time:
    """A number of seconds, or ``T``, or ``T`` minus a number; with `endless`, or ``inf``."""
    token = tokens.next()
    if token.kind == "number":
        value, unit = _seconds(tokens, token)
        return Time(value, token.text, unit, token.column)
    if token.kind != "T" or (token.text == "inf" and not endless):
        raise token.refused(wanted)
    sign = tokens.skip("sign") if token.text == "T" else None
    if sign is None:
        return Time(math.inf, token.text, "", token.column)
    if sign.text != "-":
        raise FormulaError(sign.column, "'-' or the window's end", "'+'", "no time is later than T, the plan's end")
    before, unit = _seconds(tokens, tokens.take("number", "a number"))
    return Time(BeforeEnd(before) if before else math.inf, f"T-{before:g}", unit, token.column)


def _seconds(tokens: Tokens, number: Token) -> tuple[float, str]:
    """A number with the unit that follows it, if one does, in seconds; and that unit."""
    value, unit = float(number.text), tokens.skip("name")
    if math.isinf(value):
        raise FormulaError(number.column, "a finite number", shortened(number.text))
    if unit is None:
        return value, ""
    if unit.text not in TIME_UNITS:
        raise FormulaError(unit.column, f"a unit of time ({', '.join(TIME_UNITS)})", repr(unit.text))
    numerator, denominator = TIME_UNITS[unit.text]
    return value * numerator / denominator, unit.text
