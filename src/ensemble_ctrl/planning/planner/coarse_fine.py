"""Guesses solved on the coarse grid; the best of them on the problem's own grid, and certified."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate import Certificate
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.ocp.chance import ranges
from ensemble_ctrl.ocp.rounds import Attempt, improve, rank, start, with_work
from ensemble_ctrl.ocp.truncation import Truncation, choose, coarse, nominal, points, raised, tail
from ensemble_ctrl.planning.planner.grids import refined
from ensemble_ctrl.planning.planner.proving import CLOSE, certified_with_margin, is_proven
from ensemble_ctrl.planning.planner.search import Search
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]

COARSE_ROUNDS, FINE_ROUNDS = 3, 1
RANKED_AFTER = 2
"""Coarse rounds after which guesses that keep their constraints are compared: only the best go through the rest."""
ALIKE = 0.15
"""Share of the best cost, or of 1 where that is less, by which others may cost more to be among the best then."""
WHOLE, MIDDLE_FIRST, WIDENED = (1.0,), (0.0, 1.0), (0.0, 0.25, 0.5, 0.75, 1.0)
"""Shares of the parameters' ranges that a guess is improved for, one after the other: 0 is the middle member alone."""
FINALISTS = 3
"""Coarse solutions that are refined and certified where every route is tried."""
TAIL_LIMIT = 1e-3
"""Metres of truncation error beyond which one more moment is carried."""


def coarse_all(search: Search, guesses: list[Floats], shares: tuple[float, ...] = WHOLE) -> list[Attempt]:
    """Each seed improved on its own coarse grid at low order; one that could not be solved as it is.

    Where a share of the fleet is enough, for the best choice of its members. With several `shares` of the ranges each
    is improved for one after the other, as long as that leads somewhere.
    """
    problem = search.problem
    truncation, boxes = coarse(problem), ranges(problem)
    if guesses:  # what evaluations need of bases and rules is made once, before processes are forked
        points(problem, guesses[0], truncation)

    def work(own: Search, candidate: int) -> Attempt:
        controls, tries = guesses[candidate], []
        for share in shares[:-1]:
            fewer = _for_fewer(own, controls, share)
            controls = fewer.controls
            if own.over() or fewer.value.gap < -CLOSE:
                as_it_is = start(problem, controls, truncation)
                return with_work(as_it_is, fewer, as_it_is)
        for box in boxes:
            tries.append(_solved(own, problem, controls, replace(truncation, within=box)))
            if own.over():
                break
        return min(tries, key=rank)

    found = search.side_by_side("coarse solve", work, len(guesses))
    solved = [a or start(problem, controls, truncation) for a, controls in zip(found, guesses, strict=True)]
    return _decided(search, solved)


def _decided(search: Search, solved: list[Attempt]) -> list[Attempt]:
    """The attempts, with the pending rounds of those that are about as good as the best, if there are several."""
    best = min((attempt.value.cost for attempt in solved if attempt.value.keeps(0.0)), default=np.inf)
    most = best + ALIKE * max(abs(best), 1.0)
    close = [i for i, attempt in enumerate(solved) if attempt.value.keeps(0.0) and attempt.value.cost <= most]
    if len(close) > 1 and any(solved[i].pending for i in close):
        found = search.side_by_side("coarse solve", lambda own, k: completed(own, solved[close[k]]), len(close))
        for i, attempt in zip(close, found, strict=True):
            solved[i] = attempt or solved[i]
    return solved


def _for_fewer(own: Search, controls: Floats, share: float) -> Attempt:
    """Improved for a share of the ranges around their middle, or for the middle member alone."""
    if share == 0.0:
        return _solved(own, own.problem, controls, nominal(own.problem))
    problem = own.problem.with_(fleet=narrowed(own.problem.fleet, share))
    return _solved(own, problem, controls, coarse(problem))


def _solved(own: Search, problem: Problem, controls: Floats, truncation: Truncation) -> Attempt:
    """Rounds of the coarse program: all of them, or those that tell which attempts are worth more."""
    options, watch = own.options(1e-2, 1e-3), own.watch("coarse solve")
    begun = improve(problem, controls, truncation, RANKED_AFTER, options, watch, more=True)
    return begun if begun.value.keeps(0.0) else completed(replace(own, problem=problem), begun)


def completed(own: Search, begun: Attempt) -> Attempt:
    """The rounds of the coarse program that are pending."""
    if not begun.pending or own.over():
        return begun
    options, watch, rounds = own.options(1e-2, 1e-3), own.watch("coarse solve"), COARSE_ROUNDS - RANKED_AFTER
    after = improve(own.problem, begun.controls, begun.truncation, rounds, options, watch)
    return with_work(after, begun, after)


def narrowed(fleet: Fleet, share: float) -> Fleet:
    """The same fleet with a share of each parameter's range around its middle, uniformly distributed."""
    half = share * (fleet.upper - fleet.lower) / 2
    ends = zip(fleet.names, fleet.center - half, fleet.center + half, strict=True)
    return replace(fleet, parameters={name: Interval(low, high) for name, low, high in ends}, samples=None)


def finalists(problem: Problem, solved: list[Attempt]) -> list[int]:
    """Which coarse solutions are refined, best first: one, or of all routes the best few that keep the constraints."""
    ranked = sorted(range(len(solved)), key=lambda i: rank(solved[i]))
    few = FINALISTS if problem.solve.routes == "all" else 1
    return ranked[:1] + [i for i in ranked[1:few] if solved[i].value.keeps(0.0)]


@dataclass(frozen=True, eq=False)
class Finished:
    """A coarse solution after the fine solve and the certificate, with all attempts that this took."""

    attempt: Attempt
    certificate: Certificate | None
    work: tuple[Attempt, ...]
    certify_seconds: float


def finish_all(search: Search, solved: list[Attempt]) -> list[Finished]:
    """Each coarse solution refined and certified, in order; only the first if the search is over or no other ended."""
    if len(solved) > 1:
        finished = search.side_by_side("solve", lambda own, i: _finish(own, solved[i]), len(solved))
        if any(finished):
            return [end or Finished(solved[i], None, (), 0.0) for i, end in enumerate(finished)]
    return [_finish(search, solved[0])]


def _finish(search: Search, found: Attempt) -> Finished:
    """A coarse solution refined and certified, as far as time allows."""
    final = found if search.over() else fine(search, found, search.problem)
    work = [final] if final is not found else []
    if not search.problem.verify.certificate:
        return Finished(final, None, tuple(work), 0.0)
    search.tell("certify")
    began = time.perf_counter()
    final, certificate, more = certified_with_margin(search, final, partial(fine, search))
    return Finished(final, certificate, (*work, *more), time.perf_counter() - began)


def is_good(problem: Problem, end: Finished) -> bool:
    """Whether it is a plan, proven if that is asked for."""
    keeps = is_proven(end.certificate) if problem.verify.certificate else end.attempt.value.keeps(0.0)
    return keeps and end.attempt.value.excess <= 0


def final_rank(end: Finished) -> tuple[bool, bool, float, float]:
    """Sorting key: proven first, then as `rank`."""
    return (not is_proven(end.certificate), *rank(end.attempt))


def fine(search: Search, found: Attempt, problem: Problem) -> Attempt:
    """The problem's own grid and order; what was found before where there is no time for that."""
    return search.alone("solve", partial(_on_own_grid, found, problem)) or found


def _on_own_grid(found: Attempt, problem: Problem, search: Search) -> Attempt:
    """The problem's own grid and order, started from what was found before on that grid."""
    found = completed(search, found)
    controls = refined(found.controls, problem.steps)
    # one more moment while the truncated curve is further than TAIL_LIMIT from the true one
    truncation = replace(choose(problem, controls), within=found.truncation.within)
    for _ in range(3):
        options = search.options(1e-3, 1e-3)
        attempt = improve(problem, controls, truncation, FINE_ROUNDS, options, search.watch("solve"))
        if search.over() or tail(problem, attempt.controls, truncation) < TAIL_LIMIT:
            break
        truncation, controls = raised(truncation), attempt.controls
    return attempt
