"""``ensemble-plan paper``: the paper's experiments as published, beside this package's own plans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from ensemble_ctrl.api.paper import Form, Reproduced, Robot, as_data, experiment, reproduce, table
from ensemble_ctrl.api.results import SCHEMA, to_json
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.progress import Progress, stoppable
from ensemble_ctrl.cli.root import UsageError
from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.storage import put_file
from ensemble_ctrl.files.folder import ResultsFolder

Name = TypeVar("Name", bound=str)


@dataclass(frozen=True)
class PaperRun:
    """What the command was asked for."""

    experiments: tuple[str, ...]
    robots: tuple[Robot, ...]
    forms: tuple[Form, ...]
    members: int
    bonmin_limit: float
    output: Path | None
    json: bool
    quiet: bool
    plots: bool
    overwrite: bool
    study: bool


def known(option: str, given: Sequence[str] | None, names: Sequence[Name]) -> tuple[Name, ...]:
    """What an option was given, all of it if nothing.

    Raises
    ------
    UsageError
        For a name that is none of those.
    """
    wrong = next((name for name in given or () if name not in names), None)
    if wrong is not None:
        raise UsageError(f"{option}: expected one of {', '.join(names)}, got {wrong!r}")
    return tuple(one for name in given or names for one in names if one == name)


def run_paper(asked: PaperRun) -> int:
    """Plan the experiments, print the table, and write it with a figure of each experiment."""
    progress = Progress(asked.quiet)
    for name in asked.experiments:
        for robot in asked.robots:
            experiment(name, robot)
    folder = ResultsFolder(asked.output, "paper", asked.overwrite)
    try:
        with stoppable(progress, folder.discard, "stopping"):
            if asked.study:
                return run_study(asked, progress, folder)
            rows = reproduce(asked.experiments, asked.robots, asked.members, asked.bonmin_limit, asked.forms, progress)
            if progress.stop_signal is not None:
                return codes.INTERRUPTED
            data = {"schema": SCHEMA, "rows": [as_data(row) for row in rows]}
            put_file(folder.working / "paper.json", to_json(data, indent=1) + "\n")
            if asked.plots:
                draw_experiments(rows, folder.working)
            placed = folder.commit()
    finally:
        folder.discard()
    progress.finish()
    say(to_json(data) if asked.json else "\n".join([*table(rows), f"written to {placed}"]), str(placed))
    return codes.OK


def run_study(asked: PaperRun, progress: Progress, folder: ResultsFolder) -> int:
    """Study the order, print what was found, and write it with a figure."""
    from ensemble_ctrl.api.paper_study import study, study_data

    found = study(members=asked.members, progress=progress)
    if progress.stop_signal is not None:
        return codes.INTERRUPTED
    rows = study_data(found)
    put_file(folder.working / "study.json", to_json({"schema": SCHEMA, "rows": rows}, indent=1) + "\n")
    if asked.plots:
        from ensemble_ctrl.report.canvas import save
        from ensemble_ctrl.report.orders import draw_orders

        save(draw_orders(rows), folder.working / "study.png")
    placed = folder.commit()
    progress.finish()
    lines = [*study_table(rows), f"written to {placed}"]
    say(to_json({"schema": SCHEMA, "rows": rows}) if asked.json else "\n".join(lines), str(placed))
    return codes.OK


def study_table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The study as text: a line for each order."""
    lines = [f"{'order':<7}{'published: cost':>17}{'violating':>11}{'ours: cost':>13}{'violating':>11}{'reach':>8}"]
    reach = {row["order"]: row["value"] for row in rows if row["kind"] == "reach"}
    plans = {(row["form"], row["order"]): row for row in rows if row["kind"] == "plan"}
    for order, value in reach.items():
        cells = []
        for form, width in (("published", 17), ("ours", 13)):
            row = plans.get((form, order))
            share = "-" if row is None else f"{100 * row['violating'] / row['members']:.1f} %"
            cells.append(f"{'-' if row is None else format(row['cost'], '.4f'):>{width}}{share:>11}")
        lines.append(f"{order:<7}{''.join(cells)}{value:>8.1f}")
    return lines


def draw_experiments(rows: Sequence[Reproduced], folder: Path) -> None:
    """A figure of each experiment, with a panel for each robot, published and ours."""
    from ensemble_ctrl.report.canvas import save
    from ensemble_ctrl.report.figures import draw_panels

    for name in dict.fromkeys(row.experiment for row in rows):
        same = [row for row in rows if row.experiment == name]
        own = [row for row in same if row.form != "linear"] or same
        panels = [(_title(row), experiment(name, row.robot), row.controls) for row in own]
        save(draw_panels(panels), folder / f"{name}.png")


def _title(row: Reproduced) -> str:
    """The heading of one panel."""
    if row.status == "no solution":
        return f"{row.robot}, {row.form}: no solution"
    share = 100 * row.violating / max(row.members, 1)
    return f"{row.robot}, {row.form}: {share:.0f} % violate"
