"""The largest member of a family of fleets that contain each other, with a certified plan."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.planning.ranges.oracle import Found, Oracle, Routes
from ensemble_ctrl.planning.ranges.search import GROWTH, largest
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]

FAR = 1.15
"""Times the largest size with a plan beyond which other routes are looked for."""
SLOW = 40
"""Iterations of a continuation above which the largest size is not far: sizes grow by less,"""
CAREFUL = 1.2
"""by this factor at most,"""
HARD = 80
"""and with more iterations, which are those of several rounds, by the tolerance at first."""


@dataclass(eq=False)
class Scaled:
    """A search over sizes: each try starts from the plan of the largest smaller size, and last from routes.

    Parameters
    ----------
    oracle : Oracle
    fleet_of : callable
        The fleet of a size; larger sizes contain smaller ones.
    guesses : tuple of ndarray, shape (steps', n_u)
        Controls to start from before there is a plan.

    Attributes
    ----------
    best : Found or None
        Of the largest size with a plan, which is `good`.
    failed : tuple of float and Found, or None
        The smallest size without a plan, and what came nearest to one.
    tolerance : float
        Of the size.
    effort : int
        Iterations of the last continuation that led to a plan.
    hard : int
        Plans in a row that were hard to find.
    looked : bool
        Whether other routes were looked for in vain, for a size well above one that has a plan.
    """

    oracle: Oracle
    fleet_of: Callable[[float], Fleet]
    guesses: tuple[Floats, ...] = ()
    best: Found | None = None
    failed: tuple[float, Found] | None = None
    good: float = 0.0
    tolerance: float = 0.0
    effort: int = 0
    hard: int = 0
    looked: bool = False

    def run(self, first: float, limit: float, tolerance: float) -> float:
        """The largest size with a plan, to a tolerance; 0 if none has one (`ensemble_ctrl.planning.ranges.search`).

        Where no other routes were looked for on the way, they are for a size well above it in the end.
        """
        self.tolerance = tolerance
        size = largest(self._works, first, limit, tolerance, above=self._above)[0]
        while size and self._elsewhere(1.01 * FAR * size, limit):
            size = largest(self._works, self.good, limit, tolerance, above=self._above)[0]
        return size

    def _elsewhere(self, size: float, limit: float) -> bool:
        """Whether other routes lead to a plan for a size, where none were looked for yet."""
        if self.looked or size > limit or not self.oracle.screens:
            return False
        self.looked = True
        return self._tried(size, (), "screen")

    def _above(self, good: float) -> float:
        """The next size: the harder the last plan was to find, the nearer."""
        if self.hard:
            # a little less than the tolerance, which rounding may not exceed
            return min(good + 0.98 * self.tolerance * 2.0 ** (self.hard - 1), CAREFUL * good)
        return good * (CAREFUL if self.effort > SLOW else GROWTH)

    def _routes(self, size: float) -> Routes:
        """Other routes are looked for where much more is wanted than there is: a little more needs no other route."""
        return "screen" if size > FAR * self.good else "never"

    def _works(self, size: float) -> bool:
        """Whether a plan is found for a size."""
        near = self.guesses if self.best is None else (self.best.solution.controls,)
        return size <= self.good or self._tried(size, near, self._routes(size) if near else "search")

    def _tried(self, size: float, near: tuple[Floats, ...], routes: Routes) -> bool:
        """One try, and what is learnt from it."""
        before = len(self.oracle.failed)
        try:
            fleet = self.fleet_of(size)
        except ProblemError:  # the system does not take such members
            return False
        found = self.oracle.certified(fleet, near, routes)
        if found is not None:
            self.effort = found.effort if near else 0
            self.hard = self.hard + 1 if self.effort > HARD else 0
            self.best, self.good = found, size
        elif len(self.oracle.failed) > before and (self.failed is None or size < self.failed[0]):
            self.failed = size, self.oracle.failed[-1]
        self.looked = self.looked or (found is None and routes == "screen")
        return found is not None
