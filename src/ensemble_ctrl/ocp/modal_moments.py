r"""Moments as variables, for robots on arcs: the paper's own coordinates.

::

    over        u_n                  the broadcast commands of step n
                m_n                  moments 0..N of (px, py, cos theta, sin theta) at grid time n

    subject to  m_n+1 = Phi(m_n, u_n)        Phi: the exact step of m' = (v calB1 + omega calB2) m, or Runge-Kutta

Points of the fleet's curve, of which rows speak, are linear in the moments; the moment rows read them as they are.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import UnsupportedError
from ensemble_ctrl.moments import TensorBasis
from ensemble_ctrl.ocp.arrays import CasadiArrays
from ensemble_ctrl.ocp.bilinear import MomentSystem, integrator
from ensemble_ctrl.ocp.cost import Scale
from ensemble_ctrl.ocp.layout import StateLayout
from ensemble_ctrl.ocp.margins import bulge, curvature
from ensemble_ctrl.ocp.parametrisation import Iterate
from ensemble_ctrl.ocp.program import Block
from ensemble_ctrl.ocp.truncation import Truncation
from ensemble_ctrl.ocp.weights import SLACK_WEIGHT
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
LIFTED = ("x", "y", "cos", "sin")
"""Coordinates of the lifted state."""


@dataclass(frozen=True, eq=False)
class Moments:
    """Moments of the lifted state at every grid time."""

    problem: Problem
    truncation: Truncation
    guess: Iterate

    def __post_init__(self) -> None:
        if self.truncation.hull and self.system.count < self.truncation.collocation.count:
            few, wanted = self.system.count, self.truncation.collocation.count
            what = f"a distribution of few values has {few} moments, and the guarantee hull needs {wanted}"
            raise UnsupportedError(f"moments.coordinates: {what}: use nodal, or the guarantee moment")

    @cached_property
    def system(self) -> MomentSystem:
        """The moment system, with the distributions' own polynomials."""
        fleet = self.problem.fleet
        pairs = zip(fleet.dynamic_distributions, self.truncation.orders, strict=True)
        basis = TensorBasis(tuple(one.basis(min(order, one.max_order)) for one, order in pairs))
        return MomentSystem(fleet, basis)

    @cached_property
    def layout(self) -> StateLayout:
        """Where they stand."""
        return StateLayout(len(self.guess.controls), self.system.count, n_u=2, n_x=len(LIFTED))

    @property
    def step(self) -> float:
        """Seconds."""
        return self.problem.duration / self.layout.steps

    @property
    def scale(self) -> Scale:
        """Commands as they are."""
        return Scale.none()

    @property
    def slack_weight(self) -> float:
        """Of a metre."""
        return SLACK_WEIGHT

    @property
    def dependent(self) -> Ints:
        """Moments after the start."""
        return self.layout.points[1:].ravel()

    @property
    def names(self) -> tuple[str, ...]:
        """Of the coordinates."""
        return LIFTED

    @property
    def position_columns(self) -> Any:
        """The first two coordinates."""
        return slice(0, 2 * self.layout.count)

    @cached_property
    def places(self) -> Floats:
        """From moments to points: the truncated sum at the nodes, and the points that nodes make."""
        truncation = self.truncation
        return np.asarray(truncation.to_points @ self.system.basis.evaluate(truncation.nodes))

    @property
    def shift(self) -> Floats:
        """Of the start positions, metres."""
        return np.concatenate([self.problem.fleet.shift, np.zeros(2)])

    @cached_property
    def curve(self) -> Floats:
        """The moments under the guess, shape (steps + 1, count, 4)."""
        return self.system.lifted(self.guess.controls, self.step).transpose(0, 2, 1)

    @property
    def bodies(self) -> None:
        """Robots are points."""

    def bulge(self, commands: ca.SX) -> Any:
        """What the arc of one step leaves its chord by, metres."""
        arc = curvature(self.problem, self.truncation, self.layout.steps)
        return bulge(self.problem, arc, commands[0], commands[1])

    def dynamics(self) -> list[Block]:
        """The bilinear moment system, step by step."""
        layout, n = self.layout, len(LIFTED) * self.layout.count
        system, arcs, advance = self.system, self.problem.fleet.arcs, integrator(self.problem.integrator)
        seconds, parts = self.step / self.guess.substeps, self.guess.substeps

        def build(z: ca.SX, d: ca.SX) -> ca.SX:
            v, omega = arcs.rates(z[0], z[1], CasadiArrays)
            m = z[2 : 2 + n]
            for _ in range(parts):
                m = advance(system, m, v, omega, seconds)
            # m_(n+1) - Phi(m_n, u_n) = 0
            defect: ca.SX = z[2 + n :] - m
            return defect

        columns = np.column_stack([layout.controls, layout.points[:-1], layout.points[1:]])
        zero = np.zeros((layout.steps, n))
        return [Block("moments", build, columns, np.zeros((layout.steps, 0)), zero, zero)]

    def bound(self, lower: Floats, upper: Floats) -> None:
        """Inputs, and the moments of the start."""
        fleet, layout = self.problem.fleet, self.layout
        lower[layout.controls], upper[layout.controls] = fleet.input_lower, fleet.input_upper
        lower[layout.points[0]] = upper[layout.points[0]] = self.curve[0].T.ravel()

    def start(self, x: Floats) -> None:
        """Commands and moments of the guess."""
        x[self.layout.controls] = self.guess.controls
        x[self.layout.states] = self.curve.transpose(0, 2, 1)

    def iterate(self, x: Floats) -> Iterate:
        """Commands, clipped to their bounds."""
        fleet = self.problem.fleet
        return Iterate(np.clip(x[self.layout.controls], fleet.input_lower, fleet.input_upper))
