"""A plan as a table: one row for each grid time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import UnsupportedError
from ensemble_ctrl.files.export.members import Members, sampled
from ensemble_ctrl.problem import Problem

if TYPE_CHECKING:
    from pandas import DataFrame

Floats = NDArray[np.float64]


def columns(problem: Problem, controls: Floats, members: Members) -> dict[str, Floats]:
    """The columns of the table by their names with units, each of one length.

    Times are in whole nanoseconds. The last row, at the end of the horizon, is there only for members; its commands are
    NaN, since no step begins then.
    """
    system, rows = problem.fleet.system, len(controls) + bool(members.parameters)
    found = {"t [s]": problem.times[:rows].round(9)}
    for name, unit, values in zip(system.controls, system.control_units, controls.T, strict=True):
        found[f"{name} [{unit}]"] = np.concatenate([values, np.full(rows - len(values), np.nan)])
    for name, values in zip(members.names, members.values, strict=True):
        for state, unit, column in zip(members.states, members.units, values.T, strict=True):
            found[f"{state} [{unit}] ({name})" if unit else f"{state} ({name})"] = column
    return found


def frame(problem: Problem, controls: Floats, members: int = 0) -> DataFrame:
    """The table as a pandas data frame, by time.

    Raises
    ------
    UnsupportedError
        If pandas is not installed.
    """
    try:
        from pandas import DataFrame
    except ImportError:
        raise UnsupportedError("pandas is not installed: pip install pandas") from None
    table = columns(problem, controls, sampled(problem, controls, members))
    return DataFrame(table).set_index("t [s]")


def to_csv(problem: Problem, controls: Floats, members: Members) -> str:
    """The table as comma-separated values with every digit; a cell without a value is empty."""
    table = columns(problem, controls, members)
    return "\n".join([",".join(map(_cell, table)), *_rows(table)]) + "\n"


def _rows(table: dict[str, Floats]) -> Iterator[str]:
    """The rows as text."""
    for row in zip(*(column.tolist() for column in table.values()), strict=True):
        yield ",".join("" if value != value else repr(value) for value in row)


def _cell(text: str) -> str:
    """A name as a cell."""
    return '"' + text.replace('"', '""') + '"' if set(text) & set(',"\r\n') else text
