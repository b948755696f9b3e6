r"""Full states of the Gauss-node robots as variables, for any system: multiple shooting.

::

    over        u_n         the broadcast commands of step n, in half widths of their bounds
                X_jn        the state of the Gauss-node robot j at grid time n

    subject to  X_j,n+1 = Phi(X_jn, u_n, psi_j)          Phi: the system's own map, or a Runge-Kutta rule

With the guarantee ``hull`` the points are the Bernstein coefficients of the polynomial through the nodes' states, with
``nodes`` the nodes themselves.  What the polynomial misses, and what happens between grid times, is measured by a finer
replay and comes back as room to spare.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.cost import Scale
from ensemble_ctrl.ocp.layout import StateLayout
from ensemble_ctrl.ocp.parametrisation import Iterate
from ensemble_ctrl.ocp.program import Block
from ensemble_ctrl.ocp.traced import moved
from ensemble_ctrl.ocp.truncation import Truncation
from ensemble_ctrl.ocp.weights import STATE_SLACK_WEIGHT
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def scale_of(problem: Problem) -> Scale:
    """Commands in half widths of their bounds; those that keep the middle member at rest take no effort."""
    fleet = problem.fleet
    return Scale.of_bounds(np.asarray(fleet.input_lower), np.asarray(fleet.input_upper), fleet.rest(fleet.center))


@dataclass(frozen=True, eq=False)
class States:
    """States of the node robots at every grid time."""

    problem: Problem
    truncation: Truncation
    guess: Iterate

    @cached_property
    def _simulated(self) -> Floats:
        """States under the guess, shape (steps + 1, n_x, nodes)."""
        if self.guess.states.size:
            return self.guess.states
        members = self.problem.fleet.dynamic_members(self.truncation.nodes)
        step = self.problem.duration / len(self.guess.controls)
        return self.problem.fleet.trajectories(self.guess.controls, members, step).transpose(1, 2, 0)

    @cached_property
    def layout(self) -> StateLayout:
        """Where they stand."""
        fleet = self.problem.fleet
        return StateLayout(
            len(self.guess.controls), self._simulated.shape[2], n_u=len(fleet.system.controls), n_x=len(fleet.states)
        )

    @cached_property
    def scale(self) -> Scale:
        """By the bounds of the commands."""
        return scale_of(self.problem)

    @property
    def slack_weight(self) -> float:
        """Of any state's unit."""
        return STATE_SLACK_WEIGHT

    @property
    def dependent(self) -> Ints:
        """States after the start."""
        return self.layout.points[1:].ravel()

    @property
    def names(self) -> tuple[str, ...]:
        """Of the states."""
        return self.problem.fleet.states

    @property
    def position_columns(self) -> Any:
        """Those of the states that are positions."""
        return (
            np.arange(self.layout.n_x * self.layout.count)
            .reshape(self.layout.n_x, -1)[self.problem.fleet.place_columns]
            .ravel()
        )

    @property
    def places(self) -> Floats:
        """From nodes to points."""
        return self.truncation.to_points

    @property
    def shift(self) -> Floats:
        """None: the nodes start where their members do."""
        return np.zeros(len(self.names))

    @property
    def curve(self) -> Floats:
        """States under the guess, shape (steps + 1, nodes, n_x)."""
        return self._simulated.transpose(0, 2, 1)

    @property
    def bodies(self) -> None:
        """Robots are points."""

    def bulge(self, commands: ca.SX) -> Any:
        """None: a finer replay measures what happens between grid times."""
        return 0.0

    def dynamics(self) -> list[Block]:
        """Each node robot's state follows from its last one."""
        fleet, layout = self.problem.fleet, self.layout
        psi = fleet.psi(fleet.dynamic_members(self.truncation.nodes))
        names, n_u, n_x = list(psi), layout.n_u, layout.n_x
        middle, half = self.scale.middle.tolist(), self.scale.half.tolist()
        step, substeps = self.problem.duration / layout.steps, self.guess.substeps

        def build(z: ca.SX, d: ca.SX) -> ca.SX:
            # commands in their units: u_i = middle_i + half_i s_i
            u = [m + h * z[i] for i, (m, h) in enumerate(zip(middle, half, strict=True))]
            own = {name: d[i] for i, name in enumerate(names)}
            before, after = z[n_u : n_u + n_x], z[n_u + n_x :]
            # X_(j,n+1) - Phi(X_jn, u_n, psi_j) = 0
            defect: ca.SX = after - moved(fleet.system, before, u, own, step, substeps)
            return defect

        # an instance for each step and node: its commands, its states before and after, and the node's parameters
        states, nodes = layout.states, layout.count
        columns = [layout.controls.repeat(nodes, axis=0)]
        columns += [part.transpose(0, 2, 1).reshape(-1, n_x) for part in (states[:-1], states[1:])]
        each = np.stack([psi[name] for name in names], axis=1) if names else np.zeros((nodes, 0))
        zero = np.zeros((layout.steps * nodes, n_x))
        return [Block("moving", build, np.hstack(columns), np.tile(each, (layout.steps, 1)), zero, zero)]

    def bound(self, lower: Floats, upper: Floats) -> None:
        """Inputs, and the start."""
        fleet, layout = self.problem.fleet, self.layout
        # scaled commands are in [-1, 1]; one whose bounds meet stays at its middle
        free = np.where(np.asarray(fleet.input_lower) == np.asarray(fleet.input_upper), 0.0, 1.0)
        lower[layout.controls], upper[layout.controls] = -free, free
        lower[layout.states[0]] = upper[layout.states[0]] = fleet.start_states(
            fleet.dynamic_members(self.truncation.nodes)
        )

    def start(self, x: Floats) -> None:
        """Commands and states of the guess."""
        x[self.layout.controls] = self.scale.scaled(self.guess.controls)
        x[self.layout.states] = self._simulated

    def iterate(self, x: Floats) -> Iterate:
        """Commands, clipped to their bounds, and states in a decision vector."""
        # a solver's bounds hold to its tolerance only
        scaled = np.clip(x[self.layout.controls], -1.0, 1.0)
        return Iterate(self.scale.commands(scaled), x[self.layout.states], self.guess.substeps)
