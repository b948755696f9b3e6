"""Figures of fleets that follow a differential equation: projections of space, a line over time, and their spread."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import all_paths, trajectories
from ensemble_ctrl.report.canvas import draw_scale, placed_axes
from ensemble_ctrl.report.map_content import OVER_TIME, MapContent, map_contents
from ensemble_ctrl.report.palette import (
    CONTRAST,
    KEEP_OUT,
    OBSTACLE,
    OBSTACLE_EDGE,
    ON_OBSTACLE,
    REGION,
    SLOW,
    shades,
    viridis,
)
from ensemble_ctrl.report.text import literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

MEMBERS = 21
"""Members drawn."""
SUBSTEPS = 4
"""Times in a step at which they are drawn."""
GHOSTS = 6
"""Times at which a moving obstacle is outlined."""
GAP = 0.1
"""Inches between views, besides the margin."""


def draw_paths(
    problem: Problem, controls: Floats, axes: Sequence[Axes], baseline_controls: Floats | None = None
) -> None:
    """Map and trajectories of members spread over the parameters' ranges, coloured by the first parameter.

    Parameters
    ----------
    problem : Problem
    controls : ndarray, shape (steps, n_u)
    axes : sequence of matplotlib Axes
        One for each of `ensemble_ctrl.report.map_content.map_contents`; where fewer are given, so many views are drawn.
    baseline_controls : ndarray, shape (steps, n_u), optional
        Commands of the unconstrained baseline, whose trajectories are drawn thin and dashed.
    """
    fleet = problem.fleet
    paths, members = all_paths(problem, controls, fleet.spread(MEMBERS), SUBSTEPS)
    colours = viridis(shades(fleet, members)) / 255
    for ax, content in zip(axes, map_contents(problem, paths), strict=False):
        draw_shapes(content, ax)
        for colour, path in zip(colours, content.paths, strict=True):
            ax.plot(*path.T, color=colour, linewidth=0.9, alpha=0.9)
            ax.plot(*path[-1:].T, "o", color=colour, markersize=3, zorder=4)
        ax.margins(0.06, 0.16)
    if baseline_controls is not None:
        whole = trajectories(problem, baseline_controls, members[::2], SUBSTEPS)
        for ax, content in zip(axes, map_contents(problem, whole), strict=False):
            for path in content.paths:
                ax.plot(*path.T, "--", color=CONTRAST, linewidth=0.6, alpha=0.7, zorder=1.9)
    for ax in axes:
        draw_scale(problem, ax)


def draw_shapes(content: MapContent, ax: Axes) -> None:
    """Obstacles, regions and the start of one view; what lies beside the fleet's way is outlined only."""
    from matplotlib.patches import Polygon
    from matplotlib.patheffects import withStroke

    for shape in content.obstacles:
        for corners, beside in zip(shape.pieces, shape.beside, strict=True):
            look: dict[str, Any] = (
                {"fill": False, "linestyle": ":", "zorder": 0.5} if beside else {"facecolor": OBSTACLE}
            )
            ax.add_patch(Polygon(corners, closed=True, edgecolor=OBSTACLE_EDGE, linewidth=0.9, **look))
        if shape.motion is not None:
            for k, offset in enumerate(shape.motion.at(np.linspace(0.0, content.problem.duration, GHOSTS))):
                for corners in shape.pieces:
                    ghost = Polygon(corners + offset, closed=True, fill=False, edgecolor=OBSTACLE, linestyle="--")
                    ghost.set(linewidth=0.8, alpha=1.0 - 0.8 * k / GHOSTS)
                    ax.add_patch(ghost)
        if not all(shape.beside):
            middle = shape.largest.mean(axis=0)
            label = ax.annotate(literal(shape.name), middle, ha="center", va="center", fontsize=8, color=ON_OBSTACLE)
            label.set_path_effects([withStroke(linewidth=2, foreground=OBSTACLE)])
    colours = {n: KEEP_OUT if zone.speed is None else SLOW for n, zone in content.zones.items()}
    for name, corners in content.regions.items():
        colour = colours.get(name, REGION)
        ax.add_patch(Polygon(corners, closed=True, facecolor=colour, edgecolor=colour, alpha=0.15))
    for name, (x, y) in content.tags.items():
        text, colour = literal(name), colours.get(name, REGION)
        ax.annotate(text, (x, y), (0, 3), textcoords="offset points", ha="center", fontsize=8, color=colour)
    for line in content.lines:
        marker = "x" if len(line) < 60 else ""
        ax.plot(*line.T, ":", color="black", linewidth=1.0, marker=marker, markersize=5, zorder=4.5)
    if content.view is not None:
        ax.set_aspect("equal")
    for name, start in content.starts.items():
        ax.plot(*start, "ko", markersize=5, zorder=5)
        if content.view is not None:
            # on the side of the map's middle
            inwards = float(ax.dataLim.get_points().mean(axis=0)[0]) >= start[0]
            shift, align = (-4, "left") if inwards else (4, "right")
            ax.annotate(literal(name), tuple(start), (shift, -12), textcoords="offset points", fontsize=8, ha=align)
    across, up = content.labels
    seen = f" (seen along {content.hidden}; dotted: beside the way)" if content.hidden else ""
    ax.set(xlabel=literal(f"{across}{seen}"), ylabel=literal(up))


def _times(problem: Problem, path: Floats) -> Floats:
    """Times of a path's points."""
    return np.linspace(0.0, problem.duration, len(path))


def draw_spread(problem: Problem, controls: Floats, ax: Axes) -> Axes:
    """How far apart the members are over time, in each coordinate of the position: largest less smallest."""
    paths, _ = all_paths(problem, controls, problem.fleet.grid(MEMBERS), SUBSTEPS)
    # max_i p(t; psi_i) - min_i p(t; psi_i) in each coordinate
    apart = np.ptp(paths, axis=0)
    for k, name in enumerate(problem.fleet.places):
        ax.plot(_times(problem, apart), apart[:, k], label=literal(name))
    ax.set(xlabel="t [s]", ylabel="extent of the fleet [m]", xlim=(0, problem.duration))
    ax.set_ylim(0.0, max(1.05 * float(apart.max()), 0.01))
    ax.set_title(literal(f"{problem.name}: how the fleet spreads under one control"), wrap=True)
    ax.grid(alpha=0.3)
    ax.legend(loc="upper left", fontsize="small")
    return ax


def sheet(
    problem: Problem, controls: Floats, figure: Figure, width: float, margins: tuple[float, float, float, float]
) -> list[Axes]:
    """Axes for every view below each other, in its own proportions, on a figure that is made as high as they need.

    Parameters
    ----------
    problem : Problem
    controls : ndarray, shape (steps, n_u)
    figure : matplotlib Figure
    width : float
        Of the figure, inches.
    margins : tuple of float
        Inches at the left, right, below and above; every view has as much below it.
    """
    left, right, below, above = margins
    inner = width - left - right
    heights = [inner * ratio for ratio in _ratios(problem, controls)]
    height = above + sum(heights) + len(heights) * below + (len(heights) - 1) * GAP
    figure.set_size_inches(width, height)
    made, top = [], above
    for each in heights:
        made.append(placed_axes(figure, left, right, height - top - each, top))
        top += each + below + GAP
    return made


def _ratios(problem: Problem, controls: Floats) -> list[float]:
    """Heights of all views, in widths."""
    found = []
    for content in map_contents(problem, all_paths(problem, controls, problem.fleet.corners)[0]):
        across, up = np.ptp(np.concatenate([*content.paths, *_shapes(content)]), axis=0)
        found.append(float(np.clip(up / max(across, 1e-9), 0.3, 1.3)) if content.view else OVER_TIME)
    return found


def _shapes(content: MapContent) -> list[Floats]:
    """Corners of everything that is drawn."""
    return [
        *content.regions.values(),
        *content.lines,
        *(corners for shape in content.obstacles for corners in shape.pieces),
    ]
