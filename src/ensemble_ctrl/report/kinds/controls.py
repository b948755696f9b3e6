"""The commands of every step over time, with their bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.report.figures import line_style
from ensemble_ctrl.report.kinds.panels import panels
from ensemble_ctrl.report.palette import CONTRAST
from ensemble_ctrl.report.text import literal
from ensemble_ctrl.report.transform import telling

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS = 8000
"""Commands from which on only the telling ones are drawn: more than a picture has columns."""


def draw_controls(problem: Problem, controls: NDArray[np.float64], ax: Axes) -> Axes:
    """A panel for every command, bounds dashed.

    Parameters
    ----------
    problem : Problem
        Whose commands.
    controls : ndarray, shape (steps, n_u)
        In the units of the system's controls.
    ax : matplotlib Axes
        Whose place the panels take.
    """
    system, fleet = problem.fleet.system, problem.fleet
    made = panels(ax, len(system.controls))
    for i, (panel, name, unit) in enumerate(zip(made, system.controls, system.control_units, strict=True)):
        keep = telling(controls[:, i], POINTS)
        times = np.append(problem.times[keep], problem.duration)
        panel.stairs(controls[keep, i], times, baseline=None, linewidth=1.3, color=line_style(0)["color"])
        low, high = float(fleet.input_lower[i]), float(fleet.input_upper[i])
        for bound in (low, high):
            panel.axhline(bound, linestyle="--", linewidth=0.8, color=CONTRAST)
        panel.set(ylabel=literal(f"{name} [{unit}]"), xlim=(0, problem.duration))
        pad = 0.08 * max(high - low, 1e-6)
        panel.set_ylim(low - pad, high + pad)
    made[-1].set_xlabel("t [s]")
    ax.set_title(literal(f"{problem.name}: broadcast controls (bounds dashed)"), y=1.0)
    return ax
