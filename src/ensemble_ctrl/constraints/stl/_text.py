"""Numbers and windows as they stand in a task's text."""

from __future__ import annotations

import math

from ensemble_ctrl.core.values import exact


class BeforeEnd(float):
    """A time that is counted back from the end of the plan, ``T - before``: infinite until `at` puts the end in.

    Parameters
    ----------
    before : float
        Seconds, above 0; ``T`` itself is ``math.inf``.

    Examples
    --------
    >>> BeforeEnd(2.0), BeforeEnd(2.0).at(16.0), BeforeEnd(2.0) == BeforeEnd(3.0)
    (T-2, 14.0, False)
    """

    before: float

    def __new__(cls, before: float) -> BeforeEnd:
        time = super().__new__(cls, math.inf)
        time.before = float(before)
        return time

    def at(self, duration: float) -> float:
        """The time in a plan of this duration, in seconds: the difference of the decimals, rounded once."""
        return float(exact(duration) - exact(self.before))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, BeforeEnd) and other.before == self.before

    def __hash__(self) -> int:
        return hash((math.inf, self.before))

    def __getnewargs__(self) -> tuple[float]:
        return (self.before,)

    def __repr__(self) -> str:
        return f"T-{number(self.before)}"


def resolved_time(time: float | None, duration: float) -> float | None:
    """A window's end with the plan's duration, in seconds, in place of ``T``."""
    if isinstance(time, BeforeEnd):
        return time.at(duration)
    return duration if time == math.inf else time


def backwards(a: float, b: float) -> bool:
    """Whether a window runs backwards for certain, whatever the plan's duration is."""
    if isinstance(a, BeforeEnd):
        return isinstance(b, BeforeEnd) and b.before > a.before
    return (isinstance(b, BeforeEnd) and a == math.inf) or b < a


def number(value: float) -> str:
    """The shortest text that reads back as the same number; ``T`` for infinity."""
    if isinstance(value, BeforeEnd):
        return repr(value)
    if value == math.inf:
        return "T"
    short = f"{value:g}"
    return short if float(short) == value else repr(float(value))


def window_text(a: float | None, b: float | None) -> str:
    """``[a,b]``, or nothing for the whole horizon."""
    return "" if a is None or b is None else f"[{number(a)},{number(b)}]"
