"""``ensemble-plan report``: judge a saved plan again and write its page."""

from __future__ import annotations

from pathlib import Path

from ensemble_ctrl.api.results import write_report
from ensemble_ctrl.cli.run import REPORT
from ensemble_ctrl.cli.show import judged
from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.files import planfile
from ensemble_ctrl.files.folder import require_free


def report_plan(path: Path, output: Path | None, overwrite: bool = False) -> None:
    """Write the page and say where it is: in the results folder, or beside a plan that is a file of its own."""
    file = planfile.path_of(path)
    page = output or (file.with_name(REPORT) if file.name == "plan.npz" else file.with_suffix(".html"))
    require_free(page, overwrite)
    say(str(write_report(judged(path), page, file.parent)))
