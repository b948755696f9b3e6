"""``ensemble-plan tolerance``: how much error of the model a saved plan tolerates."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.api.results import SCHEMA, to_json
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.root import UsageError
from ensemble_ctrl.cli.streams import complain, say
from ensemble_ctrl.files.folder import require_free
from ensemble_ctrl.planning.tolerance import measure
from ensemble_ctrl.report.canvas import FORMATS


def measure_plan(path: Path, attacked: bool, chart: Path | None, as_json: bool, quiet: bool, overwrite: bool) -> int:
    """Measure and print; returns 0, or 4 if the plan is not proven for robots that follow their model."""
    if chart is not None:
        if chart.suffix[1:].lower() not in FORMATS:
            raise UsageError(f"--chart: expected a name that ends in .png, .pdf or .svg, got {chart.name!r}")
        require_free(chart, overwrite)
    plan = Plan.load(path)
    found = measure(plan.problem, plan.controls, attacked=attacked, tell=None if quiet else tell_kind)
    code = codes.OK if any(one.bound > 0 for one in found.kinds) else codes.NOT_VERIFIED
    if chart is not None:
        from ensemble_ctrl.report.kinds.tolerance import write_tolerance

        write_tolerance(plan.problem.name, found, chart)
    if as_json:
        say(to_json({"schema": SCHEMA, "name": plan.problem.name, **asdict(found), "exit_code": code}))
    else:
        say(f"{plan.problem.name}: {found}")
    return code


def tell_kind(kind: str) -> None:
    """Say what is looked at."""
    complain(f"tolerance: {kind}")
