"""From a problem to the plan that a user holds: solved, replayed, and with what the search did as plain data."""

from __future__ import annotations

from dataclasses import asdict, replace
from math import isfinite
from os import PathLike
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.core.errors import RunawayError, SolveError
from ensemble_ctrl.core.values import called, numbers, path_of
from ensemble_ctrl.files.config import load
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.arrival import arrival, risk
from ensemble_ctrl.problem.evaluation.sampled import replay

if TYPE_CHECKING:
    from ensemble_ctrl.planning.minimum_time import MinimumTime
    from ensemble_ctrl.planning.planner import Progress, Solution
    from ensemble_ctrl.planning.tolerance import MostTolerant

Floats = NDArray[np.float64]


def plan(
    problem: Problem | str | PathLike[str],
    *,
    progress: Progress | None = None,
    guess: Plan | Floats | None = None,
    log: str | Path | None = None,
    check: bool = True,
) -> Plan:
    """Find one broadcast control that does the task for the whole fleet, and replay it.

    Parameters
    ----------
    problem : Problem or path
        What to plan, or its problem file.
    progress : callable, optional
        ``progress(phase, iteration or None) -> bool``; returning True stops with the best plan so far.
    guess : Plan or ndarray of shape (steps', n_u), optional
        Controls to start from instead of geometric routes.
    log : Path, optional
        File that the solver's own output is appended to.
    check : bool
        Whether to raise when no plan is found, or a replayed member violates it.

    Returns
    -------
    Plan
        Already replayed with ``problem.verify``, unless states run away under the controls found. Where a time is to
        be as short as possible, its problem is that of the time found, and ``details["minimum_time"]`` has what was
        tried (`ensemble_ctrl.planning.minimum_time.MinimumTime`).

    Raises
    ------
    SolveError
        With ``check``; the plan that fell short is its `plan`.

    Examples
    --------
    >>> import ensemble_ctrl as ec
    >>> problem = ec.load_text('''
    ... fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
    ... horizon: {duration: 4 s, steps: 20}
    ... regions: {goal: {box: [[1, 2], [-0.5, 0.5]]}}
    ... task: F[3, 4] in(goal)
    ... ''')
    >>> ec.plan(problem).replayed.satisfied
    1.0
    """
    from ensemble_ctrl.planning import minimum_time, tolerance

    began = perf_counter()
    if not isinstance(problem, Problem):
        problem = load(path_of("problem", problem, "a Problem, or the path of a file with one"))
    controls = guess.controls if isinstance(guess, Plan) else None if guess is None else numbers("guess", guess)
    file = None if log is None else path_of("log", log)
    if progress is not None:
        called("progress", progress)
    search = minimum_time.solve if problem.objective.tolerance is None else tolerance.solve
    solution, extreme = search(problem, progress=progress, guess=controls, log=file)
    if progress is not None:
        progress("replay", None)
    found = judged(solution, extreme, began, progress)
    if check and not (found.status == "planned" and found.verified):
        raise SolveError(failure_message(found), found)
    return found


def judged(
    solution: Solution,
    extreme: MinimumTime | MostTolerant | None,
    began: float | None = None,
    progress: Progress | None = None,
) -> Plan:
    """The plan of a solution, replayed unless states run away under it.

    Parameters
    ----------
    solution : Solution
    extreme : MinimumTime or MostTolerant or None
        What was tried where a time is to be as short as possible, or errors as large.
    began : float, optional
        When the search began, by ``perf_counter``: the replay ends with its time limit.
    progress : callable, optional
        As for `plan`.
    """
    name = "tolerance" if hasattr(extreme, "scale") else "minimum_time"
    details = _details(solution) | ({} if extreme is None else {name: asdict(extreme)})
    found = Plan(solution.problem, solution.controls, solution.status, details, None, solution.certificate)
    try:
        return _replayed(found, perf_counter() if began is None else began, progress)
    except RunawayError:
        known = {name: what for name, what in details.items() if name not in asdict(solution.attempt.value)}
        return replace(found, status="infeasible" if found.status == "planned" else found.status, details=known)


def _replayed(found: Plan, began: float, progress: Progress | None) -> Plan:
    """The plan with its replay, as far as that gets in what is left of the time, but at least in `AFTERWARDS`.

    After a wish to stop, that is all there is. A plan replayed on fewer members than requested is not finished.
    """
    from ensemble_ctrl.ocp.solvers import AT_WORK
    from ensemble_ctrl.planning.planner import AFTERWARDS

    ends, stopped = max(began + found.problem.solve.time_limit, perf_counter() + AFTERWARDS), False

    def watch(_: int) -> bool:
        nonlocal stopped, ends
        if not stopped and progress is not None and progress("replay", AT_WORK):
            stopped, ends = True, min(ends, perf_counter() + AFTERWARDS)
        return perf_counter() > ends

    run = replay(found.problem, found.controls, watch=watch)
    cut = run.members < found.problem.verify.members and found.status == "planned"
    return replace(found, replayed=run, status="interrupted" if cut and stopped else "limit" if cut else found.status)


def failure_message(plan: Plan) -> str:
    """Why a plan falls short, in words: the constraints that conflict with amount, parameter and time."""
    from ensemble_ctrl.ocp.terrain import crossed
    from ensemble_ctrl.report import conflict_text
    from ensemble_ctrl.report.tried import tried

    lines = [conflict_text(c) for c in plan.conflicts()[:5]]
    lead = "no plan was found" if plan.status == "infeasible" else f"the plan falls short ({plan.status})"
    if plan.status == "planned" and not lines and plan.certificate is not None:
        why = plan.certificate.reason
        lead = "a plan was found that every replayed member does, but it is not proven" + (f" ({why})" if why else "")
    listed = "; violated near the best guess: " + "; ".join(lines) if lines else ""
    met = crossed(plan.problem, plan.controls)
    listed += "".join(
        f"; members may be in terrain {name} from {t.begin:.1f} to {t.end:.1f} s" for name, t in met.items()
    )
    what = "; ".join(tried(plan.details))
    return f"{plan.problem.name}: {lead}{listed}" + (f"; tried: {what}" if what else "")


def with_baseline(plan: Plan, progress: Progress | None = None) -> Plan:
    """The plan with the controls of its problem's unconstrained baseline, if there are any (`planning.baseline`)."""
    from ensemble_ctrl.planning.baseline import unconstrained
    from ensemble_ctrl.planning.planner import solve

    solution = solve(unconstrained(plan.problem), progress=progress)
    return replace(plan, baseline=solution.controls if solution.status == "planned" else None)


def with_suggestions(plan: Plan, progress: Progress | None = None) -> Plan:
    """The plan with what would help in its details, where none was found and a second is left to search for it."""
    from ensemble_ctrl.planning.suggest import SECONDS

    left = plan.problem.solve.time_limit - sum(plan.details.get("seconds", {}).values())
    over = plan.verified or plan.status not in ("infeasible", "limit") or left < 1
    if over or plan.problem.fleet.starts:  # changes are searched for fleets with one start only
        return plan
    found = plan.suggest(min(SECONDS, left), progress=progress)
    helps = [{"change": s.change, "set": list(s.overrides), "certified": True} for s in found.helps]
    tried = {"helps": helps, "failed": list(found.failed), "seconds": found.seconds}
    tried |= {"limited": True} if found.limited else {}
    return replace(plan, details={**plan.details, "suggestions": tried})


def _details(solution: Solution) -> dict[str, Any]:
    """What the search did, as plain data."""
    attempt = solution.attempt
    return {
        **{name: float(value) for name, value in asdict(attempt.value).items()},
        "orders": list(attempt.truncation.orders),
        "degrees": list(attempt.truncation.degrees),
        "guarantee": solution.problem.solve.guarantee,
        "solver": attempt.message,
        "iterations": solution.iterations,
        "build_seconds": solution.build_seconds,
        "solve_seconds": solution.solve_seconds,
        "seconds": solution.seconds,
        "arrival": _arrival(solution),
        "at_risk": risk(solution.problem, solution.controls),
        "missing": list(solution.missing),
        "closed": list(solution.closed),
        "routes": [{**vars(route), "corners": route.corners.tolist()} for route in solution.routes],
        **({} if solution.nlp is None else {"minlp": _mixed_details(solution.nlp.value.cost, solution)}),
    }


def _arrival(solution: Solution) -> dict[str, Any]:
    """How close the fleet comes to its target; nothing where it runs away."""
    try:
        return arrival(solution.problem, solution.controls)
    except RunawayError:
        return {}


def _mixed_details(nlp_cost: float, solution: Solution) -> dict[str, Any]:
    """What choosing facets anew did, as plain data; numbers that do not exist are None."""

    def number(value: float) -> float | None:
        return float(value) if isfinite(value) else None

    return {
        "solver": "Bonmin" if solution.problem.fleet.system.transcription == "positions" else "HiGHS",
        "nlp_cost": nlp_cost,
        "cost": solution.attempt.value.cost,
        "nodes": sum(r.nodes for r in solution.rounds),
        "rounds": [
            {
                "name": r.name,
                "status": r.status,
                "message": r.message,
                "cost_with_facets": number(r.cost),
                "cost": None if r.attempt is None else number(r.attempt.value.cost),
                "switches": r.binaries,
                "nodes": r.nodes,
                "objective": number(r.objective),
                "bound": number(r.bound),
                "gap": number(r.gap),
                "seconds": r.seconds,
                "kept": r.kept,
            }
            for r in solution.rounds
        ],
        "note": "The gap is no proof of optimality: the problem is not convex, each node is solved to a local "
        "optimum, and only the offered facets were looked at.",
    }
