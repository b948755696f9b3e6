"""A task's levels as arrays, built once: their values and slopes on any curve of points.

`ensemble_ctrl.ocp.task` turns a task into linear rows on points and *levels*, each at or below a minimum of rows and
other levels, or below a smooth maximum of levels.  The rows stay the same for every curve on the same grid.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.layout import Layout
from ensemble_ctrl.ocp.task import SHARPNESS, GuessValues, Level, LevelOps, PointSignals, Reading, Row, minimum_of
from ensemble_ctrl.ocp.truncation import Truncation
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Maximum:
    """``level <= smooth maximum of parts``, all by their numbers."""

    parts: Ints
    level: int


@dataclass(frozen=True, eq=False)
class TaskLevels:
    """The levels of a task, numbered from 0; the last is the whole task's.

    Attributes
    ----------
    count : int
        How many levels; 0 for a task that only avoids.
    row_level, at : ndarray of int, shape (rows,)
        ``level <= x px + y py + offset`` for every point at grid time `at`.
    x, y, offset : ndarray, shape (rows,)
    mean : ndarray of bool, shape (rows,)
        Rows that hold for the mean member alone.
    order : ndarray of int, shape (pairs, 2)
        ``first <= second`` between levels.
    maxima : tuple of Maximum
    """

    count: int
    row_level: Ints
    at: Ints
    x: Floats
    y: Floats
    offset: Floats
    mean: NDArray[np.bool_]
    order: Ints
    maxima: tuple[Maximum, ...]

    @classmethod
    def of(cls, problem: Problem, truncation: Truncation, curve: Floats) -> TaskLevels:
        """The levels of a problem's task; `curve`, shape (steps + 1, points, 2), is any: no part is left out."""
        layout = Layout(problem.steps, truncation.count)
        first = layout.size
        readings: dict[Reading, Floats] = {"all": np.eye(truncation.count), "mean": truncation.mean[None, :]}
        ops = LevelOps(layout, GuessValues(curve, readings), np.inf)
        signals = PointSignals(problem.steps, problem.step)
        whole = minimum_of([(part.formula, signals) for part in problem.specification.parts], ops)
        if whole:
            ops.below.append((layout.level(), whole))
        # levels numbered from 0; rows (level, time, x, y, offset) and pairs of levels from the terms of each minimum
        pairs = [(low - first, term) for low, part in ops.below for term in part]
        rows = [(low, term) for low, term in pairs if isinstance(term, Row)]
        order = [(low, term.index - first) for low, term in pairs if isinstance(term, Level)]
        numbers = np.array([[*r.coefficients, r.offset] for _, r in rows]).reshape(-1, 3).T
        return cls(
            len(layout.levels),
            np.array([low for low, _ in rows], dtype=np.int64),
            np.array([r.at for _, r in rows], dtype=np.int64),
            numbers[0],
            numbers[1],
            numbers[2],
            np.array([r.of == "mean" for _, r in rows], dtype=bool),
            np.array(order, dtype=np.int64).reshape(-1, 2),
            tuple(Maximum(np.array(parts) - first, level - first) for parts, level in ops.maxima),
        )

    def heights(self, curve: Floats, mean: Floats, growth: Floats) -> Floats:
        """Values of the rows at every point, less the growth at their time, shape (rows, points).

        Parameters
        ----------
        curve : ndarray, shape (steps + 1, points, 2)
            Metres.
        mean : ndarray, shape (points,)
            Weights of the points in the mean position: rows of the mean member have its value at every point.
        growth : ndarray, shape (steps + 1,)
            Metres.
        """
        # x px + y py + offset - growth, at every point, or at the mean one
        p = curve[self.at]
        p = np.where(self.mean[:, None, None], np.einsum("rpd,p->rd", p, mean)[:, None], p)
        value = self.x[:, None] * p[..., 0] + self.y[:, None] * p[..., 1] + self.offset[:, None]
        return np.asarray(value - growth[self.at][:, None])

    def values(self, heights: Floats) -> Floats:
        """The largest values of the levels that the rows allow, shape (count,)."""
        # the least height of each level's rows; then maxima, and order between levels, by their numbers
        level = np.full(self.count, np.inf)
        np.minimum.at(level, self.row_level, heights.min(axis=1, initial=np.inf))
        for k in range(self.count):
            if k in self._parts:
                level[k] = smooth_maximum(level[self._parts[k]])[0]
            for high in self._above.get(k, ()):
                level[k] = min(level[k], level[high])
        return level

    @cached_property
    def _above(self) -> dict[int, list[int]]:
        """For each level those that it is at or below."""
        above: dict[int, list[int]] = {}
        for low, high in self.order.tolist():
            above.setdefault(low, []).append(high)
        return above

    @cached_property
    def _parts(self) -> dict[int, Ints]:
        """The parts of each maximum."""
        return {maximum.level: maximum.parts for maximum in self.maxima}


def smooth_maximum(parts: Floats) -> tuple[float, Floats]:
    """``log(mean exp(K a)) / K``, never above the largest, and its slopes."""
    # log(mean exp(K a)) / K with the largest exponent taken out; its slopes are the softmax
    scaled = SHARPNESS * parts
    top = scaled.max()
    weights = np.exp(scaled - top)
    return float(top + np.log(weights.mean())) / SHARPNESS, weights / weights.sum()
