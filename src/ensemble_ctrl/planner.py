"""From a problem to the best controls found: seeds, a coarse search over routes, and a fine solve.

1. Geometric routes of different kinds around the obstacles give first guesses (`ensemble_ctrl.ocp.seeds`).
2. Each is solved on a coarse grid at a low order; the best is kept.
3. The horizon's own grid and the order asked for, started from there.
4. Where the truncated curve is too far from the true one, one more moment is carried and it is solved again.
5. The result is certified; where the proof falls short, the margin grows by what is missing and it is solved again.
6. With ``method: minlp`` the facets of the obstacles are chosen anew (`ensemble_ctrl.ocp.mixed`); each result is
   certified in the same way, and takes the plan's place only if it costs less and no less is proven of it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate import Certificate, certify
from ensemble_ctrl.constraints.stl import Formula
from ensemble_ctrl.constraints.stl.robustness import Temporal
from ensemble_ctrl.errors import ProblemError
from ensemble_ctrl.ocp.mixed import Round, rounds
from ensemble_ctrl.ocp.rounds import Attempt, improve, start
from ensemble_ctrl.ocp.seeds import seeds
from ensemble_ctrl.ocp.solvers import IpoptOptions, Iteration
from ensemble_ctrl.ocp.truncation import Truncation, choose, raised, tail
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Status = Literal["planned", "infeasible", "limit", "interrupted"]
Progress = Callable[[str, Iteration | None], bool]
"""Called with a phase and, during a solve, the iteration; returning True asks to stop."""

COARSE_STEPS = 32
"""The coarse grid has at most this many steps, unless a window of the task needs a finer one."""
COARSE_ROUNDS, FINE_ROUNDS = 1, 1
CERTIFY_ROUNDS = 3
CLOSE = 0.05
"""Metres by which an attempt may violate its task for tightening to be worth while."""
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
    routes : tuple of (float, float, bool)
        Length in metres, cost after the coarse solve, and whether it kept the constraints, of each route tried.
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
    """

    problem: Problem
    controls: Floats
    status: Status
    attempt: Attempt
    routes: tuple[tuple[float, float, bool], ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    iterations: int = 0
    build_seconds: float = 0.0
    solve_seconds: float = 0.0
    certificate: Certificate | None = None
    nlp: Attempt | None = None
    rounds: tuple[Round, ...] = ()


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

    def options(self, barrier: float, tolerance: float) -> IpoptOptions:
        """Solver options within what is left of the time."""
        return IpoptOptions(self.problem.solve.max_iterations, self.left(), tolerance, barrier, self.log)

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
    search = _Search(problem, progress, log)
    seconds: dict[str, float] = {}
    search.tell("guess")
    steps = coarse_steps(problem)
    starts = (
        [(0.0, _given(problem, guess, steps))]
        if guess is not None
        else [(seed.length, seed.controls) for seed in seeds(problem, steps, problem.solve.routes)]
    )
    seconds["guess"] = time.perf_counter() - search.began
    search.tell("solve")
    tried = [(length, _coarse(search, controls)) for length, controls in starts]
    best = min((attempt for _, attempt in tried), key=_rank)
    final = best if search.over() else _fine(search, _refined(best.controls, problem.steps), problem)
    work = [a for _, a in tried] + ([final] if final is not best else [])
    seconds["solve"] = time.perf_counter() - search.began - sum(seconds.values())
    certificate = None
    if problem.verify.certificate:
        search.tell("certify")
        final, certificate, more = _certified(search, final)
        work += more
        seconds["certify"] = time.perf_counter() - search.began - sum(seconds.values())
    nlp: Attempt | None = None
    chosen: list[Round] = []
    if problem.solve.method == "minlp":
        nlp = final
        search.tell("minlp")
        final, certificate, chosen, more = _chosen_facets(search, final, certificate)
        work += more
        seconds["minlp"] = time.perf_counter() - search.began - sum(seconds.values())
    routes = tuple((length, a.value.cost, a.value.keeps(0.0)) for length, a in tried)
    controls = _refined(final.controls, problem.steps)
    return Solution(
        problem,
        controls,
        _status(search, final),
        final,
        routes,
        seconds,
        sum(a.iterations for a in work),
        sum(a.build_seconds for a in work),
        sum(a.solve_seconds for a in work),
        certificate,
        nlp,
        tuple(chosen),
    )


def _given(problem: Problem, guess: Floats, steps: int) -> Floats:
    """A caller's guess within the input bounds, on at least `steps` steps so that each window holds a grid time."""
    given, n_u = np.asarray(guess, dtype=float), len(problem.fleet.system.controls)
    if given.ndim != 2 or not len(given) or given.shape[1] != n_u or not np.isfinite(given).all():
        raise ProblemError(f"guess: expected finite controls of shape (steps, {n_u}), got shape {given.shape}")
    fine = given if len(given) >= steps else _refined(given, steps)
    return np.clip(fine, problem.fleet.input_lower, problem.fleet.input_upper)


def coarse_steps(problem: Problem) -> int:
    """Steps of the coarse grid: a divisor of the problem's, fine enough for every window of the task."""
    wanted = COARSE_STEPS
    for a, b in _windows(problem.task):
        wanted = max(wanted, int(np.ceil(2 * problem.duration / max(b - a, problem.step))))
    divisors = [n for n in range(1, problem.steps + 1) if problem.steps % n == 0 and n >= wanted]
    return divisors[0] if divisors else problem.steps


def _windows(formula: Formula) -> list[tuple[float, float]]:
    """Every finite window of the formula, in seconds."""
    own = []
    if isinstance(formula, Temporal) and formula.a is not None and formula.b is not None:
        own = [(formula.a, formula.b)] if np.isfinite(formula.b) else []
    return own + [w for part in formula.parts for w in _windows(part)]


def _coarse(search: _Search, controls: Floats) -> Attempt:
    """A seed improved on its own coarse grid at low order."""
    problem = search.problem
    truncation = Truncation(2, 2, problem.solve.guarantee != "moment")
    if search.over():
        return start(problem, controls, truncation)
    options = search.options(1e-2, 1e-3)
    return improve(problem, controls, truncation, COARSE_ROUNDS, options, search.watch("coarse solve"))


def _certified(search: _Search, attempt: Attempt) -> tuple[Attempt, Certificate, list[Attempt]]:
    """Certify; where that falls short, solve again with as much more margin, at most `CERTIFY_ROUNDS` times."""
    problem, work = search.problem, []
    certificate = certify(problem, _refined(attempt.controls, problem.steps))
    for _ in range(CERTIFY_ROUNDS):
        if certificate.proven == "yes" or not attempt.value.keeps(-CLOSE) or search.over():
            break
        short = max(0.0, -certificate.clearance, -certificate.robustness)
        if not np.isfinite(short):
            break
        problem = problem.with_(solve=replace(problem.solve, margin=problem.solve.margin + 1.5 * short + 1e-3))
        tighter = _fine(search, attempt.controls, problem)
        work.append(tighter)
        again = certify(search.problem, _refined(tighter.controls, problem.steps))
        if again.proven == "yes" or min(again.clearance, again.robustness) > min(
            certificate.clearance, certificate.robustness
        ):
            attempt, certificate = tighter, again
    return attempt, certificate, work


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
        if new is not None and _rank(new) < _rank(plan):
            certificate = proof
            if proof is not None:
                new, certificate, more = _certified(search, new)
                work += more
            kept = _rank(new) < _rank(plan) and _no_less_proven(certificate, proof)
            plan, proof = (new, certificate) if kept else (plan, proof)
        done.append(replace(found, kept=kept))
    return plan, proof, done, work


def _no_less_proven(new: Certificate | None, old: Certificate | None) -> bool:
    """Whether a certificate says at least as much as another."""
    if new is None or old is None or new.proven == "yes":
        return True
    return old.proven != "yes" and min(new.clearance, new.robustness) >= min(old.clearance, old.robustness)


def _fine(search: _Search, controls: Floats, problem: Problem) -> Attempt:
    """The problem's own grid and order, started from `controls` on that grid."""
    controls = _refined(controls, problem.steps)
    truncation = choose(problem, controls)
    attempt = start(problem, controls, truncation)
    for _ in range(3):
        options = search.options(1e-3, 1e-3)
        attempt = improve(problem, attempt.controls, truncation, FINE_ROUNDS, options, search.watch("solve"))
        if search.over() or tail(problem, attempt.controls, truncation) < TAIL_LIMIT:
            break
        truncation = raised(problem, truncation)
    return attempt


def _refined(controls: Floats, steps: int) -> Floats:
    """The same commands on a grid of `steps`, each repeated."""
    if steps % len(controls) == 0:
        return np.repeat(controls, steps // len(controls), axis=0)
    middle = (np.arange(steps) + 0.5) / steps * len(controls)
    return np.asarray(controls[middle.astype(int)])


def _rank(attempt: Attempt) -> tuple[bool, float, float]:
    """Sorting key: feasible first, then cost; infeasible by how much they fall short."""
    value = attempt.value
    short = max(0.0, -value.gap) + max(0.0, -value.robustness)
    return (not value.keeps(0.0), 0.0 if value.keeps(0.0) else short, value.cost)


def _status(search: _Search, attempt: Attempt) -> Status:
    """What became of the search."""
    if search.stopped:
        return "interrupted"
    if attempt.value.keeps(0.0) and attempt.status == "solved":
        return "planned"
    return "limit" if search.left() <= 0 else ("planned" if attempt.value.keeps(0.0) else "infeasible")


__all__ = ["Progress", "Solution", "Status", "coarse_steps", "solve"]
