"""``ensemble-plan sweep``: many problems, a row of facts for each, and pictures of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ensemble_ctrl.api.planned import FACTS
from ensemble_ctrl.api.results import SCHEMA, to_json
from ensemble_ctrl.api.sweep import Sweep, run
from ensemble_ctrl.api.sweep.rows import FORMATS
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.progress import Progress, stoppable
from ensemble_ctrl.cli.root import UsageError, naming
from ensemble_ctrl.cli.streams import complain, say
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError, first_of
from ensemble_ctrl.core.jobs import Cluster
from ensemble_ctrl.files.config import Variants
from ensemble_ctrl.files.folder import FolderError

CHECKPOINT = "rows.jsonl"
"""The file of finished rows in the results folder."""
PICTURES = {"heatmap": "heatmap.png", "curves": "curves.png"}
"""Kinds of pictures and their files."""
PROMISE = "stopping; finished rows are kept, run it again to go on"
"""What the first signal does."""
KEPT = frozenset({CHECKPOINT, *(f"sweep.{ending}" for ending in FORMATS), *PICTURES.values()})
"""What a sweep writes."""


@dataclass(frozen=True)
class SweepRun:
    """The options of one sweep, as given."""

    configs: tuple[str, ...]
    output: Path | None
    overrides: tuple[str, ...]
    axes: tuple[str, ...]
    cluster: str
    format: str
    value: str
    json: bool
    quiet: bool
    plots: bool
    overwrite: bool


def run_sweep(options: SweepRun) -> int:
    """Plan every row, write the table and the pictures, and print a summary; returns the exit code."""
    if options.format not in FORMATS:
        raise UsageError(f"--format: expected {' or '.join(FORMATS)}, got {options.format!r}")
    if options.value not in FACTS:
        raise UsageError(f"--plot: expected one of {', '.join(FACTS)}, got {options.value!r}")
    progress = Progress(options.quiet)
    with naming(cluster="--cluster"):
        cluster = Cluster.parse(options.cluster)
    files = {name: Variants(name, options.overrides, options.axes) for name in options.configs}
    folder = _folder(next(iter(files.values())).base.problem.name, options)
    with stoppable(progress, lambda: None, PROMISE):
        found = run(files, cluster, folder / CHECKPOINT, _Told(progress))
        found.write(folder / f"sweep.{options.format}")
        pictures = _draw(found, folder, options.value) if options.plots and progress.stop_signal is None else []
    progress.wipe()
    code = _code(found, progress)
    _print(found, folder, pictures, options, code)
    return code


class _Told:
    """Shows how far a sweep is; returns whether to stop."""

    def __init__(self, progress: Progress) -> None:
        self.progress, self.found, self.proven = progress, 0, 0

    def __call__(self, row: dict[str, Any], done: int, total: int) -> bool:
        self.found += bool(row["found"])
        self.proven += row["proven"] == "yes"
        if row["status"] in ("killed", "error"):
            self.progress.note(f"warning: {row['message']}")
        self.progress.passing(f"{done} of {total} rows, {self.found} plans found, {self.proven} proven")
        return self.progress.stop_signal is not None


def _folder(name: str, options: SweepRun) -> Path:
    """The results folder: a new one, an empty one, or that of an earlier sweep."""
    folder = options.output or Path("plans") / f"{name}-sweep"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = {path.name for path in folder.iterdir()}
        if there and CHECKPOINT not in there:
            raise FolderError(f"{folder}: expected an empty folder or that of an earlier sweep; choose another with -o")
        for known in KEPT & there if options.overwrite else ():
            (folder / known).unlink()
    except OSError as error:
        raise FolderError(f"{folder}: can't write results here ({error.strerror or error})") from None
    return folder


def _draw(found: Sweep, folder: Path, value: str) -> list[str]:
    """Draw what can be drawn of these axes; returns the names of the files."""
    from ensemble_ctrl.report.canvas import new_figure, save
    from ensemble_ctrl.report.sweeps import SIZE

    drawn = []
    for kind, name in PICTURES.items():
        figure = new_figure(SIZE)
        figure.set_layout_engine("compressed")
        try:
            found.plot(value, kind, figure.subplots())
        except ProblemError:  # no numbers, or too few axes
            continue
        save(figure, folder / name)
        drawn.append(name)
    return drawn


def _code(found: Sweep, progress: Progress) -> int:
    """Whether every row has its facts."""
    if len(found.rows) < found.total:
        return codes.of_signal(progress.stop_signal)
    return codes.INTERNAL if found.count("status", "killed") + found.count("status", "error") else codes.OK


def _print(found: Sweep, folder: Path, pictures: list[str], options: SweepRun, code: int) -> None:
    """The summary on stdout; what was left out on stderr."""
    lost = [row["message"] for row in found.rows if row["status"] in ("killed", "error")]
    counts = {name: found.count("status", name) for name in dict.fromkeys(row["status"] for row in found.rows)}
    if options.json:
        facts = {"schema": SCHEMA, "name": found.name, "exit_code": code, "total": found.total, "statuses": counts}
        say(to_json({**facts, "axes": list(found.axes), "rows": list(found.rows), "folder": str(folder)}), str(folder))
    else:
        say("\n".join(_lines(found, counts, [f"sweep.{options.format}", *pictures], folder)), str(folder))
    for line in first_of(lost):
        complain(f"error: {line}")


def _lines(found: Sweep, counts: dict[str, int], files: list[str], folder: Path) -> list[str]:
    """The summary's lines."""
    some = f"{len(found.rows)} of {found.total}" if len(found.rows) < found.total else str(found.total)
    statuses = ", ".join(f"{count} {name}" for name, count in counts.items())
    seconds = sum(row["seconds"] or 0.0 for row in found.rows)
    refused = [row["message"] for row in found.rows if row["status"] == "refused"]
    return [
        f"{found.name}: {some} row{'s' * (found.total != 1)} over {', '.join(found.axes)}",
        f"  status     {statuses}",
        *(f"  refused    {line}" for line in first_of(list(dict.fromkeys(refused)))),
        f"  proven     {found.count('proven', 'yes')} of {found.count('found', True)} plans found",
        f"  effort     {seconds:.1f} s of planning",
        f"written to {folder}: {', '.join(files)}",
    ]
