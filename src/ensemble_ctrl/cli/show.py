"""``ensemble-plan show``: replay and certify a saved plan and print its summary again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ensemble_ctrl.api.plans import Plan, checked
from ensemble_ctrl.api.results import summary, to_json
from ensemble_ctrl.cli.run import exit_code
from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.core.errors import RunawayError
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.report import summary_lines


def show_plan(path: Path, members: int | None, substeps: int | None, as_json: bool) -> int:
    """Print the summary; returns the exit code that the plan deserves."""
    found = judged(path, members, substeps)
    code = exit_code(found)
    if as_json:
        say(to_json({**summary(found), "exit_code": code, "folder": str(path)}))
    else:
        say("\n".join(summary_lines(found, str(path))))
    return code


def judged(path: Path, members: int | None = None, substeps: int | None = None) -> Plan:
    """A saved plan with a fresh replay, and a fresh certificate if its problem asks for one."""
    saved = Plan.load(path)
    verify = saved.problem.verify
    wanted = replace(
        verify,
        members=verify.members if members is None else members,
        substeps=verify.substeps if substeps is None else substeps,
    )
    problem = saved.problem.with_(verify=wanted)
    certificate = saved.certify() if verify.certificate else None
    try:
        run = replay(problem, saved.controls)
    except RunawayError:  # said as what it violates
        return replace(checked(saved, None, certificate), status="infeasible")
    return checked(saved, run, certificate)
