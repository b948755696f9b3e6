"""Plain data as strict JSON: numbers that JSON lacks become null; and texts that do nothing to a terminal."""

from __future__ import annotations

import json
import math
import re
from decimal import ROUND_FLOOR, Decimal
from typing import Any

_MARKS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
"""Controls, which steer a terminal, and marks of direction, which let a text look like another."""

TIMES = frozenset({"time", "times", "t_begin", "t_end"})
"""Keys of seconds, which are written in whole nanoseconds: 0.3, where the sum of three steps is 0.30000000000000004."""


def visible(text: str) -> str:
    r"""A text with its controls, except for new lines and tabs, and its marks of direction as escapes.

    Examples
    --------
    >>> print(visible("a\x1b[2Jb"), visible("caf\u00e9"))
    a\x1b[2Jb café
    """
    return _MARKS.sub(lambda mark: repr(mark[0])[1:-1], text)


def at_least(bound: float) -> str:
    """A lower bound with four decimals, rounded down: a text claims no more than what is proven.

    Examples
    --------
    >>> at_least(0.07356879), at_least(0.0123), at_least(-0.00001), at_least(float("inf"))
    ('0.0735', '0.0123', '-0.0001', 'inf')
    """
    if not math.isfinite(bound):
        return f"{bound:g}"
    return str(Decimal(repr(float(bound))).quantize(Decimal("0.0001"), ROUND_FLOOR))


def to_json(data: Any, indent: int | None = None) -> str:
    """Strict JSON text.

    Examples
    --------
    >>> to_json({"clearance": float("inf"), "cells": (1, 2)})
    '{"clearance": null, "cells": [1, 2]}'
    >>> to_json({"times": [0.1 * 3], "x": 0.1 * 3})
    '{"times": [0.3], "x": 0.30000000000000004}'
    """
    return json.dumps(_plain(data), indent=indent, allow_nan=False)


def _plain(data: Any, key: str = "") -> Any:
    """The same data with infinite and undefined numbers as None, and times in whole nanoseconds."""
    if isinstance(data, dict):
        return {name: _plain(value, name) for name, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(value, key) for value in data]
    if not isinstance(data, float):
        return data
    if not math.isfinite(data):
        return None
    return round(data, 9) if key in TIMES else data
