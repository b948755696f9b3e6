"""The starts of a fleet in a problem file: places by name, a list of them, or a grid."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema

from ensemble_ctrl.files.config.errors import FieldError, show
from ensemble_ctrl.problem.arguments.units import quantity
from ensemble_ctrl.problem.starts import MOST

_LENGTH = quantity("length")
EXAMPLE = "for example  {a: [0, 0], b: [1, 0]}  or  {grid: [2, 3], spacing: 1 m}"
GRID = {"grid", "spacing"}
"""The keys of a grid."""


def _starts(value: Any) -> dict[str, tuple[float, ...]]:
    """Offsets by name; those of a list and of a grid are called s1, s2, ..."""
    if isinstance(value, dict) and GRID & set(value):
        value = _grid(value)
    named = {f"s{k + 1}": place for k, place in enumerate(value)} if isinstance(value, list) else value
    if not isinstance(named, dict) or not 1 <= len(named) <= MOST:
        wanted = f"places by name, a list of them, or a grid, {MOST} at most"
        raise FieldError(f"expected {wanted}, got {show(value)}", EXAMPLE)
    # the key of a place in the file: its name, or its index in the list
    keys = map(str, range(len(named))) if isinstance(value, list) else map(str, named)
    return {str(name): _place(place, key) for (name, place), key in zip(named.items(), keys, strict=True)}


def _place(value: Any, key: str) -> tuple[float, ...]:
    """One place, in metres."""
    if not isinstance(value, list | tuple) or not 1 <= len(value) <= 3:
        raise FieldError(f"expected a place [x, y], got {show(value)}", EXAMPLE, (key,))
    try:
        return tuple(_LENGTH(one) for one in value)
    except FieldError as error:
        raise FieldError(error.message, error.hint, (key,)) from None


def _grid(value: dict[str, Any]) -> list[tuple[float, ...]]:
    """Places so far apart, along x first; the first of them has the offset 0."""
    if set(value) != GRID:
        raise FieldError(f"expected grid and spacing, got {', '.join(map(str, value))}", EXAMPLE)
    counts, spacing = value["grid"], _LENGTH(value["spacing"])
    whole = isinstance(counts, list) and all(isinstance(n, int) and not isinstance(n, bool) and n > 0 for n in counts)
    if not whole or len(counts) != 2:
        raise FieldError(f"expected how many along x and along y, got {show(counts)}", EXAMPLE, ("grid",))
    if not spacing > 0:
        raise FieldError(f"expected a length above 0 m, got {spacing:g} m", path=("spacing",))
    return [(column * spacing, row * spacing) for row in range(counts[1]) for column in range(counts[0])]


Starts = Annotated[
    dict[str, tuple[float, ...]],
    BeforeValidator(_starts),
    WithJsonSchema({"anyOf": [{"type": "object"}, {"type": "array", "items": {"type": "array"}}]}),
]
"""Offsets from the start by name, metres."""


def check_dimensions(starts: dict[str, tuple[float, ...]], positions: tuple[str, ...]) -> None:
    """Each has a number for every coordinate, and no two are alike.

    Raises
    ------
    FieldError
        At the line of the start.
    """
    seen: dict[tuple[float, ...], str] = {}
    for name, place in starts.items():
        if len(place) != len(positions):
            raise FieldError(f"expected [{', '.join(positions)}], got {show(list(place))}", path=("starts", name))
        if place in seen:
            raise FieldError(f"expected another place than that of {seen[place]}", path=("starts", name))
        seen[place] = name


def starts_data(starts: Any) -> dict[str, Any]:
    """What is written back of them: nothing where all members start alike."""
    return {"starts": {name: list(place) for name, place in starts.items()}} if starts else {}
