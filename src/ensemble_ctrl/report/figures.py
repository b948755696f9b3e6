"""Figures: the fleet's trajectories on the map, and the broadcast controls over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.drawing import highest, outlines
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.replay import trajectories
from ensemble_ctrl.report.text import ranges_text
from ensemble_ctrl.target import Formation, SpreadTarget

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

MEMBERS = 21
"""Members drawn."""
GHOSTS = 6
"""Times at which a moving obstacle is outlined."""
OBSTACLE, REGION, TWIN = "#8a8f98", "#2166ac", "#b2182b"


def draw_map(problem: Problem, ax: Axes, paths: Sequence[Floats] = ()) -> Axes:
    """Draw obstacles, regions and the start.

    Parameters
    ----------
    problem : Problem
        Whose map.
    ax : matplotlib Axes
        Where to; lengths in metres.
    paths : sequence of ndarray, shape (times, 2)
        What else will be drawn: an unbounded region is shown as far as that.
    """
    from matplotlib.patches import Polygon
    from matplotlib.patheffects import withStroke

    _draw_motions(problem, ax)
    halo = [withStroke(linewidth=2, foreground="#5a5f68")]
    for name, pieces in problem.obstacles.items():
        for piece in pieces:
            ax.add_patch(Polygon(piece.vertices, closed=True, facecolor=OBSTACLE, edgecolor="#5a5f68"))
        largest = max(pieces, key=lambda piece: float(np.ptp(piece.vertices, axis=0).prod()))
        middle = largest.vertices.mean(axis=0)
        ax.annotate(name, middle, ha="center", va="center", fontsize=8, color="white", path_effects=halo)
    for name, corners in outlines(problem, paths).items():
        ax.add_patch(Polygon(corners, closed=True, facecolor=REGION, edgecolor="none", alpha=0.15))
        ax.add_patch(Polygon(corners, closed=True, fill=False, edgecolor=REGION, linewidth=1.5))
        top = tuple(highest(corners))
        ax.annotate(name, top, (0, 3), textcoords="offset points", ha="center", fontsize=8, color=REGION)
    _draw_start(problem, ax)
    _draw_target(problem, ax)
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    ax.margins(0.08)
    return ax


def _draw_motions(problem: Problem, ax: Axes) -> None:
    """Where moving obstacles go: their outline at a few times, fainter the later, and the way of their middle."""
    from matplotlib.patches import Polygon

    for name, motion in problem.motions.items():
        times = np.linspace(0.0, problem.duration, GHOSTS)
        for piece in problem.obstacles[name]:
            for k, offset in enumerate(motion.at(times)):
                shape = Polygon(piece.vertices + offset, closed=True, fill=False, edgecolor=OBSTACLE)
                shape.set(linewidth=0.8, linestyle="--", alpha=1.0 - 0.8 * k / GHOSTS)
                ax.add_patch(shape)
            way = piece.vertices.mean(axis=0) + motion.at(np.linspace(0.0, problem.duration, 101))
            ax.plot(way[:, 0], way[:, 1], ":", color=OBSTACLE, linewidth=1.0)


def _draw_start(problem: Problem, ax: Axes) -> None:
    """The start as an arrow head in the direction of the heading."""
    fleet = problem.fleet
    x, y = fleet.position.tolist()
    marker = (3, 0, np.degrees(fleet.heading) - 90)
    ax.plot(x, y, marker=marker, color="black", markersize=9, zorder=5, linestyle="none")
    behind = (-17 * np.cos(fleet.heading), -17 * np.sin(fleet.heading))
    ax.annotate("start", (x, y), behind, textcoords="offset points", fontsize=8, ha="center", va="center")


def _draw_target(problem: Problem, ax: Axes) -> None:
    """The places of a formation as a line, mean and covariance as the ellipse of one standard deviation."""
    target = problem.objective.target
    style: dict[str, Any] = {"color": "black", "linewidth": 1.0, "linestyle": ":", "zorder": 4.5}
    if isinstance(target, Formation):
        ax.plot(target.places[:, 0], target.places[:, 1], marker="x", markersize=5, **style)
    elif isinstance(target, SpreadTarget):
        values, vectors = np.linalg.eigh(target.covariance)
        turn = np.linspace(0, 2 * np.pi, 65)
        round_ = np.stack([np.cos(turn), np.sin(turn)], axis=1) * np.sqrt(np.maximum(values, 0.0))
        ellipse = target.mean + round_ @ vectors.T
        ax.plot(ellipse[:, 0], ellipse[:, 1], **style)


def draw_trajectories(
    problem: Problem, controls: Floats, ax: Axes | None = None, twin_controls: Floats | None = None
) -> Axes:
    """Map and trajectories of members spread over the parameter's range, coloured by parameter.

    Parameters
    ----------
    problem : Problem
        Map and fleet.
    controls : ndarray, shape (steps, n_u)
        Broadcast commands.
    ax : matplotlib Axes, optional
        Where to draw; without it a new figure of pyplot's, so that a notebook or a later ``show`` shows it.
    twin_controls : ndarray, shape (steps, n_u), optional
        Commands of the unconstrained twin, whose trajectories are drawn thin and dashed below the plan's.

    Returns
    -------
    matplotlib Axes
        What was drawn on; nothing is shown.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    fleet = problem.fleet
    members = fleet.spread(MEMBERS)
    paths = trajectories(problem, controls, members, 4)
    ax = _shown_axes(map_size(problem, controls, twin_controls)) if ax is None else ax
    draw_map(problem, ax, list(paths))
    if twin_controls is not None:
        _draw_twin(trajectories(problem, twin_controls, members[::2], 4), ax)
    shade = members[:, 0] if fleet.names else np.zeros(len(members))
    colours = ScalarMappable(Normalize(shade.min(), shade.max()), "viridis")
    for value, path in zip(shade, paths, strict=True):
        colour = colours.to_rgba(np.array(value))
        ax.plot(path[:, 0], path[:, 1], color=colour, linewidth=0.9, alpha=0.9)
        ax.plot(*path[-1], "o", color=colour, markersize=3, zorder=4)
    if fleet.names:
        bar = ax.get_figure().colorbar(colours, ax=ax, fraction=0.05, pad=0.02)  # type: ignore[union-attr]
        bar.set_label(fleet.names[0])
    ax.set_title(f"{problem.name}: one control, {ranges_text(fleet)}", wrap=True)
    return ax


def _draw_twin(paths: Floats, ax: Axes) -> None:
    """The unconstrained twin's trajectories, named by one line of a legend."""
    for i, path in enumerate(paths):
        label = None if i else "unconstrained"
        ax.plot(path[:, 0], path[:, 1], "--", color=TWIN, linewidth=0.6, alpha=0.7, zorder=1.9, label=label)
    ax.legend(loc="best", fontsize=8)


def draw_comparison(problem: Problem, panels: Sequence[tuple[str, Floats]]) -> Figure:
    """Trajectories of several plans of one problem side by side, each under its own title."""
    width, height = map_size(problem, panels[0][1])
    figure = new_figure((0.75 * width * len(panels), height))
    axes: Any = figure.subplots(1, len(panels), squeeze=False)[0]
    for ax, (title, controls) in zip(axes, panels, strict=True):
        draw_trajectories(problem, controls, ax).set_title(title)
    return figure


def draw_controls(problem: Problem, controls: Floats) -> Figure:
    """The commands of every step over time, with their bounds dashed."""
    system, fleet = problem.fleet.system, problem.fleet
    figure = new_figure((7.2, 4.2))
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


def write_figures(
    problem: Problem,
    controls: Floats,
    folder: Path,
    twin_controls: Floats | None = None,
    routes: Sequence[Mapping[str, Any]] = (),
) -> list[str]:
    """Write ``trajectories.png``, ``controls.png`` and, of several routes, ``routes.png`` into `folder`.

    Returns
    -------
    list of str
        Their names.
    """
    from ensemble_ctrl.report.routes import draw_routes

    trajectory_figure = new_figure(map_size(problem, controls, twin_controls))
    draw_trajectories(problem, controls, trajectory_figure.subplots(), twin_controls)
    figures = {"trajectories.png": trajectory_figure, "controls.png": draw_controls(problem, controls)}
    if len(routes) > 1:
        figures["routes.png"] = draw_routes(problem, controls, routes)
    for name, figure in figures.items():
        figure.savefig(folder / name, dpi=150)
    return list(figures)


def map_size(problem: Problem, controls: Floats, twin_controls: Floats | None = None) -> tuple[float, float]:
    """Inches for a map of its own proportions, with room for labels and the colour bar."""
    drawn = [controls] if twin_controls is None else [controls, twin_controls]
    ends = np.concatenate([trajectories(problem, c, problem.fleet.corners) for c in drawn])
    shapes = [*outlines(problem, list(ends)).values(), *(piece.vertices for _, piece in problem.pieces)]
    width, height = np.ptp(np.concatenate([*ends, *shapes]), axis=0)
    ratio = float(np.clip(height / max(width, 1e-9), 0.4, 1.1))
    return 7.2, 1.0 + 5.6 * ratio


def new_figure(size: tuple[float, float]) -> Figure:
    """A figure of its own, outside pyplot, so that nothing has to be closed."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="compressed")
    FigureCanvasAgg(figure)
    return figure


def _shown_axes(size: tuple[float, float]) -> Axes:
    """Axes on a new figure of pyplot's."""
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=size, layout="compressed")
    return figure.subplots()
