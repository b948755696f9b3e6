"""The example with a robot in a process of its own: whatever the load, it ends in words and leaves a whole log."""

from __future__ import annotations

import json
import os
import runpy
import socket
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

import ensemble_ctrl
from tests.paths import ROOT

EXAMPLE = ROOT / "examples" / "udp_robot.py"
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(ensemble_ctrl.__file__).parents[1]), "OMP_NUM_THREADS": "1"}


def test_the_robot_over_udp(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    done = subprocess.run(
        [sys.executable, str(EXAMPLE), "--log", str(log)],
        capture_output=True,
        text=True,
        timeout=300,
        env=ENVIRONMENT,
    )
    assert (done.returncode, done.stderr) == (0, "")
    ending = done.stdout.splitlines()[-1].partition(":")[0]
    assert ending in ("success", "finished", "failed", "stopped")
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert [lines[0]["kind"], lines[-1]["kind"], lines[-1]["ending"]] == ["start", "end", ending]
    assert any(line["kind"] == "step" and line["measurement"] for line in lines)


JUNK = [
    b"",
    b"\xff\xfe",
    b"null",
    b"[1, 2]",
    b"[" * 50_000,
    b'{"begin": 0}',
    b'{"begin": 0, "controls": 3}',
    b'{"begin": 0, "controls": [[1]]}',
    b'{"begin": 0, "controls": [["a", "b"]]}',
    b'{"begin": "0", "controls": [[1, 0]]}',
    b'{"begin": NaN, "controls": [[1, 0]]}',
    b'{"begin": 0, "controls": [[NaN, 0]]}',
    b'{"begin": 0, "controls": [[Infinity, 0]]}',
    b'{"begin": 0, "controls": [[1' + b"0" * 400 + b", 0]]}",
    b'{"begin": 0, "controls": [[true, 0]]}',
    b'{"begin": 1e9, "controls": [[1, 0]]}',
    b'{"begin": 0, "controls": []}',
    b'{"begin": 0, "controls": [[1, 0]], "more": 1}',
    b'{"quit": false}',
]


@pytest.fixture(scope="module")
def example() -> dict[str, Any]:
    return runpy.run_path(str(EXAMPLE))


@pytest.mark.parametrize("datagram", JUNK)
def test_what_is_no_command_is_passed_over(example: dict[str, Any], datagram: bytes) -> None:
    message = example["understood"](datagram)
    assert message is None or example["commands_in"](message, [-1, -1.5], [1, 1.5], 0.0, 5.0) is None


def test_commands_are_within_the_robots_bounds(example: dict[str, Any]) -> None:
    message = example["understood"](b'{"begin": 0.2, "controls": [[1e9, -7], [0.5, 0.5]]}')
    begin, controls = example["commands_in"](message, [-1, -1.5], [1, 1.5], 0.0, 5.0)
    assert begin == 0.2
    assert controls.tolist() == [[1.0, -1.5], [0.5, 0.5]]


def test_poses_are_checked(example: dict[str, Any]) -> None:
    pose_in = example["pose_in"]
    assert pose_in(b'{"time": 0.1, "x": 1, "y": 2, "heading": 0.5}').x == 1
    for junk in [*JUNK, b'{"time": 0.1, "x": NaN, "y": 2, "heading": 0.5}', b'{"time": 0.1, "x": 1, "y": 2}']:
        assert pose_in(junk) is None


def test_the_robot_survives_junk_and_strangers() -> None:
    """It moves as its peer says, no faster than its bounds, as long as it was told; nobody else is heard."""
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as peer:
        peer.bind(("127.0.0.1", 0))
        peer.settimeout(60)
        port = str(peer.getsockname()[1])
        with subprocess.Popen(
            [sys.executable, str(EXAMPLE), "--robot", port, "--traction", "1"], env=ENVIRONMENT, stderr=subprocess.PIPE
        ) as robot:
            _, address = peer.recvfrom(65_507)
            with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as stranger:
                for datagram in [b'{"quit": true}', b'{"begin": 0, "controls": [[-1, 0], [-1, 0]]}', *JUNK]:
                    stranger.sendto(datagram[:60_000], address)
            for datagram in JUNK:
                peer.sendto(datagram[:60_000], address)
            peer.sendto(b'{"hello": true}', address)
            peer.sendto(b'{"begin": 1, "controls": [[1e9, 0], [1e9, 0], [1e9, 0]]}', address)
            while json.loads(peer.recv(65_507))["time"] > 0:
                pass  # poses from before the hello
            pose = {"time": 0.0}
            while pose["time"] < 1.5:
                pose = json.loads(peer.recv(65_507))
            peer.sendto(b'{"quit": true}', address)
            _, err = robot.communicate(timeout=60)
    assert (robot.returncode, err) == (0, b"")
    assert pose["x"] == pytest.approx(0.3, abs=0.021)  # three commands of 0.1 s at its 1 m/s, seen to 1 cm
