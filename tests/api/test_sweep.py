"""Sweeps: a row for each problem, in order, the same for any number of workers, resumed after a kill."""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
import signal
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

import ensemble_ctrl as ec
from ensemble_ctrl.api.planned import FACTS, TIMES
from ensemble_ctrl.api.sweep import Sweep
from tests.api.test_many import SMALL
from tests.cli.tools import COMMAND, environment

AXES = """
sweep:
  horizon.steps: [8, 10]
  fleet.radius: {from: 0 cm, to: 20 cm, step: 20 cm}
"""


@dataclass(frozen=True)
class Swept:
    """A small problem with four rows, swept once."""

    config: Path
    kept: Path
    found: Sweep


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Swept:
    """On two workers."""
    folder = tmp_path_factory.mktemp("swept")
    path = folder / "small.yaml"
    path.write_text(SMALL + AXES, encoding="utf-8")
    return Swept(path, folder / "rows.jsonl", ec.sweep(path, cluster="local:2", checkpoint=folder / "rows.jsonl"))


def facts(found: Sweep) -> list[dict[str, Any]]:
    """The rows without what differs from run to run."""
    return [{name: value for name, value in row.items() if name not in TIMES} for row in found.rows]


def test_rows_are_in_order_and_those_of_one_process(swept: Swept) -> None:
    found = swept.found
    assert found.axes == ("horizon.steps", "fleet.radius")
    assert [(row["horizon.steps"], row["fleet.radius"]) for row in found.rows] == [
        (steps, radius) for steps in (8, 10) for radius in ("0 cm", "20 cm")
    ]
    assert found.count("proven", "yes") == 4
    plan = ec.plan(ec.load(swept.config, ["horizon.steps=10", "fleet.radius=0.2"]))
    assert plan.certificate is not None
    last = found.rows[-1]
    assert (last["cost"], last["robustness"]) == (plan.details["cost"], plan.certificate.robustness)


@pytest.mark.slow
def test_rows_are_the_same_for_any_number_of_workers(swept: Swept) -> None:
    assert facts(ec.sweep(swept.config, cluster="local:1")) == facts(swept.found)


@pytest.mark.slow
def test_rows_are_the_same_on_dask(swept: Swept) -> None:
    distributed: Any = pytest.importorskip("distributed")
    options = {"processes": True, "dashboard_address": None, "silence_logs": 50, "host": "127.0.0.1"}
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, **options) as cluster:
        there = ec.sweep(swept.config, cluster=cluster.scheduler_address)
    assert facts(there) == facts(swept.found)


def test_values_that_only_together_can_not_be_used_are_a_row(tmp_path: Path) -> None:
    path = tmp_path / "small.yaml"
    path.write_text(SMALL, encoding="utf-8")
    axes = ["horizon.duration=[4 s, 2 s]", "task=['F[3, 4] in(goal)', 'F[1, 2] in(goal)']"]
    found = ec.sweep(path, axes=axes, cluster="local:2")
    assert [row["status"] for row in found.rows] == ["planned", "planned", "refused", "planned"]
    assert found.rows[2]["message"].startswith("task: ")


def test_an_axis_that_can_not_be_used_at_all_is_refused_before_any_work(swept: Swept) -> None:
    with pytest.raises(ec.ConfigError, match="did you mean 'radius'"):
        ec.sweep(swept.config, axes=["fleet.radiuss=[1, 2]"])


def test_many_files_have_an_axis_of_their_names(swept: Swept, tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    other.write_text(SMALL, encoding="utf-8")
    found = ec.sweep([other, swept.config], axes=["horizon.steps=[8]"], checkpoint=swept.kept, cluster="local:2")
    assert found.axes == ("file", "horizon.steps", "fleet.radius")
    assert [row["file"] for row in found.rows] == [str(other)] + [str(swept.config)] * 2
    assert found.rows[0]["fleet.radius"] is None
    assert list(found.rows[0])[:3] == list(found.axes)


def test_map_files_are_an_axis(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    for name, low in (("near", -0.3), ("far", -0.1)):
        ring = [(0.8, low), (1.2, low), (1.2, 0.2), (0.8, 0.2), (0.8, low)]
        text = ", ".join(f"{x} {y}" for x, y in ring)
        (tmp_path / "maps" / f"{name}.wkt").write_text(f"POLYGON (({text}))")
    path = tmp_path / "small.yaml"
    path.write_text(SMALL.replace("task: F[3, 4] in(goal)", TASK), encoding="utf-8")
    found = ec.sweep(path, axes=["obstacles.wall={files: maps/*.wkt}"], cluster="local:2")
    assert [row["obstacles.wall"] for row in found.rows] == ["maps/far.wkt", "maps/near.wkt"]
    assert [row["proven"] for row in found.rows] == ["yes", "yes"]
    plan = ec.plan(ec.load(path, ["obstacles.wall.file=maps/near.wkt", "obstacles.wall.box="]))
    assert plan.certificate is not None
    assert found.rows[1]["clearance"] == plan.certificate.clearance
    assert found.rows[0]["clearance"] != found.rows[1]["clearance"]


TASK = """obstacles: {wall: {box: [[0.8, 1.2], [-0.2, 0.2]]}}
task: F[3, 4] in(goal) and G avoid(wall)"""


def test_an_added_value_spares_the_rows_that_are_there(swept: Swept, tmp_path: Path) -> None:
    kept = Path(shutil.copy(swept.kept, tmp_path / "rows.jsonl"))
    before = len(kept.read_text().splitlines())
    more = ec.sweep(swept.config, axes=["horizon.steps=[8, 9, 10]"], checkpoint=kept, cluster="local:2")
    assert len(kept.read_text().splitlines()) == before + 2
    assert [row for row in more.rows if row["horizon.steps"] != 9] == list(swept.found.rows)


def test_tables_hold_the_rows(tmp_path: Path) -> None:
    rows = [
        dict.fromkeys(FACTS) | {"range": [0.9, 1.1], "cost": 0.1, "found": True, "status": "planned"},
        dict.fromkeys(FACTS) | {"range": [0.8, 1.2], "cost": 1 / 3, "found": False, "status": "limit"},
    ]
    found = Sweep("made", ("range",), tuple(rows), 2)
    read = list(csv.DictReader(io.StringIO(found.to_csv())))
    assert [float(row["cost"]) for row in read] == [0.1, 1 / 3]
    assert [json.loads(row["range"]) for row in read] == [[0.9, 1.1], [0.8, 1.2]]
    assert {row["clearance"] for row in read} == {""}
    assert read[0]["found"] == "true"
    pd = pytest.importorskip("pandas")
    again = pd.read_parquet(found.write(tmp_path / "sweep.parquet"))
    assert again["cost"].tolist() == [0.1, 1 / 3]
    assert again["range"][1] == "[0.8, 1.2]"
    assert list(found.to_dataframe()["found"]) == [True, False]
    with pytest.raises(ec.ProblemError, match=r"ends in \.csv or \.parquet, got 'sweep.txt'"):
        found.write(tmp_path / "sweep.txt")


def drawn(found: Sweep, kind: str | None = None, value: str = "cost") -> Any:
    return found.plot(value, kind, Figure().subplots())


def made(proven: list[str], costs: list[float | None]) -> Sweep:
    """A sweep over two axes, two by two."""
    keys = [(a, b) for a in (1, 2) for b in ("0 cm", "5 cm")]
    rows = [{"a": a, "b": b, "proven": p, "cost": c} for (a, b), p, c in zip(keys, proven, costs, strict=True)]
    return Sweep("made", ("a", "b"), tuple(rows), 4)


def test_a_heat_map_has_each_value_in_its_place_and_crosses_what_is_not_proven() -> None:
    ax = drawn(made(["yes", "yes", "no", "yes"], [1.0, 2.0, 3.0, None]))
    values = ax.images[0].get_array()
    assert values[:, 0].tolist() == [1.0, 2.0]
    assert values[0, 1] == 3.0
    assert bool(values.mask[1, 1])
    assert [(line.get_xdata()[0], line.get_ydata()[0]) for line in ax.lines] == [(1, 0)]


def test_curves_are_one_for_each_value_of_the_second_axis() -> None:
    ax = drawn(made(["yes"] * 3 + ["no"], [1.0, 2.0, 3.0, 4.0]), "curves")
    curves = [line for line in ax.lines if line.get_linestyle() == "-"]
    assert [line.get_ydata().tolist() for line in curves] == [[1.0, 3.0], [2.0, 4.0]]
    assert [line.get_label() for line in curves] == ["b 0 cm", "b 5 cm"]
    crosses = [line.get_xdata().tolist() for line in ax.lines if line.get_marker() == "x"]
    assert crosses == [[], [2.0]]


def test_axes_have_units() -> None:
    rows = tuple({"horizon.duration": t, "fleet.radius": r, "proven": "yes", "cost": t} for t in (1, 2) for r in (0, 1))
    found = Sweep("made", ("horizon.duration", "fleet.radius"), rows, 4)
    assert drawn(found, "curves", "cost").get_xlabel() == "horizon.duration [s]"
    assert drawn(found).get_ylabel() == "fleet.radius [m]"
    assert drawn(made(["yes"] * 4, [1.0] * 4)).get_ylabel() == "b", "its ticks have units"


def test_a_picture_that_can_not_be_drawn_says_why() -> None:
    with pytest.raises(ec.ProblemError, match="value: expected a column with numbers, got 'status'"):
        drawn(made(["yes"] * 4, [1.0] * 4), value="status")
    with pytest.raises(ec.ProblemError, match="kind: expected curves, or heatmap of two axes"):
        drawn(Sweep("one", ("a",), ({"a": 1, "cost": 1.0}, {"a": 2, "cost": 2.0}), 2), "heatmap")


def test_a_sweep_that_is_killed_goes_on_where_it_was(tmp_path: Path) -> None:
    config, folder = tmp_path / "small.yaml", tmp_path / "out"
    config.write_text(SMALL, encoding="utf-8")
    seeds = ["--axis", "solve.seed={seeds: 12}", "-o", str(folder), "--no-plots", "--cluster", "local:2"]
    command = [*COMMAND, "sweep", str(config), *seeds]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment()) as running:
        assert running.stderr is not None
        while "rows" not in running.stderr.readline():
            continue
        os.kill(running.pid, signal.SIGKILL)
    before = (folder / "rows.jsonl").read_text().splitlines()
    assert 0 < len(before) < 12
    done = subprocess.run(command, capture_output=True, text=True, env=environment(), check=True)
    after = (folder / "rows.jsonl").read_text().splitlines()
    assert after[: len(before)] == before
    assert len(after) == 12
    assert "small: 12 rows over solve.seed" in done.stdout
    rows = list(csv.DictReader((folder / "sweep.csv").open()))
    assert [int(row["solve.seed"]) for row in rows] == list(range(12))
    assert {float(row["cost"]) for row in rows} == {ec.plan(ec.load(config)).details["cost"]}
