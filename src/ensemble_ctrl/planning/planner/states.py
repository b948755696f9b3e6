"""The search in full states of the members at the nodes, for any system."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate import Certificate
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp import state_rounds as shooting
from ensemble_ctrl.ocp.candidates import tried
from ensemble_ctrl.ocp.guesses import Guess, Request, first_guesses, further_rounds, ompl_paths
from ensemble_ctrl.ocp.guesses.passages import closed_off
from ensemble_ctrl.ocp.guesses.restarts import Restart, restarts, wandering
from ensemble_ctrl.ocp.mixed import Round
from ensemble_ctrl.ocp.parametrisation import Iterate
from ensemble_ctrl.ocp.rounds import Attempt, rank
from ensemble_ctrl.ocp.traced import require_traceable
from ensemble_ctrl.planning.planner.coarse_fine import FINALISTS
from ensemble_ctrl.planning.planner.grids import given, refined
from ensemble_ctrl.planning.planner.proving import certified_with_margin
from ensemble_ctrl.planning.planner.search import Search
from ensemble_ctrl.planning.planner.solution import Solution, status_of
from ensemble_ctrl.planning.planner.state_facets import other_facets
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]


def by_states(search: Search, problem: Problem, guess: Floats | None) -> Solution:
    """In full states of the members at the nodes, by multiple shooting (`ensemble_ctrl.ocp.state_rounds`).

    Each guess is solved for the middle member; the best is solved for the whole fleet, the next best where that fails,
    then a few guesses of other kinds, the fleet from other starts, and the rest of these guesses. A guess that was
    given stands alone, unless a state runs away under it.
    """
    require_traceable(problem.fleet)
    search.tell("guess")
    steps = problem.steps
    first = None if guess is None else shooting.given(problem, refined(given(problem, guess, steps), steps))
    starts = [] if first is not None and not shooting.runs_away(first[0]) else first_guesses(Request(problem, steps))
    seconds = {"guess": time.perf_counter() - search.began}
    search.tell("solve")
    search.show_candidates(starts)
    found = _for_middle(search, problem, starts) if starts else [] if first is None else [first]
    none = bool(starts) and not any(shooting.middle_does(one) for one, _ in found)
    closed = closed_off(problem) if none else ()
    if none and not closed:
        more = wandering(problem, starts[0])
        starts, found = [*starts, *more], [*found, *_for_middle(search, problem, more)]
    chosen = _for_fleet(search, problem, starts, found)
    if starts and not closed:
        rounds = further_rounds(search.request(steps, chosen.attempt.controls))
        further = _tried(search, chosen, next(rounds, iter(())))
        _restarted(search, chosen, starts, found)
        while not chosen.settled(search) and (batches := next(rounds, None)):
            further += _tried(search, chosen, batches)
        starts, found = [*starts, *(guess for guess, _ in further)], [*found, *(one for _, one in further)]
    seconds["solve"] = time.perf_counter() - search.began - seconds["guess"]
    attempt, work = chosen.attempt, [*(one for one, _ in found), *chosen.work]
    certificate: Certificate | None = None
    if problem.verify.certificate:
        search.tell("certify")
        began = time.perf_counter()

        def tightened(_: Attempt, tight: Problem) -> Attempt | None:
            more = problem.with_(solve=tight.solve)
            return search.alone("solve", partial(chosen.solver, more))

        attempt, certificate, tighter = certified_with_margin(search, attempt, tightened)
        work += tighter
        seconds["certify"] = time.perf_counter() - began
    nlp, others = attempt if problem.solve.method == "minlp" else None, list[Round]()
    if nlp is not None:
        search.tell("minlp")
        began = time.perf_counter()
        attempt, certificate, others, solves = other_facets(search, problem, attempt, certificate)
        work += solves
        seconds["minlp"] = time.perf_counter() - began
    tries: list[tuple[Guess | Restart, Attempt]] = [(seed, one) for seed, (one, _) in zip(starts, found, strict=False)]
    return Solution(
        problem,
        attempt.controls,
        status_of(search, attempt, certificate),
        attempt,
        tuple(tried(seed, one, None, seed is chosen.start) for seed, one in [*tries, *chosen.restarts]),
        seconds,
        sum(a.iterations for a in work),
        sum(a.build_seconds for a in work),
        sum(a.solve_seconds for a in work),
        certificate,
        nlp,
        tuple(others),
        () if chosen.attempt.value.keeps(0.0) or not starts or closed or ompl_paths.available() else ("ompl",),
        closed,
    )


def improve(problem: Problem, controls: Floats) -> Attempt:
    """Controls from some that are nearly good, within the problem's time limit, in this process, unproven."""
    return shooting.improved(problem, controls, Search(problem, None, None))


def _for_middle(search: Search, problem: Problem, starts: list[Guess]) -> list[tuple[Attempt, Floats]]:
    """Each guess solved for the middle member, with its states; as it is where there was no time for that."""

    def work(own: Search, candidate: int) -> tuple[Attempt, Floats]:
        return shooting.first(problem, starts[candidate], own, own.watch("first solve"))

    done = search.side_by_side("first solve", work, len(starts))
    return [one or shooting.given(problem, start.iterate.controls) for one, start in zip(done, starts, strict=True)]


@dataclass(eq=False)
class _Chosen:
    """The best controls for the whole fleet so far: what they came from, and how to solve from there again."""

    attempt: Attempt
    start: Guess | Restart | None
    solver: Callable[[Problem, Search], Attempt]
    work: list[Attempt] = field(default_factory=list)
    restarts: list[tuple[Restart, Attempt]] = field(default_factory=list)

    def take(self, attempt: Attempt, start: Guess | Restart | None, solver: Callable[..., Attempt]) -> None:
        """Note an attempt, and keep it if it is better; the first one takes the place of the middle member's plan."""
        if not self.work or rank(attempt) < rank(self.attempt):
            self.attempt, self.start, self.solver = attempt, start, solver
        self.work.append(attempt)

    def settled(self, search: Search) -> bool:
        """Whether to look no further."""
        return search.over() or self.attempt.value.keeps(0.0)

    def join(self, other: _Chosen) -> None:
        """Keep the better one, and the work of both."""
        if _middle_rank(other.attempt) < _middle_rank(self.attempt):
            self.attempt, self.start, self.solver = other.attempt, other.start, other.solver
        self.work += other.work
        self.restarts += other.restarts


def _tried(
    search: Search, chosen: _Chosen, batches: Iterator[list[Guess]]
) -> list[tuple[Guess, tuple[Attempt, Floats]]]:
    """Solve further guesses for the middle member, and the best of each few for the fleet, until there is a plan."""
    done = list[tuple[Guess, tuple[Attempt, Floats]]]()
    while not chosen.settled(search) and (guesses := next(batches, None)):
        solved = _for_middle(search, search.problem, guesses)
        # where not even the middle member does the task, the fleet is not expected to
        able = [k for k, (one, _) in enumerate(solved) if shooting.middle_does(one)]
        if able:
            chosen.join(_for_fleet(search, search.problem, [guesses[k] for k in able], [solved[k] for k in able]))
        done += zip(guesses, solved, strict=True)
    return done


def _for_fleet(search: Search, problem: Problem, starts: list[Guess], found: list[tuple[Attempt, Floats]]) -> _Chosen:
    """The whole fleet from the best plans of the middle member."""
    ranked = _ranked(found)
    from_ = {k: (starts[k] if starts else None, partial(_made_good, *found[k])) for k in ranked[:FINALISTS]}
    chosen = _Chosen(found[ranked[0]][0], *from_[ranked[0]])
    for origin, solver in from_.values():
        if search.over() or (chosen.work and chosen.attempt.value.keeps(0.0)):
            return chosen
        solved = search.alone("solve", partial(solver, problem))
        if solved is None:
            return chosen
        chosen.take(solved, origin, solver)
    return chosen


def _restarted(search: Search, chosen: _Chosen, starts: list[Guess], found: list[tuple[Attempt, Floats]]) -> None:
    """The fleet from other starts, where the middle member has a plan and the fleet has none."""
    best = _ranked(found)[0]
    middle, states = found[best]
    if chosen.settled(search) or not shooting.middle_does(middle):
        return
    for batch in restarts(search.problem, starts[best].iterate, Iterate(middle.controls, states)):
        for restart, attempt in _again(search, search.problem, batch):
            chosen.take(attempt, restart, partial(_anew, restart))
            chosen.restarts.append((restart, attempt))
        if chosen.settled(search):
            break


def _ranked(found: list[tuple[Attempt, Floats]]) -> list[int]:
    """Which plans of the middle member come first, by their places."""
    return sorted(range(len(found)), key=lambda k: _middle_rank(found[k][0]))


def _middle_rank(found: Attempt) -> tuple[bool, tuple[bool, float, float]]:
    """Sorting key: controls under which not even the middle member does the task come last."""
    return not shooting.middle_does(found), rank(found)


def _again(search: Search, problem: Problem, batch: list[Restart]) -> list[tuple[Restart, Attempt]]:
    """The whole fleet from other starts, side by side: those that came to something."""

    def work(own: Search, candidate: int) -> Attempt:
        return _anew(batch[candidate], problem, own)

    done = zip(batch, search.side_by_side("solve", work, len(batch)), strict=True)
    return [(restart, one) for restart, one in done if one is not None]


def _made_good(middle: Attempt, states: Floats, problem: Problem, own: Search) -> Attempt:
    """The controls of the middle member, which has these states, made good for the whole fleet."""
    return shooting.second(problem, middle.controls, states, own, own.watch("solve"))


def _anew(restart: Restart, problem: Problem, own: Search) -> Attempt:
    """The whole fleet from another start."""
    return shooting.again(problem, restart, own, own.watch("solve"))
