"""The same problem under each guarantee and method: what the paper's constraints let through, and what safety costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ensemble_ctrl.api.planning import plan
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import expect
from ensemble_ctrl.planning.planner import Progress
from ensemble_ctrl.problem import Guarantee, Method, Problem

VARIANTS: dict[str, tuple[Guarantee, Method]] = {
    "moment": ("moment", "nlp"),
    "moment, minlp": ("moment", "minlp"),
    "nodes": ("nodes", "nlp"),
    "hull": ("hull", "nlp"),
    "hull, minlp": ("hull", "minlp"),
}
"""Guarantee and method of each row; ``moment, minlp`` has the paper's rows: moments, big-M and binaries."""
SUBSTEPS = 10
"""Times a step at which the compared plans are replayed."""


@dataclass(frozen=True, eq=False)
class Compared:
    """One row: a guarantee's and method's plan, replayed.

    Attributes
    ----------
    name : str
        Of the variant, one of `VARIANTS`.
    guarantee : str
        Which constraints it was planned with.
    plan : Plan
        The plan with its replay, `SUBSTEPS` samples per step.
    seconds : float
        Time of the search.
    iterations : int
        Of all solves.
    cost : float
        As minimised: for ``moment`` with the mean robot's robustness, for the others with the worst member's.
    violating : int
        Replayed members that fail the task or enter an obstacle.
    depth : float
        Metres by which the worst member fails; 0 if none does.
    """

    name: str
    guarantee: Guarantee
    plan: Plan
    seconds: float
    iterations: int
    cost: float
    violating: int
    depth: float


def compare(
    problem: Problem, variants: Sequence[str] = tuple(VARIANTS), progress: Progress | None = None
) -> tuple[Compared, ...]:
    """Plan `problem` once in each of the `VARIANTS` named, without certified tightening, and replay the plans.

    Variants that are not for the problem or its system (`left_out`) have no row.

    Notes
    -----
    Nothing is tightened after the first solution, so that each row shows what its constraints alone give.
    """
    expect("problem", problem, Problem)
    without = left_out(problem, variants)
    return tuple(_compared(problem, name, progress) for name in variants if name not in without)


def left_out(problem: Problem, variants: Sequence[str] = tuple(VARIANTS)) -> dict[str, str]:
    """The variants that are not for a problem, and why: moving obstacles, for example, are not for ``minlp``."""
    found = {}
    for name in variants:
        try:
            _variant(problem, name)
        except ProblemError as error:
            found[name] = str(error)
    return found


def _variant(problem: Problem, name: str) -> Problem:
    """The problem of one row."""
    guarantee, method = VARIANTS[name]
    return problem.with_(
        solve=replace(problem.solve, guarantee=guarantee, method=method),
        verify=replace(problem.verify, certificate=False, substeps=SUBSTEPS),
    )


def _compared(problem: Problem, name: str, progress: Progress | None) -> Compared:
    """One row."""
    found = plan(_variant(problem, name), progress=progress, check=False)
    run = found.replayed
    assert run is not None
    shortest = min([run.worst[0], *(c.distance for c in run.clearances)])
    return Compared(
        name,
        VARIANTS[name][0],
        found,
        sum(found.details["seconds"].values()),
        found.details["iterations"],
        found.details["cost"],
        int(run.violating.sum()),
        max(0.0, -shortest),
    )


def table(rows: Sequence[Compared]) -> list[str]:
    """The comparison as text, a line each."""
    lines = [
        f"{'guarantee':<15}{'status':<12}{'time':>8}{'iterations':>12}{'cost':>10}{'violating':>18}{'worst depth':>13}"
    ]
    for row in rows:
        members = row.plan.replayed.members if row.plan.replayed else 0
        share = f"{row.violating} ({100 * row.violating / max(members, 1):.1f} %)"
        lines.append(
            f"{row.name:<15}{row.plan.status:<12}{row.seconds:>6.2f} s{row.iterations:>12}{row.cost:>10.4f}"
            f"{share:>18}{row.depth:>11.4f} m"
        )
    return lines
