"""Proven robustness of a formula in dense time, for every member, by interval evaluation.

Time is cut into *elements*: grid time 0, the open interval after it, grid time 1, and so on.  A predicate gets a lower
bound that holds throughout an element for all members of a parameter cell.  Because robustness in negation normal form
never falls when a predicate rises, evaluating the formula on lower bounds gives a lower bound.  Windows count elements:
for windows on the grid, the elements from ``e + 2a`` to ``e + 2b`` are exactly those that the window meets for every
instant of element ``e``, for both of ``F`` and ``G``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.enclosure import Flow, Track, growth
from ensemble_ctrl.constraints.stl import ExactOps, Formula, Predicate, Signals, member_robustness, reads_fleet
from ensemble_ctrl.constraints.stl.robustness import Temporal

Floats = NDArray[np.float64]

TIGHT = 5e-4
"""Metres within which the bound of a cell meets that of the worst centre before refinement ends."""
MAX_CELLS = 4096
UP = 1 + 1e-12
"""Factor by which half widths are rounded up."""


@dataclass(frozen=True)
class TaskBound:
    """Robustness of one part of the task.

    Attributes
    ----------
    part : str
        The formula as text.
    proven : float
        Every member's robustness in dense time is at least this, metres.
    sampled : float
        Upper bound of the robustness of the worst centre: the truth lies between the two. Infinite for a formula that
        reads the fleet (``mean``, ``share``), which a list of centres can't refute.
    parameter : float
        That centre's parameter.
    covered : bool
        False if the formula is outside what this method can bound; `proven` is then minus infinity.
    """

    part: str
    proven: float
    sampled: float
    parameter: float
    covered: bool = True


@dataclass(frozen=True, eq=False)
class CellSignals:
    """Bounds of predicates over elements; each member is a parameter cell."""

    centres: Floats
    half: Floats
    position: Floats
    slope: Floats
    curvature: Floats
    bulge: Floats
    error: float
    step: float
    upper: bool = False

    @classmethod
    def of(cls, flow: Flow, centres: Floats, half: Floats, upper: bool = False) -> CellSignals:
        """Enclosures of the cells ``centres +- half``."""
        track = Track.of(flow, centres)
        n = np.arange(flow.steps)[None, :]
        none = np.zeros(flow.steps + 1)
        bulge = growth(flow, n, np.full((1, 1), flow.step), centres[:, None], half[:, None], none)
        curvature = half[:, None] ** 2 / 2 * flow.remainder()
        return cls(centres, half, track.position, track.slope, curvature, bulge, flow.rounding(), flow.step / 2, upper)

    @property
    def members(self) -> int:
        """How many cells."""
        return len(self.centres)

    @property
    def steps(self) -> int:
        """Elements less one."""
        return 2 * int(self.bulge.shape[1])

    def leaf(self, predicate: Predicate, first: int, last: int) -> Floats:
        """Bounds of a predicate, shape (cells, last - first + 1)."""
        coefficients, offset = predicate.normalised()
        by_name = dict(coefficients)
        row = np.array([by_name.get("x", 0.0), by_name.get("y", 0.0)])
        value = self.position @ row + offset
        spread = self.half[:, None] * np.abs(self.slope @ row) + self.curvature + self.error
        sign = 1.0 if self.upper else -1.0
        ends = value + sign * spread
        between = (np.maximum if self.upper else np.minimum)(ends[:, :-1], ends[:, 1:]) + sign * self.bulge
        return _interleaved(ends, between)[:, first : last + 1]

    def mean(self) -> Signals:
        """The mean member of equal cells: centres average, and curvature over a cell averages to a third."""
        third = self.curvature.max(axis=0, keepdims=True) / 3
        return CellSignals(
            self.centres[:1],
            np.zeros(1),
            self.position.mean(axis=0, keepdims=True),
            np.zeros_like(self.slope[:1]),
            third,
            self.bulge.max(axis=0, keepdims=True),
            self.error,
            self.step,
            self.upper,
        )


def bound_task(flow: Flow, formula: Formula, lower: float, upper: float, cells: int = 16) -> TaskBound:
    """Bound the robustness of a ground formula for every parameter in [lower, upper].

    Notes
    -----
    *Guarantee*: `proven` is never above the robustness of any member in dense time, nor in discrete time on the grid.
    """
    if not on_grid(formula, flow.step):
        return TaskBound(str(formula), -np.inf, np.inf, np.nan, covered=False)
    edges = np.linspace(lower, upper, cells + 1)
    centres, half = (edges[:-1] + edges[1:]) / 2, np.full(cells, (upper - lower) / cells / 2 * UP + 1e-15)
    whole = reads_fleet(formula)
    proven, sampled, target, parameter, total = np.inf, np.inf, np.inf, np.nan, 0
    while len(centres):
        total += len(centres)
        low = _evaluate(formula, CellSignals.of(flow, centres, half))
        best = _evaluate(formula, CellSignals.of(flow, centres, np.zeros_like(half), upper=True))
        if not whole and best.min() < sampled:
            sampled, parameter = float(best.min()), float(centres[best.argmin()])
        centre = _evaluate(formula, CellSignals.of(flow, centres, np.zeros_like(half)))
        target = min(target, float(centre.min()))
        open_ = low < target - TIGHT
        if whole:
            proven = float(low.min())
            open_ = np.full(len(low), bool(open_.any()))
        else:
            proven = min(proven, float(low[~open_].min(initial=np.inf)))
        if total > MAX_CELLS or not open_.any():
            proven = min(proven, float(low.min()))
            break
        h = half[open_] / 2
        centres = np.concatenate([centres[open_] - h, centres[open_] + h])
        half = np.concatenate([h, h]) * UP
    return TaskBound(str(formula), proven, sampled, parameter)


def on_grid(formula: Formula, step: float) -> bool:
    """Whether every window begins and ends at a grid time."""
    times: list[float] = []
    if isinstance(formula, Temporal) and formula.a is not None and formula.b is not None:
        times = [formula.a / step, formula.b / step]
    aligned = all(abs(t - round(t)) < 1e-6 for t in times)
    return aligned and all(on_grid(part, step) for part in formula.parts)


def _evaluate(formula: Formula, signals: CellSignals) -> Floats:
    """Bounds of the formula at time 0, one a cell."""
    return np.asarray(member_robustness(formula, signals, ExactOps()))[:, 0]


def _interleaved(ends: Floats, between: Floats) -> Floats:
    """Grid times and intervals in turn, shape (cells, 2 steps + 1)."""
    out = np.empty((len(ends), ends.shape[1] + between.shape[1]))
    out[:, ::2], out[:, 1::2] = ends, between
    return out
