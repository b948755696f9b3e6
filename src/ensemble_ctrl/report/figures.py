"""Figures of the map: the fleet's trajectories, plans side by side, and what a run writes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.drawing import highest, outlines, shadow, target_lines
from ensemble_ctrl.problem.evaluation.sampled import all_paths, trajectories
from ensemble_ctrl.problem.starts import by_start, places
from ensemble_ctrl.problem.zones import Zone
from ensemble_ctrl.report.canvas import draw_scale, new_figure, placed_axes, save, shown_axes
from ensemble_ctrl.report.errors import patch_text
from ensemble_ctrl.report.palette import (
    CONTRAST,
    DASHES,
    KEEP_OUT,
    LINES,
    OBSTACLE,
    OBSTACLE_EDGE,
    ON_OBSTACLE,
    PATCH,
    PATCH_EDGE,
    REGION,
    SLOW,
    shades,
)
from ensemble_ctrl.report.projections import draw_paths, draw_spread, sheet
from ensemble_ctrl.report.text import literal, ranges_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

MEMBERS = 21
"""Members drawn."""
POINTS = 320
"""About as many points of a way are drawn, unless it has more steps."""
GHOSTS = 6
"""Times at which a moving obstacle is outlined."""
BODIES = 12
"""Times after the start at which a body is outlined."""
LEGEND_ROW = 0.08
"""Share of a map's height that each row of the legend of its terrain takes."""
MARGINS = (0.72, 1.26, 0.5, 0.45)
"""Inches at the left, right, below and above a map."""
VIEW_MARGINS = (0.78, 1.15, 0.5, 0.45)
"""The same for views."""


def on_map(problem: Problem) -> bool:
    """Whether a fleet is drawn on one map, as robots with a heading in the plane are; others are drawn in views."""
    return bool(problem.fleet.system.heading_state) and len(problem.fleet.places) == 2


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

    _draw_terrain(problem, ax)
    _draw_motions(problem, ax)
    for name, pieces in problem.obstacles.items():
        for piece in pieces:
            ax.add_patch(Polygon(piece.vertices, closed=True, facecolor=OBSTACLE, edgecolor=OBSTACLE_EDGE))
        largest = max(pieces, key=lambda piece: float(np.ptp(piece.vertices, axis=0).prod()))
        middle = largest.vertices.mean(axis=0)
        label = ax.annotate(literal(name), middle, ha="center", va="center", fontsize="small", color=ON_OBSTACLE)
        label.set_path_effects([withStroke(linewidth=2, foreground=OBSTACLE)])
    for name, zone in problem.zones.items():
        draw_zone(name, zone, ax)
    for name, corners in outlines(problem, paths).items():
        ax.add_patch(Polygon(corners, closed=True, facecolor=REGION, edgecolor="none", alpha=0.15))
        ax.add_patch(Polygon(corners, closed=True, fill=False, edgecolor=REGION, linewidth=1.5))
        ax.annotate(
            literal(name),
            tuple(highest(corners)),
            (0, 3),
            textcoords="offset points",
            ha="center",
            fontsize="small",
            color=REGION,
        )
    _draw_start(problem, ax)
    for line in target_lines(problem):
        marker = "x" if len(line) < 60 else ""
        ax.plot(line[:, 0], line[:, 1], ":", color="black", linewidth=1.0, marker=marker, markersize=5, zorder=4.5)
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    if problem.terrain:  # the legend stands above all of the map, and names of what lies at its top
        limits = ax.dataLim
        ax.update_datalim([(limits.x0, limits.y1 + LEGEND_ROW * (len(problem.terrain) + 1) * limits.height)])
    ax.margins(0.08)
    return ax


def draw_zone(name: str, zone: Zone, ax: Axes) -> None:
    """An area with a rule: hatched, with its name and rule."""
    from matplotlib.patches import Polygon
    from matplotlib.patheffects import withStroke

    colour, hatch = (KEEP_OUT, "xx") if zone.speed is None else (SLOW, "//")
    for piece in zone.pieces:
        shape = Polygon(piece.vertices, closed=True, facecolor="none", edgecolor=colour, hatch=hatch, alpha=0.6)
        ax.add_patch(shape)
    largest = max(zone.pieces, key=lambda piece: float(np.ptp(piece.vertices, axis=0).prod()))
    middle, text = largest.vertices.mean(axis=0), literal(f"{name}: {zone}")
    label = ax.annotate(text, middle, ha="center", va="center", fontsize="small", color=colour, zorder=4)
    label.set_path_effects([withStroke(linewidth=3, foreground="white")])


def _draw_terrain(problem: Problem, ax: Axes) -> None:
    """Patches of terrain, hatched, with the ranges in them."""
    from matplotlib.patches import Polygon
    from matplotlib.patheffects import withStroke

    for name, patch in problem.terrain.items():
        for piece in patch.pieces:
            ax.add_patch(
                Polygon(piece.vertices, closed=True, facecolor=PATCH, edgecolor=PATCH_EDGE, hatch="..", alpha=0.6)
            )
        largest = max(patch.pieces, key=lambda piece: float(np.ptp(piece.vertices, axis=0).prod()))
        middle = largest.vertices.mean(axis=0)
        label = ax.annotate(literal(name), middle, ha="center", va="center", fontsize="small", color=PATCH_EDGE)
        label.set_path_effects([withStroke(linewidth=2, foreground="white")])
    if problem.terrain:
        texts = [literal(f"{name}: {', '.join(patch_text(patch))}") for name, patch in problem.terrain.items()]
        ranges = Polygon([[0.0, 0.0]], facecolor=PATCH, edgecolor=PATCH_EDGE, hatch="..", alpha=0.6)
        ax.legend([ranges] * len(texts), texts, loc="upper left", fontsize="xx-small", framealpha=0.8)


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
    """Each start as an arrow head in the direction of the heading."""
    heading = problem.fleet.heading
    for name, place in places(problem).items():
        x, y = place.tolist()
        marker = (3, 0, np.degrees(heading) - 90)
        ax.plot(x, y, marker=marker, color="black", markersize=9, zorder=5, linestyle="none")
        # the label stands beside the heading, on the side of the map's middle
        inwards = ax.dataLim.get_points().mean(axis=0) - place
        side = float(np.sign(np.dot((-np.sin(heading), np.cos(heading)), inwards))) or 1.0
        away = (-17 * side * np.sin(heading), 11 * side * np.cos(heading))
        text = literal(name)
        ax.annotate(text, (x, y), away, textcoords="offset points", fontsize="small", ha="center", va="center")


def draw_trajectories(
    problem: Problem, controls: Floats, ax: Axes | None = None, baseline_controls: Floats | None = None
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
    baseline_controls : ndarray, shape (steps, n_u), optional
        Commands of the unconstrained baseline, whose trajectories are drawn thin and dashed below the plan's.

    Returns
    -------
    matplotlib Axes
        What was drawn on; nothing is shown.
    """
    from matplotlib.collections import LineCollection

    if not on_map(problem):
        return _draw_views(problem, controls, ax, baseline_controls)
    fleet = problem.fleet
    substeps = max(1, POINTS // problem.steps)
    paths, members = all_paths(problem, controls, fleet.spread(MEMBERS), substeps)
    ax = shown_axes(map_size(problem, controls, baseline_controls)) if ax is None else ax
    draw_map(problem, ax, list(paths))
    if baseline_controls is not None:
        _draw_baseline(trajectories(problem, baseline_controls, members[::2], substeps), ax)
    shade = shades(fleet, members)
    lines = LineCollection(list(paths), array=shade, cmap="viridis", linewidths=0.9, alpha=0.9, zorder=2)
    lines.set_clim(0.0, 1.0)
    ax.add_collection(lines)
    draw_bodies(problem, controls, ax)
    ax.scatter(paths[:, -1, 0], paths[:, -1, 1], c=shade, cmap="viridis", vmin=0, vmax=1, s=9, zorder=4)
    ax.autoscale_view()
    draw_scale(problem, ax)
    ax.set_title(literal(f"{problem.name}: one control, {ranges_text(fleet)}"), wrap=True, y=1.0)
    return ax


def draw_bodies(problem: Problem, controls: Floats, ax: Axes) -> None:
    """Outlines of the middle member's body at a few times; at the end those of the members at the ranges' corners."""
    from matplotlib.collections import PolyCollection

    body, some = problem.fleet.footprint, np.linspace(0, problem.steps, BODIES + 1).round().astype(int)
    if body is None:
        return
    members = np.concatenate([problem.fleet.center[None], problem.fleet.corners])
    each = [one.fleet.full_states(controls, members, problem.step) for one in by_start(problem).values()]
    poses = np.concatenate([part for full in each for part in (full[0, some], full[1:, -1])])
    shapes = body.at(poses[:, :2], poses[:, 2])
    outlines = PolyCollection(list(shapes), facecolors="none", edgecolors="black", linewidths=0.7, alpha=0.45, zorder=3)
    ax.add_collection(outlines)


def _draw_views(problem: Problem, controls: Floats, ax: Axes | None, baseline_controls: Floats | None) -> Axes:
    """Views of a fleet, one below the other; on given axes the first of them."""
    if ax is None:
        import matplotlib.pyplot as plt

        axes = sheet(problem, controls, plt.figure(), 7.2, VIEW_MARGINS)
    else:
        axes = [ax]
    draw_paths(problem, controls, axes, baseline_controls)
    axes[0].set_title(literal(f"{problem.name}: one control, {ranges_text(problem.fleet)}"), wrap=True)
    return axes[0]


def _view_figures(problem: Problem, controls: Floats, baseline_controls: Floats | None) -> dict[str, Figure]:
    """Views of a fleet, and its spread."""
    paths, spread = new_figure((7.2, 4.2)), new_figure((7.2, 4.2))
    axes = sheet(problem, controls, paths, 7.2, VIEW_MARGINS)
    draw_paths(problem, controls, axes, baseline_controls)
    axes[0].set_title(literal(f"{problem.name}: one control, {ranges_text(problem.fleet)}"), wrap=True)
    draw_spread(problem, controls, placed_axes(spread, 0.75, 0.2, 0.55, 0.45))
    return {"trajectories.png": paths, "spread.png": spread}


def _draw_baseline(paths: Floats, ax: Axes) -> None:
    """The unconstrained baseline's trajectories, named by one line of a legend."""
    for i, path in enumerate(paths):
        label = None if i else "unconstrained"
        ax.plot(path[:, 0], path[:, 1], "--", color=CONTRAST, linewidth=0.6, alpha=0.7, zorder=1.9, label=label)
    ax.legend(loc="best", fontsize="small")


def draw_comparison(problem: Problem, panels: Sequence[tuple[str, Floats]]) -> Figure:
    """Trajectories of several plans of one problem side by side, each under its own title."""
    width, height = map_size(problem, panels[0][1])
    figure = new_figure((width * len(panels), height))
    for k, (title, controls) in enumerate(panels):
        after = (len(panels) - 1 - k) * width
        ax = placed_axes(figure, MARGINS[0] + k * width, MARGINS[1] + after, *MARGINS[2:])
        draw_trajectories(problem, controls, ax).set_title(literal(title))
    return figure


def draw_panels(panels: Sequence[tuple[str, Problem, Floats]], width: float = 3.6, columns: int = 2) -> Figure:
    """Trajectories of plans of problems on one map, each under its own title, in rows of `columns`."""
    size = map_size(panels[0][1], panels[0][2], width=width)
    rows = -(-len(panels) // columns)
    figure = new_figure((size[0] * min(columns, len(panels)), size[1] * rows))
    for k, (title, problem, controls) in enumerate(panels):
        # inches from the left, the right, below and above to the panel's own margins
        row, column = divmod(k, columns)
        across = min(columns, len(panels)) - 1 - column
        left, right, bottom, top = MARGINS
        room = (left + column * size[0], right + across * size[0], bottom + (rows - 1 - row) * size[1])
        ax = placed_axes(figure, *room, top + row * size[1])
        draw_trajectories(problem, controls, ax).set_title(literal(title), fontsize=8)
    return figure


def write_figures(
    problem: Problem,
    controls: Floats,
    folder: Path,
    baseline_controls: Floats | None = None,
    routes: Sequence[Mapping[str, Any]] = (),
) -> list[str]:
    """Write ``trajectories.png``, ``controls.png`` and, of several routes, ``routes.png`` into `folder`.

    Returns
    -------
    list of str
        Their names.
    """
    from ensemble_ctrl.report.kinds.controls import draw_controls
    from ensemble_ctrl.report.routes import draw_routes

    control_figure = new_figure((7.2, 1.0 + 1.6 * controls.shape[1]))
    draw_controls(problem, controls, placed_axes(control_figure, 0.75, 0.2, 0.55, 0.4))
    if not on_map(problem):
        figures = _view_figures(problem, controls, baseline_controls)
    else:
        figures = {"trajectories.png": new_figure(map_size(problem, controls, baseline_controls))}
        draw_trajectories(problem, controls, placed_axes(figures["trajectories.png"], *MARGINS), baseline_controls)
    figures["controls.png"] = control_figure
    if len(routes) > 1 and on_map(problem) and not problem.fleet.starts:  # routes are of the middle of the starts
        figures["routes.png"] = draw_routes(problem, controls, routes)
    for name, figure in figures.items():
        save(figure, folder / name)
    return list(figures)


def map_size(
    problem: Problem,
    controls: Floats,
    baseline_controls: Floats | None = None,
    width: float = 7.2,
    margins: tuple[float, float, float, float] = MARGINS,
) -> tuple[float, float]:
    """Inches for a map of its own proportions, with `margins` for labels and the colour bar."""
    drawn = [controls] if baseline_controls is None else [controls, baseline_controls]
    ends = np.concatenate([all_paths(problem, c, problem.fleet.corners)[0] for c in drawn])
    shapes = [*outlines(problem, list(ends)).values(), *(piece.vertices for _, piece in problem.pieces)]
    across, up = np.ptp(np.concatenate([shadow(part) for part in (*ends, *shapes)]), axis=0)
    ratio = float(np.clip(up / max(across, 1e-9), 0.4, 1.1))
    left, right, bottom, top = margins
    return width, bottom + top + (width - left - right) * ratio


def line_style(k: int) -> dict[str, Any]:
    """Colour and dashes of line number `k`."""
    dashes = DASHES[k % len(DASHES)]
    pattern = (0, tuple(float(d) for d in dashes.split())) if dashes else "-"
    return {"color": LINES[k % len(LINES)], "linestyle": pattern}
