"""Figures of fleets that follow a differential equation: projections of space, a line over time, and their spread."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.drawing import shadow
from ensemble_ctrl.problem import OdeProblem
from ensemble_ctrl.replay import trajectories
from ensemble_ctrl.report.palette import OBSTACLE, OBSTACLE_EDGE, REGION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
View = tuple[int, int]

MEMBERS = 21
"""Members drawn."""
LOOKS = 4
"""Times in a step at which they are drawn."""
VIEWS: dict[int, tuple[View, ...]] = {2: ((0, 1),), 3: ((0, 1), (0, 2))}
"""Pairs of coordinates that are drawn, for so many: the plane, or space from above and from the side."""


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
    paths = trajectories(problem, controls, members, LOOKS)
    shade = members[:, 0] if fleet.names else np.zeros(len(members))
    colours = ScalarMappable(Normalize(shade.min(), shade.max()), "viridis")
    views = VIEWS.get(len(fleet.places), ())
    for ax, view in zip(axes, views or [None], strict=False):
        if view is None:
            _draw_bands(problem, ax)
        else:
            _draw_shapes(problem, ax, view, paths)
        for value, path in zip(shade, paths, strict=True):
            colour = colours.to_rgba(np.array(value))
            x, y = (_times(problem, path), path[:, 0]) if view is None else path[:, list(view)].T
            ax.plot(x, y, color=colour, linewidth=0.9, alpha=0.9)
            ax.plot(x[-1], y[-1], "o", color=colour, markersize=3, zorder=4)
        ax.margins(0.08)
    if fleet.names:
        bar = axes[0].get_figure().colorbar(colours, ax=list(axes), fraction=0.05, pad=0.02)  # type: ignore[union-attr]
        bar.set_label(fleet.names[0])


def _draw_shapes(problem: OdeProblem, ax: Axes, view: View, paths: Floats) -> None:
    """Obstacles and regions seen along the coordinates that are not drawn.

    What lies beside the fleet's way there, so that it would hide the way, is outlined only.
    """
    from matplotlib.patches import Polygon

    hidden = [k for k in range(paths.shape[2]) if k not in view]
    low, high = paths[..., hidden].min(axis=(0, 1)), paths[..., hidden].max(axis=(0, 1))
    for _, piece in problem.pieces:
        corners = piece.vertices
        met = (corners[:, hidden].min(axis=0) <= high).all() and (corners[:, hidden].max(axis=0) >= low).all()
        look: dict[str, Any] = {"facecolor": OBSTACLE} if met else {"fill": False, "linestyle": ":", "zorder": 0.5}
        ax.add_patch(Polygon(shadow(corners, view), closed=True, edgecolor=OBSTACLE_EDGE, linewidth=0.9, **look))
    for name, region in problem.regions.items():
        if region.is_bounded:
            corners = shadow(region.vertices, view)
            ax.add_patch(Polygon(corners, closed=True, facecolor=REGION, edgecolor=REGION, alpha=0.15))
            top = (corners[:, 0].mean(), corners[:, 1].max())
            ax.annotate(name, top, (0, 3), textcoords="offset points", ha="center", fontsize=8, color=REGION)
    start = problem.fleet.position[list(view)]
    ax.plot(*start, "ko", markersize=5, zorder=5)
    ax.annotate("start", (start[0], start[1]), (0, -12), textcoords="offset points", fontsize=8, ha="center")
    names = [problem.fleet.places[k] for k in view]
    if hidden:
        seen = f"along {problem.fleet.places[hidden[0]]}; dotted: beside the way"
        ax.annotate(seen, (0, 1), (4, -4), xycoords="axes fraction", textcoords="offset points", va="top", fontsize=7)
    ax.set(xlabel=f"{names[0]} [m]", ylabel=f"{names[1]} [m]", aspect="equal")


def _draw_bands(problem: OdeProblem, ax: Axes) -> None:
    """Regions of the line as bands over time."""
    for name, region in problem.regions.items():
        if region.is_bounded:
            low, high = region.vertices[:, 0]
            ax.axhspan(low, high, color=REGION, alpha=0.15)
            ax.annotate(name, (0, high), (3, -10), textcoords="offset points", fontsize=8, color=REGION)
    ax.set(xlabel="t [s]", ylabel=f"{problem.fleet.places[0]} [m]")


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


def sheet(problem: OdeProblem, controls: Floats, figure: Figure) -> list[Axes]:
    """Axes for every view on a figure, side by side or below each other, whichever wastes less."""
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
