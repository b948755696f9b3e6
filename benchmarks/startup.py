"""Time what has to be there at once: the help, the check of a file, the import; each the best of some fresh processes.

    python benchmarks/startup.py [runs]

Prints, for each, the least wall time and the least processor time over `runs` (default 10), in seconds.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

FIVE = str(Path(__file__).parents[1] / "configs" / "five_obstacles.yaml")
COMMAND = [sys.executable, "-m", "ensemble_ctrl.cli"]
LIBRARIES = "import numpy, typer, yaml; from pydantic import BaseModel"
CASES = {
    "import ensemble_ctrl": [sys.executable, "-c", "import ensemble_ctrl"],
    "import numpy, pydantic, typer, yaml": [sys.executable, "-c", LIBRARIES],
    "ensemble-plan --help": [*COMMAND, "--help"],
    "ensemble-plan run --help": [*COMMAND, "run", "--help"],
    "ensemble-plan check": [*COMMAND, "check", "-q", FIVE],
    "ensemble-plan schema": [*COMMAND, "schema"],
}
"""What is timed, and how it is run."""


def once(command: list[str]) -> tuple[float, float]:
    """Wall time and processor time of one process."""
    began, before = time.perf_counter(), os.times()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return time.perf_counter() - began, used


def main() -> None:
    """Time every case."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    for name, command in CASES.items():
        wall, used = map(min, zip(*(once(command) for _ in range(runs)), strict=True))
        print(f"{name:<38} {wall:.2f} s, processor {used:.2f} s")


if __name__ == "__main__":
    main()
