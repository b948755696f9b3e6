"""Numbers with units: ``45 deg``, ``16 s``, ``5 km/h``; without one, a number is in SI units and radians."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

from ensemble_ctrl.constraints.stl._tokens import TIME_UNITS
from ensemble_ctrl.problem.arguments.errors import FieldError, show

UNITS: dict[str, tuple[str, float, float]] = {
    "m": ("length", 1, 1),
    "cm": ("length", 1, 100),
    "mm": ("length", 1, 1000),
    "km": ("length", 1000, 1),
    **{name: ("time", *factor) for name, factor in TIME_UNITS.items()},
    "rad": ("angle", 1, 1),
    "deg": ("angle", math.pi, 180),
}
"""Unit to what it measures, and the factor to SI as numerator and denominator (35 cm is 35 / 100)."""

RATES = {"length": "speed", "angle": "turn rate"}
"""What a unit per time measures."""

WANTED = {
    "number": "a number without a unit",
    "length": "a length in m, cm, mm or km",
    "time": "a time in s, ms, min or h",
    "angle": "an angle in rad or deg",
    "speed": "a speed in m/s, cm/s or km/h",
    "turn rate": "a turn rate in rad/s or deg/s",
}
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\W\d]+(?:\s*/\s*[^\W\d]+)?)?\s*")


def quantity(kind: str, least: float = -math.inf, *, above: float = -math.inf) -> Callable[[Any], float]:
    """A validator that turns a number, or a text with a number and a unit of `kind`, into SI units.

    Parameters
    ----------
    kind : str
        A key of `WANTED`.
    least, above : float
        The value has to be at least `least`, and more than `above`.

    Examples
    --------
    >>> quantity("time")("2 min"), quantity("speed")("36 km/h"), quantity("length")(0.5)
    (120.0, 10.0, 0.5)
    """

    def convert(value: Any) -> float:
        number = _in_si(value, kind)
        if not math.isfinite(number):
            raise FieldError(f"expected a finite number, got {show(value)}")
        if number < least or number <= above:
            bound = f"{least:g} or more" if number < least else f"above {above:g}"
            raise FieldError(f"expected {WANTED[kind]}, {bound}, got {show(value)}")
        return number

    return convert


def pattern(kind: str) -> str:
    """A regular expression, for JSON Schema, of the texts that are a number, or a number with a unit of `kind`.

    Examples
    --------
    >>> bool(re.search(pattern("speed"), "5 km/h")), bool(re.search(pattern("speed"), "5 km"))
    (True, False)
    """
    units = [unit for unit, (measured, _, _) in UNITS.items() if measured == kind]
    above = [unit for unit, (measured, _, _) in UNITS.items() if RATES.get(measured) == kind]
    below = [unit for unit, (measured, _, _) in UNITS.items() if measured == "time"]
    units += [rf"({'|'.join(above)})\s*/\s*({'|'.join(below)})"] if above else []
    unit = rf"(\s*({'|'.join(units)}))?" if units else ""
    return rf"^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?{unit}\s*$"


def _in_si(value: Any, kind: str) -> float:
    """A number, or a text with a unit, in SI units."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    match = _NUMBER.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise FieldError(f"expected {WANTED[kind]}, got {show(value)}")
    number, unit = float(match[1]), match[2]
    if not unit:
        return number
    measured, numerator, denominator = _unit(unit, kind)
    if measured != kind:
        raise FieldError(
            f"expected {WANTED[kind]}, got {show(value)}, which is a {measured}".replace("a angle", "an angle")
        )
    return number * numerator / denominator


def _unit(text: str, kind: str) -> tuple[str, float, float]:
    """What a unit or a quotient of two units measures, and its factor."""
    names = [name.strip() for name in text.split("/")]
    for name in names:
        if name not in UNITS:
            raise FieldError(f"expected {WANTED[kind]}, got the unknown unit {name!r}")
    measured, numerator, denominator = UNITS[names[0]]
    if len(names) == 1:
        return measured, numerator, denominator
    below, top, bottom = UNITS[names[1]]
    rate = RATES.get(measured, "") if below == "time" else ""
    return rate or f"{measured} per {below}", numerator * bottom, denominator * top
