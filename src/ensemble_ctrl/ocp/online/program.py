r"""The optimal-control problem solved again and again while time goes on, by sequential quadratic programs.

It is the program of `ensemble_ctrl.ocp.transcription` on the whole horizon's grid, with commands as its only unknowns
but for the levels of the task: the points are eliminated, with closed-form slopes (`ensemble_ctrl.ocp.online.curve`).
What it minimises is pinned to the program's cost, and to what a plan is worth, by a test.

- *Past*: points before the present are the measured ones; the task's rows read them at their own grid times, so what
  has been satisfied stays satisfied.
- *Sent*: from the last measurement on every node robot is carried by the commands that have been sent to the first
  step that can still be changed, so delays are predicted through exactly.
- *Robots*: several robots under one broadcast are the node robots of each, side by side, and the terminal
  error is their mean.
- *Growth*: how much larger the set of states is than the node robots' curve, in metres at each grid time.

Nothing is built between solves, and each starts from the last plan: on the whole horizon's grid that plan stands at the
right times already.  Separating hyperplanes are chosen at the guess and fixed for one quadratic program.  The Hessian
is that of effort and terminal error (Gauss-Newton); a line search on the exact cost guards every step.

*Guarantee*: none; what is found is certified before it is used.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.hyperplanes import Hyperplanes
from ensemble_ctrl.ocp.online.model import InitialCondition, OnlineModel
from ensemble_ctrl.ocp.online.point import Point
from ensemble_ctrl.ocp.online.step import change

Floats = NDArray[np.float64]
Status = Literal["converged", "improved", "limit", "stuck"]
Timer = Callable[[], float]
"""Seconds from any time on."""

ENOUGH = 1e-3
"""A solve ends when the cost falls by less."""
VIOLATED = 1e-3
"""Metres by which a row falls short for a solve that finds nothing better to be stuck."""
SHARES = (1.0, 0.5, 0.25, 0.1)
"""Of a change that the line search tries."""
LESS = 1e-9
"""By how much a cost has to fall to be lower."""


@dataclass(frozen=True, eq=False)
class Replan:
    """What a solve found.

    Attributes
    ----------
    controls : ndarray, shape (steps, n_u)
        Commands of all steps; those before ``free`` are as they were.
    status : {"converged", "improved", "limit", "stuck"}
        ``limit``: time ran out. ``stuck``: no step lowers the cost, and something is violated.
    iterations : int
        Quadratic programs, and `inner` the iterations in them.
    cost : float
        As minimised, violations included.
    short : float
        Metres by which the worst row falls short.
    seconds : float
        What it took.
    """

    controls: Floats
    status: Status
    iterations: int
    inner: int
    cost: float
    short: float
    seconds: float


class OnlineProgram(OnlineModel):
    """A problem that is solved again and again."""

    def solve(
        self, initial: InitialCondition, deadline: float = np.inf, rounds: int = 4, timer: Timer = time.perf_counter
    ) -> Replan:
        """Improve `initial.controls` by up to `rounds` quadratic programs, until `deadline` seconds of `timer`."""
        began = timer()
        point = Point(self, initial, initial.controls)
        status: Status = "limit"
        count = inner = 0
        cost, short = np.inf, np.inf
        while count < rounds:
            if count and (timer() - began) * (count + 1) / count > deadline:
                break
            # one quadratic program: hyperplanes fixed here, a step, a line search on the exact cost
            hyperplanes = point.hyperplanes()
            cost, short = point.cost(hyperplanes)
            step, more = change(point, hyperplanes)
            count, inner = count + 1, inner + more
            found = _searched(point, step, hyperplanes, cost)
            if found is None:
                status = "stuck" if short > VIOLATED else "converged"
                break
            point, better, short = found
            finished = cost - better < ENOUGH
            cost = better
            if finished:
                status = "converged"
                break
        else:
            status = "improved"
        return Replan(point.controls, status, count, inner, cost, short, timer() - began)


def _searched(point: Point, step: Floats, hyperplanes: Hyperplanes, cost: float) -> tuple[Point, float, float] | None:
    """The first point on the way that costs less, with its cost and shortfall; None if there is none."""
    for share in SHARES:
        tried = point.moved(share * step)
        better, short = tried.cost(hyperplanes)
        if better < cost - LESS:
            return tried, better, short
    return None
