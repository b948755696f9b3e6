"""From a problem to the best controls found: guesses, a coarse search over routes, and a fine solve.

1. Geometric routes of different kinds around the obstacles give first guesses (`ensemble_ctrl.ocp.guesses.roadmap`);
   tasks with repeated or conditional visits are laid out in time (`ensemble_ctrl.ocp.guesses.laid_out`).
2. Each is solved on a coarse grid at a low order, side by side where there are several cores; the best is kept, or the
   best few where every route is tried: each of them goes through what follows, and the best certified one is the plan.
   Where none of them leads to a plan, curves that the robots can drive, reversing where they may, are tried in the same
   way, and then commands with waves added (`ensemble_ctrl.ocp.guesses`).
3. The horizon's own grid and the order asked for, started from there.
4. Where the truncated curve is too far from the true one, one more moment is carried and it is solved again.
5. The result is certified; where the proof falls short, the margin grows by what is missing and it is solved again.
6. With ``method: minlp`` the facets of the obstacles are chosen anew (`ensemble_ctrl.ocp.mixed`); each result is
   certified in the same way, and takes the plan's place only if it costs less and no less is proven of it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate import Certificate, certify, unproven
from ensemble_ctrl.constraints.stl import Formula, negation_normal_form, resolve
from ensemble_ctrl.constraints.stl.dense import shrunk
from ensemble_ctrl.constraints.stl.robustness import Temporal
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.ocp import parallel
from ensemble_ctrl.ocp import state_rounds as shooting
from ensemble_ctrl.ocp.candidates import Tried, join_logs, part_log, tried
from ensemble_ctrl.ocp.chance import ranges
from ensemble_ctrl.ocp.guesses import Guess, Request, first_guesses, further_guesses, ompl_paths
from ensemble_ctrl.ocp.guesses.curved import BATCHES, promising
from ensemble_ctrl.ocp.guesses.registry import Stop
from ensemble_ctrl.ocp.guesses.restarts import Restart, restarts, wandering
from ensemble_ctrl.ocp.mixed import Round, rounds
from ensemble_ctrl.ocp.parametrisation import Iterate
from ensemble_ctrl.ocp.rounds import Attempt, improve, rank, start
from ensemble_ctrl.ocp.solvers import AT_WORK, Iteration, SolverOptions, Watch, named
from ensemble_ctrl.ocp.traced import require_traceable
from ensemble_ctrl.ocp.truncation import choose, coarse, raised, tail
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.checks import building_seconds, spoken

Floats = NDArray[np.float64]
T = TypeVar("T")
Status = Literal["planned", "infeasible", "limit", "interrupted"]
Curved = Literal["never", "after", "before"]
Progress = Callable[[str, Iteration | None], bool]
"""Called with a phase and, during a solve, the iteration; returning True asks to stop."""

COARSE_STEPS = 32
"""The coarse grid has at most this many steps, unless a window of the task needs a finer one."""
COARSE_ROUNDS, FINE_ROUNDS = 3, 1
CERTIFY_ROUNDS = 3
FINALISTS = 3
"""Coarse solutions that are refined and certified where every route is tried."""
CLOSE = 0.05
"""Metres by which an attempt may violate its task for tightening, or a finer solve, to be worth while."""
AFTERWARDS = 5.0
"""Seconds that a proof, and a replay, may take however little of the time limit is left."""
TOO_LATE, STOPPED = "the time limit ended the proof", "an interruption ended the proof"
"""Why a proof was not finished."""
TAIL_LIMIT = 1e-3
"""Metres of truncation error beyond which one more moment is carried."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The best controls found and how they were found.

    Attributes
    ----------
    problem : Problem
        What was asked.
    controls : ndarray, shape (steps, n_u)
        The broadcast commands.
    status : {"planned", "infeasible", "limit", "interrupted"}
        ``planned``: the program's own constraints hold; whether every member is safe is for replay to say.
    attempt : Attempt
        The last solve with its value.
    routes : tuple of Tried
        The routes tried, shortest first.
    seconds : dict of str to float
        Time of each phase.
    iterations, build_seconds, solve_seconds
        Work of all solves together.
    certificate : Certificate or None
        What is proven of the controls, if the problem asks for it.
    nlp : Attempt or None
        With ``method: minlp``, the plan that it started from.
    rounds : tuple of Round
        With ``method: minlp``, what was tried since.
    missing : tuple of str
        Optional libraries that are not installed and would have given more guesses, where there is no good plan.
    """

    problem: Problem
    controls: Floats
    status: Status
    attempt: Attempt
    routes: tuple[Tried, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    iterations: int = 0
    build_seconds: float = 0.0
    solve_seconds: float = 0.0
    certificate: Certificate | None = None
    nlp: Attempt | None = None
    rounds: tuple[Round, ...] = ()
    missing: tuple[str, ...] = ()


@dataclass(eq=False)
class _Search:
    """One search: the problem, whom to tell, the clock, and the best attempt so far."""

    problem: Problem
    progress: Progress | None
    log: Path | None
    began: float = field(default_factory=time.perf_counter)
    stopped: bool = False

    def left(self) -> float:
        """Seconds until the time limit."""
        return self.problem.solve.time_limit - (time.perf_counter() - self.began)

    def options(self, barrier: float, tolerance: float) -> SolverOptions:
        """Solver options within what is left of the time."""
        solve = self.problem.solve
        return SolverOptions(solve.max_iterations, self.left(), tolerance, barrier, self.log, solve.solver)

    def watch(self, phase: str) -> Callable[[Iteration], bool] | None:
        """The watcher of one phase."""
        if self.progress is None:
            return None
        progress = self.progress

        def watching(iteration: Iteration) -> bool:
            self.stopped = self.stopped or progress(phase, iteration)
            return self.stopped

        return watching

    def tell(self, phase: str) -> None:
        """Say that a phase begins."""
        if self.progress is not None:
            self.stopped = self.progress(phase, None) or self.stopped

    def side_by_side(self, phase: str, work: Callable[[_Search, int], T], count: int) -> list[T | None]:
        """Results of `work` for each candidate, under a search of its own with the same clock; None without one."""
        if self.over():
            return [None] * count
        parts = [part_log(self.log, i) for i in range(count)]

        def own(candidate: int, watch: Watch) -> T:
            def progress(_: str, iteration: Iteration | None) -> bool:
                return iteration is not None and watch(iteration)

            return work(replace(self, progress=progress, log=parts[candidate]), candidate)

        def tell(candidate: int, iteration: Iteration) -> bool:
            where = phase if count == 1 else f"{phase} {candidate + 1}/{count}"
            self.stopped = self.stopped or (self.progress is not None and self.progress(where, iteration))
            return self.stopped

        try:
            return parallel.each(own, count, tell, self.left)
        finally:
            join_logs(self.log, parts)

    def alone(self, phase: str, work: Callable[[_Search], T]) -> T | None:
        """The result of one piece of work, in the same way."""
        return self.side_by_side(phase, lambda own, _: work(own), 1)[0]

    def request(self, steps: int, best: Floats | None = None) -> Request:
        """A request for guesses, which may be made side by side."""

        def side_by_side(phase: str, work: Callable[[Stop, int], T], count: int) -> list[T | None]:
            return self.side_by_side(phase, lambda own, candidate: work(own.over, candidate), count)

        return Request(self.problem, steps, best, side_by_side=side_by_side)

    def certified(self, controls: Floats) -> Certificate:
        """What is proven of controls on the problem's grid in what is left of the time, and at least `AFTERWARDS`.

        A proof is made in a process that can be ended, where there is one.
        """
        ends = time.perf_counter() + max(self.left(), AFTERWARDS)

        def tell(_: Iteration) -> bool:
            self.stopped = self.stopped or (self.progress is not None and self.progress("certify", AT_WORK))
            return self.stopped

        proof = parallel.alone(lambda _: certify(self.problem, controls), tell, lambda: ends - time.perf_counter())
        return proof or unproven(self.problem, controls, STOPPED if self.stopped else TOO_LATE)

    def told(self, found: Round) -> None:
        """Say how a round of facets ended."""
        if self.progress is not None:
            self.progress(found.name, Iteration(found.nodes, found.objective, 0.0, found.bound))

    def over(self) -> bool:
        """Whether to stop now with what there is."""
        return self.stopped or self.left() <= 0


def solve(
    problem: Problem,
    *,
    progress: Progress | None = None,
    guess: Floats | None = None,
    log: Path | None = None,
) -> Solution:
    """Find controls for `problem`.

    Parameters
    ----------
    problem : Problem
        What to plan.
    progress : callable, optional
        ``progress(phase, iteration or None) -> bool``; True asks to stop with the best controls so far.
    guess : ndarray, shape (steps', 2), optional
        Controls to start from instead of geometric routes.
    log : Path, optional
        File that the solver's own output is appended to.

    Returns
    -------
    Solution
        Also when nothing feasible was found: `status` says so and `controls` are the best there are.
    """
    named(problem.solve.solver)
    _require_endable(problem)
    search = _Search(problem, progress, log)
    return STRATEGIES[problem.fleet.system.transcription](search, problem, guess)


def _by_positions(search: _Search, problem: Problem, guess: Floats | None) -> Solution:
    """In positions of the truncated curve: routes, coarse and fine solves, further guesses, other facets."""
    seconds: dict[str, float] = {}
    search.tell("guess")
    steps = coarse_steps(problem)
    starts = [Guess(given(problem, guess, steps))] if guess is not None else first_guesses(Request(problem, steps))
    seconds["guess"] = time.perf_counter() - search.began
    search.tell("solve")
    tries = _Tries()
    _try(search, tries, starts)
    if guess is None:
        for others in _further(search, tries, steps):
            _try(search, tries, others, lambda attempt: attempt.value.keeps(-CLOSE))
            if search.over() or _is_good(problem, tries.best):
                break
    best = tries.best
    final, certificate = best.attempt, best.certificate
    if guess is not None and (proven := _as_given(search, guess, best)):
        final, certificate = proven.attempt, proven.certificate
    seconds["solve"] = time.perf_counter() - search.began - seconds["guess"] - best.certify_seconds
    if problem.verify.certificate:
        seconds["certify"] = best.certify_seconds
    work = tries.work
    routes = tries.told
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
        _refined(final.controls, problem.steps),
        _status(search, final, certificate),
        final,
        tuple(routes),
        seconds,
        sum(a.iterations for a in work),
        sum(a.build_seconds for a in work),
        sum(a.solve_seconds for a in work),
        certificate,
        nlp,
        tuple(turned),
        () if guess is not None or _is_good(problem, best) or ompl_paths.available() else ("ompl",),
    )


def _require_endable(problem: Problem) -> None:
    """Refuse a program that takes longer to build than there is time, where nothing could end that."""
    seconds, limit = building_seconds(problem.steps), problem.solve.time_limit
    if seconds > limit and not parallel.endable():
        why = f"{spoken(seconds)} to build, more than solve.time_limit = {limit:g} s, and nothing could end that"
        where = "beside other threads, and on systems other than Linux"
        raise ProblemError(f"horizon.steps: expected fewer {where}, got {problem.steps}: {why}")


def _by_states(search: _Search, problem: Problem, guess: Floats | None) -> Solution:
    """In full states of the members at the nodes, by multiple shooting (`ensemble_ctrl.ocp.state_rounds`).

    Each guess is solved for the middle member; the best is solved for the whole fleet, the next best where that fails,
    and last from other starts. A guess that was given stands alone, unless a state runs away under it.
    """
    require_traceable(problem.fleet)
    search.tell("guess")
    steps = problem.steps
    first = None if guess is None else shooting.given(problem, _refined(given(problem, guess, steps), steps))
    starts = [] if first is not None and not shooting.runs_away(first[0]) else first_guesses(Request(problem, steps))
    seconds = {"guess": time.perf_counter() - search.began}
    search.tell("solve")
    found = _for_middle(search, problem, starts) if starts else [] if first is None else [first]
    if starts and not any(shooting.middle_does(problem, one.controls) for one, _ in found):
        more = wandering(problem, starts[0])
        starts, found = [*starts, *more], [*found, *_for_middle(search, problem, more)]
    chosen = _for_fleet(search, problem, starts, found)
    seconds["solve"] = time.perf_counter() - search.began - seconds["guess"]
    attempt, work = chosen.attempt, [*(one for one, _ in found), *chosen.work]
    certificate: Certificate | None = None
    if problem.verify.certificate:
        search.tell("certify")
        began = time.perf_counter()

        def tightened(_: Attempt, tight: Problem) -> Attempt | None:
            more = problem.with_(solve=tight.solve)
            return search.alone("solve", partial(chosen.solver, more))

        attempt, certificate, tighter = _certified(search, attempt, tightened)
        work += tighter
        seconds["certify"] = time.perf_counter() - began
    tries: list[tuple[Guess | Restart, Attempt]] = [(seed, one) for seed, (one, _) in zip(starts, found, strict=False)]
    return Solution(
        problem,
        attempt.controls,
        _status(search, attempt, certificate),
        attempt,
        tuple(tried(seed, one, None, seed is chosen.start) for seed, one in [*tries, *chosen.restarts]),
        seconds,
        sum(a.iterations for a in work),
        sum(a.build_seconds for a in work),
        sum(a.solve_seconds for a in work),
        certificate,
    )


def _for_middle(search: _Search, problem: Problem, starts: list[Guess]) -> list[tuple[Attempt, Floats]]:
    """Each guess solved for the middle member, with its states; as it is where there was no time for that."""

    def work(own: _Search, candidate: int) -> tuple[Attempt, Floats]:
        return shooting.first(problem, starts[candidate], own, own.watch("first solve"))

    done = search.side_by_side("first solve", work, len(starts))
    return [one or shooting.given(problem, start.iterate.controls) for one, start in zip(done, starts, strict=True)]


@dataclass(eq=False)
class _Chosen:
    """The best controls for the whole fleet so far: what they came from, and how to solve from there again."""

    attempt: Attempt
    start: Guess | Restart | None
    solver: Callable[[Problem, _Search], Attempt]
    work: list[Attempt] = field(default_factory=list)
    restarts: list[tuple[Restart, Attempt]] = field(default_factory=list)

    def take(self, attempt: Attempt, start: Guess | Restart | None, solver: Callable[..., Attempt]) -> None:
        """Note an attempt, and keep it if it is better; the first one takes the place of the middle member's plan."""
        if not self.work or rank(attempt) < rank(self.attempt):
            self.attempt, self.start, self.solver = attempt, start, solver
        self.work.append(attempt)


def _for_fleet(search: _Search, problem: Problem, starts: list[Guess], found: list[tuple[Attempt, Floats]]) -> _Chosen:
    """The whole fleet from the best plans of the middle member, then from other starts if that one has a plan."""
    ranked = sorted(range(len(found)), key=lambda k: _middle_rank(problem, found[k][0]))
    from_ = {k: (starts[k] if starts else None, partial(_made_good, *found[k])) for k in ranked[:FINALISTS]}
    chosen = _Chosen(found[ranked[0]][0], *from_[ranked[0]])
    for origin, solver in from_.values():
        if search.over() or (chosen.work and chosen.attempt.value.keeps(0.0)):
            return chosen
        solved = search.alone("solve", partial(solver, problem))
        if solved is None:
            return chosen
        chosen.take(solved, origin, solver)
    middle, states = found[ranked[0]]
    if not starts or chosen.attempt.value.keeps(0.0) or not shooting.middle_does(problem, middle.controls):
        return chosen
    for batch in restarts(problem, starts[ranked[0]].iterate, Iterate(middle.controls, states)):
        for restart, attempt in _again(search, problem, batch):
            chosen.take(attempt, restart, partial(_anew, restart))
            chosen.restarts.append((restart, attempt))
        if search.over() or chosen.attempt.value.keeps(0.0):
            break
    return chosen


def _middle_rank(problem: Problem, found: Attempt) -> tuple[bool, tuple[bool, float, float]]:
    """Sorting key: controls under which not even the middle member does the task come last."""
    return not shooting.middle_does(problem, found.controls), rank(found)


def _again(search: _Search, problem: Problem, batch: list[Restart]) -> list[tuple[Restart, Attempt]]:
    """The whole fleet from other starts, side by side: those that came to something."""

    def work(own: _Search, candidate: int) -> Attempt:
        return _anew(batch[candidate], problem, own)

    done = zip(batch, search.side_by_side("solve", work, len(batch)), strict=True)
    return [(restart, one) for restart, one in done if one is not None]


def _made_good(middle: Attempt, states: Floats, problem: Problem, own: _Search) -> Attempt:
    """The controls of the middle member, which has these states, made good for the whole fleet."""
    return shooting.second(problem, middle.controls, states, own, own.watch("solve"))


def _anew(restart: Restart, problem: Problem, own: _Search) -> Attempt:
    """The whole fleet from another start."""
    return shooting.again(problem, restart, own, own.watch("solve"))


STRATEGIES: dict[str, Callable[[_Search, Problem, Floats | None], Solution]] = {
    "positions": _by_positions,
    "states": _by_states,
}
"""How a problem is planned, by the transcription of its system."""


def screen(problem: Problem, *, progress: Progress | None = None, curves: Curved = "never") -> Floats | None:
    """Controls that keep the program's constraints on the coarse grid at a low order, if any are found there.

    Parameters
    ----------
    problem : Problem
    progress : callable, optional
        As for `solve`.
    curves : {"never", "after", "before"}
        Whether curves by OMPL are tried too: where no route leads to any, or before the routes.

    Returns
    -------
    ndarray of shape (coarse steps, n_u), or None

    Notes
    -----
    *Guarantee*: none; it is a quick look before `solve`, which may find a plan where this finds none and the reverse.
    """
    if problem.fleet.system.transcription == "states":  # there is no coarse grid: the search as it is, unproven
        quick = problem.with_(verify=replace(problem.verify, certificate=False))
        found = solve(quick, progress=progress)
        return found.controls if found.status == "planned" else None
    search, steps = _Search(problem, progress, None), coarse_steps(problem)

    def by_routes() -> list[Guess]:
        return first_guesses(Request(problem, steps, quick=True))

    def by_curves() -> list[Guess]:
        return promising(search.request(steps), BATCHES[0]) if ompl_paths.available() else []

    ways = {"never": (by_routes,), "after": (by_routes, by_curves), "before": (by_curves, by_routes)}[curves]
    for guessed in ways:
        solved = _coarse_all(search, [seed.controls for seed in guessed()])
        best = min(solved, key=rank, default=None)
        if best is not None and best.value.keeps(0.0):
            return best.controls
    return None


def given(problem: Problem, guess: Floats, steps: int) -> Floats:
    """A guess within the input bounds, on at least `steps` steps so that each window holds a grid time."""
    controls, n_u = np.asarray(guess, dtype=float), len(problem.fleet.system.controls)
    if controls.ndim != 2 or not len(controls) or controls.shape[1] != n_u or not np.isfinite(controls).all():
        raise ProblemError(f"guess: expected finite controls of shape (steps, {n_u}), got shape {controls.shape}")
    fine = controls if len(controls) >= steps else _refined(controls, steps)
    return np.clip(fine, problem.fleet.input_lower, problem.fleet.input_upper)


def coarse_steps(problem: Problem) -> int:
    """Steps of the coarse grid: a divisor of the problem's, fine enough for every window of the task."""
    wanted = COARSE_STEPS
    for a, b in windows(problem.task):
        wanted = max(wanted, int(np.ceil(2 * problem.duration / max(b - a, problem.step))))
    divisors = [n for n in range(1, problem.steps + 1) if problem.steps % n == 0 and n >= wanted]
    return divisors[0] if divisors else problem.steps


def windows(formula: Formula) -> list[tuple[float, float]]:
    """Every finite window of the formula, in seconds."""
    own = []
    if isinstance(formula, Temporal) and formula.a is not None and formula.b is not None:
        own = [(formula.a, formula.b)] if np.isfinite(formula.b) else []
    return own + [w for part in formula.parts for w in windows(part)]


def _coarse_all(search: _Search, guesses: list[Floats]) -> list[Attempt]:
    """Each seed improved on its own coarse grid at low order; one that could not be solved as it is.

    Where a share of the fleet is enough, for the best choice of its members.
    """
    problem = search.problem
    truncation, boxes = coarse(problem), ranges(problem)

    def work(own: _Search, candidate: int) -> Attempt:
        tries = []
        for box in boxes:
            options, members = own.options(1e-2, 1e-3), replace(truncation, within=box)
            watch = own.watch("coarse solve")
            tries.append(improve(problem, guesses[candidate], members, COARSE_ROUNDS, options, watch))
            if own.over():
                break
        return min(tries, key=rank)

    solved = search.side_by_side("coarse solve", work, len(guesses))
    return [a or start(problem, controls, truncation) for a, controls in zip(solved, guesses, strict=True)]


def _finalists(problem: Problem, solved: list[Attempt]) -> list[int]:
    """Which coarse solutions are refined, best first: one, or of all routes the best few that keep the constraints."""
    ranked = sorted(range(len(solved)), key=lambda i: rank(solved[i]))
    few = FINALISTS if problem.solve.routes == "all" else 1
    return ranked[:1] + [i for i in ranked[1:few] if solved[i].value.keeps(0.0)]


@dataclass(frozen=True, eq=False)
class _Finished:
    """A coarse solution after the fine solve and the certificate, with all attempts that this took."""

    attempt: Attempt
    certificate: Certificate | None
    work: tuple[Attempt, ...]
    certify_seconds: float


def _finish_all(search: _Search, solved: list[Attempt]) -> list[_Finished]:
    """Each coarse solution refined and certified, in order; only the first if the search is over or no other ended."""
    if len(solved) > 1:
        finished = search.side_by_side("solve", lambda own, i: _finish(own, solved[i]), len(solved))
        if any(finished):
            return [end or _Finished(solved[i], None, (), 0.0) for i, end in enumerate(finished)]
    return [_finish(search, solved[0])]


def _finish(search: _Search, found: Attempt) -> _Finished:
    """A coarse solution refined and certified, as far as time allows."""
    final = found if search.over() else _fine(search, found, search.problem)
    work = [final] if final is not found else []
    if not search.problem.verify.certificate:
        return _Finished(final, None, tuple(work), 0.0)
    search.tell("certify")
    began = time.perf_counter()
    final, certificate, more = _certified(search, final, partial(_fine, search))
    return _Finished(final, certificate, (*work, *more), time.perf_counter() - began)


@dataclass(eq=False)
class _Tries:
    """Guesses with their coarse solutions, and those of them that were finished, by their places."""

    starts: list[Guess] = field(default_factory=list)
    solved: list[Attempt] = field(default_factory=list)
    finished: dict[int, _Finished] = field(default_factory=dict)

    @property
    def which(self) -> int:
        """The best, by its place."""
        return min(self.finished, key=lambda i: _final_rank(self.finished[i]))

    @property
    def best(self) -> _Finished:
        """The best."""
        return self.finished[self.which]

    @property
    def work(self) -> list[Attempt]:
        """Every solve."""
        return [*self.solved, *(attempt for end in self.finished.values() for attempt in end.work)]

    @property
    def told(self) -> list[Tried]:
        """What became of each guess."""
        fine = {i: end.attempt for i, end in self.finished.items() if end.work}
        pairs = zip(self.starts, self.solved, strict=True)
        return [tried(seed, coarse, fine.get(i), i == self.which) for i, (seed, coarse) in enumerate(pairs)]


def _try(
    search: _Search, tries: _Tries, starts: list[Guess], worth: Callable[[Attempt], bool] = lambda _: True
) -> None:
    """Solve guesses on the coarse grid, and finish the best of them if they are worth that."""
    first = len(tries.starts)
    solved = _coarse_all(search, [seed.controls for seed in starts])
    tries.starts += starts
    tries.solved += solved
    chosen = [i for i in _finalists(search.problem, solved) if worth(solved[i])] if solved else []
    finished = _finish_all(search, [solved[i] for i in chosen]) if chosen else []
    tries.finished |= {first + i: end for i, end in zip(chosen, finished, strict=False)}


def _further(search: _Search, tries: _Tries, steps: int) -> Iterator[list[Guess]]:
    """More guesses, a few at a time, as long as there is no good plan."""
    if search.over() or _is_good(search.problem, tries.best):
        return
    yield from further_guesses(search.request(steps, tries.solved[tries.which].controls))


def _is_good(problem: Problem, end: _Finished) -> bool:
    """Whether it is a plan, proven if that is asked for."""
    keeps = _is_proven(end.certificate) if problem.verify.certificate else end.attempt.value.keeps(0.0)
    return keeps and end.attempt.value.excess <= 0


def _as_given(search: _Search, guess: Floats, found: _Finished) -> _Finished | None:
    """The guess as it is, if it is proven and what was found from it is not, or costs more."""
    problem = search.problem
    controls = _refined(given(problem, guess, problem.steps), problem.steps)
    attempt = replace(start(problem, controls, choose(problem, controls)), status="solved", message="as given")
    better = not _is_proven(found.certificate) or attempt.value.cost < found.attempt.value.cost
    if not problem.verify.certificate or not better or attempt.value.excess > 0:
        return None
    certificate = search.certified(controls)
    return _Finished(attempt, certificate, (), 0.0) if _is_proven(certificate) else None


def _is_proven(certificate: Certificate | None) -> bool:
    """Whether there is a certificate that says yes."""
    return certificate is not None and certificate.proven == "yes"


def _final_rank(end: _Finished) -> tuple[bool, bool, float, float]:
    """Sorting key: proven first, then as `rank`."""
    return (not _is_proven(end.certificate), *rank(end.attempt))


def _certified(
    search: _Search, attempt: Attempt, tightened: Callable[[Attempt, Problem], Attempt | None]
) -> tuple[Attempt, Certificate, list[Attempt]]:
    """Certify; where that falls short, solve again with as much more margin, at most `CERTIFY_ROUNDS` times.

    `tightened` solves from an attempt with a problem of more margin; None or the same attempt where there is no time.
    """
    problem, work = search.problem, []
    certificate = search.certified(_refined(attempt.controls, problem.steps))
    for _ in range(CERTIFY_ROUNDS):
        settled = certificate.proven == "yes" or bool(certificate.reason)  # no margin helps where nothing was enclosed
        if settled or not attempt.value.keeps(-CLOSE) or search.over():
            break
        short = max(0.0, -certificate.clearance, -certificate.robustness)
        if not np.isfinite(short):
            break
        more = replace(problem.solve, margin=problem.solve.margin + 1.5 * short + 1e-3)
        problem = problem.with_(
            solve=more, task=_between(search.problem) if certificate.robustness < 0 else problem.task
        )
        tighter = tightened(attempt, problem)
        if tighter is None or tighter is attempt:
            break
        work.append(tighter)
        again = search.certified(_refined(tighter.controls, problem.steps))
        if again.proven == "yes" or _least(again) > _least(certificate):
            attempt, certificate = tighter, again
    return attempt, certificate, work


def _between(problem: Problem) -> Formula:
    """The task with windows in which what is asked for again and again holds between grid times, too."""
    task = negation_normal_form(resolve(problem.task, problem.duration))
    return shrunk(task, problem.duration / problem.steps)


def _chosen_facets(
    search: _Search, plan: Attempt, proof: Certificate | None
) -> tuple[Attempt, Certificate | None, list[Round], list[Attempt]]:
    """Let rounds of other facets improve the plan; what takes its place costs less, and no less is proven of it."""
    done: list[Round] = []
    work: list[Attempt] = []
    tries = rounds(search.problem, plan, coarse_steps(search.problem), lambda: search.options(1e-3, 1e-3), search.watch)
    while not search.over():
        found = next(tries, None)
        if found is None:
            break
        search.told(found)
        new, kept = found.attempt, False
        if new is not None:
            work.append(new)
        if new is not None and rank(new) < rank(plan):
            certificate = proof
            if proof is not None:
                new, certificate, more = _certified(search, new, partial(_fine, search))
                work += more
            kept = rank(new) < rank(plan) and _no_less_proven(certificate, proof)
            plan, proof = (new, certificate) if kept else (plan, proof)
        done.append(replace(found, kept=kept))
    return plan, proof, done, work


def _no_less_proven(new: Certificate | None, old: Certificate | None) -> bool:
    """Whether a certificate says at least as much as another."""
    if new is None or old is None or new.proven == "yes":
        return True
    return old.proven != "yes" and _least(new) >= _least(old)


def _least(certificate: Certificate) -> float:
    """The smallest bound in it; minus infinity where nothing could be said."""
    return -np.inf if certificate.reason else min(certificate.clearance, certificate.robustness)


def _fine(search: _Search, found: Attempt, problem: Problem) -> Attempt:
    """The problem's own grid and order; what was found before where there is no time for that."""
    return search.alone("solve", partial(_on_own_grid, found, problem)) or found


def _on_own_grid(found: Attempt, problem: Problem, search: _Search) -> Attempt:
    """The problem's own grid and order, started from what was found before on that grid."""
    controls = _refined(found.controls, problem.steps)
    truncation = replace(choose(problem, controls), within=found.truncation.within)
    attempt = start(problem, controls, truncation)
    for _ in range(3):
        options = search.options(1e-3, 1e-3)
        attempt = improve(problem, attempt.controls, truncation, FINE_ROUNDS, options, search.watch("solve"))
        if search.over() or tail(problem, attempt.controls, truncation) < TAIL_LIMIT:
            break
        truncation = raised(truncation)
    return attempt


def _refined(controls: Floats, steps: int) -> Floats:
    """The same commands on a grid of `steps`, each repeated."""
    if steps % len(controls) == 0:
        return np.repeat(controls, steps // len(controls), axis=0)
    middle = (np.arange(steps) + 0.5) / steps * len(controls)
    return np.asarray(controls[middle.astype(int)])


def _status(search: _Search, attempt: Attempt, certificate: Certificate | None) -> Status:
    """What became of the search: rates of the commands are kept by the program, all else by it or by proof."""
    if search.stopped:
        return "interrupted"
    keeps = attempt.value.keeps(0.0) or (_is_proven(certificate) and attempt.value.excess <= 0)
    if keeps and attempt.status == "solved":
        return "planned"
    if search.left() <= 0 or (attempt.status == "limit" and not keeps):
        return "limit"
    return "planned" if keeps else "infeasible"


__all__ = ["Progress", "Solution", "Status", "coarse_steps", "screen", "solve"]
