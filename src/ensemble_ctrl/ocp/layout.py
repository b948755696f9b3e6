"""Where each quantity stands in the decision vector."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Numbers(ABC):
    """A decision vector that begins with a fixed part; levels and slacks are handed out while rows are made."""

    _levels: list[int] = field(default_factory=list, kw_only=True)
    _slacks: list[int] = field(default_factory=list, kw_only=True)

    @property
    @abstractmethod
    def fixed(self) -> int:
        """Length of the part that is there from the start."""

    @property
    def size(self) -> int:
        """Length of the decision vector so far."""
        return self.fixed + len(self._levels) + len(self._slacks)

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
        return self._hand_out(self._slacks, count)

    def _hand_out(self, kind: list[int], count: int) -> Ints:
        """The next `count` indices, noted as of one kind."""
        new = self.size + np.arange(count)
        kind.extend(new.tolist())
        return new


@dataclass(frozen=True, eq=False)
class Layout(Numbers):
    """Index arrays into the decision vector ``(v, omega, turned, points, levels, slacks, binaries)``.

    Binaries (0 or 1) and more are handed out too.

    Parameters
    ----------
    steps : int
        Control steps.
    count : int
        Points that represent the fleet's position curve.
    """

    steps: int
    count: int
    _binaries: list[int] = field(default_factory=list)
    _more: list[int] = field(default_factory=list)

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
        first = 3 * self.steps + 1
        return first + np.arange((self.steps + 1) * 2 * self.count).reshape(self.steps + 1, -1)

    @property
    def fixed(self) -> int:
        """Length of the part that is there from the start."""
        return 3 * self.steps + 1 + (self.steps + 1) * 2 * self.count

    @property
    def size(self) -> int:
        """Length of the decision vector so far."""
        return super().size + len(self._binaries) + len(self._more)

    @property
    def binaries(self) -> Ints:
        """Indices of the binaries handed out so far."""
        return np.array(self._binaries, dtype=np.int64)

    def more(self, count: int) -> Ints:
        """Hand out the indices of `count` new variables of another kind."""
        return self._hand_out(self._more, count)

    def binary(self, count: int) -> Ints:
        """Hand out the indices of `count` new binaries."""
        return self._hand_out(self._binaries, count)
