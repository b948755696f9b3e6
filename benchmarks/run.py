"""Time the planner against both hand-written programs, each in fresh processes, in turn.

    python benchmarks/run.py [runs]

Prints, for each program, the median over `runs` (default 3) of the whole process's wall time and of the solve, and the
objective of `fleet_problem.judge`.  The tuned program starts from the planner's own first seed.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from fleet_problem import judge

import ensemble_ctrl as ec
from ensemble_ctrl.ocp.seeds import seeds

HERE = Path(__file__).parent
CONFIG = HERE.parent / "configs" / "five_obstacles.yaml"
Facts = dict[str, Any]


def main() -> None:
    """Run everything and print one table."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    with tempfile.TemporaryDirectory() as folder:
        guess = write_guess(Path(folder))
        programs = {
            "plain Opti": [sys.executable, str(HERE / "plain_opti.py")],
            "tuned, our seed": [sys.executable, str(HERE / "tuned_opti.py"), str(guess)],
            "ensemble-plan, order 8": command(folder, "8"),
            "ensemble-plan, order auto": command(folder, "auto"),
        }
        timed: dict[str, list[Facts]] = {name: [] for name in programs}
        for _ in range(runs):
            for name, arguments in programs.items():
                timed[name].append(run(arguments, Path(folder)))
    show(timed)


def write_guess(folder: Path) -> Path:
    """The planner's first seed on the full grid, as the tuned program reads it."""
    problem = ec.load(CONFIG)
    controls = seeds(problem, problem.steps, 1)[0].controls
    path = folder / "guess.npz"
    np.savez(path, v=controls[:, 0], omega=controls[:, 1])
    return path


def command(folder: str, order: str) -> list[str]:
    """The planner's command, without plots."""
    code = "from ensemble_ctrl.cli import main; main()"
    options = ["--no-plots", "-q", "--json", "--overwrite", "-o", f"{folder}/plan-{order}"]
    return [sys.executable, "-c", code, str(CONFIG), "--set", f"moments.order={order}", *options]


def run(arguments: list[str], folder: Path) -> Facts:
    """One process: its wall time, and what it printed."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    began = time.perf_counter()
    done = subprocess.run(arguments, capture_output=True, text=True, check=True, env=environment)
    seconds = time.perf_counter() - began
    facts: Facts = json.loads(done.stdout.strip().splitlines()[-1])
    return {"wall": seconds, **(ours(facts) if "details" in facts else theirs(facts))}


def ours(facts: Facts) -> Facts:
    """The planner's own facts in the benchmark's terms."""
    controls = np.load(Path(facts["folder"]) / "plan.npz")["controls"]
    verdict = judge(controls[:, 0], controls[:, 1])
    details = facts["details"]
    return {
        "build": details["build_seconds"],
        "solve": details["solve_seconds"],
        "iterations": details["iterations"],
        "objective": verdict.objective,
        "proven": facts["certificate"]["proven"],
    }


def theirs(facts: Facts) -> Facts:
    """A hand-written program's facts."""
    kept = {"build": facts["build_s"], "solve": facts["solve_s"], "iterations": facts["iterations"]}
    return {**kept, "objective": facts["objective"], "proven": "-"}


def show(timed: dict[str, list[Facts]]) -> None:
    """The table of medians."""
    plain = statistics.median(facts["wall"] for facts in timed["plain Opti"])
    print(
        f"{'program':<28}{'process':>10}{'build':>9}{'solve':>9}{'iterations':>12}{'objective':>11}{'ratio':>8}  proven"
    )
    for name, runs in timed.items():
        wall, build, solve = (statistics.median(facts[key] for facts in runs) for key in ("wall", "build", "solve"))
        last = runs[-1]
        print(
            f"{name:<28}{wall:>8.2f} s{build:>7.2f} s{solve:>7.2f} s{last['iterations']:>12}{last['objective']:>11.3f}"
            f"{plain / wall:>7.1f}x  {last['proven']}"
        )


if __name__ == "__main__":
    main()
