"""``ensemble-plan report``: judge a saved plan again and write its page, with what it tolerates if that is wanted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ensemble_ctrl.api.results import write_report
from ensemble_ctrl.cli.root import UsageError
from ensemble_ctrl.cli.run import REPORT
from ensemble_ctrl.cli.show import judged
from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.cli.tolerance import tell_kind
from ensemble_ctrl.files import planfile
from ensemble_ctrl.files.folder import require_free
from ensemble_ctrl.planning.tolerance import measure
from ensemble_ctrl.report.tolerances import MEASURED


def report_plan(
    path: Path, output: Path | None, overwrite: bool = False, tolerance: bool = False, attacked: bool = False
) -> None:
    """Write the page and say where it is: in the results folder, or beside a plan that is a file of its own."""
    if attacked and not tolerance:
        raise UsageError("--attack: expected with --tolerance, which it adds to")
    file = planfile.path_of(path)
    page = output or (file.with_name(REPORT) if file.name == "plan.npz" else file.with_suffix(".html"))
    require_free(page, overwrite)
    plan = judged(path)
    if tolerance:
        found = measure(plan.problem, plan.controls, attacked=attacked, tell=tell_kind)
        plan = replace(plan, details={**plan.details, MEASURED: found})
    say(str(write_report(plan, page, file.parent)))
