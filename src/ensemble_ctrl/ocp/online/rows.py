"""Linear rows ``a . change >= b`` of the quadratic program around a point, by the free commands and the levels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.hyperplanes import Hyperplanes
from ensemble_ctrl.ocp.levels import smooth_maximum
from ensemble_ctrl.ocp.online.model import NEAR
from ensemble_ctrl.ocp.online.point import Point

Floats = NDArray[np.float64]


def hyperplane_rows(point: Point, hyperplanes: Hyperplanes) -> tuple[Floats, Floats]:
    """Near points at both ends of each step, on the free sides of their hyperplanes: ``n . dP >= required - n . P``."""
    free, curve = point.initial.free, point.curve.points
    count = curve.shape[1]
    side, at = np.nonzero(hyperplanes.active & (hyperplanes.gap < NEAR))
    # one column for each point and end of the step
    end, which = np.repeat([0, 1], count), np.tile(np.arange(count), 2)
    when = (free + at)[:, None] + end
    normal = hyperplanes.normal[side, at]
    value = np.einsum("rkd,rd->rk", curve[when, which], normal) - hyperplanes.drift[side, at][:, end]
    b = point.required(hyperplanes)[side, at][:, None] - value
    # rows that may bind: near ones, at times that can still change, the lowest half of the points at each end
    used = (b > -NEAR) & (when > free)
    for k in (0, 1):
        used[:, k * count : (k + 1) * count] &= _lowest(-b[:, k * count : (k + 1) * count])
    row = np.nonzero(used)[0]
    return point.curve.slopes(when[used], np.broadcast_to(which, used.shape)[used], normal[row]), b[used]


def task_rows(point: Point) -> tuple[Floats, Floats]:
    """Rows that keep the levels below what they stand for, around their values here; the last asks for the margin."""
    task, n = point.model.levels, point.free.size
    if not task.count:
        return np.zeros((0, n)), np.zeros(0)
    # linearised at the levels' values here; a level without rows counts as 0
    level = np.where(np.isfinite(point.levels), point.levels, 0.0)
    A, b = _height_rows(point, level)
    parts = [A, *(row[None] for row in _level_rows(point, level))]
    rest = [b, *(np.array([short]) for short in _level_shorts(point, level))]
    return np.concatenate(parts), np.concatenate(rest)


def _height_rows(point: Point, level: Floats) -> tuple[Floats, Floats]:
    """``d(x px + y py) - d level >= level - height`` for the lowest points of each row that is near its level."""
    task, free, n, count = point.model.levels, point.initial.free, point.free.size, point.curve.points.shape[1]
    # height - level of each row at each point; rows near their level, and of these the lowest points
    excess = point.heights - level[task.row_level][:, None]
    used = (excess < 2 * NEAR) & _lowest(excess)
    row, which = np.nonzero(used)
    slope = np.zeros((len(row), n))
    later, normal = task.at[row] > free, np.stack([task.x, task.y], axis=1)[row]
    own = later & ~task.mean[row]
    slope[own] = point.curve.slopes(task.at[row[own]], which[own], normal[own])
    # rows of the mean member: the weighted sum of the points' slopes
    for k in np.flatnonzero(later & task.mean[row]):
        same = np.full(count, task.at[row[k]]), np.arange(count), np.tile(normal[k], (count, 1))
        slope[k] = point.mean @ point.curve.slopes(*same)
    # -1 for the level that the row is below
    one = np.zeros((len(row), task.count))
    one[np.arange(len(row)), task.row_level[row]] = -1.0
    return np.hstack([slope, one]), -excess[used]


def _level_rows(point: Point, level: Floats) -> list[Floats]:
    """Slopes of ``second - first``, of ``smooth maximum - level``, and of the whole task's level."""
    task, n = point.model.levels, point.free.size
    rows = []
    for low, high in task.order.tolist():
        # d second - d first, then d smooth maximum - d level with the softmax as slopes, then d level
        rows.append(np.zeros(n + task.count))
        rows[-1][n + low] -= 1.0
        rows[-1][n + high] += 1.0
    for maximum in task.maxima:
        rows.append(np.zeros(n + task.count))
        rows[-1][n + maximum.parts] = smooth_maximum(level[maximum.parts])[1]
        rows[-1][n + maximum.level] -= 1.0
    rows.append(np.zeros(n + task.count))
    rows[-1][-1] = 1.0
    return rows


def _level_shorts(point: Point, level: Floats) -> list[float]:
    """By how much those fall short now."""
    task = point.model.levels
    shorts = [float(level[low] - level[high]) for low, high in task.order.tolist()]
    shorts += [float(level[m.level] - smooth_maximum(level[m.parts])[0]) for m in task.maxima]
    return [*shorts, float(point.model.problem.solve.margin - level[-1])]


def rate_rows(point: Point) -> tuple[Floats, Floats]:
    """``-most <= D u <= most`` for the commands' changes."""
    bounds = point.model.most
    if bounds is None:
        return np.zeros((0, point.free.size)), np.zeros(0)
    # -most - change <= D du <= most - change
    D = np.kron(point.differences, np.eye(2))
    change = point.changes.ravel()
    most = np.tile(bounds, len(point.changes))
    finite = np.isfinite(most)
    D, change, most = D[finite], change[finite], most[finite]
    return np.concatenate([D, -D]), np.concatenate([-most - change, change - most])


def _lowest(values: Floats) -> NDArray[np.bool_]:
    """The lower half of the points in each row, shape of `values`: others follow, or are seen in the next round."""
    half = max(1, -(-values.shape[1] // 2))
    if half == values.shape[1] or not len(values):
        return np.ones(values.shape, dtype=bool)
    return np.asarray(values <= np.partition(values, half - 1, axis=1)[:, half - 1 : half])
