"""Signals of a group of members whose states are computed only at the times that a formula reads."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import Predicate, Signals
from ensemble_ctrl.core.errors import ProblemError

Floats = NDArray[np.float64]


class GroupSignals:
    """Values of predicates on states that are computed when they are read.

    Parameters
    ----------
    during : callable
        The states at the times first..last, shape (n_x, members, last - first + 1).
    names : sequence of str
        The states' names.
    step : float
        Seconds between two times.
    members, steps : int
        How many there are.
    """

    def __init__(
        self,
        during: Callable[[int, int], Floats],
        names: Sequence[str],
        step: float,
        members: int,
        steps: int,
    ) -> None:
        self.step, self.members, self.steps = step, members, steps
        self._compute, self._names = during, tuple(names)
        self._known: dict[tuple[int, int], Floats] = {}

    def leaf(self, predicate: Predicate, first: int, last: int) -> Floats:
        """Robustness of a predicate at the times first..last, shape (members, last - first + 1)."""
        terms, offset = predicate.normalised()
        columns = self._during(first, last)
        result = np.full(columns.shape[1:], float(offset))
        # rho = c x + offset with |c| = 1
        for name, value in terms:
            if name not in self._names:
                raise ProblemError(f"formula: expected one of the states {', '.join(self._names)}, got {name!r}")
            result += value * columns[self._names.index(name)]
        return result

    def mean(self) -> Signals:
        """A mean is of all members, and not of a group."""
        raise ProblemError("formula: expected a task that is read for each member, got one with a mean")

    def _during(self, first: int, last: int) -> Floats:
        """States at the times first..last, computed once for all faces of a region."""
        if (first, last) not in self._known:
            self._known[first, last] = self._compute(first, last)
        return self._known[first, last]
