"""The summary that a person reads: about a dozen lines, all of it computed in this run or read from the plan."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.replay import Replay

if TYPE_CHECKING:
    from ensemble_ctrl.conflicts import Conflict


class PlanLike(Protocol):
    """What a summary needs of a plan."""

    @property
    def problem(self) -> Problem:
        """What was asked."""

    @property
    def status(self) -> str:
        """How the search ended."""

    @property
    def details(self) -> dict[str, Any]:
        """What the search did."""

    @property
    def replayed(self) -> Replay | None:
        """The replay, if any."""

    def conflicts(self) -> tuple[Conflict, ...]:
        """What fails."""


STATUS_WORDS = {
    "planned": "plan found",
    "infeasible": "NO PLAN FOUND (infeasible near every guess)",
    "limit": "limit reached, best plan so far",
    "interrupted": "interrupted, best plan so far",
}


def verdict(plan: PlanLike) -> str:
    """One line: what became of it."""
    words = STATUS_WORDS[plan.status]
    run = plan.replayed
    if plan.status == "infeasible" or run is None:
        return words
    bad = int(run.violating.sum())
    return f"{words}, " + (
        f"no member of {run.members} violates" if not bad else f"{bad} of {run.members} members VIOLATE it"
    )


def summary_lines(plan: PlanLike, files: str | None = None) -> list[str]:
    """The summary, a line each."""
    problem, d = plan.problem, plan.details
    rows = [
        ("fleet", _fleet(problem)),
        ("horizon", f"{problem.duration:g} s in {problem.steps} steps"),
        ("task", str(problem.task)),
        *_measured(plan.replayed, problem.fleet.parameter_name),
    ]
    if plan.replayed is None or plan.replayed.violating.any() or plan.status == "infeasible":
        rows += [("violated", conflict_text(problem, c)) for c in plan.conflicts()[:5]]
    if plan.status == "infeasible":
        rows.append(("try", "a longer horizon, higher input bounds, a narrower parameter range, or wider passages"))
    rows.append(("proven", _proven(d)))
    if d.keys() >= {"cost", "effort", "terminal"}:
        rows.append(("cost", _cost(d)))
    if d.keys() >= {"seconds", "routes", "iterations", "build_seconds"}:
        rows.append(("work", _work(d)))
    if files:
        rows.append(("files", files))
    return [f"{problem.name}: {verdict(plan)}", *(f"  {label:<11}{text}" for label, text in rows)]


def _fleet(problem: Problem) -> str:
    """Who moves, from where."""
    fleet, law = problem.fleet, problem.fleet.parameter
    x, y = fleet.position
    return (
        f"{fleet.system.name}, {fleet.parameter_name} {law.lower:g} to {law.upper:g}, radius {fleet.radius:g} m, "
        f"from ({x:g}, {y:g}) heading {np.degrees(fleet.heading):.4g} deg"
    )


def _measured(run: Replay | None, name: str) -> list[tuple[str, str]]:
    """What the replay found."""
    if run is None:
        return []
    value, parameter = run.worst
    rows = [("robustness", f"{value:.4f} m for the worst member ({name} {parameter:.4f})")]
    if run.clearances:
        c = min(run.clearances, key=lambda c: c.distance)
        rows.append(
            (
                "clearance",
                f"{c.distance:.4f} m to {c.obstacle} at t = {c.time:.2f} s ({name} {c.parameter:.4f})",
            )
        )
    bad = int(run.violating.sum())
    rows.append(
        (
            "replay",
            f"{run.members} members, {run.substeps} look{'s' if run.substeps > 1 else ''} a step: {bad} violate, "
            f"{_percent(run.satisfied)} % satisfy ({run.seconds:.2f} s)",
        )
    )
    return rows


def conflict_text(problem: Problem, c: Conflict) -> str:
    """One violated constraint, with amount, parameter and time."""
    return f"{c.what} by {c.amount:.3g} m ({problem.fleet.parameter_name} {c.parameter:.4g}, t = {c.time:.2f} s)"


def _proven(d: dict[str, Any]) -> str:
    """What holds for every parameter, and what does not."""
    order = d.get("order")
    if order is None:
        return "nothing for all parameters"
    if d.get("guarantee") == "nodes":
        return f"nothing for all parameters; obstacles were kept off at {order + 1} Gauss nodes and grid times"
    return f"nothing yet for all parameters; obstacles were kept off by hulls over the whole range, order {order}"


def _percent(share: float) -> str:
    """A share in percent; never 100 while one member is missing."""
    text = f"{100 * share:.5g}"
    return "99.999" if text == "100" and share < 1 else text


def _cost(d: dict[str, Any]) -> str:
    """The cost and its parts."""
    return (
        f"{d['cost']:.4f} = effort {d['effort']:.4f} + terminal {d['terminal']:.4f}"
        f" - weighted robustness {d['effort'] + d['terminal'] - d['cost']:.4f}"
    )


def _work(d: dict[str, Any]) -> str:
    """What it took."""
    times = ", ".join(f"{name} {value:.2f} s" for name, value in d["seconds"].items())
    count = len(d["routes"])
    return f"{count} route{'s' * (count != 1)}, {d['iterations']} iterations, build {d['build_seconds']:.2f} s; {times}"
