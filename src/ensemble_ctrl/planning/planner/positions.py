"""The search in positions of the truncated curve: routes, further guesses, other facets."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate import Certificate
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.candidates import Tried, tried
from ensemble_ctrl.ocp.guesses import Guess, first_guesses, further_rounds, ompl_paths
from ensemble_ctrl.ocp.guesses.passages import closed_off
from ensemble_ctrl.ocp.mixed import Round, rounds
from ensemble_ctrl.ocp.rounds import Attempt, rank, start
from ensemble_ctrl.ocp.truncation import choose
from ensemble_ctrl.planning.planner.coarse_fine import (
    MIDDLE_FIRST,
    WHOLE,
    WIDENED,
    Finished,
    coarse_all,
    final_rank,
    finalists,
    fine,
    finish_all,
    is_good,
)
from ensemble_ctrl.planning.planner.grids import coarse_steps, given, refined
from ensemble_ctrl.planning.planner.proving import CLOSE, certified_with_margin, is_proven, no_less_proven
from ensemble_ctrl.planning.planner.published import by_published
from ensemble_ctrl.planning.planner.search import Search
from ensemble_ctrl.planning.planner.solution import Solution, status_of
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

NEAREST = 4
"""Guesses that are tried for ranges that widen slowly, where nothing else was any help."""


def by_positions(search: Search, problem: Problem, guess: Floats | None) -> Solution:
    """In positions of the truncated curve: routes, coarse and fine solves, further guesses, other facets."""
    if problem.solve.as_published:
        return by_published(search, problem, guess)
    seconds: dict[str, float] = {}
    search.tell("guess")
    steps = coarse_steps(problem)
    starts = [Guess(given(problem, guess, steps))] if guess is not None else first_guesses(search.request(steps))
    seconds["guess"] = time.perf_counter() - search.began
    search.tell("solve")
    tries = _Tries()
    _try(search, tries, starts)
    closed = () if guess is not None or is_good(problem, tries.best) else closed_off(problem)
    if guess is None and not closed:
        for others, shares in _further(search, tries, steps):
            _try(search, tries, others, shares)
            if search.over() or is_good(problem, tries.best):
                break
    best = tries.best
    final, certificate = best.attempt, best.certificate
    if guess is not None and (proven := _as_given(search, guess, best)):
        final, certificate = proven.attempt, proven.certificate
    seconds["solve"] = time.perf_counter() - search.began - seconds["guess"] - best.certify_seconds
    if problem.verify.certificate:
        seconds["certify"] = best.certify_seconds
    work = tries.work
    routes = tries.reported
    nlp: Attempt | None = None
    turned: list[Round] = []
    if problem.solve.method == "minlp":
        nlp = final
        search.tell("minlp")
        final, certificate, turned, more = _chosen_facets(search, final, certificate)
        work += more
        seconds["minlp"] = time.perf_counter() - search.began - sum(seconds.values())
    return Solution(
        problem,
        refined(final.controls, problem.steps),
        status_of(search, final, certificate),
        final,
        tuple(routes),
        seconds,
        sum(a.iterations for a in work),
        sum(a.build_seconds for a in work),
        sum(a.solve_seconds for a in work),
        certificate,
        nlp,
        tuple(turned),
        () if guess is not None or closed or is_good(problem, best) or ompl_paths.available() else ("ompl",),
        closed,
    )


@dataclass(eq=False)
class _Tries:
    """Guesses with their coarse solutions, and those of them that were finished, by their places."""

    starts: list[Guess] = field(default_factory=list)
    solved: list[Attempt] = field(default_factory=list)
    finished: dict[int, Finished] = field(default_factory=dict)

    @property
    def which(self) -> int:
        """The best, by its place."""
        return min(self.finished, key=lambda i: final_rank(self.finished[i]))

    @property
    def best(self) -> Finished:
        """The best."""
        return self.finished[self.which]

    @property
    def work(self) -> list[Attempt]:
        """Every solve."""
        return [*self.solved, *(attempt for end in self.finished.values() for attempt in end.work)]

    @property
    def reported(self) -> list[Tried]:
        """What became of each guess."""
        fine = {i: end.attempt for i, end in self.finished.items() if end.work}
        pairs = zip(self.starts, self.solved, strict=True)
        return [tried(seed, coarse, fine.get(i), i == self.which) for i, (seed, coarse) in enumerate(pairs)]


def _try(search: Search, tries: _Tries, starts: list[Guess], shares: tuple[float, ...] = WHOLE) -> None:
    """Solve guesses on the coarse grid, and finish the best of them.

    Those that are tried for shares of the ranges first, where others led to no plan, are finished only if that is worth
    while.
    """
    first = len(tries.starts)
    search.show_candidates([*(tries.reported if tries.finished else tries.starts), *starts])
    solved = coarse_all(search, [seed.controls for seed in starts], shares)
    tries.starts += starts
    tries.solved += solved
    chosen = finalists(search.problem, solved) if solved else []
    chosen = [i for i in chosen if shares == WHOLE or solved[i].value.keeps(-CLOSE)]
    finished = finish_all(search, [solved[i] for i in chosen]) if chosen else []
    tries.finished |= {first + i: end for i, end in zip(chosen, finished, strict=False)}
    if tries.finished:
        search.show_candidates(tries.reported)


def _further(search: Search, tries: _Tries, steps: int) -> Iterator[tuple[list[Guess], tuple[float, ...]]]:
    """More guesses, a few at a time, as long as there is no good plan, and the shares of the ranges to try them for.

    First the same ones, and after each round that had others, the nearest so far for ranges that widen slowly.
    """
    if search.over() or is_good(search.problem, tries.best):
        return
    yield [replace(guess, kind="middle") for guess in tries.starts], MIDDLE_FIRST
    widened: set[int] = set()
    for batches in further_rounds(search.request(steps, tries.solved[tries.which].controls)):
        before = len(tries.starts)
        for guesses in batches:
            yield guesses, MIDDLE_FIRST
        if len(tries.starts) == before:
            continue
        nearest = sorted(set(range(len(tries.solved))) - widened, key=lambda i: rank(tries.solved[i]))[:NEAREST]
        widened |= {*nearest, *range(len(tries.solved), len(tries.solved) + len(nearest))}
        yield [_from(tries, i) for i in nearest], WIDENED


def _from(tries: _Tries, i: int) -> Guess:
    """What was found from a guess, as a guess."""
    return replace(tries.starts[i], controls=tries.solved[i].controls, kind="widened")


def _as_given(search: Search, guess: Floats, found: Finished) -> Finished | None:
    """The guess as it is, if it is proven and what was found from it is not, or costs more."""
    problem = search.problem
    controls = refined(given(problem, guess, problem.steps), problem.steps)
    attempt = replace(start(problem, controls, choose(problem, controls)), status="solved", message="as given")
    better = not is_proven(found.certificate) or attempt.value.cost < found.attempt.value.cost
    if not problem.verify.certificate or not better or attempt.value.excess > 0:
        return None
    certificate = search.certified(controls)
    return Finished(attempt, certificate, (), 0.0) if is_proven(certificate) else None


def _chosen_facets(
    search: Search, plan: Attempt, proof: Certificate | None
) -> tuple[Attempt, Certificate | None, list[Round], list[Attempt]]:
    """Let rounds of other facets improve the plan; what takes its place costs less, and no less is proven of it."""
    done: list[Round] = []
    work: list[Attempt] = []
    full = search.problem.solve.grid == "full"
    steps = search.problem.steps if full else coarse_steps(search.problem)
    tries = rounds(search.problem, plan, steps, lambda: search.options(1e-3, 1e-3), search.watch)
    while not search.over():
        found = next(tries, None)
        if found is None:
            break
        search.reported(found)
        new, kept = found.attempt, False
        if new is not None:
            work.append(new)
        if new is not None and not search.problem.solve.polish:
            # the integer solution as it is returned
            kept, plan = True, new
            proof = None if proof is None else search.certified(refined(new.controls, search.problem.steps))
        elif new is not None and rank(new) < rank(plan):
            certificate = proof
            if proof is not None:
                new, certificate, more = certified_with_margin(search, new, partial(fine, search))
                work += more
            kept = rank(new) < rank(plan) and no_less_proven(certificate, proof)
            plan, proof = (new, certificate) if kept else (plan, proof)
        done.append(replace(found, kept=kept))
    return plan, proof, done, work
