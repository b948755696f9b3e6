"""``ensemble-plan sweep``: the folder, the summary, the exit codes, and Ctrl-C."""

from __future__ import annotations

import csv
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest

from ensemble_ctrl.api.sweep import run
from ensemble_ctrl.cli import sweep as module
from tests.processes import children

from .conftest import Command
from .tools import COMMAND, environment

FAST = ("--set", "horizon.steps=10", "--set", "verify.members=20", "--cluster", "local:2")


def test_a_table_and_pictures(command: Command, place: Path) -> None:
    done = command("sweep", "small.yaml", *FAST, "--axis", "fleet.radius=[0, 0.1]", "--axis", "solve.seed={seeds: 2}")
    assert done.code == 0
    head, *rows = done.out.splitlines()
    assert head == "small: 4 rows over fleet.radius, solve.seed"
    assert rows[-1] == "written to plans/small-sweep: sweep.csv, heatmap.png, curves.png"
    folder = place / "plans/small-sweep"
    assert sorted(path.name for path in folder.iterdir()) == ["curves.png", "heatmap.png", "rows.jsonl", "sweep.csv"]
    with (folder / "sweep.csv").open() as file:
        assert [row["fleet.radius"] for row in csv.DictReader(file)] == ["0", "0", "0.1", "0.1"]
    again = command("sweep", "small.yaml", *FAST, "--axis", "fleet.radius=[0.1]", "--json", "--format", "parquet")
    assert (again.code, again.data["total"], again.data["statuses"]) == (0, 1, {"planned": 1})
    assert (folder / "sweep.parquet").exists()
    assert len((folder / "rows.jsonl").read_text().splitlines()) == 4


def test_a_folder_of_something_else_is_left_alone(command: Command, place: Path) -> None:
    (place / "mine").mkdir()
    (place / "mine" / "notes.txt").write_text("notes")
    done = command("sweep", "small.yaml", "-o", "mine")
    assert done.code == 2
    assert done.err == ("error: mine: expected an empty folder or that of an earlier sweep; choose another with -o\n")
    assert [path.name for path in (place / "mine").iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--format", "xlsx"], "error: --format: expected csv or parquet, got 'xlsx'"),
        (["--plot", "costs"], "error: --plot: expected one of status"),
        (["--cluster", "everywhere"], "error: --cluster: expected local, local:N or tcp://HOST:PORT, got 'everywhere'"),
        (["--axis", "solve.seed=1"], "--axis solve.seed=1: error: expected a list or a section of values"),
    ],
)
def test_wrong_usage_is_said_before_anything_is_made(
    command: Command, place: Path, arguments: list[str], message: str
) -> None:
    done = command("sweep", "small.yaml", *arguments)
    assert done.code == 2
    assert message in done.err
    assert not (place / "plans").exists()


def test_why_rows_are_refused_is_said(command: Command, place: Path) -> None:
    axes = ("--axis", "horizon.duration=[4, 0.5]", "--axis", "fleet.radius=[0, 0.1]")
    done = command("sweep", "small.yaml", *FAST, *axes, "--no-plots")
    assert done.code == 0
    refused = [line for line in done.out.splitlines() if line.startswith("  refused ")]
    assert len(refused) == 1
    assert "F[3, 4]" in refused[0] or "horizon" in refused[0] or "task" in refused[0]


def test_a_row_that_is_left_out_is_named(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    lost = {"status": "killed", "message": "row 2: left out after it ended 3 workers (ended by SIGKILL)"}
    real = run

    def with_one_lost(*given: Any, **options: Any) -> Any:
        found = real(*given, **options)
        return type(found)(found.name, found.axes, (found.rows[0], found.rows[1] | lost), 2)

    monkeypatch.setattr(module, "run", with_one_lost)
    done = command("sweep", "small.yaml", *FAST, "--axis", "solve.seed={seeds: 2}", "-q")
    assert done.code == 1
    assert "status     1 planned, 1 killed" in done.out
    assert done.err == "error: row 2: left out after it ended 3 workers (ended by SIGKILL)\n"


def test_ctrl_c_keeps_the_finished_rows(place: Path) -> None:
    options = [*FAST, "--axis", "solve.seed={seeds: 500}", "-o", "out", "--no-plots"]
    before = children()
    with subprocess.Popen(
        [*COMMAND, "sweep", "small.yaml", *options],
        cwd=place,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
    ) as running:
        assert running.stderr is not None
        while "rows" not in running.stderr.readline():
            continue
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=60)
    assert running.returncode == 130
    assert "stopping; finished rows are kept, run it again to go on" in err
    assert "Traceback" not in err
    kept = len((place / "out/rows.jsonl").read_text().splitlines())
    assert out.startswith(f"small: {kept} of 500 rows over solve.seed")
    assert (place / "out/sweep.csv").read_text().count("\n") == kept + 1
    assert children() == before
