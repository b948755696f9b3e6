"""As soon as possible: the shortest plan, or the earliest passage of a region, that can be certified.

Both ask for the least value of one number (the plan's duration, or a deadline) with a plan. Every value is a problem of
its own; the search is over values:

1. Below a *bound* no plan exists: the checks of a problem are certain, and refuse every smaller value.
2. On the coarse grid, from every route, values of a ladder are tried upwards until one has a solution. The ladder is
   the same whatever the largest value is, so that what is found for one limit is found for every longer one. Below that
   value the rest is bisected; each starts from the solution at the last good one, driven faster along the same arcs.
   Where no value that is allowed has a solution, longer plans are looked for, to be driven faster.
3. Around what that finds, whole searches with certificates narrow it down to `TOLERANCE`.

*Guarantee*: the plan returned keeps its own value's problem as any plan does, proven where its certificate says so.
That no smaller value has a plan is proven below the bound only; between the two, none was found.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import field, replace
from functools import partial
from math import ceil, log, sqrt
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp import parallel
from ensemble_ctrl.ocp.guesses import Request, first_guesses
from ensemble_ctrl.ocp.rounds import Attempt, improve
from ensemble_ctrl.ocp.solvers import Iteration, SolverOptions
from ensemble_ctrl.ocp.truncation import coarse
from ensemble_ctrl.planning import planner
from ensemble_ctrl.planning.minimum_time.goals import Goal, bound, goal_of, is_sound
from ensemble_ctrl.planning.planner import Progress, Solution, coarse_steps
from ensemble_ctrl.planning.planner.coarse_fine import COARSE_ROUNDS
from ensemble_ctrl.planning.planner.grids import given
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

TOLERANCE = 0.01
"""Share of the value within which a plan was found and none was found."""
COARSE = 0.03
"""The same for the search on the coarse grid."""
RUNG = 1.35
"""Factor between the values of the ladder, which are its whole powers in seconds."""
LADDER = 0.5
"""Share of the time that smaller values may take before the largest is tried."""
SCREEN = 0.1
"""Share of the time limit that one short search takes at most, where there is no coarse grid."""
STEP = 0.03
"""Share by which the first whole searches differ."""


@dataclass(frozen=True)
class MinimumTime:
    """What the search for the least value found.

    Attributes
    ----------
    of : str
        What is least: ``duration``, or ``passage of`` a region.
    value : float
        Seconds; the least with a plan that is as good as was asked for.
    bound : float
        Seconds; below it certainly no plan exists.
    missed : float or None
        Seconds; the largest value at which none was found.
    tried : int
        Values tried with a whole search; those on the coarse grid are not counted.
    """

    of: str
    value: float
    bound: float
    missed: float | None
    tried: int


def solve(
    problem: Problem,
    *,
    progress: Progress | None = None,
    guess: Floats | None = None,
    log: Path | None = None,
) -> tuple[Solution, MinimumTime | None]:
    """Find controls, as `ensemble_ctrl.planning.planner.solve`, for the least value where one is asked for.

    Returns
    -------
    solution : Solution
        Its `problem` is that of the value found: with this duration, or with the visit in its task.
    found : MinimumTime or None
        None where nothing is to be least, or no plan was found at all.
    """
    goal = goal_of(problem)
    if goal is None:
        return planner.solve(problem, progress=progress, guess=guess, log=log), None
    return _Search(goal, progress, log).run(guess)


@dataclass(eq=False)
class _Search:
    """One search over values: the clock, the best plan, and what failed."""

    goal: Goal
    progress: Progress | None
    log: Path | None
    began: float = field(default_factory=time.perf_counter)
    stopped: bool = False
    best: Solution | None = None
    value: float = np.inf
    missed: float | None = None
    tried: int = 0
    seconds: float = 0.0
    work: list[Attempt] = field(default_factory=list)

    def run(self, guess: Floats | None) -> tuple[Solution, MinimumTime | None]:
        """Coarse, then whole searches; where nothing is found, the plan for the largest value as it is."""
        lowest = bound(self.goal)
        value, controls = self._coarse(lowest, guess)
        last = self._narrow(value, controls, lowest)
        if self.best is None and guess is not None and not self._over():  # it may be a plan as it is
            last = self._tried(self.goal.most, guess, self.goal.most)
        if self.best is None:
            return self._summed(last), None
        found = MinimumTime(self.goal.of, self.value, lowest, self.missed, self.tried)
        return self._summed(self.best), found

    def _summed(self, solution: Solution) -> Solution:
        """A solution with the work of the whole search."""
        return replace(
            solution,
            iterations=solution.iterations + sum(a.iterations for a in self.work),
            build_seconds=solution.build_seconds + sum(a.build_seconds for a in self.work),
            solve_seconds=solution.solve_seconds + sum(a.solve_seconds for a in self.work),
            seconds={"search": self.seconds, **solution.seconds},
        )

    # --- on the coarse grid

    def _coarse(self, lowest: float, guess: Floats | None) -> tuple[float, Floats | None]:
        """The least value with a solution on the coarse grid, within `COARSE`, and the solution."""
        low, most = lowest, self.goal.nearest(self.goal.most, 0.0, np.inf)
        if most is None:
            return self.goal.most, guess
        high, live = most, [] if guess is None else self._solved(most, [guess])
        by_routes = self.goal.problem.fleet.system.transcription == "positions"
        ladder = self._ladder(low, most) if by_routes else iter([most])
        while not live and not self._over() and (rung := next(ladder, None)) is not None:
            high, live = rung, self._solved(rung, [])
        if not live:
            return most, guess
        # bisection at geometric means: `high` has a solution, `low` has none
        while high - low > COARSE * high and not self._over():
            if (middle := self._between(low, high)) is None:
                break
            found = self._solved(middle, [self.goal.carried(c, high, middle) for c in live])
            low, high, live = (low, middle, found) if found else (middle, high, live)
        return (high, live[0]) if high <= self.goal.most else (most, guess)

    def _ladder(self, low: float, most: float) -> Iterator[float]:
        """Values upwards that depend on the largest as little as can be, with that one, and those beyond it."""
        goal, limit = self.goal.beyond, self.goal.problem.solve.time_limit
        # exponents of the powers of RUNG from the bound to the largest value, and to those beyond it
        first, last, end = (ceil(log(max(t, 0.01 * most)) / log(RUNG)) for t in (low, most, goal.most))
        for k in range(first, last):
            value = goal.nearest(RUNG**k, low, most)
            if value is not None and self._left() > (1 - LADDER) * limit:
                yield value
        yield most
        for k in range(last, end):
            value = goal.nearest(RUNG**k, most, np.inf)
            if value is not None and is_sound(self.goal, value):
                yield value

    def _between(self, low: float, high: float) -> float | None:
        """A value near the geometric mean of two others."""
        return self.goal.nearest(sqrt(max(low, 0.01 * high) * high), low, high)

    def _solved(self, value: float, guesses: list[Floats]) -> list[Floats]:
        """Solutions at a value from some guesses, cheapest first, or where these fail from routes."""
        problem = self.goal.at(value)
        if problem.fleet.system.transcription == "states":
            return self._screened(problem)
        steps = coarse_steps(problem)
        found = self._improved(problem, [given(problem, guess, steps) for guess in guesses])
        if not found and not self._over():
            found = self._improved(
                problem, [guess.controls for guess in first_guesses(Request(problem, steps, quick=True))]
            )
        return [a.controls for a in sorted(found, key=lambda a: a.value.cost)]

    def _screened(self, problem: Problem) -> list[Floats]:
        """The controls that a short search without a proof finds, if any."""
        seconds = min(self._left(), SCREEN * self.goal.problem.solve.time_limit)
        options = replace(problem.solve, time_limit=max(seconds, 1e-3))
        found = planner.screen(problem.with_(solve=options), progress=self._tell)
        return [] if found is None else [found]

    def _improved(self, problem: Problem, guesses: list[Floats]) -> list[Attempt]:
        """Those of the guesses that become solutions."""
        found = []
        for guess in guesses:
            if self._over():
                break
            limits = problem.solve.max_iterations, self._left()
            options = SolverOptions(*limits, 1e-3, 1e-2, self.log, problem.solve.solver)
            work = partial(improve, problem, guess, coarse(problem), COARSE_ROUNDS, options)
            attempt = parallel.alone(work, self._watch, self._left)
            if attempt is None:
                break
            self.work.append(attempt)
            found += [attempt] if attempt.value.keeps(0.0) else []
        return found

    # --- whole searches

    def _narrow(self, value: float, controls: Floats | None, lowest: float) -> Solution:
        """Whole searches up from a value until one is good, then down until the step is within the tolerance.

        Returns the last of the first ones.
        """
        last = self._tried(value, controls, value)
        while self.best is None and not self._over() and value < self.goal.most:
            # up by STEP until a whole search succeeds
            higher = self.goal.nearest(value * (1 + STEP), value, np.inf)
            if higher is None:
                break
            last = self._tried(higher, controls, value)
            value, controls = higher, last.controls
        while self.best is not None and not self._over():
            # STEP lower, or halfway to the largest value without a plan, whichever is less far
            floor = lowest if self.missed is None else max(self.missed, lowest)
            lower = self.goal.nearest(max(self.value * (1 - STEP), (floor + self.value) / 2), floor, self.value)
            if self.value - floor <= TOLERANCE * self.value or lower is None:
                break
            self._tried(lower, self.best.controls, self.value)
        return last

    def _tried(self, value: float, controls: Floats | None, made_for: float) -> Solution:
        """A whole search at a value, from controls made for another if there are any; the best plan is kept."""
        solution = self._whole(value, None if controls is None else self.goal.carried(controls, made_for, value))
        proven = solution.certificate is None or solution.certificate.proven == "yes"
        good = solution.status == "planned" and proven
        if good and value < self.value:
            self.best, self.value = solution, value
        elif not good and not self.stopped:
            self.missed = value if self.missed is None else max(self.missed, value)
        return solution

    def _whole(self, value: float, guess: Floats | None) -> Solution:
        """One search of the planner."""
        problem = self.goal.at(value)
        options = replace(problem.solve, time_limit=max(self._left(), 1e-3))
        self.tried += 1
        self.seconds = time.perf_counter() - self.began
        solution = planner.solve(problem.with_(solve=options), progress=self._tell, guess=guess, log=self.log)
        return replace(solution, problem=problem)

    # --- the clock

    def _left(self) -> float:
        """Seconds until the time limit."""
        return self.goal.problem.solve.time_limit - (time.perf_counter() - self.began)

    def _over(self) -> bool:
        """Whether to stop with what there is."""
        return self.stopped or self._left() <= 0

    def _tell(self, phase: str, iteration: Iteration | None) -> bool:
        """Pass on how it goes, and remember a wish to stop."""
        self.stopped = self.stopped or (self.progress is not None and self.progress(phase, iteration))
        return self.stopped

    def _watch(self, iteration: Iteration) -> bool:
        """The same for a solve on the coarse grid."""
        return self._tell("coarse solve", iteration)
