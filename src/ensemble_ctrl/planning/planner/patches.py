"""Across patches of terrain, or round them: both are tried, and the better plan is kept.

The program counts what a patch does to a plan by its margins, which follow from the plan before: it pays for crossing,
but does not see that a way round would cost nothing.  So some patches are made obstacles, and what is found for that
problem is a guess for the problem itself.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from itertools import combinations, islice

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import Always, And, Avoid
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.ocp.guesses import Request, first_guesses
from ensemble_ctrl.ocp.rounds import rank
from ensemble_ctrl.planning.planner.coarse_fine import coarse_all
from ensemble_ctrl.planning.planner.grids import coarse_steps
from ensemble_ctrl.planning.planner.proving import CLOSE, is_proven
from ensemble_ctrl.planning.planner.search import Search
from ensemble_ctrl.planning.planner.solution import Solution
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Strategy = Callable[[Search, Problem, Floats | None], Solution]

MOST = 6
"""Sets of patches that are kept out of, at most."""


def across_or_round(strategy: Strategy, search: Search, problem: Problem, guess: Floats | None) -> Solution:
    """The best of a plan that may cross every patch, and of plans that are found by keeping out of some.

    Each starts from a route; only where none of them is a plan, guesses of other kinds are tried.

    Parameters
    ----------
    strategy : callable
        How a problem is planned.
    search : Search
    problem : Problem
        With terrain.
    guess : ndarray, shape (steps', n_u), optional
    """
    found = [] if guess is None else [_timed(strategy, search, problem, guess)]
    for names in islice(_sets(list(problem.terrain)), MOST):
        around = kept_out(problem, names)
        start = None if around is None or search.over() else _by_routes(replace(search, problem=around), around)
        if around is None or start is None:
            continue
        if names:
            way = strategy(replace(search, problem=around), around, start)
            start = way.controls if way.status == "planned" else None
        if start is not None and not search.over():
            found.append(_timed(strategy, search, problem, start))
    if not any(one.status == "planned" for one in found):  # further guesses, and what is missing, in full
        found.append(_timed(strategy, search, problem, None))
    best = min(found, key=_rank)
    rest = time.perf_counter() - search.began - sum(best.seconds.values())
    best = replace(best, seconds={**best.seconds, "other ways": rest})
    return replace(best, status="interrupted") if search.stopped else best


def _timed(strategy: Strategy, search: Search, problem: Problem, guess: Floats | None) -> Solution:
    """One search, what went before not counted among its seconds."""
    before = time.perf_counter() - search.began
    found = strategy(search, problem, guess)
    return replace(found, seconds={**found.seconds, "guess": found.seconds["guess"] - before})


def _sets(names: list[str]) -> Iterator[tuple[str, ...]]:
    """What to keep out of: nothing, all patches, all but one, and each one alone."""
    sizes = dict.fromkeys(size for size in (0, len(names), len(names) - 1, 1) if size >= 0)
    return (some for size in sizes for some in combinations(names, size))


def _by_routes(search: Search, problem: Problem) -> Floats | None:
    """Controls on the coarse grid that keep the constraints, if some route leads to any."""
    guesses = first_guesses(Request(problem, coarse_steps(problem), quick=True))
    best = min(coarse_all(search, [guess.controls for guess in guesses]), key=rank)
    return best.controls if best.value.keeps(-CLOSE) else None


def _rank(found: Solution) -> tuple[bool, bool, float, float]:
    """Sorting key: proven first, then as attempts are ranked."""
    return (not is_proven(found.certificate), *rank(found.attempt))


def kept_out(problem: Problem, names: Collection[str]) -> Problem | None:
    """The problem with patches as obstacles; None where that can't be, as at the start."""
    if not names:
        return problem
    patches = {name: problem.terrain[name].pieces for name in sorted(names)}
    rest = {name: patch for name, patch in problem.terrain.items() if name not in names}
    how = {"verify": replace(problem.verify, certificate=False), "solve": replace(problem.solve, method="nlp")}
    try:
        task = And((problem.task, *(Always(Avoid(name)) for name in patches)))
        return problem.with_(obstacles={**problem.obstacles, **patches}, terrain=rest, task=task, **how)
    except ProblemError:
        return None
