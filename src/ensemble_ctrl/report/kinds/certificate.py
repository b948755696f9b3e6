"""What is proven of a plan and what was seen, for every avoided obstacle and every part of the task."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate import Certificate
from ensemble_ctrl.report.palette import CONTRAST, LINES
from ensemble_ctrl.report.text import literal, short
from ensemble_ctrl.report.words import length

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROWS = 12
"""Bounds shown at most, the lowest first."""
LONGEST = 19
"""Letters of a part of the task."""
LONGEST_UNIT = 5
"""Of a unit beside a bar."""
APART = 10.0
"""Times by which the largest number exceeds the smallest before the axis is logarithmic."""
LEAST = 1e-4
"""Metres below which even that axis is linear."""


def draw_certificate(name: str, certificate: Certificate, ax: Axes, units: Mapping[str, str]) -> Axes:
    """A row for each bound: proven for every member as a bar, the worst seen as a dot; the truth lies between them."""
    rows = [(f"avoid({b.obstacle})", b.proven, b.sampled, "m") for b in certificate.clearances]
    rows += [(b.part, b.proven, b.sampled, units.get(b.part, "m")) for b in certificate.parts]
    rows = sorted((row for row in rows if np.isfinite(row[1])), key=lambda row: row[1])[:ROWS]
    places = np.arange(len(rows))
    for place, (_, proven, seen, unit) in zip(places, rows, strict=True):
        good = proven >= 0
        ax.barh(
            place, proven, height=0.5, color=LINES[0] if good else "white", edgecolor=LINES[0] if good else CONTRAST
        )
        if np.isfinite(seen):
            ax.plot(seen, place, "o", color="black", markersize=4)
        ax.annotate(_number(proven, unit), (max(proven, seen if np.isfinite(seen) else proven, 0.0), place), (6, 0),
                    textcoords="offset points", va="center", fontsize="small")  # fmt: skip
    ax.axvline(0.0, color="black", linewidth=0.8)
    ax.set_yticks(places, [literal(short(text, LONGEST)) for text, *_ in rows])
    ax.set_ylim(len(rows) - 0.4, -0.6)
    unit = "m" if all(unit == "m" for *_, unit in rows) else "SI"
    ax.set(xlabel=f"proven (bar), worst seen (dot) [{unit}]")
    _scale(ax, unit, np.array([value for _, *both, _ in rows for value in both if np.isfinite(value)]))
    ax.grid(alpha=0.3, axis="x")
    ax.set_title(literal(f"{name}: proven: {certificate.proven}"))
    return ax


def _number(proven: float, unit: str) -> str:
    """A bound with its unit, where that is one and not words about several."""
    return length(proven, unit) if len(unit) <= LONGEST_UNIT else length(proven, "SI")


def _scale(ax: Axes, unit: str, values: NDArray[np.float64]) -> None:
    """Room for the numbers beside the bars, and a logarithmic axis where a linear one would hide the tightest."""
    sizes = np.maximum(np.abs(values[values != 0]), LEAST)
    if sizes.size and sizes.max() > APART * sizes.min():
        start = 10.0 ** np.floor(np.log10(sizes.min()))
        ax.set_xscale("symlog", linthresh=start)
        ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        ax.set_xlabel(f"proven (bar), seen (dot) [{unit}, log]")
    to_axis = ax.xaxis.get_transform()
    low, high = to_axis.transform(np.array([min(values.min(initial=0.0), 0.0), max(values.max(initial=0.0), 0.0)]))
    room = max(high - low, 1e-9)
    ax.set_xlim(*to_axis.inverted().transform(np.array([low - 0.04 * room * (low < 0), high + 0.32 * room])))
