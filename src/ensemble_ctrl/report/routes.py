"""The routes that a search tried: as a table, and as a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from ensemble_ctrl.report.text import literal

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
Tried = Mapping[str, Any]
"""A route of ``details["routes"]``: the fields of `ensemble_ctrl.ocp.candidates.Tried`."""

PLAN = "#1b7837"
LEGEND = 0.4
"""Inches for the legend."""
STYLES: dict[str, dict[str, Any]] = {
    "not feasible": {"color": "#c8c8c8", "linewidth": 0.6, "zorder": 1.7},
    "feasible": {"color": "#6a6a6a", "linewidth": 0.9, "zorder": 1.9},
    "kept": {"color": "#d95f02", "linewidth": 2.0, "zorder": 3.1},
}
"""How routes are drawn: kept, others whose coarse solution keeps the constraints, and the rest."""
HEADER = f"{'length':>9}{'coarse cost':>13}{'fine cost':>11}{'clearance':>12}{'time':>9}  {'outcome':<9}route"


def route_lines(routes: Sequence[Tried]) -> list[str]:
    """The table, a line each, shortest route first; costs are as minimised, clearances those of the coarse solve."""
    return [
        f"routes tried: {len(routes)} (X left: obstacle X lies to the left of the route)",
        HEADER,
        *map(_line, routes),
    ]


def _line(route: Tried) -> str:
    """One row."""
    fine = "-" if route["fine_cost"] is None else f"{route['fine_cost']:.4f}"
    clearance = f"{route['clearance']:.4f} m" if np.isfinite(route["clearance"]) else "-"
    return (
        f"{route['length']:>7.2f} m{route['cost']:>13.4f}{fine:>11}{clearance:>12}{route['seconds']:>7.2f} s"
        f"  {route['outcome']:<9}{route['name']}"
    )


def draw_routes(problem: Problem, controls: Floats, routes: Sequence[Tried]) -> Figure:
    """The routes as thin grey lines on the map, the one that was kept marked, and the plan that came of it.

    Parameters
    ----------
    problem : Problem
        Whose map.
    controls : ndarray, shape (steps, n_u)
        The plan's commands.
    routes : sequence of mappings
        Shortest first.
    """
    from ensemble_ctrl.report.canvas import new_figure, placed_axes
    from ensemble_ctrl.report.figures import MARGINS, draw_map, map_size

    left, right, bottom, top = MARGINS
    width, height = map_size(problem, controls)
    figure = new_figure((width, height + LEGEND))
    ax = placed_axes(figure, left, right, bottom + LEGEND, top)
    lines = [np.array(route["corners"], dtype=float).reshape(-1, 2) for route in routes]
    plan = trajectories(problem, controls, problem.fleet.center[None], 4)[0]
    draw_map(problem, ax, [*lines, plan])
    for kind, style in STYLES.items():
        chosen = [line for line, route in zip(lines, routes, strict=True) if _kind(route) == kind]
        for i, line in enumerate(chosen):
            label = None if i else kind if kind == "kept" else f"{len(chosen)} {kind}"
            ax.plot(line[:, 0], line[:, 1], label=label, **style)
    ax.plot(plan[:, 0], plan[:, 1], color=PLAN, linewidth=1.4, zorder=3.2, label="plan (middle member)")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=4, fontsize="small", frameon=False)
    ax.set_title(literal(f"{problem.name}: {len(routes)} routes tried"), y=1.0)
    return figure


def _kind(route: Tried) -> str:
    """How a route is drawn."""
    return "kept" if route["outcome"] == "kept" else "feasible" if route["feasible"] else "not feasible"
