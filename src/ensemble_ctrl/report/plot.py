"""Pictures of a plan by the name of their kind, on given Axes or into a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.problem.evaluation.conflicts import units_of_parts
from ensemble_ctrl.report.canvas import COLUMN, PAPER, new_figure, place_axes, placed_axes, save, shown_axes
from ensemble_ctrl.report.figures import draw_trajectories, map_size, on_map
from ensemble_ctrl.report.kinds.certificate import draw_certificate
from ensemble_ctrl.report.kinds.clearance import draw_clearance
from ensemble_ctrl.report.kinds.controls import draw_controls
from ensemble_ctrl.report.kinds.moments import draw_moments
from ensemble_ctrl.report.kinds.panels import legend_shape
from ensemble_ctrl.report.kinds.robustness import draw_robustness
from ensemble_ctrl.report.projections import draw_paths, draw_spread, sheet
from ensemble_ctrl.report.text import PlanLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Margins = tuple[float, float, float, float]
"""Inches at the left, right, below and above."""
LEGEND_ROW = 0.16
"""Inches that each row of a legend above the picture takes."""
COMMAND = 1.2
"""Inches for each command of ``controls``."""
VIEW_MARGINS: Margins = (0.62, 0.9, 0.42, 0.2)
"""Around several drawings of one map."""


class Drawable(PlanLike, Protocol):
    """What a picture needs of a plan."""

    @property
    def baseline(self) -> NDArray[np.float64] | None:
        """Commands of the unconstrained baseline, if it was planned."""


@dataclass(frozen=True)
class PlotKind:
    """One kind of picture, and its shape in a column of a paper.

    Attributes
    ----------
    draw : callable
        Draws a plan on Axes and returns them.
    height : float or callable
        Inches without a legend; of a plan, where it depends on that.
    margins : tuple of float
        Inches at the left, right, below and above.
    legend : bool
        Whether a legend stands above, for which there is to be room.
    proof : bool
        Whether it shows what is proven, so that the command certifies the plan first.
    """

    draw: Callable[[Drawable, Axes], Axes]
    height: float | Callable[[Drawable], float] = 2.4
    margins: Margins = (0.56, 0.18, 0.42, 0.12)
    legend: bool = False
    proof: bool = False


def _trajectories(plan: Drawable, ax: Axes) -> Axes:
    """The map with members."""
    return draw_trajectories(plan.problem, plan.controls, ax, plan.baseline)


def _certificate(plan: Drawable, ax: Axes) -> Axes:
    """What is proven and what was seen."""
    assert plan.certificate is not None
    return draw_certificate(plan.problem.name, plan.certificate, ax, units_of_parts(plan.problem))


def _map_height(plan: Drawable) -> float:
    """That of a map; of several views, the usual one."""
    if not on_map(plan.problem):
        return 2.4
    return map_size(plan.problem, plan.controls, plan.baseline, COLUMN, KINDS["trajectories"].margins)[1]


KINDS: dict[str, PlotKind] = {
    "trajectories": PlotKind(_trajectories, _map_height, (0.5, 0.9, 0.42, 0.16)),
    "controls": PlotKind(
        lambda plan, ax: draw_controls(plan.problem, plan.controls, ax),
        lambda plan: 0.5 + COMMAND * len(plan.problem.fleet.system.controls),
        (0.66, 0.18, 0.42, 0.12),
    ),
    "moments": PlotKind(lambda plan, ax: draw_moments(plan.problem, plan.controls, ax), 3.2, (0.66, 0.18, 0.42, 0.12)),
    "robustness": PlotKind(lambda plan, ax: draw_robustness(plan.problem, plan.controls, ax), legend=True),
    "clearance": PlotKind(draw_clearance, legend=True, proof=True),
    "spread": PlotKind(lambda plan, ax: draw_spread(plan.problem, plan.controls, ax), 2.4, (0.66, 0.18, 0.42, 0.12)),
    "certificate": PlotKind(_certificate, 2.3, (1.35, 0.12, 0.42, 0.12), proof=True),
}
"""Every kind of picture by its name: `Plan.plot`, ``ensemble-plan plot`` and the results folder read it."""


def draw(plan: Drawable, kind: str, ax: Axes | None = None) -> Axes:
    """Draw one kind of picture.

    Parameters
    ----------
    plan : Drawable
        What to draw.
    kind : str
        Of `KINDS`.
    ax : matplotlib Axes, optional
        Where to; without it a new figure of pyplot's.

    Returns
    -------
    matplotlib Axes
        What was drawn on; nothing is shown. ``controls`` and ``moments`` put panels in its place: its `child_axes`.

    Raises
    ------
    ProblemError
        For another kind, and for the certificate of a plan without one.
    """
    if kind not in KINDS:
        raise ProblemError(f"kind: expected one of {', '.join(KINDS)}, got {kind!r}")
    if kind == "certificate" and plan.certificate is None:
        raise ProblemError("kind: expected a plan with a certificate, got one without; see Plan.certify")
    if kind == "trajectories":
        return draw_trajectories(plan.problem, plan.controls, ax, plan.baseline)
    return KINDS[kind].draw(plan, shown_axes((6.4, 4.4)) if ax is None else ax)


def write_plot(plan: Drawable, kind: str, path: Path, format: str = "png") -> Path:
    """One picture in a file, for a column of a paper: 3.5 inches wide, text of 8 points, no title.

    Parameters
    ----------
    plan : Drawable
        What to draw.
    kind : str
        Of `KINDS`.
    path : Path
        The file.
    format : {"png", "pdf", "svg"}
        What to write; PNG has 300 dots an inch.
    """
    from matplotlib import rc_context

    with rc_context(PAPER):
        shape = KINDS[kind]
        margins = shape.margins
        height = shape.height(plan) if callable(shape.height) else shape.height
        figure = new_figure((COLUMN, height), dpi=300)
        if kind == "trajectories" and not on_map(plan.problem):
            axes = sheet(plan.problem, plan.controls, figure, COLUMN, VIEW_MARGINS)
            draw_paths(plan.problem, plan.controls, axes, plan.baseline)
            ax = axes[0]
        else:
            ax = draw(plan, kind, placed_axes(figure, *margins))
        ax.set_title("")
        if shape.legend:
            _, rows = legend_shape(ax.get_legend_handles_labels()[1])
            room = rows * LEGEND_ROW
            figure.set_size_inches(COLUMN, height + room)
            place_axes(ax, *margins[:3], margins[3] + room)
        save(figure, path, format)
    return path
