"""From a plan to one of a nearby problem, with a bounded effort: no other guesses, and a coarser grid where that does.

Each round chooses the separating hyperplanes at the last controls, solves once and certifies. Where the hull of the
whole fleet is what falls short, the next round gives parts of the range hyperplanes of their own; where the program is
satisfied and the proof falls short, it has more margin. Rounds end with a proof, where the controls are too far from
one, and where a round brings them no nearer to it.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate import Certificate
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.rounds import Attempt, anew, start
from ensemble_ctrl.ocp.truncation import Truncation, choose, raised, tail
from ensemble_ctrl.planning.planner.coarse_fine import TAIL_LIMIT
from ensemble_ctrl.planning.planner.grids import between, coarse_steps, given, refined
from ensemble_ctrl.planning.planner.proving import is_proven, least_bound
from ensemble_ctrl.planning.planner.search import Progress, Search
from ensemble_ctrl.planning.planner.solution import Solution, status_of
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

ROUNDS = 4
"""Solves of one try."""
ITERATIONS = 80
"""Iterations of each solve: one that succeeds takes 15 to 65."""
STEPS = 64
"""The grid has at least this many steps: on coarser ones too much happens between them."""
HOPELESS = 0.15
"""Metres that the controls may be short of a proof for another round to be worth while."""
PROGRESS = 0.7
"""Part of what was missing to a proof that may still be missing after another round."""
STUCK = 2e-3
"""Metres that the task may fall short by where the obstacles are kept clear of, for another round to be worth while."""
MOST_CELLS = 4
"""Parts of the range with hyperplanes of their own, at most, unless the problem has more."""
MOST_POINTS = 45
"""Points of the hulls of all parts, at most: of a box of two parameters each part has as many as a range squared."""


@dataclass(frozen=True, eq=False)
class _Round:
    """Controls, what they are worth, and what is proven of them."""

    attempt: Attempt
    certificate: Certificate

    @property
    def short(self) -> float:
        """Metres that are missing to a proof."""
        return 0.0 if is_proven(self.certificate) else max(0.0, -least_bound(self.certificate))


def continued(problem: Problem, controls: Floats, *, progress: Progress | None = None) -> Solution:
    """Controls for a problem from those of a nearby one.

    Parameters
    ----------
    problem : Problem
        Of a system whose program is in positions; it is certified whether or not it asks for that.
    controls : ndarray, shape (steps', n_u)
        Of the nearby problem.
    progress : callable, optional
        As for `solve`.

    Returns
    -------
    Solution
        The first proven controls, else those that fall short least.
    """
    search = Search(problem, progress, None)
    search.tell("solve")
    steps = _steps(problem)
    best = last = _as_given(search, refined(given(problem, controls, problem.steps), problem.steps))
    truncation, work, asked = choose(problem, refined(best.attempt.controls, steps)), list[Attempt](), problem
    while not (is_proven(best.certificate) or len(work) == ROUNDS or search.over()):
        found = _round(search, asked, refined(last.attempt.controls, steps), truncation)
        if found is None:
            break
        work.append(found.attempt)
        near = found.short <= HOPELESS and (len(work) == 1 or found.short <= PROGRESS * last.short)
        best = found if len(work) == 1 or found.short < best.short else best
        last = found
        if not near or _is_stuck(problem, found.attempt) or _is_full(problem, found.attempt):
            break
        truncation, asked = _relaxed(problem, found.attempt), _tightened(problem, asked, found)
    return _solution(search, best, work)


def _steps(problem: Problem) -> int:
    """Steps of the grid: a divisor of the problem's, of at least `STEPS` and those of the coarse grid."""
    least = max(STEPS, coarse_steps(problem))
    return next((n for n in range(least, problem.steps) if problem.steps % n == 0), problem.steps)


def _as_given(search: Search, controls: Floats) -> _Round:
    """The controls as they are."""
    attempt = start(search.problem, controls, choose(search.problem, controls))
    return _Round(replace(attempt, status="solved", message="as given"), search.certified(controls))


def _round(search: Search, asked: Problem, controls: Floats, truncation: Truncation) -> _Round | None:
    """One choice of hyperplanes, one solve, one certificate; None where there is no time."""
    options = replace(search.options(1e-3, 1e-3), max_iterations=ITERATIONS)

    def work(own: Search) -> Attempt:
        return anew(asked, controls, truncation, options, own.watch("solve"))

    attempt = search.alone("solve", work)
    if attempt is None:
        return None
    return _Round(attempt, search.certified(refined(attempt.controls, search.problem.steps)))


def _is_stuck(problem: Problem, attempt: Attempt) -> bool:
    """Whether the task alone falls short, which parts with hyperplanes of their own do not change."""
    value = attempt.value
    return attempt.status == "solved" and value.gap >= -problem.solve.margin and value.robustness < -STUCK


def _is_full(problem: Problem, attempt: Attempt) -> bool:
    """Whether the hull is too large for as many parts as would make it smaller."""
    truncation = attempt.truncation
    crowded = truncation.count * 2 * truncation.cells > MOST_POINTS
    return _is_wide(problem, attempt) and crowded and truncation.cells < MOST_CELLS


def _is_wide(problem: Problem, attempt: Attempt) -> bool:
    """Whether the hull of a part of the range does not keep clear of the obstacles."""
    return bool(attempt.truncation.orders) and attempt.value.gap < problem.solve.margin


def _relaxed(problem: Problem, attempt: Attempt) -> Truncation:
    """For the next round: more cells where the hull is too large, and one more moment where the tail is."""
    truncation = attempt.truncation
    if _is_wide(problem, attempt):
        truncation = replace(truncation, cells=max(truncation.cells, min(2 * truncation.cells, MOST_CELLS)))
    long = tail(problem, attempt.controls, truncation) >= TAIL_LIMIT
    return raised(truncation) if long else truncation


def _tightened(problem: Problem, asked: Problem, found: _Round) -> Problem:
    """For the next round: more margin, and windows that hold between grid times, where only the proof falls short."""
    if not found.attempt.value.keeps(0.0) or not np.isfinite(found.short):
        return asked
    # the margin grows by 1.5 times what is missing, and 1 mm
    solve = replace(asked.solve, margin=asked.solve.margin + 1.5 * found.short + 1e-3)
    return asked.with_(solve=solve, task=between(problem) if found.certificate.robustness < 0 else asked.task)


def _solution(search: Search, best: _Round, work: list[Attempt]) -> Solution:
    """What was found, with the work of all rounds."""
    attempt, certificate = best.attempt, best.certificate
    return Solution(
        search.problem,
        refined(attempt.controls, search.problem.steps),
        status_of(search, attempt, certificate),
        attempt,
        seconds={"solve": time.perf_counter() - search.began},
        iterations=sum(a.iterations for a in work),
        build_seconds=sum(a.build_seconds for a in work),
        solve_seconds=sum(a.solve_seconds for a in work),
        certificate=certificate,
    )
