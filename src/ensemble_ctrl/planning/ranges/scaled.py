"""The largest member of a family of fleets that contain each other, with a certified plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.planning.ranges.oracle import Found, Oracle, Routes
from ensemble_ctrl.planning.ranges.search import largest
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]

FAR = 1.15
"""Times the largest size with a plan beyond which other routes are looked for."""


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
    """

    oracle: Oracle
    fleet_of: Callable[[float], Fleet]
    guesses: tuple[Floats, ...] = ()
    best: Found | None = None
    failed: tuple[float, Found] | None = None
    good: float = 0.0

    def run(self, first: float, limit: float, tolerance: float) -> float:
        """The largest size with a plan, to a tolerance; 0 if none has one (`ensemble_ctrl.planning.ranges.search`)."""
        return largest(self._works, first, limit, tolerance)[0]

    def _routes(self, size: float) -> Routes:
        """Other routes are looked for where much more is wanted than there is: a little more needs no other route."""
        return "screen" if size > FAR * self.good else "never"

    def _works(self, size: float) -> bool:
        """Whether a plan is found for a size."""
        before = len(self.oracle.failed)
        near = self.guesses if self.best is None else (self.best.solution.controls,)
        try:
            fleet = self.fleet_of(size)
        except ProblemError:  # the system does not take such members
            return False
        found = self.oracle.certified(fleet, near, self._routes(size) if near else "search")
        if found is not None:
            self.best, self.good = found, size
        elif len(self.oracle.failed) > before and (self.failed is None or size < self.failed[0]):
            self.failed = size, self.oracle.failed[-1]
        return found is not None
