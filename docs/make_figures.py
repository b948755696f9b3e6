"""The figures of ``docs/method.md``, made by the code they speak of: ``python docs/make_figures.py``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib

matplotlib.use("svg")

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.moments import moments_of_function, nodes_to_bernstein
from ensemble_ctrl.ocp.truncation import Truncation, tail

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
HERE = Path(__file__).parent
FOLDER = HERE / "_static" / "method"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
"""Okabe and Ito's, told apart by colour-blind readers too."""
S = np.linspace(-1, 1, 161)
STYLE: dict[str, Any] = {
    "font.size": 9,
    "svg.hashsalt": "method",
    "svg.fonttype": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "figure.facecolor": "white",
}
"""Text stays text, and the file is the same at each run."""


def axes(columns: int, width: float = 7.0, height: float = 2.6) -> tuple[Figure, list[Axes]]:
    """A row of axes."""
    figure, row = plt.subplots(1, columns, figsize=(width, height), layout="constrained", squeeze=False)
    return figure, list(row[0])


def polynomials() -> Figure:
    """The orthonormal polynomials, and the positive and negative part of one."""
    figure, (left, right) = axes(2)
    basis = ec.LegendreBasis(4)
    values = basis.evaluate(S)
    for k in range(5):
        left.plot(S, values[:, k], color=COLOURS[k], label=f"$\\phi_{k}$")
    left.legend(frameon=False, ncols=5, handlelength=1, columnspacing=0.8, loc="upper center", fontsize=8)
    left.set(xlabel="s", ylim=(-2.3, 3.2), title="orthonormal Legendre polynomials")
    cubic = values[:, 3]
    right.fill_between(S, np.maximum(cubic, 0), color=COLOURS[0], alpha=0.35, label="positive part")
    right.fill_between(S, np.minimum(cubic, 0), color=COLOURS[1], alpha=0.35, label="negative part")
    right.plot(S, cubic, color="black", linewidth=0.8)
    positive, negative = basis.signed_moments()
    right.legend(frameon=False, fontsize=8, loc="upper left")
    right.set(xlabel="s", title=f"$m_3^+ = {positive[3]:.3f}$, $m_3^- = {negative[3]:.3f}$")
    return figure


def member(s: Floats, time: float = 4.0) -> Floats:
    """Where robots are that were told to drive a circle: positions of shape (..., 2), traction 1 + 0.3 s."""
    traction = 1 + 0.3 * np.asarray(s)
    angle = traction * time * 0.5
    return np.stack([2 * np.sin(angle), 2 * (1 - np.cos(angle))], axis=-1)


def curve() -> Figure:
    """The fleet at one time is a curve; few moments draw it well, and Bernstein points contain it."""
    figure, row = axes(3, height=3.4)
    truth = member(S)
    for ax, order in zip(row, (1, 2, 3), strict=True):
        basis = ec.LegendreBasis(order)
        moments = np.column_stack([moments_of_function(basis, lambda s, i=i: member(s)[:, i]) for i in (0, 1)])
        drawn = basis.evaluate(S) @ moments
        points = nodes_to_bernstein(basis) @ (basis.evaluate(basis.nodes) @ moments)
        ax.fill(*hull(points).T, color=COLOURS[4], alpha=0.2, linewidth=0, label="hull of Bernstein points")
        ax.plot(*points.T, "o", color=COLOURS[4], markersize=4)
        ax.plot(*truth.T, color="black", linewidth=3, alpha=0.35, label="the fleet")
        ax.plot(*drawn.T, color=COLOURS[1], linewidth=1, label="from its moments")
        error = np.linalg.norm(drawn - truth, axis=1).max()
        ax.set(xlabel="x [m]", title=f"order {order}: {error:.2g} m off", aspect="equal")
        ax.set(xlim=(0.8, 2.4), ylim=(1.4, 4.0))
    row[0].set_ylabel("y [m]")
    handles, labels = row[0].get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, fontsize=8, ncols=3, loc="outside lower center")
    return figure


def hull(points: Floats) -> Floats:
    """Corners of the convex hull, in order."""
    from scipy.spatial import ConvexHull

    return points[ConvexHull(points).vertices] if len(points) > 2 else points


def truncation() -> Figure:
    """What leaving out higher moments costs, for a plan and for wider fleets under the same commands."""
    figure, (ax,) = axes(1, width=4.6)
    problem = ec.load(HERE.parent / "configs" / "five_obstacles.yaml")
    controls = ec.plan(problem, check=False).controls
    for colour, half in zip(COLOURS, (0.1, 0.2, 0.4), strict=False):
        fleet = wider(problem.fleet, half)
        orders = range(1, 11)
        errors = [tail(problem.with_(fleet=fleet), controls, Truncation((n,), (n,), hull=False)) for n in orders]
        label = f"traction {1 - half:g} to {1 + half:g}"
        ax.semilogy(orders, np.maximum(errors, 1e-13), "o-", color=colour, markersize=3, label=label)
    ax.axhline(1e-4, color="grey", linewidth=0.8, linestyle=":")
    ax.text(10, 1.3e-4, "auto stops here", ha="right", fontsize=7, color="grey")
    ax.set(xlabel="order N", ylabel="largest error [m]", ylim=(1e-13, 10))
    ax.legend(frameon=False, fontsize=8)
    return figure


def wider(fleet: ec.Fleet, half: float) -> ec.Fleet:
    """The fleet with tractions from 1 - half to 1 + half."""
    from dataclasses import replace

    return replace(fleet, parameters={"traction": ec.Interval(1 - half, 1 + half)})


def moment_rows() -> Figure:
    """A fleet that satisfies the paper's rows and is not in the box: the moments' bounds against the truth."""
    figure, (left, right) = axes(2)
    box = Polyhedron.box([[-1.6, 2.2], [-0.4, 3.2]])
    order = 4
    basis = ec.LegendreBasis(order)
    truth = member(S)
    left.add_patch(plt.Rectangle((-1.6, -0.4), 3.8, 3.6, facecolor=COLOURS[4], alpha=0.2))
    inside = box.margin(truth) >= 0
    left.plot(*np.where(inside[:, None], truth, np.nan).T, color="black", linewidth=2, label="members inside")
    left.plot(*np.where(inside[:, None], np.nan, truth).T, color=COLOURS[1], linewidth=2, label="members outside")
    left.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xlim=(-2.2, 2.8), ylim=(-1, 5.4))
    left.legend(frameon=False, fontsize=8, loc="upper left")
    moments = moments_of_function(basis, lambda s: member(s)[:, 1])
    lower, upper = (bounds[:, 1] for bounds in box.moment_bounds(basis))
    k = np.arange(order + 1)
    right.vlines(k, lower, upper, color=COLOURS[4], linewidth=8, alpha=0.5, label="allowed by the rows")
    right.plot(k, moments, "o", color="black", label="the fleet's moments of y")
    right.set(xlabel="order k", ylabel="$m_k$ [m]", xticks=k)
    right.legend(frameon=False, fontsize=8)
    share = 100 * (~inside).mean()
    left.set_title(f"{share:.0f} % of the fleet is outside")
    right.set_title("and every row holds" if ((moments >= lower) & (moments <= upper)).all() else "a row fails")
    return figure


FIGURES = {"polynomials": polynomials, "curve": curve, "truncation": truncation, "moment_rows": moment_rows}
"""File name and what draws it."""


def main() -> None:
    """Draw all."""
    FOLDER.mkdir(exist_ok=True)
    with plt.rc_context(STYLE):
        for name, draw in FIGURES.items():
            figure = draw()
            figure.savefig(FOLDER / f"{name}.svg", metadata={"Date": None})
            plt.close(figure)
            print(f"{name}.svg: {(FOLDER / f'{name}.svg').stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
