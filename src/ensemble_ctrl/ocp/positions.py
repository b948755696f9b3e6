r"""Positions of the truncated curve as variables, for robots on arcs.

::

    over        v_n, omega_n         the broadcast commands of step n
                turned_n             the integral of the turn rate before step n, shared by every member
                P_n                  points that represent the fleet's position curve at grid time n

    subject to  turned_{n+1} = turned_n + rate(v_n, omega_n) dt
                P_{n+1} = P_n + C d(v_n, omega_n, turned_n)
                                     d: exact arcs of the Gauss-node robots, C their points
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.arrays import CasadiArrays
from ensemble_ctrl.ocp.bodies import BodyRows
from ensemble_ctrl.ocp.cost import Scale
from ensemble_ctrl.ocp.layout import Layout
from ensemble_ctrl.ocp.margins import bulge, curvature
from ensemble_ctrl.ocp.parametrisation import Iterate
from ensemble_ctrl.ocp.program import Block
from ensemble_ctrl.ocp.truncation import Truncation, node_drives, points
from ensemble_ctrl.ocp.weights import SLACK_WEIGHT
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Positions:
    """Points of the position curve at every grid time, and the common turn."""

    problem: Problem
    truncation: Truncation
    guess: Iterate

    @cached_property
    def layout(self) -> Layout:
        """Where they stand."""
        return Layout(len(self.guess.controls), self.truncation.count)

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
        """Turn and points after the start."""
        return np.concatenate([self.layout.turned[1:], self.layout.points[1:].ravel()])

    @property
    def names(self) -> tuple[str, ...]:
        """Of the coordinates."""
        return ("x", "y")

    @property
    def position_columns(self) -> Any:
        """All are positions."""
        return slice(None)

    @property
    def places(self) -> Floats | None:
        """The variables are the points."""
        return None

    @property
    def image(self) -> Floats:
        """C, from positions of the Gauss-node robots to the variables of a coordinate."""
        return self.truncation.to_points

    @property
    def shift(self) -> Floats:
        """Of the start positions, metres."""
        return self.problem.fleet.shift

    @cached_property
    def curve(self) -> Floats:
        """The points under the guess, shape (steps + 1, points, 2), metres."""
        return points(self.problem, self.guess.controls, self.truncation)

    @cached_property
    def _curvature(self) -> float:
        """Metres by which an arc leaves its chord for ``|v omega| = 1``."""
        return curvature(self.problem, self.truncation, self.layout.steps)

    @property
    def bodies(self) -> BodyRows | None:
        """Corners of bodies follow from the points and the common turn."""
        return None if self.problem.fleet.footprint is None else BodyRows(self.problem, self.truncation, self.layout)

    def bulge(self, commands: ca.SX) -> Any:
        """What the arc of one step leaves its chord by, metres."""
        return bulge(self.problem, self._curvature, commands[0], commands[1])

    def dynamics(self) -> list[Block]:
        """The turn, then the points."""
        return [self._turning(), self._moving()]

    def _turning(self) -> Block:
        """``turned`` is the running integral of the turn rate."""
        system, layout, step = self.problem.fleet.arcs, self.layout, self.step
        columns = np.column_stack([layout.controls, layout.turned[:-1], layout.turned[1:]])
        zero = np.zeros((layout.steps, 1))

        def build(z: ca.SX, d: ca.SX) -> ca.SX:
            _, omega = system.rates(z[0], z[1], CasadiArrays)
            # Omega_(n+1) - Omega_n - omega_n dt = 0
            turned: ca.SX = z[3] - z[2] - step * omega
            return turned

        return Block("turning", build, columns, np.zeros((layout.steps, 0)), zero, zero)

    def _moving(self) -> Block:
        """The points move by the image C of the Gauss-node robots' exact displacements d."""
        system, layout, step, n = self.problem.fleet.arcs, self.layout, self.step, self.layout.count
        image = ca.DM(self.image)
        # drives (a_j, b_j, g_j) of the node robots are numbers of the program
        linear, angular, heading = (ca.DM(column) for column in node_drives(self.problem, self.truncation)[:, :3].T)

        def build(z: ca.SX, d: ca.SX) -> ca.SX:
            before, after = z[3 : 3 + 2 * n], z[3 + 2 * n :]
            dx: ca.SX
            dy: ca.SX
            # exact arcs: d(v, omega, Omega) of every node robot, then its image C for x and for y
            v, omega = system.rates(z[0], z[1], CasadiArrays)
            dx, dy = system.displacement(v, omega, z[2], linear, angular, heading, step, CasadiArrays)
            # P_(n+1) - P_n - C d(v_n, omega_n, Omega_n) = 0
            return after - before - ca.vertcat(ca.mtimes(image, dx), ca.mtimes(image, dy))

        columns = np.column_stack([layout.controls, layout.turned[:-1], layout.points[:-1], layout.points[1:]])
        zero = np.zeros((layout.steps, 2 * n))
        return Block("moving", build, columns, np.zeros((layout.steps, 0)), zero, zero)

    def bound(self, lower: Floats, upper: Floats) -> None:
        """Inputs, and the common start."""
        fleet, layout = self.problem.fleet, self.layout
        lower[layout.controls], upper[layout.controls] = fleet.input_lower, fleet.input_upper
        for bound in (lower, upper):
            # Omega_0 = 0, and all points start at p_0: the box of starts is a constant of the rows
            bound[layout.turned[0]] = 0.0
            bound[layout.points[0]] = np.repeat(fleet.start_place, layout.count)

    def start(self, x: Floats) -> None:
        """Commands, turn and points under the guess."""
        controls, layout = self.guess.controls, self.layout
        _, omega = self.problem.fleet.arcs.rates(*controls.T)
        x[layout.controls] = controls
        # Omega_n = sum_(m<n) omega_m dt under the guess
        x[layout.turned] = np.concatenate([[0.0], np.cumsum(omega) * self.step])
        x[layout.points] = np.concatenate([self.curve[..., 0], self.curve[..., 1]], axis=1)

    def iterate(self, x: Floats) -> Iterate:
        """Commands, clipped to their bounds."""
        fleet = self.problem.fleet
        return Iterate(np.clip(x[self.layout.controls], fleet.input_lower, fleet.input_upper))
