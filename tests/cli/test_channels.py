"""``channels``: the fewest groups of a fleet, a verified plan in a folder for each."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from .conftest import Command

PUSHED = """\
name: pushed
fleet:
  model: double_integrator
  parameters: {mass: {range: [1.0, 1.7]}}
  start: {position: [0, 0]}
horizon: {duration: 4 s, steps: 16}
regions: {goal: {box: [[1.7, 2.3], [-0.5, 0.5]]}}
task: G[3.5, 4] in(goal)
verify: {members: 100}
"""
"""Masses differ by more than the goal's 2.3 / 1.7."""
QUICK = ("--tolerance", "0.05", "-q")


@pytest.fixture
def pushed(place: Path) -> Path:
    """The folder of the channels of the problem above."""
    (place / "pushed.yaml").write_text(PUSHED)
    return place


def test_every_channel_has_a_plan_in_its_own_folder_that_verify_proves(command: Command, pushed: Path) -> None:
    done = command("channels", "pushed.yaml", *QUICK)
    assert done.code == 0, done.err
    assert done.out.startswith("pushed: 2 broadcast channels, each certified for its group\n")
    folder = pushed / "plans" / "pushed-channels"
    data = json.loads((folder / "channels.json").read_text())
    assert [row["folder"] for row in data["channels"]] == ["channel-1", "channel-2"]
    ranges = [row["ranges"]["mass"] for row in data["channels"]]
    assert ranges[0][0] == 1.0
    assert ranges[0][1] == ranges[1][0]
    assert ranges[1][1] == 1.7
    for row in data["channels"]:
        verified = command("verify", str(folder / row["folder"]), "--members", "50", "--json")
        assert verified.code == 0, verified.err
        assert verified.data["certificate"]["ranges"] == row["ranges"]
    colours = {tuple(c) for c in np.asarray(Image.open(folder / "channels.png").convert("RGB")).reshape(-1, 3).tolist()}
    assert {(0, 114, 178), (213, 94, 0)} <= colours  # those of the first two channels
    again = command("channels", "pushed.yaml", *QUICK, "-o", str(folder), "--overwrite", "--no-plots", "--json")
    assert again.code == 0, again.err
    assert len(again.data["channels"]) == 2
    assert not (folder / "channels.png").exists()


def test_what_is_said_of_fewer_channels(command: Command, pushed: Path) -> None:
    one = command("channels", "pushed.yaml", "--set", "fleet.parameters.mass.range=[1.0, 1.05]", *QUICK, "--no-plots")
    assert one.code == 0, one.err
    assert "  bound      one channel is the fewest\n" in one.out
    assert one.out.rstrip().endswith("plans/pushed-channels/channel-1")
    none = command("channels", "pushed.yaml", "--set", "fleet.parameters.mass.range=[1.0, 1.05]", "--clearance", "9",
        "--set", "obstacles.wall.box=[[4, 5], [4, 5]]", *QUICK)  # fmt: skip
    assert none.code == 3, none.err
    assert "could not be covered" in none.out
    assert "bound" not in none.out


def test_too_few_channels_leave_nothing_written(command: Command, pushed: Path) -> None:
    done = command("channels", "pushed.yaml", "--at-most", "1", *QUICK, "--json")
    assert done.code == 3
    assert done.data["channels"] == []
    assert done.data["missed"]["mass"][1] == 1.7
    assert done.data["folder"] is None
    assert not (pushed / "plans").exists()
    assert command("channels", "pushed.yaml", "--at-most", "0").code == 2
    said = command("channels", "pushed.yaml", "--at-most", "1", *QUICK)
    assert "no channel was left of --at-most 1" in said.out


def test_folders_with_anything_else_are_not_replaced(command: Command, pushed: Path) -> None:
    folder = pushed / "mine"
    (folder / "channel-1").mkdir(parents=True)
    (folder / "channels.json").write_text("{}")
    (folder / "channel-1" / "diary.txt").write_text("kept")
    done = command("channels", "pushed.yaml", *QUICK, "-o", "mine", "--overwrite")
    assert done.code == 2
    assert "channel-1, which is not a result" in done.err
    assert (folder / "channel-1" / "diary.txt").read_text() == "kept"
