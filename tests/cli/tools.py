"""A small problem, and ways to run the command: within this process, or as one of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.paths import SOURCES

SMALL = """\
# One obstacle on a short way.
name: small
fleet:
  model: unicycle
  start: {position: [0, 0], heading: 0 deg}
horizon: {duration: 4 s, steps: 20}
regions:
  goal: {box: [[1.5, 2.5], [-0.5, 0.5]]}
obstacles:
  block: {box: [[0.8, 1.2], [-0.3, 0.1]]}
task: "F[3, 4] in(goal) and G avoid(block)"
verify: {members: 200}
"""

WALLED = """\
# The goal is walled in on every side, by walls that touch: no proof that there is no plan.
name: walled
fleet:
  model: unicycle
  start: {position: [0, 0], heading: 0 deg}
horizon: {duration: 4 s, steps: 20}
regions:
  goal: {box: [[2, 2.6], [-0.3, 0.3]]}
obstacles:
  west: {box: [[1.5, 1.8], [-0.9, 0.9]]}
  east: {box: [[2.8, 3.1], [-0.9, 0.9]]}
  south: {box: [[1.8, 2.8], [-0.9, -0.6]]}
  north: {box: [[1.8, 2.8], [0.6, 0.9]]}
task: "F[3, 4] in(goal) and G avoid(obstacles)"
verify: {members: 200}
"""

FAST = ("--set", "horizon.steps=10", "--set", "solve.routes=1")
"""Options with which the second soon has no plan."""

COMMAND = [sys.executable, "-m", "ensemble_ctrl.cli"]


@dataclass(frozen=True)
class Outcome:
    """How a run of the command ended."""

    code: int
    out: str
    err: str

    @property
    def data(self) -> dict[str, Any]:
        """The one JSON object on stdout."""
        assert self.out.count("\n") == 1, self.out
        found = json.loads(self.out)
        assert isinstance(found, dict)
        return found


def environment(**changes: str) -> dict[str, str]:
    """The environment here, with the package's sources, and changed."""
    plain = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "COLUMNS", "TERM")}
    return {**plain, "PYTHONPATH": str(SOURCES), "COLUMNS": "80", **changes}


def process(*arguments: str, cwd: Path, stdin: str | None = None, **changes: str) -> Outcome:
    """Run the command as a process of its own."""
    done = subprocess.run(
        [*COMMAND, *arguments],
        cwd=cwd,
        input=stdin,
        capture_output=True,
        text=True,
        env=environment(**changes),
        timeout=60,
    )
    return Outcome(done.returncode, done.stdout, done.stderr)


def left(folder: Path) -> list[str]:
    """Everything in a folder, hidden or not."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
