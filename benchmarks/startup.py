"""Time what has to be there at once: help, check of a file, import, first solve; each the best of some fresh processes.

    python benchmarks/startup.py [runs]

Prints, for each, the least wall time and the least processor time over `runs` (default 10), in seconds.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

FIVE = str(Path(__file__).parents[1] / "configs" / "five_obstacles.yaml")
COMMAND = [sys.executable, "-m", "ensemble_ctrl.cli"]
LIBRARIES = "import numpy, typer, yaml; from pydantic import BaseModel"
FIRST_SOLVE = "ensemble-plan, to the first solve"
ALL_LIBRARIES = "import casadi, numpy, pydantic, typer, yaml"
CASES = {
    "import ensemble_ctrl": [sys.executable, "-c", "import ensemble_ctrl"],
    "import numpy, pydantic, typer, yaml": [sys.executable, "-c", LIBRARIES],
    "ensemble-plan --help": [*COMMAND, "--help"],
    "ensemble-plan run --help": [*COMMAND, "run", "--help"],
    "ensemble-plan check": [*COMMAND, "check", "-q", FIVE],
    "ensemble-plan schema": [*COMMAND, "schema"],
    ALL_LIBRARIES: [sys.executable, "-c", f"import casadi; {LIBRARIES}"],
    FIRST_SOLVE: [sys.executable, "-c", "from startup import first_solve; first_solve()"],
}
"""What is timed, and how it is run."""


def first_solve() -> None:
    """The command for five_obstacles, up to the first word from its first solve."""
    from ensemble_ctrl.cli import main as command
    from ensemble_ctrl.cli.progress import Progress

    def told(self: Progress, phase: str, iteration: object) -> bool:
        if "solve" in phase:
            raise SystemExit
        return False

    Progress.__call__ = told  # type: ignore[method-assign]
    with tempfile.TemporaryDirectory() as folder:
        command([FIVE, "--no-plots", "-q", "-o", f"{folder}/plan"])


def started(runs: int) -> str:
    """How long the command takes to its first solve, and the import of the libraries that it needs, in turn."""
    times = [[once(CASES[name])[1] for name in (FIRST_SOLVE, ALL_LIBRARIES)] for _ in range(runs)]
    ours, libraries = (min(column) for column in zip(*times, strict=True))
    return (
        f"command to its first solve / import of its libraries: {ours:.2f} / {libraries:.2f} s = {ours / libraries:.2f}"
    )


def once(command: list[str]) -> tuple[float, float]:
    """Wall time and processor time of one process."""
    began, before = time.perf_counter(), os.times()
    # from here, so that a child finds this file
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=Path(__file__).parent)
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
