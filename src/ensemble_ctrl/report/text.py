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
    rows = [("fleet", _fleet(problem)), ("task", str(problem.task)), *_measured(plan.replayed)]
    if plan.replayed is None or plan.replayed.violating.any() or plan.status == "infeasible":
        rows += [("violated", _conflict(problem, c)) for c in plan.conflicts()[:5]]
    if plan.status == "infeasible":
        rows.append(("try", "a longer horizon, higher input bounds, a narrower parameter range, or wider passages"))
    rows.append(("proven", _proven(d)))
    if "cost" in d:
        rows.append(("cost", _cost(d)))
    if "seconds" in d:
        rows.append(("work", _work(d)))
    if files:
        rows.append(("files", files))
    return [f"{problem.name}: {verdict(plan)}", *(f"  {label:<11}{text}" for label, text in rows)]


def _fleet(problem: Problem) -> str:
    """Who moves, from where."""
    fleet, law = problem.fleet, problem.fleet.parameter
    x, y = fleet.position
    return (
        f"{fleet.system.name}, {fleet.parameter_name} {law.lower:g} to {law.upper:g}, from ({x:g}, {y:g}) heading "
        f"{np.degrees(fleet.heading):.4g} deg, radius {fleet.radius:g} m, {problem.duration:g} s in {problem.steps} steps"
    )


def _measured(run: Replay | None) -> list[tuple[str, str]]:
    """What the replay found."""
    if run is None:
        return []
    value, parameter = run.worst
    rows = [("robustness", f"{value:.4f} m for the worst member (parameter {parameter:.4f})")]
    if run.clearances:
        c = min(run.clearances, key=lambda c: c.distance)
        rows.append(
            ("clearance", f"{c.distance:.4f} m to {c.obstacle} at t = {c.time:.2f} s (parameter {c.parameter:.4f})")
        )
    bad = int(run.violating.sum())
    rows.append(
        (
            "replay",
            f"{run.members} members, {run.substeps} look{'s' if run.substeps > 1 else ''} a step: {bad} violate, "
            f"{100 * run.satisfied:.5g} % satisfy ({run.seconds:.2f} s)",
        )
    )
    return rows


def _conflict(problem: Problem, c: Conflict) -> str:
    """One violated constraint."""
    return f"{c.what} by {c.amount:.3g} m ({problem.fleet.parameter_name} {c.parameter:.4g}, t = {c.time:.2f} s)"


def _proven(d: dict[str, Any]) -> str:
    """What holds for every parameter, and what does not."""
    if d.get("guarantee") == "nodes":
        return f"nothing for all parameters; constrained at the {d.get('order', 0) + 1} Gauss nodes, grid times only"
    return (
        f"nothing yet for all parameters; constrained as hulls over the whole range and every step interval "
        f"(order {d.get('order', '?')}, moments 0..{d.get('degree', '?')} carried), then sampled"
    )


def _cost(d: dict[str, Any]) -> str:
    """The cost and its parts."""
    return (
        f"{d['cost']:.4f} = effort {d['effort']:.4f} + terminal {d['terminal']:.4f}"
        f" - weighted robustness {d['effort'] + d['terminal'] - d['cost']:.4f}"
    )


def _work(d: dict[str, Any]) -> str:
    """What it took."""
    times = ", ".join(f"{name} {value:.2f} s" for name, value in d["seconds"].items())
    return f"{len(d['routes'])} route(s), {d['iterations']} iterations, build {d['build_seconds']:.2f} s; {times}"
