"""Where each quantity stands in the decision vector of multiple shooting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.layout import Numbers

Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ShootingLayout(Numbers):
    """Index arrays into ``(commands, states of the node robots, levels and slacks)``.

    Parameters
    ----------
    steps : int
        Control steps.
    count : int
        Gauss-node robots.
    n_u, n_x : int
        Commands and states.
    """

    steps: int
    count: int
    n_u: int
    n_x: int

    @property
    def controls(self) -> Ints:
        """Indices of the scaled commands, shape (steps, n_u)."""
        return np.arange(self.steps * self.n_u).reshape(self.steps, self.n_u)

    @property
    def points(self) -> Ints:
        """Indices of the states, shape (steps + 1, n_x * count): all robots' first state, then their second."""
        size = self.n_x * self.count
        return self.steps * self.n_u + np.arange((self.steps + 1) * size).reshape(self.steps + 1, size)

    @property
    def states(self) -> Ints:
        """The same indices, shape (steps + 1, n_x, count)."""
        return self.points.reshape(self.steps + 1, self.n_x, self.count)

    @property
    def fixed(self) -> int:
        """Length of the part that is there from the start."""
        return self.steps * self.n_u + (self.steps + 1) * self.n_x * self.count
