"""The paper's program as it is printed: on the problem's own grid, with all facets, its solution as it is returned.

1. A linear model (HiGHS) gives a path, from which every solve starts, and a facet of every obstacle at every time.
2. The binaries fixed to these facets: IPOPT.
3. All facets: Bonmin, in a process that is ended at its limit. Where it has a solution, that is the plan; else the one
   with the fixed facets.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.evaluate import evaluate
from ensemble_ctrl.ocp.guesses.drive import follow, smoothed
from ensemble_ctrl.ocp.linear_facets import LinearPlan, linear_facets
from ensemble_ctrl.ocp.mixed import Round
from ensemble_ctrl.ocp.published import PublishedProgram, published_program
from ensemble_ctrl.ocp.published.program import published_truncation
from ensemble_ctrl.ocp.rounds import Attempt
from ensemble_ctrl.ocp.solvers import Nlp, Outcome, solve
from ensemble_ctrl.ocp.solvers import Status as SolverStatus
from ensemble_ctrl.planning.planner.grids import given
from ensemble_ctrl.planning.planner.search import Search
from ensemble_ctrl.planning.planner.solution import Solution, status_of
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

LINEAR_LIMIT = 120.0
"""Seconds for the linear model, whose nodes are limited, too."""
BARRIER, TOLERANCE = 1e-2, 1e-4
"""Of IPOPT."""


def by_published(search: Search, problem: Problem, guess: Floats | None) -> Solution:
    """Plan with the paper's own program; the rounds of the solution say what each solver made of it."""
    search.tell("guess")
    linear = linear_facets(problem, min(LINEAR_LIMIT, search.left()))
    seconds = {"guess": time.perf_counter() - search.began}
    program = published_program(problem, _start(problem, linear, guess))
    rounds = [round for round in (_fixed(search, program, linear), _branched(search, program)) if round is not None]
    best = next((round for round in reversed(rounds) if round.attempt is not None), rounds[0])
    final = best.attempt or _attempt(problem, program.controls(program.nlp.guess), best.status, best.message, 0)
    seconds["solve"] = time.perf_counter() - search.began - seconds["guess"]
    certificate = None
    if problem.verify.certificate:
        search.tell("certify")
        certificate = search.certified(final.controls)
        seconds["certify"] = time.perf_counter() - search.began - sum(seconds.values())
    return Solution(
        problem,
        final.controls,
        status_of(search, final, certificate),
        final,
        seconds=seconds,
        iterations=sum(r.attempt.iterations for r in rounds if r.attempt and not r.nodes),
        solve_seconds=seconds["solve"],
        certificate=certificate,
        nlp=rounds[0].attempt or final,
        rounds=tuple(replace(round, kept=round is best) for round in rounds),
    )


def _start(problem: Problem, linear: LinearPlan, guess: Floats | None) -> Floats:
    """Commands along the path of the linear model, or those given."""
    if guess is not None:
        return given(problem, guess, problem.steps)
    if linear.found:
        return follow(problem, smoothed(linear.fine(problem.steps)))
    return np.tile(np.clip(np.zeros(2), problem.fleet.input_lower, problem.fleet.input_upper), (problem.steps, 1))


def _fixed(search: Search, program: PublishedProgram, linear: LinearPlan) -> Round | None:
    """IPOPT with the linear model's facets, or with nothing to choose."""
    steps = search.problem.steps
    if program.facets and not linear.found:
        return Round("facets of the linear model", None, "failed", linear.message, seconds=linear.seconds)
    choice = [linear.of_piece(i, one.times, steps) for i, one in enumerate(program.facets)]
    name = "facets of the linear model" if choice else "moments"
    return _solved(search, name, program, program.fixed(choice), "ipopt")


def _branched(search: Search, program: PublishedProgram) -> Round | None:
    """Bonmin with all facets."""
    if not program.facets or search.over() or search.problem.solve.facets != "all":
        return None
    return _solved(search, "all facets", program, program.nlp, "bonmin")


def _solved(search: Search, name: str, program: PublishedProgram, nlp: Nlp, solver: str) -> Round:
    """One solve of the program as a round, with its solution as it is returned."""
    began = time.perf_counter()
    search.tell(name)
    options = replace(search.options(BARRIER, TOLERANCE), solver=solver)
    if solver == "bonmin":
        options = replace(options, time_limit=min(search.problem.solve.bonmin_limit, options.time_limit))
    outcome = solve(nlp, options, search.watch(name))
    good = outcome.status == "solved" or (solver == "bonmin" and np.isfinite(outcome.cost))
    attempt = _of(search.problem, program, outcome) if good else None
    return Round(
        name,
        attempt,
        outcome.status,
        outcome.message,
        cost=attempt.value.cost if attempt else np.inf,
        binaries=len(nlp.discrete),
        nodes=outcome.iterations if solver == "bonmin" else 0,
        objective=outcome.cost if good else np.inf,
        bound=outcome.bound,
        seconds=time.perf_counter() - began,
    )


def _of(problem: Problem, program: PublishedProgram, outcome: Outcome) -> Attempt:
    """A solver's solution as an attempt."""
    return _attempt(problem, program.controls(outcome.x), "solved", outcome.message, outcome.iterations)


def _attempt(problem: Problem, controls: Floats, status: SolverStatus, message: str, iterations: int) -> Attempt:
    """Controls with what they are worth."""
    truncation = published_truncation(problem)
    value = evaluate(problem, controls, truncation)
    return Attempt(controls, value, truncation, status, message, iterations, 0.0, 0.0, 0)
