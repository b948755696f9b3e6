"""Where each quantity stands in the decision vector of multiple shooting."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ShootingLayout:
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
    _levels: list[int] = field(default_factory=list)
    _slacks: list[int] = field(default_factory=list)

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
    def size(self) -> int:
        """Length of the decision vector so far."""
        own = self.steps * self.n_u + (self.steps + 1) * self.n_x * self.count
        return own + len(self._levels) + len(self._slacks)

    @property
    def levels(self) -> Ints:
        """Indices of the levels handed out so far."""
        return np.array(self._levels, dtype=np.int64)

    @property
    def slacks(self) -> Ints:
        """Indices of the slacks handed out so far."""
        return np.array(self._slacks, dtype=np.int64)

    def level(self) -> int:
        """Hand out the index of a new robustness level."""
        self._levels.append(self.size)
        return self._levels[-1]

    def slack(self, count: int) -> Ints:
        """Hand out the indices of `count` new slacks."""
        new = self.size + np.arange(count)
        self._slacks.extend(new.tolist())
        return new
