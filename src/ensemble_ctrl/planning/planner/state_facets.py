"""Other facets for a plan in full states: a mixed-integer linear program around it, then the nonlinear one."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial

from ensemble_ctrl.certificate import Certificate
from ensemble_ctrl.ocp import state_rounds as shooting
from ensemble_ctrl.ocp.linearised_facets import Chosen, linearised_facets
from ensemble_ctrl.ocp.mixed import ENOUGH, Round
from ensemble_ctrl.ocp.rounds import Attempt, rank
from ensemble_ctrl.planning.planner.proving import certified_with_margin, no_less_proven
from ensemble_ctrl.planning.planner.search import Search
from ensemble_ctrl.problem import Problem

NEIGHBOURHOODS = {"facets nearby": 0.1, "facets anywhere": 2.0}
"""How far commands may change, in half widths of their bounds; 2 is all that these allow."""
USABLE = 0.1
"""Metres, or a unit of the task, by which a choice may fall short for a nonlinear program to start from it."""


def other_facets(
    search: Search, problem: Problem, plan: Attempt, proof: Certificate | None
) -> tuple[Attempt, Certificate | None, list[Round], list[Attempt]]:
    """Improve a plan by other facets; what takes its place costs less, and no less is proven of it.

    Returns
    -------
    attempt, certificate
        The best plan, and what is proven of it.
    rounds
        Every neighbourhood, with how it ended.
    work
        All solves.
    """
    began, done, work = time.perf_counter(), list[Round](), list[Attempt]()
    for name, trust in NEIGHBOURHOODS.items():
        if search.over() or time.perf_counter() - began > ENOUGH:
            break
        first = time.perf_counter()
        pair = search.alone("minlp", partial(_chosen, problem, plan, trust))
        if pair is None:
            break
        found, new = pair
        kept = False
        if new is not None:
            work.append(new)
        if new is not None and rank(new) < rank(plan):
            certificate = proof
            if proof is not None:
                new, certificate, more = certified_with_margin(search, new, partial(_tightened, search, problem))
                work += more
            kept = rank(new) < rank(plan) and no_less_proven(certificate, proof)
            plan, proof = (new, certificate) if kept else (plan, proof)
        round_ = replace(_round(name, found, new), seconds=time.perf_counter() - first, kept=kept)
        search.reported(round_)
        done.append(round_)
    return plan, proof, done, work


def _chosen(problem: Problem, plan: Attempt, trust: float, own: Search) -> tuple[Chosen, Attempt | None]:
    """A choice of facets, and the plan that the nonlinear program makes of it."""
    limit = min(problem.solve.bonmin_limit, own.left() / 2)
    found = linearised_facets(problem, shooting.whole(problem), plan.controls, trust, limit)
    if not found.short <= USABLE or own.over():
        return found, None
    return found, shooting.improved(problem, found.controls, own)


def _tightened(search: Search, problem: Problem, attempt: Attempt, tight: Problem) -> Attempt | None:
    """The same with more margin."""
    more = problem.with_(solve=tight.solve)
    return search.alone("solve", lambda own: shooting.improved(more, attempt.controls, own))


def _round(name: str, found: Chosen, new: Attempt | None) -> Round:
    """How one neighbourhood ended."""
    if new is None:
        message = found.message if not len(found.controls) else f"these facets fall short by {found.short:.2g}"
        return Round(name, None, "infeasible", message, binaries=found.binaries, bound=found.bound)
    how = new.status, new.message
    return Round(name, new, *how, new.value.cost, found.binaries, 0, found.cost, found.bound)
