"""A picture of how much of one parameter's range another one costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.report.canvas import new_figure, placed_axes
from ensemble_ctrl.report.palette import GRID, LINES
from ensemble_ctrl.report.text import literal, parameter_label

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_boxes(problem: Problem, curve: Sequence[Mapping[str, float]], largest: Mapping[str, float]) -> Figure:
    """The half widths of certified boxes, and the one of the largest area.

    Parameters
    ----------
    problem : Problem
        The boxes stand around the middles of its fleet's ranges.
    curve : sequence of mapping of str to float
        Half widths of the two parameters, by their names, from the first alone to the second.
    largest : mapping of str to float
        Half widths of the box of the largest area.

    Notes
    -----
    *Guarantee*: every point of the shaded area is a box with a certified plan, since it is in one that has. Beyond it
    none was found.
    """
    from matplotlib.patches import Rectangle

    first, second = largest
    figure = new_figure((5.0, 3.6))
    ax = placed_axes(figure, 0.75, 0.25, 0.55, 0.4)
    points = sorted((point[first], point[second]) for point in curve)
    widths, heights = zip(*points, strict=True)
    # no point is in the box of another one, so that heights fall where widths grow
    ax.fill_between((0, *widths), (heights[0], *heights), step="pre", color=LINES[0], alpha=0.25, linewidth=0, zorder=1)
    ax.plot(widths, heights, "o", color=LINES[0], zorder=3, clip_on=False, label="certified box")
    size = largest[first], largest[second]
    label = "largest area"
    ax.add_patch(Rectangle((0, 0), *size, fill=False, edgecolor=LINES[1], linewidth=1.4, zorder=2, label=label))
    ax.set(xlabel=_label(problem, first), ylabel=_label(problem, second))
    ax.set(xlim=(0, 1.08 * max(widths)), ylim=(0, 1.08 * max(heights)))
    ax.grid(color=GRID)
    ax.legend(loc="upper right", fontsize="small")
    ax.set_title(literal(f"{problem.name}: what one range costs of the other"), y=1.0)
    return figure


def _label(problem: Problem, name: str) -> str:
    """An axis: the half width of a parameter's range."""
    return f"half width of {parameter_label(problem, name)}"
