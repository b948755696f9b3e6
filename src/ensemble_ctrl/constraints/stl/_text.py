"""Numbers and windows as they stand in a task's text."""

from __future__ import annotations

import math


def number(value: float) -> str:
    """The shortest text that reads back as the same number; ``T`` for infinity."""
    if value == math.inf:
        return "T"
    short = f"{value:g}"
    return short if float(short) == value else repr(float(value))


def window_text(a: float | None, b: float | None) -> str:
    """``[a,b]``, or nothing for the whole horizon."""
    return "" if a is None or b is None else f"[{number(a)},{number(b)}]"
