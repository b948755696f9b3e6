"""Units of work: each once, whatever ends, and the same on processes and on Dask."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ensemble_ctrl.core.errors import ProblemError, UnsupportedError, WorkerError
from ensemble_ctrl.core.jobs import Checkpoint, Cluster, Content, Outcome, Unit, outcomes
from ensemble_ctrl.core.jobs import versions as versions_module
from ensemble_ctrl.core.jobs.child import Child
from ensemble_ctrl.core.jobs.versions import versions
from tests.core.job_kinds import KIND
from tests.paths import SOURCES
from tests.processes import children

LOCAL = Cluster(workers=2)


def units(function: str, count: int, folder: Path | str = "") -> list[Unit]:
    content = Content(f"{function} {folder}")
    return [Unit(KIND, content, i, f"unit {i}") for i in range(count)]


def done(function: str, count: int, folder: Path | str = "", cluster: Cluster = LOCAL) -> list[Outcome]:
    """The outcomes, by index."""
    return sorted(outcomes(units(function, count, folder), cluster), key=lambda outcome: outcome.unit.index)


@pytest.fixture(scope="module")
def dask() -> Iterator[Cluster]:
    """A Dask cluster of two worker processes on this machine."""
    distributed: Any = pytest.importorskip("distributed")
    options = {"processes": True, "dashboard_address": None, "silence_logs": 50, "host": "127.0.0.1"}
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, **options) as cluster:
        yield Cluster.parse(cluster.scheduler_address)


@pytest.fixture(params=["processes", pytest.param("dask", marks=pytest.mark.slow)])
def cluster(request: pytest.FixtureRequest) -> Cluster:
    """Both places where units are computed."""
    found = LOCAL if request.param == "processes" else request.getfixturevalue("dask")
    assert isinstance(found, Cluster)
    return found


def test_every_unit_has_one_result(cluster: Cluster) -> None:
    assert [outcome.result for outcome in done("square", 7, cluster=cluster)] == [i**2 for i in range(7)]


def test_what_a_library_prints_is_no_answer() -> None:
    assert [outcome.result for outcome in done("printed", 3)] == [0, 1, 2]


def test_an_exception_is_the_outcome_of_its_unit_alone(cluster: Cluster) -> None:
    found = done("third_raises", 5, cluster=cluster)
    assert [outcome.failure for outcome in found if outcome.failure] == ["unit 3: ValueError: three"]
    assert [outcome.result for outcome in found] == [0, 1, 2, None, 4]


def test_a_unit_that_kills_three_workers_is_named_and_left_out(cluster: Cluster, tmp_path: Path) -> None:
    found = done("third_is_deadly", 6, tmp_path, cluster)
    assert [outcome.result for outcome in found] == [0, 1, 2, None, 4, 5]
    assert found[3].failure == "unit 3: left out after it ended 3 workers (ended by SIGKILL)"
    assert (tmp_path / "tried").read_text() == "xxx"


def test_a_unit_is_given_up_at_its_limit(cluster: Cluster, tmp_path: Path) -> None:
    began = time.monotonic()
    limited = [replace(unit, limit=2.0) for unit in units("second_is_slow", 4, tmp_path)]
    found = sorted(outcomes(limited, cluster), key=lambda outcome: outcome.unit.index)
    assert [outcome.failure for outcome in found] == ["", "unit 1: given up after 2 s", "", ""]
    assert [outcome.late for outcome in found] == [False, True, False, False]
    assert (tmp_path / "unit1").read_text() == "x", "it is not tried again"
    assert time.monotonic() - began < 40


def test_units_alone_share_no_process(cluster: Cluster, tmp_path: Path) -> None:
    alone = [replace(unit, alone=True) for unit in units("child_of", 4)]
    assert len({outcome.result["pid"] for outcome in outcomes(alone, cluster)}) == 4


def test_units_of_workers_that_end_are_computed_by_others(cluster: Cluster, tmp_path: Path) -> None:
    found = done("deadly_once", 7, tmp_path, cluster)
    assert [outcome.result for outcome in found] == list(range(7))
    assert len(list(tmp_path.iterdir())) == 3


def test_a_result_that_is_not_strict_json_is_refused() -> None:
    (found,) = done("undefined", 1)
    assert found.error.startswith("ValueError: Out of range float")


@pytest.mark.slow
def test_a_worker_that_grew_is_replaced() -> None:
    first, second, third = done("large", 3, cluster=Cluster(workers=1))
    assert first.memory > 1 << 30 > second.memory > 0
    assert first.result != second.result == third.result


def test_no_worker_is_left_and_none_is_begun_for_nothing() -> None:
    before = children()
    running = outcomes(units("square", 50), LOCAL)
    next(running)
    assert 0 < len(children() - before) <= 2
    running.close()  # type: ignore[attr-defined]
    assert children() == before
    assert list(outcomes([], LOCAL)) == []


def test_units_are_taken_as_workers_get_free() -> None:
    taken: list[int] = []

    def many() -> Iterator[Unit]:
        for unit in units("square", 10_000):
            taken.append(unit.index)
            yield unit

    running = outcomes(many(), LOCAL)
    for _ in range(5):
        next(running)
    assert len(taken) <= 5 + 2 * LOCAL.workers


def test_a_stop_gives_up_what_is_at_work(cluster: Cluster, tmp_path: Path) -> None:
    began = time.monotonic()
    found: list[int] = []
    for outcome in outcomes(units("slow", 20, tmp_path), cluster, stop=lambda: bool(found)):
        found.append(outcome.result)
    assert found == [0]
    assert time.monotonic() - began < 30
    deadline = time.monotonic() + 10
    while any(alive(path) for path in tmp_path.iterdir()) and time.monotonic() < deadline:
        time.sleep(0.05)
    busy = [path for path in tmp_path.iterdir() if alive(path)]
    assert len(busy) <= (0 if cluster is LOCAL else 1)  # an idle one may wait for more on Dask


def alive(path: Path) -> bool:
    """Whether a worker that left its number is running."""
    stat = Path("/proc") / path.name.removeprefix("pid") / "stat"
    try:
        return stat.read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_workers_of_other_versions_are_refused() -> None:
    child = Child({**versions(), "numpy": "0.9"})
    try:
        with pytest.raises(WorkerError, match=r"other versions.*numpy .*, here 0\.9"):
            child.finished()
    finally:
        child.end()


@pytest.mark.slow
def test_workers_of_other_versions_are_refused_on_dask(dask: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ensemble_ctrl.core.jobs.dask.versions", lambda: {**versions(), "code": "another"})
    with pytest.raises(WorkerError, match="other versions, so that its results may differ: code"):
        list(outcomes(units("square", 2), dask))


@pytest.mark.slow
def test_without_a_scheduler() -> None:
    with pytest.raises(WorkerError, match=r"tcp://127\.0\.0\.1:9: expected a Dask scheduler, found none"):
        list(outcomes(units("square", 2), Cluster.parse("tcp://127.0.0.1:9")))


SCHEDULER = """
import time
from distributed import LocalCluster
if __name__ == "__main__":
    options = {"processes": True, "dashboard_address": None, "silence_logs": 50, "host": "127.0.0.1"}
    with LocalCluster(n_workers=2, threads_per_worker=1, **options) as cluster:
        print(cluster.scheduler_address, flush=True)
        time.sleep(600)
"""


@pytest.mark.slow
def test_a_scheduler_that_ends_loses_nothing(dask: Cluster, tmp_path: Path) -> None:
    path, marks = tmp_path / "rows.jsonl", tmp_path / "marks"
    marks.mkdir()
    (tmp_path / "cluster.py").write_text(SCHEDULER)
    command = [sys.executable, str(tmp_path / "cluster.py")]
    environment = {**os.environ, "PYTHONPATH": f"{SOURCES}:{SOURCES.parent}"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=environment, start_new_session=True
    ) as running:
        assert running.stdout is not None
        there = Cluster.parse(running.stdout.readline().strip())
        with pytest.raises(WorkerError, match="scheduler does not answer any more"), Checkpoint(path) as kept:  # noqa: PT012
            for count, _ in enumerate(outcomes(units("counted", 500, marks), there, kept)):
                if count == 20:
                    os.killpg(running.pid, signal.SIGKILL)
    before = len(path.read_text().splitlines())
    assert 20 < before < 500
    with Checkpoint(path) as kept:
        found = [outcome.result for outcome in outcomes(units("counted", 60, marks), dask, kept)]
    assert sorted(found) == list(range(60))


@pytest.mark.parametrize("text", ["local:0", "local:x", "remote", "tcp://host", "local:2:3", "http://host:1"])
def test_an_address_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ProblemError, match=r"cluster: expected local, local:N or tcp://HOST:PORT, got"):
        Cluster.parse(text)


def test_where_pipes_can_not_be_waited_for_it_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ensemble_ctrl.core.jobs.cluster.os", SimpleNamespace(name="nt"))
    with pytest.raises(UnsupportedError, match="expected Linux or macOS, got Windows"):
        list(outcomes(units("square", 1), LOCAL))


def test_a_checkpoint_spares_what_is_done(tmp_path: Path) -> None:
    path, marks = tmp_path / "rows.jsonl", tmp_path / "marks"
    marks.mkdir()
    with Checkpoint(path) as kept:
        first = [outcome.result for outcome in outcomes(units("counted", 4, marks), LOCAL, kept)]
    with path.open("ab") as file:
        file.write(b'{"unit": "half a li')
    with Checkpoint(path) as kept:
        second = [outcome.result for outcome in outcomes(units("counted", 6, marks), LOCAL, kept)]
        assert [kept.result(unit) for unit in units("counted", 6, marks)] == list(range(6))
    assert sorted(first) == list(range(4))
    assert sorted(second) == list(range(6))
    assert {mark.read_text() for mark in marks.iterdir()} == {"x"}
    assert len([json.loads(line) for line in path.read_text().splitlines()]) == 6


def test_a_checkpoint_of_other_versions_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (unit,) = units("square", 1)
    with Checkpoint(tmp_path / "rows.jsonl") as kept:
        kept.add(Outcome(unit, 7))
        assert unit in kept
    monkeypatch.setattr("ensemble_ctrl.core.jobs.checkpoint.versions", lambda: {"code": "another"})
    with Checkpoint(tmp_path / "rows.jsonl") as kept:
        assert (unit in kept, kept.stale) == (False, 1)


def test_a_checkpoint_belongs_to_one_process(tmp_path: Path) -> None:
    with Checkpoint(tmp_path / "rows.jsonl"), pytest.raises(WorkerError, match="another process is writing"):
        Checkpoint(tmp_path / "rows.jsonl")


def test_a_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "rows.jsonl").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="rows"):
        Checkpoint(tmp_path / "rows.jsonl")
    assert not (tmp_path / "elsewhere").exists()


def test_the_code_is_part_of_the_versions(tmp_path: Path) -> None:
    assert versions()["code"] == versions_module._code() != ""


CLIENT = """
import sys
from pathlib import Path
from ensemble_ctrl.core.jobs import Checkpoint, Cluster, Content, Unit, outcomes
content = Content(f"counted {sys.argv[1]}/marks")
with Checkpoint(Path(sys.argv[1], "rows.jsonl")) as kept:
    for _ in outcomes([Unit("tests.core.job_kinds", content, i) for i in range(100)], Cluster.parse(sys.argv[2]), kept):
        print("done", flush=True)
"""


def test_a_client_that_is_killed_loses_nothing(tmp_path: Path) -> None:
    marks = tmp_path / "marks"
    marks.mkdir()
    command = [sys.executable, "-c", CLIENT, str(tmp_path), "local:2"]
    environment = {**os.environ, "PYTHONPATH": f"{SOURCES}:{SOURCES.parent}"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as running:
        assert running.stdout is not None
        for _ in range(20):
            running.stdout.readline()
        running.send_signal(signal.SIGKILL)
    before = len((tmp_path / "rows.jsonl").read_text().splitlines())
    assert 20 <= before < 100
    subprocess.run(command, check=True, capture_output=True, env=environment)
    counts = [len(mark.read_text()) for mark in marks.iterdir()]
    assert len(counts) == 100
    assert sum(counts) <= 100 + 2  # those that were at work when the client was killed
    lines = (tmp_path / "rows.jsonl").read_text().splitlines()
    assert sorted(json.loads(line)["result"] for line in lines) == list(range(100))
