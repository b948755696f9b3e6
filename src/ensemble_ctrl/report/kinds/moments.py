"""The fleet's moments of position over time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.moments import TensorBasis
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from ensemble_ctrl.report.kinds.panels import panels
from ensemble_ctrl.report.palette import LINES
from ensemble_ctrl.report.text import literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]

ORDER = 3
"""Highest moment drawn of a fleet with one parameter that bends trajectories; else the first of each."""
COUNT = 24
"""Points of the rule that integrates over the parameter; a quarter as many for each of several."""

LEGEND_ROW = 0.15
"""Room above the curves for each coordinate's row of the legend, in shares of their height."""
DASHES = ("-", "--", ":")
"""Of the coordinates."""


def moments(problem: Problem, controls: Floats) -> Iterator[tuple[str, Floats]]:
    """Moments of position by name, each of shape (steps + 1, d), metres, the lowest first.

    Notes
    -----
    Integrals of exact trajectories against the orthonormal polynomials of the parameters' distributions, by Gauss
    rules; the mean position is ``m_0 / sqrt(2)``.
    """
    fleet = problem.fleet
    distributions = fleet.dynamic_distributions
    order = ORDER if len(distributions) == 1 else 1
    # m_k(t) = sum_n w_n phi_k(s_n) p(t; s_n): quadrature over the distributions
    nodes, weights = fleet.rule(COUNT if len(distributions) < 2 else COUNT // 4)
    paths = trajectories(problem, controls, fleet.dynamic_members(nodes))
    # phi_k of the product distribution, degrees up to `order` in all
    basis = TensorBasis(tuple(distribution.basis(order) for distribution in distributions))
    phi = basis.evaluate(nodes)
    for column, index in enumerate(basis.indices):
        if sum(index) <= order:
            name = "".join(map(str, index)) or "0"
            yield f"m_{{{name}}}", np.einsum("n,n,ntd->td", weights, phi[:, column], paths)


def draw_moments(problem: Problem, controls: Floats, ax: Axes) -> Axes:
    """The lowest moment in a panel of its own above the others, which are smaller; x solid, y dashed, z dotted."""
    axes = [literal(place) for place in problem.fleet.places]
    lowest, *others = moments(problem, controls)
    top, *below = panels(ax, 2 if others else 1)
    for axis, column, dashes in zip(axes, lowest[1].T, DASHES, strict=False):
        top.plot(problem.times, column, dashes, label=f"{axis}, ${lowest[0]}$", color=LINES[0], linewidth=1.1)
    for k, (name, values) in enumerate(others, start=1):
        for axis, column, dashes in zip(axes, values.T, DASHES, strict=False):
            below[0].plot(problem.times, column, dashes, label=f"{axis}, ${name}$", color=LINES[k], linewidth=1.1)
    for panel in (top, *below):
        panel.set(ylabel="moment [m]", xlim=(0, problem.duration))
        low, high = panel.get_ylim()
        panel.set_ylim(low, high + LEGEND_ROW * len(axes) * (high - low))
        panel.legend(fontsize="x-small", ncols=3, loc="upper left", handlelength=2.2, columnspacing=1.0)
    (below[0] if below else top).set_xlabel("t [s]")
    ax.set_title(literal(f"{problem.name}: moments of position"))
    return ax
