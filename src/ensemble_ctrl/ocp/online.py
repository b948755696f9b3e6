r"""The optimal-control problem solved again and again while time goes on, by sequential quadratic programs.

It is the program of `ensemble_ctrl.ocp.transcription` on the whole horizon's grid, with commands as its only unknowns
but for the levels of the task.  The displacement of a node robot over a step is a function of the commands alone, so
the points at grid time n have closed-form slopes:

.. math::

    \frac{\partial P_n}{\partial v_l} = C \frac{\partial d_l}{\partial v}, \qquad
    \frac{\partial P_n}{\partial \omega_l} = C \Bigl(\frac{\partial d_l}{\partial \omega}
        + \Delta\, \psi_2\, R_{\perp} (p_n - p_{l+1})\Bigr) \qquad (l < n)

for turning a little more in step l turns everything that follows about the place where the step ends.

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
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.hyperplanes import Hyperplanes, separate
from ensemble_ctrl.ocp.layout import Layout
from ensemble_ctrl.ocp.levels import TaskLevels, smooth_maximum
from ensemble_ctrl.ocp.margins import curvature
from ensemble_ctrl.ocp.quadratic import Quadratic, solve_quadratic
from ensemble_ctrl.ocp.terminal import terminal_blocks
from ensemble_ctrl.ocp.truncation import Truncation, plain, points
from ensemble_ctrl.ocp.weights import RATE_SPARE, SLACK_WEIGHT
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.specification import AvoidConstraint

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Status = Literal["converged", "improved", "limit", "stuck"]
Timer = Callable[[], float]
"""Seconds from any time on."""

NEAR = 0.3
"""Metres beyond what is asked within which a row takes part."""
BLOCKS = 40
"""Groups of steps, short ones first, in each of which one quadratic program changes the commands alike."""
TRUST = 0.25
"""Share of a command's range by which one quadratic program may change it."""
PROXIMAL = 1.0
"""Weight that keeps levels where they are, per square metre."""
SMALL = 1e-3
"""Weight that keeps commands where they are."""
ENOUGH = 1e-3
"""A solve ends when the cost falls by less."""
LEVEL_TRUST = 10.0
"""Metres by which one quadratic program may change a level."""
EDGE = 1e-6
"""Room between bounds that meet; commands are clipped afterwards."""
TINY = 1e-20
"""Imaginary step of a derivative: exact to rounding, for nothing is subtracted."""


@dataclass(frozen=True, eq=False)
class Present:
    """What a solve starts from.

    Attributes
    ----------
    at : int
        Grid time of the measurement.
    free : int
        First step whose commands may still be changed.
    drives : ndarray, shape (robots * nodes, 5)
        Drives of the node robots at grid time `at`, those of one robot after the other: factors, heading and place.
    path : ndarray, shape (at or more, robots, 2)
        Where the robots have been at the grid times before `at`, metres.
    growth : ndarray, shape (steps + 1,)
        Metres by which the sets of states are larger than the node robots' curves, at each grid time.
    controls : ndarray, shape (steps, n_u)
        Commands: those sent before `free`, and a guess from there on.
    shift : float
        Seconds from the problem's time 0 to that of the grid, for obstacles that move.
    """

    at: int
    free: int
    drives: Floats
    path: Floats
    growth: Floats
    controls: Floats
    shift: float = 0.0


@dataclass(frozen=True, eq=False)
class Replanned:
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


@dataclass(frozen=True, eq=False)
class OnlineProgram:
    """A problem made ready to be solved again and again.

    Attributes
    ----------
    problem : Problem
        On its whole horizon. Parameters of its fleet bend trajectories; where robots start is measured.
    truncation : Truncation
        Which moments are kept.
    levels : TaskLevels
        The task's rows.
    """

    problem: Problem
    truncation: Truncation
    levels: TaskLevels
    avoid: tuple[AvoidConstraint, ...]
    _terminal: ca.Function | None

    @classmethod
    def of(cls, problem: Problem, controls: Floats, order: int) -> OnlineProgram:
        """Ready for moments 0..order; `controls` of shape (steps, n_u) are any commands."""
        truncation = plain((order,) * len(problem.fleet.bent), hull=True)
        levels = TaskLevels.of(problem, truncation, points(problem, controls, truncation))
        return cls(problem, truncation, levels, problem.specification.avoid, _terminal(problem, truncation))

    def solve(
        self, present: Present, deadline: float = np.inf, rounds: int = 4, timer: Timer = time.perf_counter
    ) -> Replanned:
        """Improve `present.controls` by up to `rounds` quadratic programs, until `deadline` seconds of `timer`."""
        began = timer()
        point = _Point(self, present, present.controls)
        status: Status = "limit"
        count = inner = 0
        cost, short = np.inf, np.inf
        while count < rounds:
            if count and (timer() - began) * (count + 1) / count > deadline:
                break
            hyperplanes = point.hyperplanes()
            cost, short = point.cost(hyperplanes)
            change, more = point.change(hyperplanes)
            count, inner = count + 1, inner + more
            found = _searched(point, change, hyperplanes, cost)
            if found is None:
                status = "stuck" if short > 1e-3 else "converged"
                break
            point, better, short = found
            finished = cost - better < ENOUGH
            cost = better
            if finished:
                status = "converged"
                break
        else:
            status = "improved"
        return Replanned(point.controls, status, count, inner, cost, short, timer() - began)


def _searched(
    point: _Point, change: Floats, hyperplanes: Hyperplanes, cost: float
) -> tuple[_Point, float, float] | None:
    """The first point on the way that costs less, with its cost and shortfall; None if there is none."""
    for share in (1.0, 0.5, 0.25, 0.1):
        tried = point.moved(share * change)
        better, short = tried.cost(hyperplanes)
        if better < cost - 1e-9:
            return tried, better, short
    return None


class _Point:
    """Commands with the fleet's points under them."""

    def __init__(self, program: OnlineProgram, present: Present, controls: Floats) -> None:
        problem, truncation, at = program.problem, program.truncation, present.at
        self.program, self.present, self.controls = program, present, controls
        system = problem.fleet.system
        self.robots = present.path.shape[1]
        self.image = np.kron(np.eye(self.robots), truncation.to_points)
        self.nodal = system.positions(controls[at:], present.drives, problem.step)
        ahead = np.einsum("ij,jtd->tid", self.image, self.nodal)
        before = np.repeat(present.path[:at], truncation.count, axis=1)
        self.curve = np.concatenate([before, ahead])

    def moved(self, change: Floats) -> _Point:
        """The point after a change of the free commands, shape (free steps, n_u)."""
        controls, fleet = self.controls.copy(), self.program.problem.fleet
        controls[self.present.free :] += change
        return _Point(self.program, self.present, np.clip(controls, fleet.input_lower, fleet.input_upper))

    def hyperplanes(self) -> Hyperplanes:
        """Separating hyperplanes of the steps from the first free one on."""
        problem, free = self.program.problem, self.present.free
        begin = free * problem.step + self.present.shift
        left = problem.duration - free * problem.step
        return separate(self.curve[free:], self.program.avoid, left, begin=begin, within=2 * NEAR)

    def cost(self, hyperplanes: Hyperplanes) -> tuple[float, float]:
        """The cost, shortfalls included, and the largest shortfall in metres."""
        problem, free = self.program.problem, self.present.free
        aim, step = problem.objective, problem.step
        u = self.controls[free:]
        total = step * float((u**2).sum(axis=0) @ aim.efforts())
        change = np.diff(self._with_last(), axis=0)
        total += aim.smoothness / step * float((change**2).sum())
        total += sum(float(error[0]) for _, error in self._ends) / self.robots
        away = np.maximum(self._keep(hyperplanes) - hyperplanes.nearest(self.curve[free:]), 0.0)
        shorts = [away[hyperplanes.active].ravel()]
        if problem.fleet.rate_bounds is not None:
            shorts.append(np.maximum(np.abs(change) - self._rates(), 0.0).ravel())
        if self.program.levels.count:
            level = float(self.level_values()[-1])
            total -= aim.robustness * level
            shorts.append(np.maximum(np.array([problem.solve.margin - level]), 0.0))
        short = np.concatenate(shorts)
        return total + SLACK_WEIGHT * float(short.sum()), float(short.max(initial=0.0))

    def level_values(self) -> Floats:
        """What the task's levels are worth."""
        return self._levels

    @cached_property
    def _levels(self) -> Floats:
        return self.program.levels.values(self._heights)

    def change(self, hyperplanes: Hyperplanes) -> tuple[Floats, int]:
        """The change of the free commands that the quadratic program here asks for, and its iterations."""
        problem, free = self.program.problem, self.present.free
        fleet, u = problem.fleet, self.controls[free:]
        n, starts = 2 * len(u), _blocks(len(u))
        H, g = self._smooth_cost()
        line_a, line_b = self._hyperplane_rows(hyperplanes)
        task_a, task_b = self._task_rows()
        rate_a, rate_b = self._rate_rows()
        A = np.concatenate([np.pad(a, [(0, 0), (0, len(g) - a.shape[1])]) for a in (line_a, task_a, rate_a)])
        most = TRUST * (fleet.input_upper - fleet.input_lower)
        low = np.maximum.reduceat(np.maximum(fleet.input_lower - u, -most), starts)
        high = np.minimum.reduceat(np.minimum(fleet.input_upper - u, most), starts)
        levels = np.full(len(g) - n, LEVEL_TRUST)
        program = Quadratic(
            _summed(_summed(H, starts, n).T, starts, n),
            _summed(g[None], starts, n)[0],
            _summed(A, starts, n),
            np.concatenate([line_b, task_b, rate_b]),
            SLACK_WEIGHT,
            np.concatenate([low.ravel(), -levels]) - EDGE,
            np.concatenate([high.ravel(), levels]) + EDGE,
        )
        z, inner = solve_quadratic(program, 1e-4)
        change = z[: low.size].reshape(-1, 2)
        return np.repeat(change, np.diff([*starts, len(u)]), axis=0), inner

    def _smooth_cost(self) -> tuple[Floats, Floats]:
        """Hessian and gradient of effort, smoothness, terminal error and the reward of robustness."""
        problem, free = self.program.problem, self.present.free
        aim, step, u = problem.objective, problem.step, self.controls[free:]
        n, levels = 2 * len(u), self.program.levels.count
        H, g = np.zeros((n + levels, n + levels)), np.zeros(n + levels)
        diagonal = np.arange(n)
        H[diagonal, diagonal] = np.tile(2 * step * aim.efforts(), len(u)) + SMALL
        g[:n] = 2 * step * (u * aim.efforts()).ravel()
        if aim.smoothness:
            D = self._differences()
            weight = 2 * aim.smoothness / step
            H[:n, :n] += weight * np.kron(D.T @ D, np.eye(2))
            g[:n] += weight * (D.T @ np.diff(self._with_last(), axis=0)).ravel()
        if levels:
            H[n + np.arange(levels), n + np.arange(levels)] = PROXIMAL
            g[-1] = -aim.robustness
        for every, error in self._ends:
            slope, bend = np.array(error[1]).ravel() / self.robots, np.array(error[2]) / self.robots
            eigen, vectors = np.linalg.eigh(bend)
            last = np.full_like(every, problem.steps)
            axes = np.repeat(np.eye(2), len(every), axis=0)
            S = self._slopes(np.tile(last, 2), np.tile(every, 2), axes)
            root = (np.sqrt(np.maximum(eigen, 0.0))[:, None] * vectors.T) @ S
            H[:n, :n] += root.T @ root
            g[:n] += slope @ S
        return H, g

    @cached_property
    def _ends(self) -> list[tuple[Ints, Sequence[ca.DM]]]:
        """The points of each robot, with the error of where they end, its gradient and its Hessian."""
        if self.program._terminal is None:
            return []
        robots = np.arange(self.curve.shape[1], dtype=np.int64).reshape(self.robots, -1)
        return [(own, self.program._terminal(self.curve[-1, own].T.ravel())) for own in robots]

    def _hyperplane_rows(self, hyperplanes: Hyperplanes) -> tuple[Floats, Floats]:
        """Rows of the near points at both ends of each step on the free sides of their hyperplanes."""
        free, count = self.present.free, self.curve.shape[1]
        side, at = np.nonzero(hyperplanes.active & (hyperplanes.gap < NEAR))
        end = np.repeat([0, 1], count)
        point = np.tile(np.arange(count), 2)
        time_ = (free + at)[:, None] + end
        normal = hyperplanes.normal[side, at]
        value = np.einsum("rkd,rd->rk", self.curve[time_, point], normal) - hyperplanes.drift[side, at][:, end]
        b = self._keep(hyperplanes)[side, at][:, None] - value
        used = (b > -NEAR) & (time_ > free)
        for k in (0, 1):
            used[:, k * count : (k + 1) * count] &= _lowest(-b[:, k * count : (k + 1) * count])
        row = np.nonzero(used)[0]
        return self._slopes(time_[used], np.broadcast_to(point, used.shape)[used], normal[row]), b[used]

    def _task_rows(self) -> tuple[Floats, Floats]:
        """Rows that keep the levels below what they stand for, around their present values."""
        task, free, margin = self.program.levels, self.present.free, self.program.problem.solve.margin
        n, count = 2 * (self.program.problem.steps - free), self.curve.shape[1]
        if not task.count:
            return np.zeros((0, n)), np.zeros(0)
        heights, level = self._heights, self._levels
        level = np.where(np.isfinite(level), level, 0.0)
        excess = heights - level[task.row_level][:, None]
        used = (excess < 2 * NEAR) & _lowest(excess)
        row, point = np.nonzero(used)
        weights = self._mean
        slope = np.zeros((len(row), n))
        later = task.at[row] > free
        own = later & ~task.mean[row]
        normal = np.stack([task.x, task.y], axis=1)[row]
        slope[own] = self._slopes(task.at[row[own]], point[own], normal[own])
        for k in np.flatnonzero(later & task.mean[row]):
            same = np.full(count, task.at[row[k]]), np.arange(count), np.tile(normal[k], (count, 1))
            slope[k] = weights @ self._slopes(*same)
        one = np.zeros((len(row), task.count))
        one[np.arange(len(row)), task.row_level[row]] = -1.0
        A, b = [np.hstack([slope, one])], [-excess[used]]
        for low, high in task.order.tolist():
            line = np.zeros(n + task.count)
            line[n + low] -= 1.0
            line[n + high] += 1.0
            A.append(line[None])
            b.append(np.array([level[low] - level[high]]))
        for maximum in task.maxima:
            value, weight = smooth_maximum(level[maximum.parts])
            line = np.zeros(n + task.count)
            line[n + maximum.parts] = weight
            line[n + maximum.level] -= 1.0
            A.append(line[None])
            b.append(np.array([level[maximum.level] - value]))
        last = np.zeros((1, n + task.count))
        last[0, -1] = 1.0
        return np.concatenate([*A, last]), np.concatenate([*b, [margin - level[-1]]])

    def _rate_rows(self) -> tuple[Floats, Floats]:
        """Rows of the commands' changes."""
        bounds, free = self.program.problem.fleet.rate_bounds, self.present.free
        n = 2 * (len(self.controls) - free)
        if bounds is None:
            return np.zeros((0, n)), np.zeros(0)
        u = self._with_last()
        D = np.kron(self._differences(), np.eye(2))
        change, most = np.diff(u, axis=0).ravel(), np.tile(self._rates(), len(u) - 1)
        finite = np.isfinite(most)
        D, change, most = D[finite], change[finite], most[finite]
        return np.concatenate([D, -D]), np.concatenate([-most - change, change - most])

    def _differences(self) -> Floats:
        """Matrix from changes of one free command to those of the steps between successive ones."""
        count = len(self.controls) - self.present.free
        D = np.eye(count) - np.eye(count, k=-1)
        return D if self.present.free else D[1:]

    def _rates(self) -> Floats:
        """Largest change of each command over a step."""
        bounds = self.program.problem.fleet.rate_bounds
        assert bounds is not None
        return (1 - RATE_SPARE) * bounds * self.program.problem.step

    def _with_last(self) -> Floats:
        """The free commands, after the last that was sent."""
        return self.controls[max(self.present.free - 1, 0) :]

    @cached_property
    def _heights(self) -> Floats:
        return self.program.levels.heights(self.curve, self._mean, self.present.growth)

    @property
    def _mean(self) -> Floats:
        """Weights of the points in the mean position."""
        return np.asarray(np.tile(self.program.truncation.mean, self.robots) / self.robots)

    def _keep(self, hyperplanes: Hyperplanes) -> Floats:
        """What ``normal . p`` has to reach for every pair of a side and a step."""
        problem, free = self.program.problem, self.present.free
        v, omega = problem.fleet.system.rates(*self.controls[free:].T)
        arc = curvature(problem, self.program.truncation, problem.steps) * np.abs(v * omega)
        growth = self.present.growth[free:]
        grown = np.maximum(growth[:-1], growth[1:]) + arc + problem.solve.margin
        return np.asarray(hyperplanes.support + hyperplanes.radius[:, None] + grown)

    def _slopes(self, at: Ints, point: Ints, normal: Floats) -> Floats:
        """Slopes of ``normal . point`` at grid times by the free commands, shape (rows, 2 * free steps)."""
        direct, by_turn, turning = self._steps
        free, step, levers = self.present.free, self.program.problem.step, self._levers
        count = len(self.controls) - free
        back = _quarter(normal, not self._swapped)
        v, omega = np.empty((len(at), count)), np.empty((len(at), count))
        for i in range(direct.shape[1]):
            rows = point == i
            v[rows] = normal[rows] @ direct[:, i].T
            here = (back[rows] * levers[at[rows], i]).sum(axis=1)
            omega[rows] = normal[rows] @ by_turn[:, i].T + step * (here[:, None] - back[rows] @ levers[free + 1 :, i].T)
        later = np.arange(count) >= (at - free)[:, None]
        v[later] = omega[later] = 0.0
        chained = v[..., None] * turning[:, 0] + omega[..., None] * turning[:, 1]
        return chained.reshape(len(at), 2 * count)

    @property
    def _swapped(self) -> bool:
        return self.program.problem.fleet.system.heading_from == "y"

    @cached_property
    def _steps(self) -> tuple[Floats, Floats, Floats]:
        """Slopes of a step's displacement by speed and turn rate, at the points, and of the rates by the commands.

        By imaginary steps.
        """
        problem, present = self.program.problem, self.present
        system, free, at = problem.fleet.system, present.free, present.at
        image = self.image
        first, second = self.controls[free:].T
        v, omega = system.rates(first, second)
        ahead = system.rates(*self.controls[at:].T)[1]
        turned = system.turned(ahead, problem.step)[free - at :]
        linear, angular, heading = (column[:, None] for column in present.drives[:, :3].T)

        def slope(dv: complex, dw: complex) -> Floats:
            moves = system.displacement(v + dv, omega + dw, turned, linear, angular, heading, problem.step)
            return np.asarray(np.einsum("ij,djs->sid", image, np.stack(moves).imag / TINY))

        h = 1j * TINY
        rates = [np.stack(system.rates(first + a, second + b)).imag / TINY for a, b in ((h, 0.0), (0.0, h))]
        turning = np.stack(rates, axis=-1).transpose(1, 0, 2)  # (steps, rate, command)
        return slope(h, 0.0), slope(0.0, h), turning

    @cached_property
    def _levers(self) -> Floats:
        """Angular factors times places, at the points, shape (steps + 1, points, 2); zero before the present."""
        weighted = self.present.drives[:, 1, None, None] * self.nodal
        ahead = np.einsum("ij,jtd->tid", self.image, weighted)
        return np.concatenate([np.zeros((self.present.at, *ahead.shape[1:])), ahead])


def _lowest(values: Floats) -> NDArray[np.bool_]:
    """The lower half of the points in each row, shape of `values`: others follow, or are seen in the next round."""
    half = max(1, -(-values.shape[1] // 2))
    if half == values.shape[1] or not len(values):
        return np.ones(values.shape, dtype=bool)
    return np.asarray(values <= np.partition(values, half - 1, axis=1)[:, half - 1 : half])


def _blocks(steps: int) -> Ints:
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
        covered = BLOCKS if middle == 1 else (middle**BLOCKS - 1) / (middle - 1)
        low, high = (middle, high) if covered < steps else (low, middle)
    return high


def _summed(rows: Floats, starts: Ints, n: int) -> Floats:
    """Columns of commands added up over groups of steps; other columns as they are."""
    commands = rows[:, :n].reshape(len(rows), n // 2, 2)
    summed = np.add.reduceat(commands, starts, axis=1)
    return np.asarray(np.concatenate([summed.reshape(len(rows), 2 * len(starts)), rows[:, n:]], axis=1))


def _quarter(vectors: Floats, swapped: bool) -> Floats:
    """Vectors turned by a quarter in the direction in which headings grow."""
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([y, -x] if swapped else [-y, x], axis=-1)


def _terminal(problem: Problem, truncation: Truncation) -> ca.Function | None:
    """Value, gradient and Hessian of the terminal term by the final points, all x and then all y."""
    blocks = terminal_blocks(problem, truncation, Layout(problem.steps, truncation.count))
    if not blocks:
        return None
    z = ca.SX.sym("z", 2 * truncation.count)
    value = blocks[0].build(z, ca.SX(0, 1))
    hessian, gradient = ca.hessian(value, z)
    return ca.Function("terminal", [z], [value, gradient, ca.densify(hessian)])
