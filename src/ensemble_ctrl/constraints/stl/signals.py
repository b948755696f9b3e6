"""Where a robustness walk gets its numbers from."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.constraints.stl.leaves import Predicate
from ensemble_ctrl.core.errors import ProblemError

Array = NDArray[np.float64]


class Signals(Protocol):
    """Values of the leaves over members and time."""

    @property
    def members(self) -> int:
        """How many members."""

    @property
    def steps(self) -> int:
        """How many steps; there are steps + 1 times."""

    @property
    def step(self) -> float:
        """Seconds from one time to the next."""

    def leaf(self, predicate: Predicate, first: int, last: int) -> Any:
        """Robustness of a predicate (`normalised`) at first..last: (members, last - first + 1)."""

    def mean(self) -> Signals:
        """The same for the mean state: one member."""


class StateSignals:
    """Signals of state trajectories in a NumPy array.

    Parameters
    ----------
    states : array_like, shape (members, steps + 1, n_x)
        Units as in the problem.
    names : sequence of str
        The n_x states' names.
    step : float
        Seconds.
    """

    def __init__(self, states: ArrayLike, names: Sequence[str], step: float) -> None:
        self.states = np.asarray(states, dtype=float)
        if self.states.ndim != 3 or self.states.shape[2] != len(names) or not self.states.size:
            wanted = f"(members, steps + 1, {len(names)})"
            raise ProblemError(f"states: expected shape {wanted}, got {self.states.shape}")
        if not (step > 0 and np.isfinite(step)):
            raise ProblemError(f"step: expected a positive number of seconds, got {step}")
        self.names = tuple(names)
        self.step = float(step)
        self._columns: dict[str, Array] = {}

    @property
    def members(self) -> int:
        """How many members."""
        return len(self.states)

    @property
    def steps(self) -> int:
        """How many steps."""
        return len(self.states[0]) - 1

    def leaf(self, predicate: Predicate, first: int, last: int) -> Array:
        """Robustness of a predicate at the times first..last, shape (members, last - first + 1)."""
        # rho = c x + offset with |c| = 1 (see Predicate.normalised), one state at a time
        ((name, value), *more), offset = predicate.normalised()
        result = _affine(self._column(name)[:, first : last + 1], value, offset)
        for name, value in more:
            result += value * self._column(name)[:, first : last + 1]
        return result

    def blocks(self, entries: int) -> list[StateSignals]:
        """The same with fewer members each, so that a state has about `entries` values in a block."""
        # members in a block: `entries` over the number of times
        size = max(1, entries // self.states.shape[1])
        if self.members <= size:
            return [self]
        parts = [self.states[i : i + size] for i in range(0, self.members, size)]
        return [StateSignals(part, self.names, self.step) for part in parts]

    def mean(self) -> StateSignals:
        """The mean state's signals."""
        return self._mean

    @cached_property
    def _mean(self) -> StateSignals:
        return StateSignals(self.states.mean(axis=0, keepdims=True), self.names, self.step)

    def _column(self, name: str) -> Array:
        """A state's values, one member after the other in memory."""
        if name not in self.names:
            raise ProblemError(f"formula: expected one of the states {', '.join(self.names)}, got {name!r}")
        if name not in self._columns:
            self._columns[name] = np.ascontiguousarray(self.states[:, :, self.names.index(name)])
        return self._columns[name]


def _affine(x: Array, value: float, offset: float) -> Array:
    """``value x + offset`` in one pass where that is possible."""
    if value == -1.0:
        return np.asarray(offset - x)
    if value == 1.0:
        return np.asarray(x + offset)
    result = value * x
    result += offset
    return result
