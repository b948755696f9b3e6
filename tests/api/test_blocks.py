"""Replay on several workers: the summary of one process, bit for bit, whatever is killed on the way."""

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
from typing import Any

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.api.blocks import Draw, replay_on, units
from ensemble_ctrl.core.jobs import Outcome, outcomes
from ensemble_ctrl.problem.evaluation.streaming import division
from ensemble_ctrl.problem.evaluation.summary import Summary
from tests.cli.tools import COMMAND, environment
from tests.paths import CONFIGS, ROOT

MEMBERS, SIZE = 2500, 1000


@pytest.fixture(scope="module")
def plan() -> ec.Plan:
    """Controls that some members of the five obstacles' fleet fail with."""
    problem = ec.load(CONFIGS / "five_obstacles.yaml")
    controls = np.column_stack([np.full(problem.steps, 0.55), 0.05 * np.sin(np.arange(problem.steps) / 9)])
    return ec.Plan(problem, controls, "infeasible")


@pytest.fixture(scope="module")
def alone(plan: ec.Plan) -> Summary:
    """The summary of this process."""
    return plan.replay_blocks(MEMBERS, block=SIZE)


@pytest.mark.parametrize("workers", [1, 2])
def test_the_summary_is_that_of_one_process(plan: ec.Plan, alone: Summary, workers: int) -> None:
    found = plan.replay_blocks(MEMBERS, block=SIZE, cluster=f"local:{workers}")
    assert found.to_json() == alone.to_json()
    assert found.members == MEMBERS


def test_blocks_are_those_of_more_members(plan: ec.Plan) -> None:
    few, more = (
        list(units(plan.problem, plan.controls, Draw(2500, size=1000))),
        list(units(plan.problem, plan.controls, Draw(4000, size=1000))),
    )
    assert [unit.key for unit in few[:2]] == [unit.key for unit in more[:2]]
    assert few[2].key != more[2].key
    assert few[0].content is few[1].content
    assert [unit.name for unit in few] == ["members 0 to 1000", "members 1000 to 2000", "members 2000 to 2500"]
    other = replace(plan, controls=plan.controls * 0.5)
    assert next(units(other.problem, other.controls, Draw(2500, size=1000))).key != few[0].key


def test_kept_blocks_are_not_run_again(plan: ec.Plan, alone: Summary, tmp_path: Path) -> None:
    kept = tmp_path / "blocks.jsonl"
    seen: list[Summary] = []
    plan.replay_blocks(2000, block=SIZE, checkpoint=kept, cluster="local:1")
    before = kept.read_text()

    def watch(so_far: Summary) -> bool:
        seen.append(so_far)
        return False

    found = plan.replay_blocks(MEMBERS, block=SIZE, checkpoint=kept, cluster="local:1", watch=watch)
    assert found == alone
    assert kept.read_text().startswith(before)
    assert len(kept.read_text().splitlines()) == 3
    assert len(seen) == 3


def test_a_watch_ends_it(plan: ec.Plan) -> None:
    found = plan.replay_blocks(10**9, block=SIZE, cluster="local:1", watch=lambda _: True)
    assert found.members == SIZE


def test_a_stop_ends_it_with_a_block_at_least(plan: ec.Plan) -> None:
    found = replay_on(plan.problem, plan.controls, Draw(10**9, size=SIZE), "local:1", stop=lambda: True)
    assert found.members == SIZE


def test_a_block_that_is_lost_is_named(plan: ec.Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    def with_one_lost(*given: Any) -> Iterator[Outcome]:
        for outcome in outcomes(*given):
            yield outcome if outcome.unit.index != 1 else Outcome(outcome.unit, killed="ended by SIGKILL")

    monkeypatch.setattr("ensemble_ctrl.api.blocks.outcomes", with_one_lost)
    words = r"members 1000 to 2000: left out after it ended 3 workers \(ended by SIGKILL\)"
    with pytest.raises(ec.EnsembleError, match=words):
        plan.replay_blocks(MEMBERS, block=SIZE, cluster="local:1")
    lost: list[Outcome] = []
    found = replay_on(plan.problem, plan.controls, Draw(MEMBERS, size=SIZE), "local:1", left_out=lost.append)
    assert found.members == 1500
    assert [outcome.unit.index for outcome in lost] == [1]


@pytest.mark.slow
def test_a_million_members_survive_the_end_of_client_and_workers(plan: ec.Plan, tmp_path: Path) -> None:
    """The client is killed, run again, and then loses a worker: each block is in the result once."""
    plan.save(tmp_path / "plan.npz")
    command = [*COMMAND, "replay", "plan.npz", "--members", "1e6", "--block", "2e4", "--json"]
    command += ["--cluster", "local:2", "--checkpoint", "blocks.jsonl"]
    options: dict[str, Any] = {"cwd": tmp_path, "env": environment(), "text": True}
    options |= {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, **options) as client:
        until(tmp_path / "blocks.jsonl", 5)
        client.kill()
    first = (tmp_path / "blocks.jsonl").read_text().splitlines()
    assert 5 <= len(first) < 50
    with subprocess.Popen(command, **options) as client:
        until(tmp_path / "blocks.jsonl", len(first) + 5)
        victim = children_of(client.pid)[0]
        os.kill(victim, signal.SIGKILL)
        out, _ = client.communicate(timeout=300)
    data = json.loads(out)
    assert data["members"] == data["wanted_members"] == 1_000_000
    assert data["left_out"] == []
    found = Summary.from_data({name: data[name] for name in plan.replay_blocks(10).as_data()})
    assert found.to_json() == plan.replay_blocks(1_000_000, block=20_000).to_json()
    assert len((tmp_path / "blocks.jsonl").read_text().splitlines()) == 50


def until(path: Path, lines: int) -> None:
    """Wait for a file to have so many lines."""
    deadline = time.monotonic() + 120
    while not path.exists() or path.read_text().count("\n") < lines:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def children_of(parent: int) -> list[int]:
    """Processes that a process has started."""
    listed = Path(f"/proc/{parent}/task/{parent}/children").read_text()
    return [int(number) for number in listed.split()]


@pytest.mark.slow
def test_the_summary_is_the_same_on_dask_when_a_worker_of_it_is_killed(plan: ec.Plan, tmp_path: Path) -> None:
    distributed: Any = pytest.importorskip("distributed")
    options = {"processes": True, "dashboard_address": None, "silence_logs": 50, "host": "127.0.0.1"}
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, **options) as cluster:
        pids = [worker.process.pid for worker in (nanny.process for nanny in cluster.workers.values())]
        killed: list[int] = []

        def watch(so_far: Summary) -> bool:
            if so_far.members >= 200_000 and not killed:
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)
            return False

        found = plan.replay_blocks(1_000_000, block=20_000, cluster=cluster.scheduler_address, watch=watch)
    assert killed
    assert found.to_json() == plan.replay_blocks(1_000_000, block=20_000).to_json()


DIVIDED = """
import sys, resource
import ensemble_ctrl as ec
from ensemble_ctrl.api.blocks import Draw, units
from ensemble_ctrl.core.jobs import Cluster, outcomes
if __name__ == "__main__":
    plan = ec.Plan.load(sys.argv[1])
    found = outcomes(units(plan.problem, plan.controls, Draw(400_000)), Cluster(workers=1))
    print(max(outcome.memory for outcome in found))
"""


def test_a_worker_takes_less_than_a_gigabyte(plan: ec.Plan, tmp_path: Path) -> None:
    plan.save(tmp_path / "plan.npz")
    command = [sys.executable, "-c", DIVIDED, str(tmp_path / "plan.npz")]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment(), cwd=ROOT)
    assert 20e6 < int(done.stdout) < 400e6
    assert len(list(division(400_000))) == 4
