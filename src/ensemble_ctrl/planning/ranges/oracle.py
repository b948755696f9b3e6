"""Whether a part of a fleet has a certified plan: tries with a bounded effort."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import field, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.planning import minimum_time, planner
from ensemble_ctrl.planning.minimum_time import MinimumTime
from ensemble_ctrl.planning.minimum_time.goals import goal_of
from ensemble_ctrl.planning.planner import Progress, Solution
from ensemble_ctrl.planning.planner.continuation import ITERATIONS
from ensemble_ctrl.planning.planner.proving import is_proven, least_bound
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]
Routes = Literal["never", "screen", "search"]
Tell = Callable[[Fleet, bool], None]
"""Called after each part of a fleet tried, with whether it was certified."""

PATIENCE = 4.0
"""A try may take so many times as long as the longest that found a plan,"""
LEAST_SECONDS = 20.0
"""and at least so many seconds."""


@dataclass(frozen=True, eq=False)
class Found:
    """What a try came to, certified or not.

    Attributes
    ----------
    solution : Solution
    shortest : MinimumTime or None
        Where a time is to be as short as possible.
    """

    solution: Solution
    shortest: MinimumTime | None = None

    @property
    def proven(self) -> bool:
        """Whether the controls are proven for every member."""
        return is_proven(self.solution.certificate) and self.solution.attempt.value.excess <= 0

    @property
    def effort(self) -> int:
        """Iterations of all solves."""
        return self.solution.iterations

    @property
    def shortfall(self) -> float:
        """What is missing to a proof, metres."""
        certificate = self.solution.certificate
        return np.inf if certificate is None else -least_bound(certificate)


@dataclass(eq=False)
class Oracle:
    """Tries for parts of one problem's fleet.

    Parameters
    ----------
    problem : Problem
        All but the fleet.
    progress : callable, optional
        As for `ensemble_ctrl.planning.planner.solve`; once it returns True, every further try fails at once.
    tell : callable, optional
        Called after each try.
    """

    problem: Problem
    progress: Progress | None = None
    tell: Tell | None = None
    tried: int = 0
    stopped: bool = False
    slowest: float = 0.0
    failed: list[Found] = field(default_factory=list)

    @property
    def screens(self) -> bool:
        """Whether there is a coarse grid to look for routes on."""
        return _is_quick(self.problem)

    def certified(self, fleet: Fleet, guesses: Sequence[Floats] = (), routes: Routes = "search") -> Found | None:
        """A certified plan for `fleet`, if one is found.

        Parameters
        ----------
        fleet : Fleet
            A part of the problem's, or wider than it.
        guesses : sequence of ndarray, shape (steps', n_u)
            Controls of plans for other parts, the nearest first: each is continued.
        routes : {"never", "screen", "search"}
            What is tried where no guess leads to a plan: nothing, routes on the coarse grid whose result is continued
            (nothing for systems without such a grid), or all that the planner does.

        Notes
        -----
        *Guarantee*: what is returned is certified for every member of `fleet`; None proves nothing.
        """
        if self.stopped:
            return None
        self.tried += 1
        best: Found | None = None
        for found in self._tries(fleet, guesses, routes):
            best = found if best is None or found.shortfall < best.shortfall else best
            if found.proven:
                break
        proven = best is not None and best.proven
        if self.stopped and not proven:  # it was not tried to its end
            return None
        if best is not None and not proven:
            self.failed.append(best)
        if self.tell is not None:
            self.tell(fleet, proven)
        return best if proven else None

    def _tries(self, fleet: Fleet, guesses: Sequence[Floats], routes: Routes) -> Iterator[Found]:
        """What each start comes to."""
        try:
            problem = self.problem.with_(fleet=fleet, verify=replace(self.problem.verify, certificate=True))
        except ProblemError:  # the checks refuse it: there is certainly no plan
            return
        quick = _is_quick(problem)
        for guess in guesses:
            if not self.stopped:
                yield self._continued(problem, guess) if quick else self._whole(problem, guess)
        if routes == "search" and not self.stopped:
            yield self._whole(problem, None)
        elif routes == "screen" and quick and not self.stopped:
            controls = planner.screen(_brief(problem), progress=self._watch)
            if controls is not None and not self.stopped:
                yield self._continued(problem, controls)

    def _continued(self, problem: Problem, guess: Floats) -> Found:
        """From the plan of another part: its rounds and iterations are bounded, so that no clock has to end it."""
        return Found(planner.continued(problem, guess, progress=self._watch))

    def _whole(self, problem: Problem, guess: Floats | None) -> Found:
        """All that the planner does."""
        return self._timed(problem, lambda timed: Found(*minimum_time.solve(timed, progress=self._watch, guess=guess)))

    def _timed(self, problem: Problem, work: Callable[[Problem], Found]) -> Found:
        """What comes of work within a time that successes suggest."""
        began, limit = time.perf_counter(), problem.solve.time_limit
        if self.slowest:
            limit = min(limit, max(LEAST_SECONDS, PATIENCE * self.slowest))
        found = work(problem.with_(solve=replace(problem.solve, time_limit=limit)))
        if found.proven:
            self.slowest = max(self.slowest, time.perf_counter() - began)
        return replace(found, solution=replace(found.solution, problem=_asked(found.solution.problem, problem)))

    @property
    def _watch(self) -> Progress:
        """The progress, which remembers a wish to stop."""
        return partial(_watching, self)


def _watching(oracle: Oracle, phase: str, iteration: object) -> bool:
    """Pass on how far a try is."""
    if oracle.progress is not None:
        oracle.stopped = oracle.progress(phase, iteration) or oracle.stopped  # type: ignore[arg-type]
    return oracle.stopped


def _is_quick(problem: Problem) -> bool:
    """Whether plans of other parts are continued, and routes looked for on a coarse grid."""
    return problem.fleet.system.transcription == "positions" and goal_of(problem) is None


def _brief(problem: Problem) -> Problem:
    """The problem with as many iterations as a screen is worth."""
    return problem.with_(solve=replace(problem.solve, max_iterations=min(problem.solve.max_iterations, ITERATIONS)))


def _asked(solved: Problem, asked: Problem) -> Problem:
    """The problem as solved, with the time limit that was asked for."""
    return solved.with_(solve=replace(solved.solve, time_limit=asked.solve.time_limit))
