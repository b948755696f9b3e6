"""Rounds of solving: separating hyperplanes are re-chosen at each solution, and pairs that it violates are added."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.chance import all_hyperplanes, reach
from ensemble_ctrl.ocp.evaluate import Value, evaluate
from ensemble_ctrl.ocp.hyperplanes import Hyperplanes
from ensemble_ctrl.ocp.solvers import Outcome, SolverOptions, Status, Watch, solve
from ensemble_ctrl.ocp.transcription import Avoiding, Iterate, transcribe
from ensemble_ctrl.ocp.truncation import Truncation, occupied, tail
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

GAIN = 5e-3
"""Rounds end when one lowers the cost by less."""
TIGHT = 1e-6
"""Metres by which a pair may fall short before it counts as violated."""


@dataclass(frozen=True, eq=False)
class Attempt:
    """Controls with what they are worth, to the middle member alone if that is known, and what it took to find them.

    `pending` says that another round is expected to lower the cost, and left to whoever chooses between attempts.
    """

    controls: Floats
    value: Value
    truncation: Truncation
    status: Status
    message: str
    iterations: int
    build_seconds: float
    solve_seconds: float
    pairs: int
    middle: Value | None = None
    pending: bool = False


def improve(
    problem: Problem,
    controls: Floats,
    truncation: Truncation,
    rounds: int,
    options: SolverOptions,
    watch: Watch | None = None,
    *,
    more: bool = False,
) -> Attempt:
    """Solve up to `rounds` times from `controls`, each time around the last solution; `more` rounds may follow."""
    attempt = start(problem, controls, truncation)
    for _ in range(rounds):
        better = _round(problem, attempt, options, watch)
        finished = better.status in ("interrupted", "limit") or better.value.cost > attempt.value.cost - GAIN
        worse = attempt.value.keeps(0.0) and not (better.value.keeps(0.0) and better.value.cost <= attempt.value.cost)
        attempt = with_work(attempt if worse else better, attempt, better)
        if (finished and attempt.value.keeps(0.0)) or options.left <= 0:
            return attempt
    return replace(attempt, pending=more)


def anew(
    problem: Problem, controls: Floats, truncation: Truncation, options: SolverOptions, watch: Watch | None = None
) -> Attempt:
    """The solution of one round around controls, even where these keep the constraints and cost less."""
    return _round(problem, start(problem, controls, truncation), options, watch)


def start(problem: Problem, controls: Floats, truncation: Truncation) -> Attempt:
    """The guess as an attempt that cost nothing."""
    value = evaluate(problem, controls, truncation)
    return Attempt(controls, value, truncation, "failed", "not solved", 0, 0.0, 0.0, 0)


def _round(problem: Problem, attempt: Attempt, options: SolverOptions, watch: Watch | None) -> Attempt:
    """One choice of hyperplanes: solve, and solve again with the pairs that the solution violates."""
    truncation, guess = attempt.truncation, attempt.controls
    curve = occupied(problem, guess, truncation)
    # rows for pairs within reach, with the truncation error of the guess as margin
    near = reach(problem, curve)
    hyperplanes = all_hyperplanes(problem, truncation, curve, near, guess)
    missed = tail(problem, guess, truncation) if truncation.hull else 0.0
    in_moments = problem.solve.guarantee == "moment"
    pairs = (hyperplanes.gap < near) & (not in_moments)
    total = replace(attempt, iterations=0, build_seconds=0.0, solve_seconds=0.0)
    for _ in range(4):
        began = time.perf_counter()
        program = transcribe(problem, truncation, Iterate(guess), Avoiding(hyperplanes, pairs), (missed, 0.0))
        built = time.perf_counter()
        outcome = solve(program.nlp, options, watch)
        controls = program.iterate(outcome.x).controls
        total = _after(problem, total, outcome, controls, built - began, time.perf_counter() - built)
        missing = _violated(problem, hyperplanes, occupied(problem, controls, truncation)) & ~pairs
        if outcome.status != "solved" or in_moments or not missing.any() or options.left <= 0:
            break
        pairs |= _widened(missing)
    return replace(total, pairs=int(pairs.sum()))


def _after(
    problem: Problem,
    total: Attempt,
    outcome: Outcome,
    controls: Floats,
    built: float,
    solved: float,
) -> Attempt:
    """The attempt after one more solve."""
    return replace(
        total,
        controls=controls,
        value=evaluate(problem, controls, total.truncation),
        status=outcome.status,
        message=outcome.message,
        iterations=total.iterations + outcome.iterations,
        build_seconds=total.build_seconds + built,
        solve_seconds=total.solve_seconds + solved,
    )


def rank(attempt: Attempt) -> tuple[bool, float, float]:
    """Sorting key: feasible first, then cost; infeasible by how much they fall short."""
    value = attempt.value
    # total shortfall: clearance, robustness and rates
    short = max(0.0, -value.gap) + max(0.0, -value.robustness) + max(0.0, value.excess)
    return (not value.keeps(0.0), 0.0 if value.keeps(0.0) else short, value.cost)


def with_work(kept: Attempt, before: Attempt, after: Attempt) -> Attempt:
    """`kept` with the work of both."""
    return replace(
        kept,
        iterations=before.iterations + after.iterations,
        build_seconds=before.build_seconds + after.build_seconds,
        solve_seconds=before.solve_seconds + after.solve_seconds,
    )


def _violated(problem: Problem, hyperplanes: Hyperplanes, curve: Floats) -> NDArray[np.bool_]:
    """Pairs whose hyperplane the new points cross, shape (sides, steps)."""
    short = (
        hyperplanes.nearest(curve) - hyperplanes.support - hyperplanes.radius[:, None] < problem.solve.margin - TIGHT
    )
    return np.asarray(short & hyperplanes.active)


def _widened(pairs: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The pairs with three steps to either side."""
    wide = pairs.copy()
    for shift in range(1, 4):
        wide[:, shift:] |= pairs[:, :-shift]
        wide[:, :-shift] |= pairs[:, shift:]
    return wide
