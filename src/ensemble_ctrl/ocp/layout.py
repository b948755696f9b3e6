"""Where each quantity stands in the decision vector."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass

Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Numbers(ABC):
    """A decision vector that begins with commands and what represents the fleet at every grid time.

    Levels, slacks, binaries and more are handed out while rows are made.

    Parameters
    ----------
    steps : int
        Control steps.
    count : int
        Variables for each coordinate of the fleet at one time.
    """

    steps: int
    count: int
    _levels: list[int] = field(default_factory=list, kw_only=True)
    _slacks: list[int] = field(default_factory=list, kw_only=True)
    _binaries: list[int] = field(default_factory=list, kw_only=True)
    _more: list[int] = field(default_factory=list, kw_only=True)

    @property
    @abstractmethod
    def fixed(self) -> int:
        """Length of the part that is there from the start."""

    @property
    @abstractmethod
    def controls(self) -> Ints:
        """Indices of the scaled commands, shape (steps, n_u)."""

    @property
    @abstractmethod
    def points(self) -> Ints:
        """Indices of the fleet's variables, shape (steps + 1, coordinates * count): one coordinate after the other."""

    @property
    def size(self) -> int:
        """Length of the decision vector so far."""
        return self.fixed + sum(map(len, (self._levels, self._slacks, self._binaries, self._more)))

    @property
    def levels(self) -> Ints:
        """Indices of the levels handed out so far."""
        return np.array(self._levels, dtype=np.int64)

    @property
    def slacks(self) -> Ints:
        """Indices of the slacks handed out so far."""
        return np.array(self._slacks, dtype=np.int64)

    @property
    def binaries(self) -> Ints:
        """Indices of the binaries handed out so far."""
        return np.array(self._binaries, dtype=np.int64)

    def level(self) -> int:
        """Hand out the index of a new robustness level."""
        self._levels.append(self.size)
        return self._levels[-1]

    def slack(self, count: int) -> Ints:
        """Hand out the indices of `count` new slacks."""
        return self._hand_out(self._slacks, count)

    def binary(self, count: int) -> Ints:
        """Hand out the indices of `count` new binaries."""
        return self._hand_out(self._binaries, count)

    def more(self, count: int) -> Ints:
        """Hand out the indices of `count` new variables of another kind."""
        return self._hand_out(self._more, count)

    def _hand_out(self, kind: list[int], count: int) -> Ints:
        """The next `count` indices, noted as of one kind."""
        # new variables stand after all that were handed out before
        new = self.size + np.arange(count)
        kind.extend(new.tolist())
        return new


@dataclass(frozen=True, eq=False)
class Layout(Numbers):
    """Index arrays into ``(v, omega, turned, points, more)``: positions of the truncated curve."""

    @property
    def controls(self) -> Ints:
        """Indices of v and omega, shape (steps, 2)."""
        return np.arange(2 * self.steps).reshape(2, -1).T

    @property
    def turned(self) -> Ints:
        """Indices of the integral of omega at every grid time, shape (steps + 1,)."""
        return 2 * self.steps + np.arange(self.steps + 1)

    @property
    def points(self) -> Ints:
        """Indices of the points, shape (steps + 1, 2 * count): all x, then all y."""
        # after v and omega of S steps and Omega at S + 1 grid times
        first = 3 * self.steps + 1
        return first + np.arange((self.steps + 1) * 2 * self.count).reshape(self.steps + 1, -1)

    @property
    def fixed(self) -> int:
        """Length of the part that is there from the start."""
        return 3 * self.steps + 1 + (self.steps + 1) * 2 * self.count


@dataclass(frozen=True, eq=False)
class StateLayout(Numbers):
    """Index arrays into ``(commands, states of the node robots, more)``.

    Parameters
    ----------
    n_u, n_x : int
        Commands and states.
    """

    n_u: int
    n_x: int

    @property
    def controls(self) -> Ints:
        """Indices of the scaled commands, shape (steps, n_u)."""
        return np.arange(self.steps * self.n_u).reshape(self.steps, self.n_u)

    @property
    def points(self) -> Ints:
        """Indices of the states, shape (steps + 1, n_x * count): all robots' first state, then their second."""
        # S steps of n_u commands, then n_x * count states at each of S + 1 grid times
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
