"""Plans that tolerate most: the largest multiple of given errors of the model with a certified plan.

Every multiple is a problem of its own, whose fleet has these errors. It is doubled from one, or halved, until a plan
was found for one multiple and none for another; the rest is bisected, each search from the last good plan.

*Guarantee*: the plan returned is proven with the errors that its problem has. That none tolerates more is not proven.
"""

from __future__ import annotations

import time
from dataclasses import field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.planning import planner
from ensemble_ctrl.planning.planner import Progress, Solution
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.uncertainty import Uncertainty

Floats = NDArray[np.float64]

CLOSE = 0.1
"""Share of a multiple within which a plan was found and none was found."""
LEAST, MOST = 1e-3, 1e3
"""Multiples beyond which nothing is looked for."""
STEP = 2.0
"""Factor between the first multiples."""


@dataclass(frozen=True)
class MostTolerant:
    """What the search found.

    Attributes
    ----------
    scale : float
        The largest multiple with a certified plan.
    missed : float or None
        The smallest multiple for which none was found.
    tried : int
        Multiples that were tried.
    bounds : dict
        The errors of that plan's problem, as plain data.
    """

    scale: float
    missed: float | None
    tried: int
    bounds: dict[str, Any]


def solve(
    problem: Problem, *, progress: Progress | None = None, guess: Floats | None = None, log: Path | None = None
) -> tuple[Solution, MostTolerant | None]:
    """Find the plan that tolerates the largest multiple of ``objective.tolerance``.

    Returns
    -------
    solution : Solution
        Its `problem` has the errors that the plan is proven with, and no longer asks for more.
    found : MostTolerant or None
        None where no plan was found for any multiple.
    """
    errors = problem.objective.tolerance
    if errors is None:
        raise AssertionError("a problem that asks for tolerance")
    return _Search(problem, errors, progress, log).run(guess)


@dataclass(eq=False)
class _Search:
    """One search over multiples: the clock, the best plan, and what failed."""

    problem: Problem
    errors: Uncertainty
    progress: Progress | None
    log: Path | None
    began: float = field(default_factory=time.perf_counter)
    stopped: bool = False
    best: Solution | None = None
    scale: float = 0.0
    missed: float = np.inf
    tried: int = 0

    def run(self, guess: Floats | None) -> tuple[Solution, MostTolerant | None]:
        """Growth, then bisection."""
        last = self._try(1.0, guess)
        while not self._over() and not (self.scale and self.missed < np.inf):
            scale = self.scale * STEP if self.scale else self.missed / STEP
            if not LEAST <= scale <= MOST:
                break
            last = self._try(scale, None)
        while self.best is not None and not self._over() and self.missed < np.inf:
            if self.missed <= (1 + CLOSE) * self.scale:
                break
            self._try(float(np.sqrt(self.scale * self.missed)), self.best.controls)
        if self.best is None:
            return last, None
        missed = None if np.isinf(self.missed) else self.missed
        bounds = self.best.problem.fleet.uncertainty.data()
        return self.best, MostTolerant(self.scale, missed, self.tried, bounds)

    def _try(self, scale: float, guess: Floats | None) -> Solution:
        """A whole search for one multiple; from a guess, and without it where that fails."""
        self.tried += 1
        whole = self._of(scale)
        start = guess if guess is not None else None if self.best is None else self.best.controls
        found = planner.solve(whole, progress=self._tell, guess=start, log=self.log)
        if not _good(found) and start is not None and not self._over():
            found = planner.solve(self._of(scale), progress=self._tell, log=self.log)
        if _good(found) and scale > self.scale:
            self.best, self.scale = found, scale
        elif not _good(found):
            self.missed = min(self.missed, scale)
        return found

    def _of(self, scale: float) -> Problem:
        """The problem of one multiple, within what is left of the time."""
        left = max(1.0, self.problem.solve.time_limit - (time.perf_counter() - self.began))
        fleet = self.problem.fleet.with_(uncertainty=self.errors.scaled(scale))
        aim = replace(self.problem.objective, tolerance=None)
        return self.problem.with_(fleet=fleet, objective=aim, solve=replace(self.problem.solve, time_limit=left))

    def _tell(self, phase: str, iteration: Any) -> bool:
        """Pass on what happens; remember a wish to stop."""
        self.stopped = self.stopped or (self.progress is not None and self.progress(phase, iteration))
        return self.stopped

    def _over(self) -> bool:
        """Whether to stop now."""
        return self.stopped or time.perf_counter() - self.began > self.problem.solve.time_limit


def _good(found: Solution) -> bool:
    """Whether a plan was found and proven."""
    return found.status == "planned" and found.certificate is not None and found.certificate.proven == "yes"
