"""Axes of a sweep: fields of a problem file, each with the values that it takes in turn."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

from pydantic import ValidationInfo

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.values import exact
from ensemble_ctrl.files.config.errors import FieldError, only, show
from ensemble_ctrl.files.config.source import checked_path
from ensemble_ctrl.problem.arguments.errors import is_number

KEY = re.compile(r"[^\s.\[\]=]+(?:\.[^\s.\[\]=]+|\[\d+\])*")
MOST_VALUES = 100_000
"""Values of one axis."""
RANGE = ("from", "to", "count", "step", "spacing")
EXAMPLE = "for example  [1, 2, 5]  {from: 0, to: 1, count: 11}  {seeds: 20}  {files: maps/*.geojson}"
_WITH_UNIT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)?\s*")


@dataclass(frozen=True)
class Axis:
    """One field and its values.

    Attributes
    ----------
    key : str
        Dotted, as for ``--set``.
    values : tuple
        As they would stand in the file.
    """

    key: str
    values: tuple[Any, ...]


def axes(value: Any, info: ValidationInfo) -> tuple[Axis, ...]:
    """The section ``sweep``."""
    return axes_of(value, Path((info.context or {}).get("folder", Path())))


def axes_of(value: Any, folder: Path) -> tuple[Axis, ...]:
    """Axes from plain data.

    Parameters
    ----------
    value : dict
        Dotted keys with a list of values, or a section that says which.
    folder : Path
        Where names of files start.

    Raises
    ------
    FieldError
        For anything else.
    """
    if isinstance(value, tuple):
        return value
    if not isinstance(value, dict):
        raise FieldError(
            f"expected fields with their values, got {show(value)}", "for example  solve.seed: {seeds: 20}"
        )
    return tuple(_axis(str(key), values, folder) for key, values in value.items())


def _axis(key: str, values: Any, folder: Path) -> Axis:
    """One axis."""
    if not KEY.fullmatch(key) or key.split(".")[0] == "sweep":
        raise FieldError(f"expected a field's dotted key, got {show(key)}", "for example  horizon.duration", (key,))
    try:
        found = tuple(_values(values, folder))
    except FieldError as error:
        raise FieldError(error.message, error.hint, (key, *error.path)) from None
    if not found:
        raise FieldError("expected at least one value, got none", EXAMPLE, (key,))
    return Axis(key, found)


def _values(values: Any, folder: Path) -> Iterator[Any]:
    """The values of one axis."""
    if isinstance(values, list):
        if any(value is None for value in values):
            raise FieldError("expected values, got one that is empty", EXAMPLE)
        yield from values
    elif isinstance(values, dict) and "seeds" in values:
        only(values, ("seeds", "first"))
        first = _whole(values.get("first", 0), 0, "first")
        yield from range(first, first + _whole(values["seeds"], 1, "seeds"))
    elif isinstance(values, dict) and "files" in values:
        only(values, ("files",))
        yield from _files(values["files"], folder)
    elif isinstance(values, dict) and "from" in values:
        only(values, RANGE)
        yield from _range(values)
    else:
        raise FieldError(f"expected a list, a range, seeds or files, got {show(values)}", EXAMPLE)


def _files(pattern: Any, folder: Path) -> Iterator[dict[str, str]]:
    """Files in the folder of the problem file or below, in the order of their names."""
    if not isinstance(pattern, str) or Path(pattern).is_absolute() or ".." in Path(pattern).parts or not pattern:
        raise FieldError(
            f"expected a pattern of files in the same folder or below, got {show(pattern)}", path=("files",)
        )
    names = sorted(str(path.relative_to(folder)) for path in folder.glob(pattern) if path.is_file())
    if not names:
        raise FieldError(f"expected files, found none like {show(pattern)}", f"in {folder.resolve()}", ("files",))
    for name in names:
        checked_path(folder, name)
        yield {"file": name}


def _range(values: dict[str, Any]) -> Iterator[Any]:
    """Evenly spaced values from one to another, both included."""
    if "to" not in values or ("count" in values) == ("step" in values):
        raise FieldError("expected from, to, and count or step", "for example  {from: 0, to: 1, count: 11}")
    low, high = values["from"], values["to"]
    spacing = values.get("spacing", "linear")
    if spacing not in ("linear", "log"):
        raise FieldError(f"expected linear or log, got {show(spacing)}", path=("spacing",))
    if "count" in values:
        count = _whole(values["count"], 2, "count")
        shares = [Fraction(i, count - 1) for i in range(count)]
    else:
        shares = _steps(low, high, values["step"])
    for share in shares:
        yield _between(low, high, share, spacing)


def _steps(low: Any, high: Any, step: Any) -> list[Fraction]:
    """Where the values are that lie whole steps from the first one."""
    start, end, size = _number(low, "from")[0], _number(high, "to")[0], _number(step, "step")[0]
    if size == 0 or (end - start) / size < 0 or (end - start) / size > MOST_VALUES:
        raise FieldError(f"expected a step from {show(low)} towards {show(high)}, got {show(step)}", path=("step",))
    if start == end:
        return [Fraction(0)]
    return [i * size / (end - start) for i in range(math.floor((end - start) / size) + 1)]


def _between(low: Any, high: Any, share: Fraction, spacing: str) -> Any:
    """A value part of the way between two numbers, numbers with a unit, or lists of such."""
    if isinstance(low, list) and isinstance(high, list) and len(low) == len(high):
        return [_between(a, b, share, spacing) for a, b in zip(low, high, strict=True)]
    (start, unit), (end, same) = _number(low, "from"), _number(high, "to")
    if unit != same:
        raise FieldError(f"expected the same unit at both ends, got {show(low)} and {show(high)}", path=("to",))
    if spacing == "linear":
        return _written(start + (end - start) * share, unit, isinstance(low, int))
    if start <= 0 or end <= 0:
        raise FieldError("expected numbers above 0 for spacing: log", path=("from",))
    return _written(exact(float(start) * (float(end) / float(start)) ** float(share)), unit, False)


def _written(number: Fraction, unit: str, whole: bool) -> Any:
    """A number as it would stand in the file."""
    value = int(number) if (whole or unit) and number.denominator == 1 else float(number)
    return f"{value!r} {unit}" if unit else value


def _number(value: Any, name: str) -> tuple[Fraction, str]:
    """A number and its unit."""
    if is_number(value) and math.isfinite(value):
        return exact(value), ""
    match = _WITH_UNIT.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise FieldError(f"expected a number, with or without a unit, got {show(value)}", path=(name,))
    return exact(float(match[1])), match[2] or ""


def _whole(value: Any, least: int, name: str) -> int:
    """A whole number."""
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= MOST_VALUES:
        raise FieldError(f"expected a whole number from {least} to {MOST_VALUES}, got {show(value)}", path=(name,))
    return value
