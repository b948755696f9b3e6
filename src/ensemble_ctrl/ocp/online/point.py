"""Commands with what they cost: the cost of `ensemble_ctrl.ocp.cost`, and its slopes by the commands."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.cost import cost
from ensemble_ctrl.ocp.hyperplanes import Hyperplanes, separate
from ensemble_ctrl.ocp.margins import curvature
from ensemble_ctrl.ocp.online.curve import Curve
from ensemble_ctrl.ocp.online.model import NEAR, InitialCondition, OnlineModel
from ensemble_ctrl.ocp.weights import SLACK_WEIGHT

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PROXIMAL = 1.0
"""Weight that keeps levels where they are, per square metre."""
SMALL = 1e-3
"""Weight that keeps commands where they are."""


class Point:
    """Commands with the fleet's points under them."""

    def __init__(self, model: OnlineModel, initial: InitialCondition, controls: Floats) -> None:
        self.model, self.initial, self.controls = model, initial, controls
        self.curve = Curve(model.problem, model.truncation, initial, controls)

    def moved(self, change: Floats) -> Point:
        """The point after a change of the free commands, shape (free steps, n_u)."""
        controls, fleet = self.controls.copy(), self.model.problem.fleet
        controls[self.initial.free :] += change
        return Point(self.model, self.initial, np.clip(controls, fleet.input_lower, fleet.input_upper))

    @property
    def free(self) -> Floats:
        """The commands that may still be changed, shape (free steps, n_u)."""
        return self.controls[self.initial.free :]

    @property
    def last(self) -> Floats | None:
        """The last command that was sent."""
        return self.controls[self.initial.free - 1] if self.initial.free else None

    @property
    def changes(self) -> Floats:
        """Changes of the free commands, from the last that was sent on."""
        return np.diff(self.controls[max(self.initial.free - 1, 0) :], axis=0)

    @property
    def differences(self) -> Floats:
        """Matrix D from the changes of one free command to those of `changes`."""
        count = len(self.free)
        D = np.eye(count) - np.eye(count, k=-1)
        return D if self.initial.free else D[1:]

    def hyperplanes(self) -> Hyperplanes:
        """Separating hyperplanes of the steps from the first free one on."""
        problem, free = self.model.problem, self.initial.free
        begin = free * problem.step
        avoid = self.model.avoid if self.initial.avoid is None else self.initial.avoid
        return separate(self.curve.points[free:], avoid, problem.duration - begin, begin=begin, within=2 * NEAR)

    def cost(self, hyperplanes: Hyperplanes) -> tuple[float, float]:
        """The cost, shortfalls included, and the largest shortfall in metres."""
        problem = self.model.problem
        # by how much rows fall short: hyperplanes, rates, and the task's level
        away = np.maximum(self.required(hyperplanes) - hyperplanes.nearest(self.curve.points[self.initial.free :]), 0.0)
        shorts = [away[hyperplanes.active].ravel()]
        if self.model.most is not None:
            shorts.append(np.maximum(np.abs(self.changes) - self.model.most, 0.0).ravel())
        level = float(self.levels[-1]) if self.model.levels.count else 0.0
        if self.model.levels.count:
            shorts.append(np.maximum(np.array([problem.solve.margin - level]), 0.0))
        short = np.concatenate(shorts)
        terminal = sum(float(error[0]) for _, error in self._ends) / self.curve.robots
        whole = cost(problem.objective, self.model.commands.total(self.free, self.last), terminal, level)
        return whole + SLACK_WEIGHT * float(short.sum()), float(short.max(initial=0.0))

    def smooth_cost(self) -> tuple[Floats, Floats]:
        """Hessian (Gauss-Newton) and gradient of all but shortfalls, by the free commands and the levels."""
        commands, levels, n = self.model.commands, self.model.levels.count, self.free.size
        H, g = np.zeros((n + levels, n + levels)), np.zeros(n + levels)
        # effort: 2 dt w (s - r) and 2 dt w; smoothness: (2 w_s / dt) D^T D
        slope, bend = commands.effort_slopes(self.free)
        H[np.arange(n), np.arange(n)] = np.tile(bend, len(self.free)) + SMALL
        g[:n] = slope.ravel()
        if commands.smoothness:
            D, weight = self.differences, commands.roughness_bend
            H[:n, :n] += weight * np.kron(D.T @ D, np.eye(2))
            g[:n] += weight * (D.T @ self.changes).ravel()
        # the level's reward, and a pull on every level to stay
        if levels:
            H[n + np.arange(levels), n + np.arange(levels)] = PROXIMAL
            g[-1] = -self.model.problem.objective.robustness
        # the terminal term of each robot: S^T F S with the positive part of its Hessian F by the final points
        for own, error in self._ends:
            gradient, hessian = np.array(error[1]).ravel(), np.array(error[2])
            eigen, vectors = np.linalg.eigh(hessian / self.curve.robots)
            last, axes = np.full(2 * len(own), self.model.problem.steps), np.repeat(np.eye(2), len(own), axis=0)
            S = self.curve.slopes(last, np.tile(own, 2), axes)
            root = (np.sqrt(np.maximum(eigen, 0.0))[:, None] * vectors.T) @ S
            H[:n, :n] += root.T @ root
            g[:n] += gradient / self.curve.robots @ S
        return H, g

    def required(self, hyperplanes: Hyperplanes) -> Floats:
        """What ``normal . p`` has to reach for every pair of a side and a step."""
        problem, free = self.model.problem, self.initial.free
        # support + radius + margin + sagitta + growth at the larger of both ends
        v, omega = problem.fleet.arcs.rates(*self.free.T)
        arc = curvature(problem, self.model.truncation, problem.steps) * np.abs(v * omega)
        growth = self.initial.growth[free:]
        grown = np.maximum(growth[:-1], growth[1:]) + arc + problem.solve.margin
        return np.asarray(hyperplanes.support + hyperplanes.radius[:, None] + grown)

    @cached_property
    def heights(self) -> Floats:
        """Values of the task's rows, shape (rows, points)."""
        return self.model.levels.heights(self.curve.points, self.mean, self.initial.growth)

    @cached_property
    def levels(self) -> Floats:
        """What the task's levels are worth."""
        return self.model.levels.values(self.heights)

    @property
    def mean(self) -> Floats:
        """Weights of the points in the mean position."""
        return np.asarray(np.tile(self.model.truncation.mean, self.curve.robots) / self.curve.robots)

    @cached_property
    def _ends(self) -> list[tuple[Ints, Sequence[ca.DM]]]:
        """The points of each robot, with the error of where they end, its gradient and its Hessian."""
        if self.model.terminal is None:
            return []
        final = self.curve.points[-1]
        robots = np.arange(len(final), dtype=np.int64).reshape(self.curve.robots, -1)
        return [(own, self.model.terminal(final[own].T.ravel())) for own in robots]
