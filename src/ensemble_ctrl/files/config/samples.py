"""Measured values of a parameter, from a list or from a table of numbers."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ensemble_ctrl.files.config.errors import FieldError, show
from ensemble_ctrl.files.config.source import MAX_MAP_BYTES, checked_path, read_bytes, text_of
from ensemble_ctrl.files.config.tree import TextError
from ensemble_ctrl.problem.arguments.units import quantity
from ensemble_ctrl.problem.checks import MAX_SAMPLES

Values = tuple[float, ...]
Convert = Callable[[Any], float]
POSITIVE: Convert = quantity("number", above=0.0)
Columns = Mapping[str, Values]
"""Columns of a table by their names; one column without a header is called ``""``."""

_EXAMPLE = "for example [0.95, 1.0, 1.02], or measured.csv with one number a line"
_THIN = "keep every tenth, say: the distribution hardly changes"


def samples(value: Any, convert: Convert = POSITIVE) -> Values | str:
    """A list of numbers that `convert` accepts, or the name of a file."""
    if isinstance(value, str):
        return value
    if not isinstance(value, list | tuple):
        raise FieldError(f"expected a list of numbers or the name of a file, got {show(value)}", _EXAMPLE)
    if not value:
        raise FieldError("expected at least one number, got an empty list", _EXAMPLE)
    if len(value) > MAX_SAMPLES:
        raise FieldError(f"expected at most {MAX_SAMPLES} numbers, got {len(value)}", _THIN)
    return tuple(_item(i, item, convert) for i, item in enumerate(value))


def columns_of(folder: Path, name: str, above: float = -math.inf) -> Columns:
    """The columns of a CSV file that a problem file in `folder` names: there or below, as every file that it names.

    Parameters
    ----------
    folder : Path
        Of the problem file.
    name : str
        Of the CSV file; see `columns_from_file` for what it holds, and for `above`.

    Raises
    ------
    FieldError
        If it is elsewhere, or not what was wanted.
    """
    return columns_from_file(checked_path(folder, name), above)


def columns_from_file(path: Path, above: float = -math.inf) -> Columns:
    """The columns of a CSV file.

    Parameters
    ----------
    path : Path
        One number a line, or cells separated by commas, semicolons or tabs. The first line may name the columns; empty
        lines, and lines that begin with ``#``, are left out.
    above : float
        What every number has to be above.

    Raises
    ------
    FieldError
        If it can't be read, has no numbers or too many, or a cell is not a finite number in range.
    """
    try:
        text = text_of(read_bytes(path, MAX_MAP_BYTES), MAX_MAP_BYTES)
    except TextError as error:
        hint = _THIN if error.message.startswith("expected at most") else error.hint
        raise FieldError(f"{path.name}: {error.message}", hint) from None
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and line.lstrip()[0] != "#"]
    if not lines:
        raise FieldError(f"{path.name}: expected numbers, got an empty file", _EXAMPLE)
    rows = [(i, _cells(path, i, line, _separator(lines[0][1]))) for i, line in lines]
    names = rows.pop(0)[1] if not all(map(_is_number, rows[0][1])) else []
    if not names and len(rows[0][1]) > 1:
        wanted = "expected a first line that names the columns"
        raise FieldError(f"{path.name}, line {rows[0][0]}: {wanted}, got {len(rows[0][1])} columns of numbers")
    return _columns(path, names or [""], rows, above)


def _columns(path: Path, names: list[str], rows: list[tuple[int, list[str]]], above: float) -> Columns:
    """Rows of cells as columns of numbers."""
    if not rows:
        raise FieldError(f"{path.name}: expected numbers below the names of the columns, got none", _EXAMPLE)
    if len(rows) > MAX_SAMPLES:
        raise FieldError(f"{path.name}: expected at most {MAX_SAMPLES} lines, got {len(rows)}", _THIN)
    for i, row in rows:
        if len(row) != len(names):
            raise FieldError(
                f"{path.name}, line {i}: expected {len(names)} cell{'s' * (len(names) != 1)}, got {len(row)}"
            )
    return {name: tuple(_cell(path, i, row[c], above) for i, row in rows) for c, name in enumerate(names)}


def _separator(line: str) -> str:
    """What separates the cells of a line."""
    return next((mark for mark in ("\t", ";", ",") if mark in line), ",")


def _cells(path: Path, i: int, line: str, separator: str) -> list[str]:
    """The cells of a line."""
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]
    except csv.Error as error:
        raise FieldError(f"{path.name}, line {i}: expected cells, got what can't be read ({error})") from None


def _is_number(cell: str) -> bool:
    """Whether a cell is meant as a number, in range or not."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def _cell(path: Path, line: int, cell: str, above: float) -> float:
    """The number of a cell."""
    number = float(cell) if _is_number(cell) else math.nan
    if not above < number < math.inf:
        wanted = "a finite number" if above == -math.inf else f"a finite number above {above:g}"
        raise FieldError(f"{path.name}, line {line}: expected {wanted}, got {show(cell)}")
    return number


def _item(i: int, item: Any, convert: Convert) -> float:
    """One number of a list."""
    try:
        return convert(item)
    except FieldError as error:
        raise FieldError(error.message, error.hint, (i,)) from None
