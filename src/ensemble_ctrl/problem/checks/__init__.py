"""Checks of a problem as a whole: what each part can't see by itself.

A finding names the key of the problem file that is wrong, so that `ensemble_ctrl.files.config` can show its line.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ensemble_ctrl.constraints.stl.rewrite import ALL_OBSTACLES
from ensemble_ctrl.core.errors import ProblemError, first_of
from ensemble_ctrl.problem.checks.bodies import body_findings
from ensemble_ctrl.problem.checks.coverage import coverage, coverage_findings, coverage_text
from ensemble_ctrl.problem.checks.finding import Finding, Path, Severity, path_text
from ensemble_ctrl.problem.checks.impossible import impossible_findings
from ensemble_ctrl.problem.checks.minimum_time import minimum_time_findings
from ensemble_ctrl.problem.checks.motion import motion_findings
from ensemble_ctrl.problem.checks.numbers import (
    MAX_MEMBERS,
    MAX_SAMPLES,
    MAX_SEED,
    MAX_STEPS,
    name_findings,
    number_findings,
)
from ensemble_ctrl.problem.checks.places import area_findings, start_findings
from ensemble_ctrl.problem.checks.signals import signal_findings
from ensemble_ctrl.problem.checks.starts import findings_of_starts
from ensemble_ctrl.problem.checks.support import dimension_findings, support_findings
from ensemble_ctrl.problem.checks.target import place_findings, target_findings
from ensemble_ctrl.problem.checks.task import STATES, task_findings, unused_findings
from ensemble_ctrl.problem.checks.uncertainty import terrain_findings, uncertainty_findings
from ensemble_ctrl.problem.checks.work import building_seconds, spoken, work_findings
from ensemble_ctrl.problem.checks.zones import zone_findings

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem

__all__ = [
    "ALL_OBSTACLES",
    "MAX_MEMBERS",
    "MAX_SAMPLES",
    "MAX_SEED",
    "MAX_STEPS",
    "STATES",
    "Finding",
    "Path",
    "Severity",
    "building_seconds",
    "coverage",
    "coverage_text",
    "findings",
    "path_text",
    "require_sound",
    "spoken",
]


def require_sound(problem: Problem) -> None:
    """Refuse a problem with errors.

    Raises
    ------
    ProblemError
        With the first errors in its message, and all as `Finding` in its attribute ``findings``.
    """
    errors = tuple(finding for finding in findings(problem) if finding.severity == "error")
    if errors:
        refusal = ProblemError("\n".join(first_of(errors)))
        refusal.findings = errors
        raise refusal


def findings(problem: Problem) -> tuple[Finding, ...]:
    """Everything wrong or odd in a problem; where a number makes no sense, only such numbers are reported.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    tuple of Finding

    Notes
    -----
    *Guarantee*: every error is certain: no plan can satisfy the task and keep clear of the obstacles (at all
    times, whether or not the task mentions them). The converse does not hold.
    """
    return findings_of_starts(problem, _findings) if problem.fleet.starts else _findings(problem)


def _findings(problem: Problem) -> tuple[Finding, ...]:
    """Everything wrong or odd in a problem with one start."""
    numbers = (*number_findings(problem), *name_findings(problem))
    unsupported = () if numbers else tuple(support_findings(problem))
    numbers += unsupported or tuple(target_findings(problem))
    if numbers:
        return numbers
    if shapes := (*dimension_findings(problem),):
        return (*shapes, *task_findings(problem))
    checks = (
        area_findings,
        task_findings,
        signal_findings,
        zone_findings,
        minimum_time_findings,
        motion_findings,
        start_findings,
        body_findings,
        place_findings,
        uncertainty_findings,
        terrain_findings,
        impossible_findings,
        unused_findings,
        coverage_findings,
        work_findings,
    )
    return tuple(finding for check in checks for finding in check(problem))
