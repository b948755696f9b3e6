"""``replay``: any number of members of a saved plan, ended whenever one likes."""

from __future__ import annotations

import json
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.problem.evaluation.summary import Summary

from .conftest import Command
from .tools import COMMAND, environment


def test_a_saved_plan_is_replayed_on_many_members(command: Command, results: Path) -> None:
    outcome = command("replay", "results", "--members", "3e4", "--block", "1e4", "-o", "replay.json")
    assert outcome.code == 0
    assert outcome.out.startswith("small: no member of 30000 violates\n")
    assert "20 steps, 1 sample per step" in outcome.out
    data = json.loads((results.parent / "replay.json").read_text())
    plan = ec.Plan.load(results)
    found = plan.replay_blocks(30_000, block=10_000)
    assert found == Summary.from_data({name: data[name] for name in found.as_data()})
    assert (data["mean"], data["wanted_members"], data["exit_code"]) == (found.mean, 30_000, 0)
    assert f"{found.worst[0].robustness:.6f} m (traction" in outcome.out
    assert f"{found.clearances[0].distance:.6f} m to block at t = " in outcome.out


def test_members_that_violate_end_with_code_4(command: Command, results: Path) -> None:
    plan = ec.Plan.load(results)
    ec.Plan(plan.problem, plan.controls * 0.5, "planned").save(results / "plan.npz")
    outcome = command("replay", "results", "--members", "1000", "--json", "--substeps", "3", "--seed", "7")
    assert outcome.code == outcome.data["exit_code"] == 4
    assert (outcome.data["violating"], outcome.data["substeps"]) == (1000, 3)
    assert command("replay", "results", "--members", "1000").out.startswith("small: 1000 of 1000 members VIOLATE\n")


@pytest.mark.parametrize("text", ["1.5", "0", "-3", "many", "1e99", "nan"])
def test_a_number_of_members_that_is_none(command: Command, results: Path, text: str) -> None:
    for option in ("--members", "--block"):
        outcome = command("replay", "results", f"{option}={text}")
        assert outcome.code == 2
        assert f"{option}: expected a whole number from 1 on, such as 1000000 or 1e6, got '{text}'" in outcome.err


def test_a_file_that_is_there_is_kept(command: Command, results: Path) -> None:
    (results.parent / "mine.json").write_text("mine")
    outcome = command("replay", "results", "--members", "10", "-o", "mine.json")
    assert outcome.code != 0
    assert "--overwrite" in outcome.err
    assert (results.parent / "mine.json").read_text() == "mine"
    assert command("replay", "results", "--members", "10", "-o", "mine.json", "--overwrite").code == 0
    assert json.loads((results.parent / "mine.json").read_text())["members"] == 10


def test_a_signal_keeps_the_members_that_were_run(results: Path) -> None:
    arguments = ["replay", "results", "--members", "1e12", "--block", "1e3", "--json"]
    with subprocess.Popen(
        [*COMMAND, *arguments],
        cwd=results.parent,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
        start_new_session=True,
    ) as running:
        assert running.stderr is not None
        assert "members, 0 violate" in running.stderr.readline()
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=60)
    assert running.returncode == 130
    assert "stopping after this block; the members run so far are kept" in err
    data = json.loads(out)
    plan = ec.Plan.load(results)
    assert 0 < data["members"] < 10**12
    assert data["members"] % 1000 == 0
    again = plan.replay_blocks(data["members"], block=1000)
    assert again.worst[0].robustness == data["worst"][0][0]
    np.testing.assert_array_equal(again.histograms[0].as_data()["counts"], data["histograms"][0]["counts"])
