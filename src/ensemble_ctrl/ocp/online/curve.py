r"""The fleet's points under commands, and their slopes by those that may still be changed.

The displacement of a node robot over a step is a function of the commands alone, so the points at grid time n have
closed-form slopes:

.. math::

    \frac{\partial P_n}{\partial v_l} = C \frac{\partial d_l}{\partial v}, \qquad
    \frac{\partial P_n}{\partial \omega_l} = C \Bigl(\frac{\partial d_l}{\partial \omega}
        + \Delta\, \psi_2\, R_{\perp} (p_n - p_{l+1})\Bigr) \qquad (l < n)

for turning a little more in step l turns everything that follows about the place where the step ends.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.online.model import InitialCondition
from ensemble_ctrl.ocp.truncation import Truncation
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TINY = 1e-20
"""Imaginary step of a derivative: exact to rounding, for nothing is subtracted."""


class Curve:
    """Points of all robots at every grid time.

    Attributes
    ----------
    points : ndarray, shape (steps + 1, points, 2)
        Metres; those of one robot after the other, measured ones before the initial condition.
    """

    def __init__(self, problem: Problem, truncation: Truncation, initial: InitialCondition, controls: Floats) -> None:
        self.problem, self.initial, self.controls = problem, initial, controls
        self.robots = initial.path.shape[1]
        # C for each robot, side by side; P_n = C p_n from the measured pose on, measured places before it
        self._image = np.kron(np.eye(self.robots), truncation.to_points)
        self._nodal = problem.fleet.arcs.paths(controls[initial.at :], initial.coefficients, problem.step)
        ahead = np.einsum("ij,jtd->tid", self._image, self._nodal)
        before = np.repeat(initial.path[: initial.at], truncation.count, axis=1)
        self.points = np.concatenate([before, ahead])

    def slopes(self, at: Ints, point: Ints, normal: Floats) -> Floats:
        """Slopes of ``normal . point`` at grid times by the free commands, shape (rows, 2 * free steps)."""
        direct, by_turn, chain = self._steps
        free, step, levers = self.initial.free, self.problem.step, self._levers
        count = len(self.controls) - free
        back = _quarter(normal, self.problem.fleet.arcs.heading_from == "x")
        v, omega = np.empty((len(at), count)), np.empty((len(at), count))
        # n . C dd_l/dv, and n . C (dd_l/domega + dt psi_2 R (p_n - p_l+1)): R is moved over to n as its transpose
        for i in range(direct.shape[1]):
            rows = point == i
            v[rows] = normal[rows] @ direct[:, i].T
            here = (back[rows] * levers[at[rows], i]).sum(axis=1)
            omega[rows] = normal[rows] @ by_turn[:, i].T + step * (here[:, None] - back[rows] @ levers[free + 1 :, i].T)
        # nothing depends on steps that come later; then from the rates (v, omega) to the commands
        later = np.arange(count) >= (at - free)[:, None]
        v[later] = omega[later] = 0.0
        chained = v[..., None] * chain[:, 0] + omega[..., None] * chain[:, 1]
        return chained.reshape(len(at), 2 * count)

    @cached_property
    def _steps(self) -> tuple[Floats, Floats, Floats]:
        """``C dd_l/dv`` and ``C dd_l/domega``, (free steps, points, 2), and d(v, omega)_l/du_l, by imaginary steps."""
        initial, system = self.initial, self.problem.fleet.arcs
        free, at, step = initial.free, initial.at, self.problem.step
        first, second = self.controls[free:].T
        v, omega = system.rates(first, second)
        turned = system.turned(system.rates(*self.controls[at:].T)[1], step)[free - at :]
        linear, angular, heading = (column[:, None] for column in initial.coefficients[:, :3].T)

        # imaginary steps: d/dv f(v) = Im f(v + i h) / h, exact to rounding
        def slope(dv: complex, dw: complex) -> Floats:
            moves = system.displacement(v + dv, omega + dw, turned, linear, angular, heading, step)
            return np.asarray(np.einsum("ij,djs->sid", self._image, np.stack(moves).imag / TINY))

        h = 1j * TINY
        rates = [np.stack(system.rates(first + a, second + b)).imag / TINY for a, b in ((h, 0.0), (0.0, h))]
        chain = np.stack(rates, axis=-1).transpose(1, 0, 2)  # (steps, rate, command)
        return slope(h, 0.0), slope(0.0, h), chain

    @cached_property
    def _levers(self) -> Floats:
        """``C psi_2 p_n``, shape (steps + 1, points, 2); zero before the initial condition."""
        weighted = self.initial.coefficients[:, 1, None, None] * self._nodal
        ahead = np.einsum("ij,jtd->tid", self._image, weighted)
        return np.concatenate([np.zeros((self.initial.at, *ahead.shape[1:])), ahead])


def _quarter(vectors: Floats, from_x: bool) -> Floats:
    """Vectors turned by a quarter against the direction in which headings grow, from the x or from the y axis."""
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([y, -x] if from_x else [-y, x], axis=-1)
