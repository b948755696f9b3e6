"""A time that is to be as short as possible, where that makes no sense."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ensemble_ctrl.problem.checks.finding import Finding

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem


def minimum_time_findings(problem: Problem) -> Iterator[Finding]:
    """A passage of nothing, or two times at once."""
    name, path = problem.objective.earliest, ("objective", "earliest")
    if name is None:
        return
    if name not in problem.regions:
        known = ", ".join(problem.regions) or "there is none"
        yield Finding(path, f"expected the name of a region ({known}), got {name!r}")
    elif problem.least_duration is not None:
        message = "expected a fixed horizon.duration with the earliest passage of a region, got a free one"
        yield Finding(path, message, "ask for one or the other")
