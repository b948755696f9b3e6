"""Pictures of a fleet on several broadcast channels: who goes where, and clearance against the number of channels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from ensemble_ctrl.report.canvas import new_figure, placed_axes
from ensemble_ctrl.report.figures import MARGINS, POINTS, VIEW_MARGINS, draw_map, line_style, map_size, on_map
from ensemble_ctrl.report.map_content import map_contents
from ensemble_ctrl.report.palette import GRID, LINES, OBSTACLE
from ensemble_ctrl.report.projections import draw_shapes, sheet
from ensemble_ctrl.report.text import literal, ranges_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
Group = tuple[Problem, Floats]
"""A channel's problem, of its members alone, and its commands, shape (steps, n_u)."""

MEMBERS = 9
"""Members drawn of each channel."""
ROW = 0.2
"""Inches for each row of the legend."""


def draw_channels(problem: Problem, groups: Sequence[Group]) -> Figure:
    """Trajectories of every channel's members, one colour and dash pattern for each channel.

    Parameters
    ----------
    problem : Problem
        Of the whole fleet.
    groups : sequence of Group
        In the order of the channels.
    """
    paths = [trajectories(part, u, part.fleet.spread(MEMBERS), max(1, POINTS // part.steps)) for part, u in groups]
    legend = ROW * len(groups) + 0.3
    figure = new_figure((7.2, 4.0))
    if on_map(problem):
        axes = [_map(problem, groups, paths, figure, legend)]
        drawn = [paths]
    else:
        left, _, bottom, top = VIEW_MARGINS
        axes = sheet(problem, groups[0][1], figure, 7.2, (left, 0.2, bottom + legend / 2, top))
        contents = map_contents(problem, np.concatenate(paths))
        for content, ax in zip(contents, axes, strict=True):
            draw_shapes(content, ax)
        drawn = [np.split(np.asarray(content.paths), len(groups)) for content in contents]
    for ax, shown in zip(axes, drawn, strict=True):
        for k, ((part, _), group) in enumerate(zip(groups, shown, strict=True)):
            _draw_group(ax, k, group, f"channel {k + 1}: {ranges_text(part.fleet)}")
    below = -0.45 / (axes[-1].get_position().height * figure.get_size_inches()[1])
    axes[-1].legend(loc="upper left", bbox_to_anchor=(0.0, below), fontsize="small", frameon=False)
    axes[0].set_title(literal(f"{problem.name}: {len(groups)} broadcast channel{'s' * (len(groups) > 1)}"), y=1.0)
    return figure


def _map(problem: Problem, groups: Sequence[Group], paths: Sequence[Floats], figure: Figure, legend: float) -> Axes:
    """The map of a fleet in the plane, above a legend of so many inches."""
    left, _, bottom, top = MARGINS
    margins = (left, 0.2, bottom + legend, top)
    figure.set_size_inches(*map_size(problem, groups[0][1], margins=margins))
    return draw_map(problem, placed_axes(figure, *margins), [path for group in paths for path in group])


def _draw_group(ax: Axes, k: int, paths: Floats, name: str) -> None:
    """One channel's members."""
    style = line_style(k)
    for i, path in enumerate(paths):
        ax.plot(path[:, 0], path[:, 1], linewidth=0.9, alpha=0.9, zorder=2, label=None if i else literal(name), **style)
    ax.scatter(paths[:, -1, 0], paths[:, -1, 1], color=style["color"], s=9, zorder=4)


def draw_curve(problem: Problem, points: Sequence[tuple[int, float]], least: int) -> Figure:
    """The clearance that is proven of every channel against the number of channels.

    Parameters
    ----------
    problem : Problem
        Of the whole fleet.
    points : sequence of (int, float)
        Channels, and metres.
    least : int
        No fewer channels are enough.
    """
    from matplotlib.ticker import MaxNLocator

    figure = new_figure((5.0, 3.2))
    ax = placed_axes(figure, 0.75, 0.25, 0.55, 0.4)
    counts, clearances = zip(*points, strict=True)
    ax.step(counts, clearances, where="post", color=LINES[0], linewidth=1.2)
    ax.plot(counts, clearances, "o", color=LINES[0], label="found, proven")
    if least > 1:
        ax.axvspan(0.5, least - 0.5, color=OBSTACLE, alpha=0.3, linewidth=0, label="proven to be too few")
    ax.set(xlabel="broadcast channels", ylabel="least clearance [m]", xlim=(0.5, max(counts) + 0.5), ylim=(0, None))
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.grid(color=GRID)
    ax.legend(loc="upper left", fontsize="small", frameon=False)
    ax.set_title(literal(f"{problem.name}: what more channels buy"), y=1.0)
    return figure
