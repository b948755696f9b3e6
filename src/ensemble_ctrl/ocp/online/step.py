"""One quadratic program around a point: which change of the commands it asks for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.hyperplanes import Hyperplanes
from ensemble_ctrl.ocp.online.point import Point
from ensemble_ctrl.ocp.online.rows import hyperplane_rows, rate_rows, task_rows
from ensemble_ctrl.ocp.solvers.quadratic import Quadratic, solve_quadratic
from ensemble_ctrl.ocp.weights import SLACK_WEIGHT

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BLOCKS = 40
"""Groups of steps, short ones first, in each of which one quadratic program changes the commands alike."""
TRUST = 0.25
"""Share of a command's range by which one quadratic program may change it."""
LEVEL_TRUST = 10.0
"""Metres by which one quadratic program may change a level."""
EDGE = 1e-6
"""Room between bounds that meet; commands are clipped afterwards."""
ACCURACY = 1e-4
"""Mean complementarity at which a quadratic program counts as solved, in units of the cost."""


def change(point: Point, hyperplanes: Hyperplanes) -> tuple[Floats, int]:
    """The change of the free commands that the quadratic program here asks for, and its iterations."""
    fleet, u = point.model.problem.fleet, point.free
    n, starts = u.size, groups(len(u))
    # the quadratic program min du^T H du / 2 + g . du + c sum(slacks), A du + slack >= b
    H, g = point.smooth_cost()
    rows = [hyperplane_rows(point, hyperplanes), task_rows(point), rate_rows(point)]
    A = np.concatenate([np.pad(a, [(0, 0), (0, len(g) - a.shape[1])]) for a, _ in rows])
    # the change of a group is within the tightest room of its steps
    most = TRUST * (fleet.input_upper - fleet.input_lower)
    low = np.maximum.reduceat(np.maximum(fleet.input_lower - u, -most), starts)
    high = np.minimum.reduceat(np.minimum(fleet.input_upper - u, most), starts)
    levels = np.full(len(g) - n, LEVEL_TRUST)
    # commands of a group change alike: H, g and A summed over the steps of each group
    program = Quadratic(
        _summed(_summed(H, starts, n).T, starts, n),
        _summed(g[None], starts, n)[0],
        _summed(A, starts, n),
        np.concatenate([b for _, b in rows]),
        SLACK_WEIGHT,
        np.concatenate([low.ravel(), -levels]) - EDGE,
        np.concatenate([high.ravel(), levels]) + EDGE,
    )
    z, inner = solve_quadratic(program, ACCURACY)
    grouped = z[: low.size].reshape(-1, u.shape[1])
    return np.repeat(grouped, np.diff([*starts, len(u)]), axis=0), inner


def groups(steps: int) -> Ints:
    """First steps of at most about `BLOCKS` groups that grow with time."""
    starts, size = [], 1.0
    growth = 1.0 if steps <= BLOCKS else _growth(steps)
    at = 0.0
    while round(at) < steps:
        starts.append(round(at))
        at, size = at + size, size * growth
    return np.array(starts, dtype=np.int64)


def _growth(steps: int) -> float:
    """The factor by which groups grow so that `BLOCKS` of them cover all steps."""
    low, high = 1.0, 2.0
    for _ in range(40):
        middle = (low + high) / 2
        # sum_k growth^k over BLOCKS groups = (growth^BLOCKS - 1) / (growth - 1), by bisection
        covered = BLOCKS if middle == 1 else (middle**BLOCKS - 1) / (middle - 1)
        low, high = (middle, high) if covered < steps else (low, middle)
    return high


def _summed(rows: Floats, starts: Ints, n: int) -> Floats:
    """Columns of commands added up over groups of steps; other columns as they are."""
    commands = rows[:, :n].reshape(len(rows), n // 2, 2)
    summed = np.add.reduceat(commands, starts, axis=1)
    return np.asarray(np.concatenate([summed.reshape(len(rows), 2 * len(starts)), rows[:, n:]], axis=1))
