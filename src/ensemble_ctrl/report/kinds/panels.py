"""Panels one above the other in the place of one Axes, and legends that hide nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GAP = 0.1
"""Room between panels, in shares of the whole height."""


def panels(ax: Axes, count: int) -> list[Axes]:
    """`count` panels inside `ax`, the first on top; only the last has numbers along x. `ax` keeps its title."""
    ax.set_axis_off()
    height = (1.0 - GAP * (count - 1)) / count
    made = [ax.inset_axes((0.0, 1.0 - (k + 1) * height - k * GAP, 1.0, height)) for k in range(count)]
    for panel in made:
        panel.grid(alpha=0.3)
        panel.set_title("", y=1.0)  # a title with a place of its own is not searched for one, which takes long
    for panel in made[:-1]:
        panel.tick_params(labelbottom=False)
    return made


def legend_shape(names: Sequence[str]) -> tuple[int, int]:
    """Columns and rows of a legend that fits a column of a paper."""
    longest = max((len(name) for name in names), default=0)
    columns = 3 if longest <= 9 else 2 if longest <= 17 else 1
    return columns, -(-len(names) // columns)


def title_and_legend(ax: Axes, title: str) -> None:
    """The legend above the axes, where it hides nothing, and the title above the legend."""
    handles, names = ax.get_legend_handles_labels()
    columns, rows = legend_shape(names)
    ax.legend(
        handles,
        names,
        fontsize="small",
        ncols=columns,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.2,
        frameon=False,
        handlelength=2.6,
        columnspacing=1.0,
    )
    ax.set_title(title, pad=8 + 13 * rows)
