"""A figure of the study of truncation orders: violation and cost, what moments allow, and truncation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ensemble_ctrl.report.canvas import new_figure, placed_axes
from ensemble_ctrl.report.palette import LINES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Rows = Sequence[Mapping[str, Any]]

PANEL = (3.1, 2.7)
"""Inches of one panel."""
MARGINS = (0.62, 0.2, 0.48, 0.32)
"""Inches at its left, right, below and above."""


def draw_orders(rows: Rows) -> Figure:
    """Four panels over the order: members that violate, cost, reach of moments, and truncation errors."""
    panels = (_violating, _costs, _reach, _truncation)
    figure = new_figure((2 * PANEL[0], 2 * PANEL[1]))
    left, right, bottom, top = MARGINS
    for k, draw in enumerate(panels):
        row, column = divmod(k, 2)
        room = (left + column * PANEL[0], right + (1 - column) * PANEL[0])
        ax = placed_axes(figure, *room, bottom + (1 - row) * PANEL[1], top + row * PANEL[1])
        draw(rows, ax)
        ax.set_xlabel("truncation order", fontsize=8)
        ax.tick_params(labelsize=8)
        ax.grid(alpha=0.3)
    return figure


def _plans(rows: Rows, form: str) -> list[Mapping[str, Any]]:
    """The plans of one form."""
    return [row for row in rows if row["kind"] == "plan" and row["form"] == form]


def _violating(rows: Rows, ax: Axes) -> None:
    """Share of members that violate the task, both forms."""
    for form, colour in zip(("published", "ours"), LINES, strict=False):
        own = _plans(rows, form)
        shares = [100 * row["violating"] / row["members"] for row in own]
        ax.plot([row["order"] for row in own], shares, "o-", ms=3, color=colour, label=form)
    ax.set_title("members that violate the task [%]", fontsize=8)
    ax.legend(fontsize=7)


def _costs(rows: Rows, ax: Axes) -> None:
    """Cost of both forms."""
    for form, colour in zip(("published", "ours"), LINES, strict=False):
        own = _plans(rows, form)
        ax.plot([row["order"] for row in own], [row["cost"] for row in own], "o-", ms=3, color=colour, label=form)
    ax.set_title("cost, worst member's robustness", fontsize=8)


def _reach(rows: Rows, ax: Axes) -> None:
    """What a function within the bounds on moments may reach."""
    own = [row for row in rows if row["kind"] == "reach"]
    ax.plot([row["order"] for row in own], [row["value"] for row in own], "o-", ms=3, color=LINES[0])
    ax.set_title("largest |x| that moments allow for |x| <= 1", fontsize=8)


def _truncation(rows: Rows, ax: Axes) -> None:
    """Truncation errors for each range."""
    own = [row for row in rows if row["kind"] == "truncation"]
    for half, colour in zip(dict.fromkeys(row["half_width"] for row in own), LINES, strict=False):
        line = [(row["order"], row["error"]) for row in own if row["half_width"] == half]
        ax.semilogy(*zip(*line, strict=True), "o-", ms=3, color=colour, label=f"1 ± {half:g}")
    ax.set_title("truncation error [m] for ranges of traction", fontsize=8)
    ax.legend(fontsize=7)
