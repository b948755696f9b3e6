"""What came of a sweep: rows in order, as a table, a data frame, a file or a picture."""

from __future__ import annotations

import csv
import io
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ensemble_ctrl.api.planned import FACTS
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError, UnsupportedError
from ensemble_ctrl.core.storage import put_file
from ensemble_ctrl.core.values import path_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

FORMATS = ("csv", "parquet")
"""Endings of the files that a sweep can be written to."""


@dataclass(frozen=True, eq=False)
class Sweep:
    """Rows of a sweep.

    Attributes
    ----------
    name : str
        Of the problem, or of the first of many.
    axes : tuple of str
        The dotted keys that vary; with many files the first is ``file``.
    rows : tuple of dict
        In the order of the axes, the first of which changes slowest: their values, then the columns
        `ensemble_ctrl.api.planned.FACTS`. Lengths are in metres, times in seconds; what does not exist is None.
    total : int
        Rows that the whole sweep has; fewer are here after an interruption.

    Notes
    -----
    *Guarantee*: a row claims what its plan's certificate does; ``proven`` is ``yes`` only with one.
    """

    name: str
    axes: tuple[str, ...]
    rows: tuple[dict[str, Any], ...]
    total: int

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns."""
        return (*self.axes, *FACTS)

    def count(self, column: str, value: object) -> int:
        """How many rows have a value."""
        return sum(row[column] == value for row in self.rows)

    def to_csv(self) -> str:
        """The rows as comma-separated values: empty where there is no value, lists as JSON."""
        content = io.StringIO()
        writer = csv.writer(content, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([[_cell(row.get(name)) for name in self.columns] for row in self.rows])
        return content.getvalue()

    def to_dataframe(self) -> DataFrame:
        """The rows as a data frame; needs pandas.

        Raises
        ------
        UnsupportedError
            If pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise UnsupportedError("to_dataframe needs the library pandas: pip install pandas") from None
        return pd.DataFrame(list(self.rows), columns=list(self.columns))

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the rows to a ``.csv`` or a ``.parquet`` file, as a whole or not at all.

        Raises
        ------
        ProblemError
            For another ending.
        UnsupportedError
            For Parquet, if pyarrow is not installed.
        """
        path = path_of("path", path)
        form = path.suffix.removeprefix(".")
        if form not in FORMATS:
            raise ProblemError(f"path: expected a name that ends in .csv or .parquet, got {path.name!r}")
        put_file(path, self.to_csv() if form == "csv" else self._parquet())
        return path

    def plot(self, value: str = "cost", kind: str | None = None, ax: Axes | None = None) -> Axes:
        """Draw a column as a heat map or as curves; see `ensemble_ctrl.report.sweeps.draw_sweep`."""
        from ensemble_ctrl.report.sweeps import draw_sweep

        return draw_sweep(self.rows, self.axes, value, kind, ax)

    def _parquet(self) -> bytes:
        """The rows as a Parquet file."""
        try:
            import pyarrow as pa
            import pyarrow.parquet as pq
        except ImportError:
            raise UnsupportedError("Parquet needs the library pyarrow: pip install 'ensemble-ctrl[parquet]'") from None
        content = io.BytesIO()
        table = {name: _column([row.get(name) for row in self.rows]) for name in self.columns}
        pq.write_table(pa.table(table), content)
        return content.getvalue()

    def __repr__(self) -> str:
        over = ", ".join(self.axes)
        some = f"{len(self.rows)} of {self.total}" if len(self.rows) < self.total else str(self.total)
        return f"Sweep({self.name!r}: {some} rows over {over}, {self.count('proven', 'yes')} proven)"


def _cell(value: Any) -> Any:
    """One value as text."""
    if value is None or isinstance(value, str):
        return value
    return json.dumps(value)


def _column(values: list[Any]) -> list[Any]:
    """Values of one type: lists, and a mixture of texts and numbers, as texts."""
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float} or kinds in ({bool}, {str}):
        return values
    return [_cell(value) for value in values]
