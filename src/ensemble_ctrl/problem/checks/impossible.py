"""Tasks that no plan can do, with the reason: too far, too soon, in two places at one time, or behind a closed wall."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ensemble_ctrl.problem.checks.apart import apart_findings
from ensemble_ctrl.problem.checks.finding import Finding
from ensemble_ctrl.problem.checks.presence import Presence, alternatives
from ensemble_ctrl.problem.checks.reach import reach_findings
from ensemble_ctrl.problem.checks.task import are_known
from ensemble_ctrl.problem.checks.walls import wall_findings

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem


def impossible_findings(problem: Problem) -> Iterator[Finding]:
    """Why no way of doing the task can be driven; nothing if some way may be.

    Notes
    -----
    *Guarantee*: where there is a finding, no plan does the task for every member. The converse does not hold.
    """
    if not are_known(problem):
        return  # an unknown name is a finding of its own
    found: dict[tuple[str, int | None], Finding] = {}
    for way in alternatives(problem):
        reasons = list(_reasons(problem, way))
        if not reasons:
            return
        for reason in reasons:
            found.setdefault((reason.message, reason.offset), reason)
    yield from found.values()


def _reasons(problem: Problem, way: Sequence[Presence]) -> Iterator[Finding]:
    """Why one way of doing the task can't be driven; walls are looked for where nothing simpler is found."""
    simple = [*reach_findings(problem, way), *apart_findings(problem, way)]
    yield from simple or wall_findings(problem, way)


__all__ = ["impossible_findings"]
