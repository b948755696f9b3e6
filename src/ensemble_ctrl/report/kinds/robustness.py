"""How far the fleet is from failing each part of its task, over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.report.figures import line_style
from ensemble_ctrl.report.kinds.panels import title_and_legend
from ensemble_ctrl.report.series import distance_label, over_time
from ensemble_ctrl.report.text import literal, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_robustness(problem: Problem, controls: NDArray[np.float64], ax: Axes) -> Axes:
    """Worst member as a line, thick while the task requires it, and the others as a shade up to the best."""
    times, series = over_time(problem, controls)
    for k, one in enumerate(series):
        style = line_style(k)
        ax.plot(times, one.low, label=literal(short(one.name)), linewidth=1.1, **style)
        ax.fill_between(times, one.low, one.high, color=style["color"], alpha=0.15, linewidth=0)
        asked = (times >= one.begin - 1e-9) & (times <= one.end + 1e-9)
        ax.plot(times[asked], one.low[asked], color=style["color"], linewidth=2.6, alpha=0.7)
    ax.axhline(0.0, color="black", linewidth=0.8)
    ax.set(xlabel="t [s]", ylabel=distance_label(problem), xlim=(0, problem.duration))
    ax.grid(alpha=0.3)
    title_and_legend(ax, literal(f"{problem.name}: worst robot (line) to best"))
    return ax
