"""Pictures of a sweep: a column as a heat map over two axes, or as curves over one."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.report.canvas import shown_axes
from ensemble_ctrl.report.palette import CONTRAST, LINES, SOFT
from ensemble_ctrl.report.text import literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Row = dict[str, Any]
KINDS = ("heatmap", "curves")
SIZE = (6.4, 4.2)
"""Inches of a figure of its own."""
UNITS = {
    **dict.fromkeys(("clearance", "robustness"), "m"),
    **dict.fromkeys(("duration", "seconds", "build_seconds", "solve_seconds", "proof_seconds"), "s"),
}
"""Of the columns that have one."""
OF_KEYS = {
    **dict.fromkeys(("duration", "time_limit", "bonmin_limit", "deadline", "delay", "jitter"), "s"),
    **dict.fromkeys(("radius", "margin", "wheelbase", "start_x", "start_y"), "m"),
    **dict.fromkeys(("heading", "start_heading"), "rad"),
}
"""Of the last words of keys whose values are numbers without a unit."""
MOST_CURVES = len(LINES)
"""Curves in one picture; values of a further axis beyond them are left out, and their number is said."""
_LEADING = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*")


@dataclass(frozen=True, eq=False)
class Scale:
    """The values of one axis in their order.

    Attributes
    ----------
    key : str
    values : list
        Each once, as in the rows.
    """

    key: str
    values: list[Any]

    @property
    def numbers(self) -> NDArray[np.float64] | None:
        """The values as numbers in one unit; None if they are none."""
        read = [_number(value) for value in self.values]
        return np.array([number for number, _ in read]) if len({unit for _, unit in read} - {"?"}) == 1 else None

    @property
    def label(self) -> str:
        """The key, with the unit of values that have none of their own."""
        unit = _number(self.values[0])[1] or OF_KEYS.get(self.key.rpartition(".")[2], "")
        return self.key if self.numbers is None or not unit else f"{self.key} [{unit}]"

    @property
    def ticks(self) -> list[str]:
        """The values as short texts."""
        return [value if isinstance(value, str) else json.dumps(_rounded(value)) for value in self.values]


def draw_sweep(
    rows: Sequence[Row], axes: Sequence[str], value: str = "cost", kind: str | None = None, ax: Axes | None = None
) -> Axes:
    """Draw a column of a sweep.

    Parameters
    ----------
    rows : sequence of dict
        Of a sweep.
    axes : sequence of str
        Keys that vary. Over more axes than two that have several values, rows are averaged.
    value : str
        The column. Rows that are not proven are marked by crosses.
    kind : {"heatmap", "curves"}, optional
        A heat map over two axes, which is what is drawn of two; or a curve over the first axis for each value of the
        second, which is what is drawn of one.
    ax : matplotlib Axes, optional
        Where to; without it a new figure of pyplot's.

    Returns
    -------
    Axes

    Raises
    ------
    ProblemError
        If nothing varies, the column has no numbers, or for another kind.
    """
    scales = [_scale(rows, key) for key in axes]
    scales = [scale for scale in scales if len(scale.values) > 1]
    known = [row for row in rows if isinstance(row.get(value), int | float)]
    if not scales or not known:
        what = "a column with numbers" if scales else "a sweep whose axes have several values"
        raise ProblemError(f"value: expected {what}, got {value!r}")
    if kind not in (None, *KINDS) or (kind == "heatmap" and len(scales) < 2):
        raise ProblemError(f"kind: expected curves, or heatmap of two axes with several values, got {kind!r}")
    ax = shown_axes(SIZE) if ax is None else ax
    if len(scales) == 1 or kind == "curves":
        _curves(rows, scales[0], scales[1:2], value, ax)
    else:
        _heat_map(rows, scales[0], scales[1], value, ax)
    rest = [scale.key for scale in scales[2:]]
    ax.set_title(literal(f"mean over {', '.join(rest)}") if rest else "", fontsize=9)
    return ax


def _curves(rows: Sequence[Row], across: Scale, other: Sequence[Scale], value: str, ax: Axes) -> None:
    """A column over one axis, for each value of another if there is one."""
    places = np.arange(len(across.values)) if across.numbers is None else across.numbers
    means, proven = (found.reshape(len(places), -1) for found in _means(rows, [across, *other], value))
    names = [f"{other[0].key} {tick}" for tick in other[0].ticks] if other else [""]
    for k, name in enumerate(names[:MOST_CURVES]):
        ax.plot(places, means[:, k], "o-", color=LINES[k], markersize=4, label=literal(name))
        lacking = np.logical_not(proven[:, k])
        # crosses at the bottom, one row of them for each curve
        bottom, over = np.full(int(lacking.sum()), 0.02 + 0.04 * k), ax.get_xaxis_transform()
        ax.plot(places[lacking], bottom, "x", color=LINES[k], transform=over, clip_on=False)
    if other:
        left = len(names) - MOST_CURVES
        ax.legend(frameon=False, fontsize=8, title=f"and {left} more" if left > 0 else None)
    if across.numbers is None:
        ax.set_xticks(places, [literal(text) for text in across.ticks], rotation=30, ha="right")
    ax.set_xlabel(literal(across.label))
    ax.set_ylabel(literal(_named(value)))
    ax.grid(alpha=0.3)


def _heat_map(rows: Sequence[Row], across: Scale, up: Scale, value: str, ax: Axes) -> None:
    """A column over two axes; cells that have no number are empty, those without a proof are crossed."""
    means, proven = _means(rows, [across, up], value)
    drawn = ax.imshow(means.T, origin="lower", aspect="auto", cmap="viridis")
    for column, row in np.argwhere(np.logical_not(proven)):
        ax.plot(column, row, "x", color=CONTRAST if np.isfinite(means[column, row]) else SOFT, markersize=7)
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.colorbar(drawn, ax=ax, label=literal(_named(value)))
    for axis, scale in ((ax.xaxis, across), (ax.yaxis, up)):
        shown = np.unique(np.linspace(0, len(scale.values) - 1, min(len(scale.values), 8)).round().astype(int))
        axis.set_ticks(shown.tolist(), labels=[literal(scale.ticks[i]) for i in shown])
    # ticks that are texts have their units
    names = [scale.key if isinstance(scale.values[0], str) else scale.label for scale in (across, up)]
    ax.set_xlabel(literal(names[0]))
    ax.set_ylabel(literal(names[1]))


def _means(rows: Sequence[Row], scales: Sequence[Scale], value: str) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The mean of a column for each place along some axes, and whether every row there is proven."""
    shape = [len(scale.values) for scale in scales]
    total, count, proven = np.zeros(shape), np.zeros(shape), np.ones(shape, dtype=bool)
    for row in rows:
        place = tuple(scale.values.index(row[scale.key]) for scale in scales)
        proven[place] &= row.get("proven") == "yes" or (row.get("proven") is None and bool(row.get("verified")))
        if isinstance(row.get(value), int | float):
            total[place] += row[value]
            count[place] += 1
    return np.divide(total, count, out=np.full(shape, np.nan), where=count > 0), proven


def _scale(rows: Sequence[Row], key: str) -> Scale:
    """The values that rows have along an axis, in their order."""
    values: list[Any] = []
    for row in rows:
        if row[key] not in values:
            values.append(row[key])
    return Scale(key, values)


def _number(value: Any) -> tuple[float, str]:
    """A value as a number and its unit; the unit of what is none is a question mark."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value), ""
    match = _LEADING.fullmatch(value) if isinstance(value, str) else None
    return (float(match[1]), match[2]) if match else (0.0, "?")


def _named(column: str) -> str:
    """A column with its unit."""
    return f"{column} [{UNITS[column]}]" if column in UNITS else column


def _rounded(value: Any) -> Any:
    """A value with few digits."""
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value
