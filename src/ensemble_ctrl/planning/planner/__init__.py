"""From a problem to the best controls found: guesses, a coarse search over routes, and a fine solve.

1. Geometric routes of different kinds around the obstacles give first guesses (`ensemble_ctrl.ocp.guesses.roadmap`);
   tasks with repeated or conditional visits are laid out in time (`ensemble_ctrl.ocp.guesses.laid_out`).
2. Each is solved on a coarse grid at a low order, side by side where there are several cores; the best is kept, or the
   best few where every route is tried: each of them goes through what follows, and the best certified one is the plan.
   Where none of them leads to a plan, other kinds of guesses are tried (`ensemble_ctrl.ocp.guesses`), first for the
   middle member alone, and the nearest for ranges that widen.
3. The horizon's own grid and the order asked for, started from there.
4. Where the truncated curve is too far from the true one, one more moment is carried and it is solved again.
5. The result is certified; where the proof falls short, the margin grows by what is missing and it is solved again.
6. Where the plan may touch patches of terrain, paths around them are tried, too (`planning.planner.patches`).
7. With ``method: minlp`` the facets of the obstacles are chosen anew (`ensemble_ctrl.ocp.mixed`); each result is
   certified in the same way, and takes the plan's place only if it costs less and no less is proven of it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.ocp import parallel
from ensemble_ctrl.ocp.guesses import Guess, Request, first_guesses, ompl_paths
from ensemble_ctrl.ocp.guesses.curved import BATCHES, promising
from ensemble_ctrl.ocp.rounds import rank
from ensemble_ctrl.ocp.solvers import named
from ensemble_ctrl.planning.planner.coarse_fine import coarse_all
from ensemble_ctrl.planning.planner.continuation import continued
from ensemble_ctrl.planning.planner.grids import coarse_steps
from ensemble_ctrl.planning.planner.one_frame import in_one_frame
from ensemble_ctrl.planning.planner.patches import across_or_round
from ensemble_ctrl.planning.planner.positions import by_positions
from ensemble_ctrl.planning.planner.proving import CERTIFY_ROUNDS, CLOSE, is_proven, least_bound
from ensemble_ctrl.planning.planner.search import AFTERWARDS, Progress, Search
from ensemble_ctrl.planning.planner.solution import Solution, Status
from ensemble_ctrl.planning.planner.states import by_states
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.checks import building_seconds, spoken

LOG = logging.getLogger(__name__)
Floats = NDArray[np.float64]

Curved = Literal["never", "after", "before"]


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
    if problem.fleet.starts:
        base = in_one_frame(problem)

        def again(margin: float, controls: Floats | None) -> Solution:
            with_margin = replace(base.solve, margin=base.solve.margin + margin)
            return solve(base.with_(solve=with_margin), progress=progress, guess=controls, log=log)

        return _of_all_starts(problem, again(0.0, guess), again)
    search = Search(problem, progress, log)
    strategy = STRATEGIES[problem.fleet.system.transcription]
    ways = partial(across_or_round, strategy) if problem.terrain and not problem.solve.as_published else strategy
    found = ways(search, problem, guess)
    _report(found)
    return found


def _of_all_starts(problem: Problem, found: Solution, again: Callable[[float, Floats | None], Solution]) -> Solution:
    """The plan of the common frame as the plan of a fleet with several starts, proven for each of them.

    Where members come closer to each other than they may, it is solved `again` with more margin.
    """
    if not problem.verify.certificate:
        return replace(found, problem=problem)
    certificate, margin = certify(problem, found.controls), 0.0
    for _ in range(CERTIFY_ROUNDS if problem.specification.apart else 0):
        short = max(0.0, -certificate.clearance, -certificate.robustness)
        if is_proven(certificate) or certificate.reason or not short <= CLOSE or found.status == "interrupted":
            break
        # the margin grows by 1.5 times what is missing, and 1 mm
        margin += 1.5 * short + 1e-3
        better = again(margin, found.controls)
        proof = certify(problem, better.controls)
        if is_proven(proof) or least_bound(proof) > least_bound(certificate):
            found, certificate = better, proof
    # what the program falls short of by its own, coarser measure is a plan all the same where it is proven
    good = found.status == "infeasible" and is_proven(certificate) and found.attempt.value.excess <= 0
    return replace(found, problem=problem, certificate=certificate, status="planned" if good else found.status)


def _report(found: Solution) -> None:
    """What was tried, and what came of it, to the log."""
    name = found.problem.name
    for one in found.routes:
        LOG.info("%s: %s %s: %s, cost %.4g, short by %.3g", name, one.kind, one.name, one.outcome, one.cost, one.short)
    for library in found.missing:
        LOG.info("%s: %s is not installed; it would give more guesses", name, library)
    spent = ", ".join(f"{phase} {seconds:.2f} s" for phase, seconds in found.seconds.items())
    LOG.info("%s: %s after %d iterations (%s)", name, found.status, found.iterations, spent)


def _require_endable(problem: Problem) -> None:
    """Refuse a program that takes longer to build than there is time, where nothing could end that."""
    seconds, limit = building_seconds(problem.steps), problem.solve.time_limit
    if seconds > limit and not parallel.endable():
        why = f"{spoken(seconds)} to build, more than solve.time_limit = {limit:g} s, and nothing could end that"
        where = "beside other threads, and on systems other than Linux"
        raise ProblemError(f"horizon.steps: expected fewer {where}, got {problem.steps}: {why}")


STRATEGIES: dict[str, Callable[[Search, Problem, Floats | None], Solution]] = {
    "positions": by_positions,
    "states": by_states,
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
    search, steps = Search(problem, progress, None), coarse_steps(problem)

    def by_routes() -> list[Guess]:
        return first_guesses(Request(problem, steps, quick=True))

    def by_curves() -> list[Guess]:
        return promising(search.request(steps), BATCHES[0]) if ompl_paths.available() else []

    ways = {"never": (by_routes,), "after": (by_routes, by_curves), "before": (by_curves, by_routes)}[curves]
    for guessed in ways:
        solved = coarse_all(search, [seed.controls for seed in guessed()])
        best = min(solved, key=rank, default=None)
        if best is not None and best.value.keeps(0.0):
            return best.controls
    return None


__all__ = ["AFTERWARDS", "Curved", "Progress", "Solution", "Status", "coarse_steps", "continued", "screen", "solve"]
