"""Figures: the fleet's trajectories on the map, and the broadcast controls over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.replay import trajectories

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

MEMBERS = 21
"""Members drawn."""
OBSTACLE, REGION = "#8a8f98", "#2166ac"


def draw_map(problem: Problem, ax: Axes) -> Axes:
    """Obstacles, regions and the start, on `ax`; lengths in metres."""
    from matplotlib.patches import Polygon

    for name, pieces in problem.obstacles.items():
        for piece in pieces:
            ax.add_patch(Polygon(piece.vertices, closed=True, facecolor=OBSTACLE, edgecolor="#5a5f68", alpha=0.75))
        middle = np.mean([p.vertices.mean(axis=0) for p in pieces], axis=0)
        ax.annotate(name, middle, ha="center", va="center", fontsize=8, color="white")
    for name, region in problem.regions.items():
        corners = region.vertices
        ax.add_patch(Polygon(corners, closed=True, facecolor=REGION, edgecolor=REGION, alpha=0.15))
        ax.add_patch(Polygon(corners, closed=True, fill=False, edgecolor=REGION, linewidth=1.5))
        top = corners[corners[:, 1].argmax()]
        ax.annotate(name, (corners[:, 0].mean(), top[1]), xytext=(0, 3), textcoords="offset points",
                    ha="center", fontsize=8, color=REGION)
    start = problem.fleet.position
    ax.plot(*start, "k>", markersize=6, zorder=5)
    ax.annotate("start", start, xytext=(4, -10), textcoords="offset points", fontsize=8)
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    ax.autoscale_view()
    return ax


def draw_trajectories(problem: Problem, controls: Floats, ax: Axes | None = None) -> Axes:
    """Map and trajectories of members spread over the parameter's range, coloured by parameter.

    Parameters
    ----------
    problem : Problem
        Map and fleet.
    controls : ndarray, shape (steps, n_u)
        Broadcast commands.
    ax : matplotlib Axes, optional
        Where to draw; a new figure without it. Nothing is shown.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    ax = _new_axes((7.2, 5.6)) if ax is None else ax
    draw_map(problem, ax)
    law = problem.fleet.parameter
    parameters = np.linspace(law.lower, law.upper, MEMBERS)
    colours = ScalarMappable(Normalize(law.lower, law.upper), "viridis")
    for parameter, path in zip(parameters, trajectories(problem, controls, parameters, 4), strict=True):
        colour = colours.to_rgba(np.array(parameter))
        ax.plot(path[:, 0], path[:, 1], color=colour, linewidth=0.9, alpha=0.9)
        ax.plot(*path[-1], "o", color=colour, markersize=3, zorder=4)
    bar = ax.get_figure().colorbar(colours, ax=ax, shrink=0.8)  # type: ignore[union-attr]
    bar.set_label(problem.fleet.parameter_name)
    ax.set_title(f"{problem.name}: one control, {problem.fleet.parameter_name} {law.lower:g} to {law.upper:g}")
    return ax


def draw_controls(problem: Problem, controls: Floats) -> Figure:
    """The commands of every step over time, with their bounds dashed."""
    system, fleet = problem.fleet.system, problem.fleet
    figure = _new_figure((7.2, 4.2))
    axes: Any = figure.subplots(len(system.controls), 1, sharex=True, squeeze=False)[:, 0]
    for i, (ax, name, unit) in enumerate(zip(axes, system.controls, system.control_units, strict=True)):
        ax.stairs(controls[:, i], problem.times, baseline=None, linewidth=1.4)
        low, high = fleet.input_lower[i], fleet.input_upper[i]
        for bound in (low, high):
            ax.axhline(bound, linestyle="--", linewidth=0.8, color="#b2182b")
        ax.set_ylabel(f"{name} [{unit}]")
        pad = 0.08 * max(high - low, 1e-6)
        ax.set_ylim(low - pad, high + pad)
        ax.grid(alpha=0.3)
    axes[0].set_title(f"{problem.name}: broadcast controls (bounds dashed)")
    axes[-1].set(xlabel="t [s]", xlim=(0, problem.duration))
    return figure


def write_figures(problem: Problem, controls: Floats, folder: Path) -> list[str]:
    """Write ``trajectories.png`` and ``controls.png`` into `folder`; returns their names."""
    figures = {
        "trajectories.png": draw_trajectories(problem, controls).get_figure(),
        "controls.png": draw_controls(problem, controls),
    }
    for name, figure in figures.items():
        assert figure is not None
        figure.savefig(folder / name, dpi=150)
    return list(figures)


def _new_figure(size: tuple[float, float]) -> Figure:
    """A figure of its own, outside pyplot, so that nothing has to be closed."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _new_axes(size: tuple[float, float]) -> Axes:
    """Axes on a new figure."""
    axes: Axes = _new_figure(size).subplots()
    return axes
