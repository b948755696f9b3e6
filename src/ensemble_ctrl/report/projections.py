"""Figures of fleets that follow a differential equation: projections of space, a line over time, and their spread."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import OdeProblem
from ensemble_ctrl.replay import trajectories
from ensemble_ctrl.report.palette import OBSTACLE, OBSTACLE_EDGE, REGION
from ensemble_ctrl.report.scene import VIEWS, Scene, scenes
from ensemble_ctrl.report.text import parameter_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

MEMBERS = 21
"""Members drawn."""
LOOKS = 4
"""Times in a step at which they are drawn."""


def draw_paths(problem: OdeProblem, controls: Floats, axes: Sequence[Axes]) -> None:
    """Map and trajectories of members spread over the parameters' ranges, coloured by the first parameter.

    Parameters
    ----------
    problem : OdeProblem
    controls : ndarray, shape (steps, n_u)
    axes : sequence of matplotlib Axes
        One for each of `VIEWS`, or one for a position of one coordinate, which is drawn over time; where fewer are
        given, so many views are drawn.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    fleet = problem.fleet
    members = fleet.spread(MEMBERS)
    shade = members[:, 0] if fleet.names else np.zeros(len(members))
    colours = ScalarMappable(Normalize(shade.min(), shade.max()), "viridis")
    for ax, scene in zip(axes, scenes(problem, trajectories(problem, controls, members, LOOKS)), strict=False):
        _draw_shapes(scene, ax)
        for value, path in zip(shade, scene.paths, strict=True):
            colour = colours.to_rgba(np.array(value))
            ax.plot(*path.T, color=colour, linewidth=0.9, alpha=0.9)
            ax.plot(*path[-1:].T, "o", color=colour, markersize=3, zorder=4)
        ax.margins(0.08)
    if fleet.names:
        bar = axes[0].get_figure().colorbar(colours, ax=list(axes), fraction=0.05, pad=0.02)  # type: ignore[union-attr]
        bar.set_label(parameter_label(problem, fleet.names[0]))


def _draw_shapes(scene: Scene, ax: Axes) -> None:
    """Obstacles, regions and the start of one view; what lies beside the fleet's way is outlined only."""
    from matplotlib.patches import Polygon

    for shape in scene.obstacles:
        for corners, beside in zip(shape.pieces, shape.beside, strict=True):
            look: dict[str, Any] = (
                {"fill": False, "linestyle": ":", "zorder": 0.5} if beside else {"facecolor": OBSTACLE}
            )
            ax.add_patch(Polygon(corners, closed=True, edgecolor=OBSTACLE_EDGE, linewidth=0.9, **look))
    for corners in scene.regions.values():
        ax.add_patch(Polygon(corners, closed=True, facecolor=REGION, edgecolor=REGION, alpha=0.15))
    for name, (x, y) in scene.tags.items():
        ax.annotate(name, (x, y), (0, 3), textcoords="offset points", ha="center", fontsize=8, color=REGION)
    ax.plot(*scene.start, "ko", markersize=5, zorder=5)
    if scene.view is not None:
        ax.set_aspect("equal")
        ax.annotate("start", tuple(scene.start), (0, -12), textcoords="offset points", fontsize=8, ha="center")
    if scene.hidden:
        seen = f"along {scene.hidden}; dotted: beside the way"
        ax.annotate(seen, (0, 1), (4, -4), xycoords="axes fraction", textcoords="offset points", va="top", fontsize=7)
    across, up = scene.labels
    ax.set(xlabel=across, ylabel=up)


def _times(problem: OdeProblem, path: Floats) -> Floats:
    """Times of a path's points."""
    return np.linspace(0.0, problem.duration, len(path))


def draw_spread(problem: OdeProblem, controls: Floats, ax: Axes) -> None:
    """How far apart the members are over time, in each coordinate of the position: largest less smallest."""
    paths = trajectories(problem, controls, problem.fleet.grid(MEMBERS), LOOKS)
    apart = np.ptp(paths, axis=0)
    for k, name in enumerate(problem.fleet.places):
        ax.plot(_times(problem, apart), apart[:, k], label=name)
    ax.set(xlabel="t [s]", ylabel="largest distance between members [m]", xlim=(0, problem.duration))
    ax.set_title(f"{problem.name}: how the fleet spreads under one control", wrap=True)
    ax.grid(alpha=0.3)
    ax.legend(loc="upper left", fontsize=8)


def sheet(problem: OdeProblem, figure: Figure) -> list[Axes]:
    """Axes for every view on a figure, below each other."""
    count = max(1, len(VIEWS.get(len(problem.fleet.places), ())))
    axes: Any = figure.subplots(count, 1, squeeze=False)[:, 0]
    return list(axes)


def sheet_size(problem: OdeProblem, controls: Floats) -> tuple[float, float]:
    """Inches for all views of the map in its own proportions."""
    views = VIEWS.get(len(problem.fleet.places), ())
    if not views:
        return 7.2, 4.2
    paths = trajectories(problem, controls, problem.fleet.corners)
    corners = [piece.vertices for _, piece in problem.pieces]
    corners += [region.vertices for region in problem.regions.values() if region.is_bounded]
    size = np.ptp(np.concatenate([paths.reshape(-1, paths.shape[2]), *corners]), axis=0)
    ratios = [float(np.clip(size[j] / max(size[i], 1e-9), 0.3, 1.3)) for i, j in views]
    return 7.2, 0.9 + sum(5.6 * ratio + 0.4 for ratio in ratios)
