"""Try one problem, as a unit of work; ``python -m benchmarks.finding.one mazes 3 60 planner`` prints the outcome."""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import ensemble_ctrl as ec

from .case import Case
from .families import drawn
from .judge import cost, verdict
from .plain import plain


def prepare(text: str) -> dict[str, Any]:
    """What a unit is about: a line of the results without what came of it."""
    about: dict[str, Any] = json.loads(text)
    return about


def run(about: dict[str, Any], index: int) -> dict[str, Any]:
    """What comes of a unit; there is one of each, index 0."""
    return tried(drawn(about["family"], about["seed"]), about["limit"], about["program"])


def tried(case: Case, seconds: float, program: str) -> dict[str, Any]:
    """Outcome, seconds and cost of one program for one problem."""
    began = time.perf_counter()
    try:
        problem = case.problem(seconds)
    except ec.ConfigError:
        # a plain program has no check of its own, and refuses nothing
        outcome = "none" if program == "plain" else "refused"
        return {"outcome": outcome, "seconds": time.perf_counter() - began, "cost": None}
    found = plain(problem, seconds) if program == "plain" else planned(problem)
    known = None if case.controls is None else cost(problem, case.controls)
    return {**found, "known": known}


def planned(problem: ec.Problem) -> dict[str, Any]:
    """What the planner finds and claims, within its limit or when it is over."""
    began = time.perf_counter()
    plan = ec.plan(problem, check=False)
    seconds = time.perf_counter() - began
    outcome = verdict(problem, plan.controls) if plan.status != "infeasible" else "none"
    return {"outcome": outcome, "seconds": seconds, "cost": None if outcome == "none" else cost(problem, plan.controls)}


if __name__ == "__main__":
    family, seed, limit, name = sys.argv[1:]
    print(json.dumps(tried(drawn(family, int(seed)), float(limit), name)))
