"""``ensemble-plan compare``: the same problem under each guarantee and method, in one table and one picture."""

from __future__ import annotations

from pathlib import Path

from ensemble_ctrl.api.comparison import Compared, compare, left_out, table
from ensemble_ctrl.api.results import SCHEMA, to_json
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.progress import Progress, stoppable
from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.core.storage import put_file
from ensemble_ctrl.files.config import read
from ensemble_ctrl.files.folder import ResultsFolder


def compare_guarantees(
    config: str, output: Path | None, overrides: list[str], as_json: bool, quiet: bool, plots: bool, overwrite: bool
) -> int:
    """Plan once for each row, print the table, and write it with the picture."""
    progress = Progress(quiet)
    problem = read(config, overrides).problem
    folder = ResultsFolder(output, f"{problem.name}-compare", overwrite)
    try:
        with stoppable(progress, folder.discard):
            rows = compare(problem, progress=progress)
            if progress.stop_signal is not None:
                return codes.INTERRUPTED
            without = left_out(problem)
            data = {
                "schema": SCHEMA,
                "name": problem.name,
                "rows": [_as_data(row) for row in rows],
                "left_out": without,
            }
            text = to_json(data, indent=2)
            put_file(folder.working / "compare.json", text + "\n")
            if plots:
                from ensemble_ctrl.report.canvas import save
                from ensemble_ctrl.report.figures import draw_comparison

                figure = draw_comparison(problem, [(_title(row), row.plan.controls) for row in rows])
                save(figure, folder.working / "compare.png")
            placed = folder.commit()
    finally:
        folder.discard()
    progress.finish()
    notes = [f"{name:<15}left out: {why}" for name, why in without.items()]
    say(text if as_json else "\n".join([problem.name, *table(rows), *notes, f"written to {placed}"]), str(placed))
    return codes.OK


def _title(row: Compared) -> str:
    """The heading of one panel."""
    return f"{row.name}: {row.violating} of {row.plan.replayed.members if row.plan.replayed else 0} violate"


def _as_data(row: Compared) -> dict[str, object]:
    """One row as plain data."""
    return {
        "name": row.name,
        "guarantee": row.guarantee,
        "method": row.plan.problem.solve.method,
        "status": row.plan.status,
        "seconds": row.seconds,
        "iterations": row.iterations,
        "cost": row.cost,
        "members": 0 if row.plan.replayed is None else row.plan.replayed.members,
        "violating": row.violating,
        "worst_depth": row.depth,
    }
