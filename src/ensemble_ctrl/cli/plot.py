"""``ensemble-plan plot``: pictures of a saved plan for a paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ensemble_ctrl.api.planning import with_baseline
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.files import planfile
from ensemble_ctrl.files.config.errors import suggestion
from ensemble_ctrl.files.folder import require_free
from ensemble_ctrl.report.canvas import FORMATS
from ensemble_ctrl.report.plot import KINDS, write_plot


class PlotError(EnsembleError):
    """The pictures that were asked for can't be drawn or written."""


def plot_plan(
    path: Path, kinds: Sequence[str], output: Path | None, format: str | None, overwrite: bool = False
) -> None:
    """Write a file for each kind, all kinds without any, and say where they are."""
    for kind in kinds:
        if kind not in KINDS:
            hint = suggestion(kind, KINDS)
            raise PlotError(f"{kind}: expected kinds among {', '.join(KINDS)}" + (f"; {hint}" if hint else ""))
    plan = Plan.load(path)
    wanted = list(dict.fromkeys(kinds)) or list(KINDS)
    files = _files(path, wanted, output, format)
    for file in files.values():
        require_free(file, overwrite)
    if any(KINDS[kind].proof for kind in wanted):
        plan = replace(plan, certificate=plan.certify(each=True))
    if "trajectories" in wanted and plan.problem.report.baseline:
        plan = with_baseline(plan)
    for kind, file in files.items():
        say(str(write_plot(plan, kind, file, file.suffix[1:])))


def _files(path: Path, kinds: Sequence[str], output: Path | None, format: str | None) -> dict[str, Path]:
    """Where each kind goes: one kind to `output`, several into it as a folder, and without it beside the plan."""
    ending = "" if output is None else output.suffix[1:].lower()
    kind_of_file = format or (ending if ending in FORMATS else "png")
    if kind_of_file not in FORMATS:
        raise PlotError(f"--format: expected one of {', '.join(FORMATS)}, got {format}")
    if output is not None and len(kinds) == 1 and not output.is_dir():
        if ending and ending not in FORMATS:
            raise PlotError(f"{output}: expected a name that ends in .png, .pdf or .svg")
        if ending and ending != kind_of_file:
            raise PlotError(f"{output}: expected a name that ends in .{kind_of_file}, or another --format")
        return {kinds[0]: output if ending else output.with_name(f"{output.name}.{kind_of_file}")}
    folder = planfile.path_of(path).parent if output is None else output
    if output is not None and not output.is_dir():
        if ending in FORMATS:
            raise PlotError(f"{output}: expected a folder for {len(kinds)} pictures, got a file's name")
        output.mkdir(parents=True)
    return {kind: folder / f"figure-{kind}.{kind_of_file}" for kind in kinds}
