"""Pictures of a plan by the name of their kind, on given Axes or into a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.problem import OdeProblem
from ensemble_ctrl.problem.evaluation.conflicts import units_of_parts
from ensemble_ctrl.report.canvas import COLUMN, PAPER, new_figure, place_axes, placed_axes, save, shown_axes
from ensemble_ctrl.report.figures import draw_trajectories, map_size
from ensemble_ctrl.report.kinds.panels import legend_shape
from ensemble_ctrl.report.projections import draw_paths, sheet
from ensemble_ctrl.report.text import PlanLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes

KINDS = ("trajectories", "controls", "moments", "robustness", "clearance", "certificate")
"""Names of the kinds of pictures."""
SIZES = {"moments": 3.2, "certificate": 2.3}
"""Heights in inches at paper column width; else `HEIGHT`."""
HEIGHT = 2.4
COMMAND = 1.2
"""Inches for each command of ``controls``."""
MARGINS = {
    "trajectories": (0.5, 0.9, 0.42, 0.16),
    "views": (0.62, 0.9, 0.42, 0.2),
    "moments": (0.66, 0.12, 0.42, 0.12),
    "certificate": (1.35, 0.12, 0.42, 0.12),
}
"""Inches at the left, right, below and above; else `AROUND`. ``views`` are several drawings of one map."""
LEGENDS, LEGEND_ROW = ("robustness", "clearance"), 0.16
"""Kinds with a legend above, and the inches that each of its rows takes."""
AROUND = (0.56, 0.12, 0.42, 0.12)


class Drawable(PlanLike, Protocol):
    """What a picture needs of a plan."""

    @property
    def twin(self) -> NDArray[np.float64] | None:
        """Commands of the unconstrained twin, if it was planned."""


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
    if kind == "trajectories":
        return draw_trajectories(plan.problem, plan.controls, ax, plan.twin)
    certificate = plan.certificate
    if kind == "certificate" and certificate is None:
        raise ProblemError("kind: expected a plan with a certificate, got one without; see Plan.certify")
    ax = shown_axes((6.4, 4.4)) if ax is None else ax
    if kind == "certificate" and certificate is not None:
        from ensemble_ctrl.report.kinds.certificate import draw_certificate

        return draw_certificate(plan.problem.name, certificate, ax, units_of_parts(plan.problem))
    if kind == "clearance":
        from ensemble_ctrl.report.kinds.clearance import draw_clearance

        return draw_clearance(plan, ax)
    if kind == "robustness":
        from ensemble_ctrl.report.kinds.robustness import draw_robustness

        return draw_robustness(plan.problem, plan.controls, ax)
    if kind == "controls":
        from ensemble_ctrl.report.kinds.controls import draw_controls

        return draw_controls(plan.problem, plan.controls, ax)
    from ensemble_ctrl.report.kinds.moments import draw_moments

    return draw_moments(plan.problem, plan.controls, ax)


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
        margins = MARGINS.get(kind, AROUND)
        figure = new_figure((COLUMN, height := _height(plan, kind, margins)), dpi=300)
        if kind == "trajectories" and isinstance(plan.problem, OdeProblem):
            axes = sheet(plan.problem, plan.controls, figure, COLUMN, MARGINS["views"])
            draw_paths(plan.problem, plan.controls, axes)
            ax = axes[0]
        else:
            ax = draw(plan, kind, placed_axes(figure, *margins))
        ax.set_title("")
        if kind in LEGENDS:
            _, rows = legend_shape(ax.get_legend_handles_labels()[1])
            room = rows * LEGEND_ROW
            figure.set_size_inches(COLUMN, height + room)
            place_axes(ax, *margins[:3], margins[3] + room)
        save(figure, path, format)
    return path


def _height(plan: Drawable, kind: str, margins: tuple[float, float, float, float]) -> float:
    """Inches, without a legend's."""
    if kind == "trajectories" and not isinstance(plan.problem, OdeProblem):
        return map_size(plan.problem, plan.controls, plan.twin, COLUMN, margins)[1]
    if kind == "controls":
        return 0.5 + COMMAND * len(plan.problem.fleet.system.controls)
    return SIZES.get(kind, HEIGHT)
