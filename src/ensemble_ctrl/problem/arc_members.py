"""Members on arcs: each by five coefficients, which are affine in its parameters."""

from __future__ import annotations

from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import UnsupportedError
from ensemble_ctrl.problem.ensemble import Ensemble
from ensemble_ctrl.systems import ArcSystem, System

Floats = NDArray[np.float64]

START_COLUMNS = {"start_heading": 2, "start_x": 3, "start_y": 4}
"""Parameters of the start of robots on arcs, and their places among the member coefficients."""


class ArcMembers(Ensemble):
    """An ensemble with a system; where that moves on arcs, its members' coefficients."""

    system: System

    @property
    def heading(self) -> float:
        """Start heading, radians from +x counter-clockwise."""
        raise NotImplementedError

    @property
    def position(self) -> Floats:
        """Start position, shape (d,), metres."""
        raise NotImplementedError

    @property
    def arcs(self) -> ArcSystem:
        """The system of a fleet that moves on exact arcs; what follows is about such fleets."""
        if not self.system.on_arcs:
            raise UnsupportedError(f"expected a system on arcs, got the {self.system.name}")
        return cast(ArcSystem, self.system)

    @property
    def own_heading(self) -> float:
        """Start heading in radians in the system's own convention."""
        return float(self.arcs.own_heading(self.heading))

    @cached_property
    def directions(self) -> Floats:
        """How much each parameter adds to the coefficients, shape (parameters, 5)."""
        rows = np.zeros((len(self.parameters), 5))
        for row, name in zip(rows, self.names, strict=True):
            if name in START_COLUMNS:
                row[START_COLUMNS[name]] = -1.0 if name == "start_heading" and self.arcs.heading_from == "y" else 1.0
            else:
                row[:2] = self.arcs.directions[name]
        return rows

    @cached_property
    def origin(self) -> Floats:
        """The coefficients from which `directions` count, shape (5,)."""
        # factors that no parameter sets are 1
        given = self.directions[:, :2].any(axis=0)
        return np.array([*np.where(given, 0.0, 1.0), self.own_heading, *self.position])

    @cached_property
    def fastest(self) -> tuple[float, float]:
        """Largest linear and angular factor of any member."""
        corners = self.coefficients(self.corners)
        return float(np.abs(corners[:, 0]).max()), float(np.abs(corners[:, 1]).max())

    @cached_property
    def slowest(self) -> float:
        """Smallest linear factor of any member."""
        return float(self.coefficients(self.corners)[:, 0].min())

    def coefficients(self, members: Floats) -> Floats:
        """The coefficients of members of shape (members, parameters), shape (members, 5)."""
        # affine in the parameters: (linear, angular, heading, x, y) = origin + psi directions
        return np.asarray(self.origin + members @ self.directions)
