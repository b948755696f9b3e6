"""What is proven of a plan and what was seen, for every duty and every part of the task."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ensemble_ctrl.certificate import Certificate
from ensemble_ctrl.report.palette import LINES, TWIN
from ensemble_ctrl.report.text import literal, short
from ensemble_ctrl.report.words import length

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROWS = 12
"""Bounds shown at most, the lowest first."""
LONGEST = 19
"""Letters of a part of the task."""


def draw_certificate(name: str, certificate: Certificate, ax: Axes) -> Axes:
    """A row for each bound: proven for every member as a bar, the worst seen as a dot; the truth lies between them."""
    rows = [(f"avoid({b.obstacle})", b.proven, b.sampled) for b in certificate.clearances]
    rows += [(b.part, b.proven, b.sampled) for b in certificate.parts]
    rows = sorted((row for row in rows if np.isfinite(row[1])), key=lambda row: row[1])[:ROWS]
    places = np.arange(len(rows))
    for place, (_, proven, seen) in zip(places, rows, strict=True):
        good = proven >= 0
        ax.barh(place, proven, height=0.5, color=LINES[0] if good else "white", edgecolor=LINES[0] if good else TWIN)
        if np.isfinite(seen):
            ax.plot(seen, place, "o", color="black", markersize=4)
        ax.annotate(length(proven), (max(proven, seen if np.isfinite(seen) else proven, 0.0), place), (6, 0),
                    textcoords="offset points", va="center", fontsize="small")  # fmt: skip
    ax.axvline(0.0, color="black", linewidth=0.8)
    ax.set_yticks(places, [literal(short(text, LONGEST)) for text, _, _ in rows])
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set(xlabel="proven (bar), worst seen (dot) [m]")
    low, high = ax.get_xlim()
    ax.set_xlim(low, high + 0.22 * (high - low))
    ax.grid(alpha=0.3, axis="x")
    ax.set_title(literal(f"{name}: proven: {certificate.proven}"))
    return ax
