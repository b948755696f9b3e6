"""``ensemble-plan export``: a saved plan as a file for other programs."""

from __future__ import annotations

from pathlib import Path

from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.cli.verify import read_plan
from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.files.export import FORMATS, export


def export_plan(plan: Path, form: str | None, output: Path | None, members: int | None, overwrite: bool) -> None:
    """Print the plan in a format, or write it.

    Raises
    ------
    EnsembleError
        If the plan, the format or the place is not what was wanted.
    """
    form = output.suffix.removeprefix(".") if form is None and output is not None else form
    if form not in FORMATS:
        got = "none" if form is None else repr(form)
        raise EnsembleError(f"--to: expected one of {', '.join(FORMATS)}, got {got}")
    if form == "rosbag" and output is None:
        raise EnsembleError("--to rosbag: a bag is a folder; say where with -o FOLDER")
    found = read_plan(plan)
    certificate = found.certify() if form == "json" else None
    text = export(found.problem, found.controls, certificate, form, output, members, overwrite)
    say(f"wrote {output}" if text is None else text.rstrip("\n"))
