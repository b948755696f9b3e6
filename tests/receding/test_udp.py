"""The example with a robot in a process of its own: whatever the load, it ends in words and leaves a whole log."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import ensemble_ctrl

EXAMPLE = Path(__file__).parents[2] / "examples" / "udp_robot.py"


def test_the_robot_over_udp(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    done = subprocess.run(
        [sys.executable, str(EXAMPLE), "--log", str(log)],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "PYTHONPATH": str(Path(ensemble_ctrl.__file__).parents[1]), "OMP_NUM_THREADS": "1"},
    )
    assert (done.returncode, done.stderr) == (0, "")
    ending = done.stdout.splitlines()[-1].partition(":")[0]
    assert ending in ("success", "finished", "failed", "stopped")
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert [lines[0]["kind"], lines[-1]["kind"], lines[-1]["ending"]] == ["start", "end", ending]
    assert any(line["kind"] == "step" and line["measurement"] for line in lines)
