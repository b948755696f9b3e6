"""How close members come to failing, over the fleet's first parameter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ensemble_ctrl.report.figures import line_style
from ensemble_ctrl.report.kinds.panels import title_and_legend
from ensemble_ctrl.report.series import by_parameter, distance_label
from ensemble_ctrl.report.text import PlanLike, literal, parameter_label, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PROVEN = "#1b7837"
"""Levels that hold for everyone."""


def draw_clearance(plan: PlanLike, ax: Axes) -> Axes:
    """Least distance from each obstacle and least robustness of the rest, over time; what is proven as levels."""
    profile = by_parameter(plan.problem, plan.controls)
    for k, (name, values) in enumerate(profile.curves.items()):
        marker = "o" if len(values) == 1 else ""
        ax.plot(profile.values, values, label=literal(short(name)), marker=marker, linewidth=1.1, **line_style(k))
    certificate = plan.certificate
    bounds = [] if certificate is None else [certificate.clearance, certificate.robustness]
    for k, bound in enumerate(b for b in bounds if np.isfinite(b)):
        ax.axhline(bound, color=PROVEN, linestyle=":", linewidth=1.2, label=None if k else "proven for all")
    ax.axhline(0.0, color="black", linewidth=0.8)
    label = parameter_label(plan.problem, profile.parameter) if profile.parameter else "(all robots are equal)"
    ax.set_xlabel(literal(label))
    if not profile.parameter:
        ax.set_xticks([])
    ax.set_ylabel(distance_label(plan.problem))
    ax.grid(alpha=0.3)
    title_and_legend(ax, literal(f"{plan.problem.name}: least over time"))
    return ax
