"""Time the planner against both hand-written programs, each in fresh processes, in turn.

    python benchmarks/run.py [runs]

Takes, for each program, the median over `runs` (default 3) of the whole process's wall time, and the objective and the
clearance of `fleet_problem.judge`; prints them, and keeps them for docs/benchmarks.md.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from fleet_problem import judge
from record import record
from startup import started

HERE = Path(__file__).parent
VERSION_0_1 = HERE / "measured" / "version_0_1.json"
"""Processor time of version 0.1's command over that of each hand-written program, both in the same run."""
CONFIG = HERE.parent / "configs" / "five_obstacles.yaml"
Facts = dict[str, Any]
NINE = "nine robots, grid times"
ROUTE = "route over the top, drawn after seeing the plain result"
PROGRAMS = (
    ("plain", "straight line", ["plain_opti.py"]),
    ("tuned", "route between the boxes", ["tuned_opti.py"]),
    ("tuned", ROUTE, ["tuned_opti.py", "outer"]),
)
"""Hand-written programs: name, first guess, and how they are called."""


def main() -> None:
    """Run everything, print it and keep it."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    with tempfile.TemporaryDirectory() as folder:
        timed = [
            [_turn(name, guess, script) for name, guess, script in PROGRAMS] + [_ours(folder)] for _ in range(runs)
        ]
    rows = []
    for turns in zip(*timed, strict=True):
        seconds = statistics.median(turn["process"] for turn in turns)
        rows.append({**turns[-1], "process": seconds, "runs": runs})
        print(rows[-1])
    record("programs", rows)
    print(started(runs))
    print("\n".join(ratios([min(turns, key=lambda turn: turn["processor"]) for turns in zip(*timed, strict=True)])))


def ratios(best: list[Facts]) -> Iterator[str]:
    """The command's processor time over that of each tuned program, now and in version 0.1."""
    before = {row["guess"]: row["ratio"] for row in json.loads(VERSION_0_1.read_text(encoding="utf-8"))["rows"]}
    *programs, ours = best
    for row in programs:
        if row["guess"] in before:
            now = ours["processor"] / row["processor"]
            yield f"command / tuned program ({row['guess']}): {now:.2f}, version 0.1 {before[row['guess']]:.2f}"


def _turn(name: str, guess: str, script: list[str]) -> Facts:
    """A hand-written program, once."""
    seconds, processor, facts = _run([sys.executable, str(HERE / script[0]), *script[1:]])
    kept = {"objective": facts["objective"], "clearance": facts["min_clearance"], "iterations": facts["iterations"]}
    return {"program": name, "guess": guess, "whom": NINE, "process": seconds, "processor": processor, **kept}


def _ours(folder: str) -> Facts:
    """The planner's command, without plots, once."""
    options = ["--no-plots", "-q", "--json", "--overwrite", "-o", f"{folder}/plan"]
    seconds, processor, facts = _run([sys.executable, "-m", "ensemble_ctrl.cli", str(CONFIG), *options])
    assert facts["certificate"]["proven"] == "yes"
    controls = np.load(Path(facts["folder"]) / "plan.npz")["controls"]
    verdict = judge(controls[:, 0], controls[:, 1])
    kept = {"objective": verdict.objective, "clearance": verdict.min_clearance}
    return {
        "program": "`ensemble-plan`",
        "guess": "its own routes",
        "whom": "proven for every traction in [0.9, 1.1] and every instant",
        "process": seconds,
        "processor": processor,
        "iterations": facts["details"]["iterations"],
        **kept,
    }


def _run(command: list[str]) -> tuple[float, float, Facts]:
    """One process: its wall time, its processor time with children, and the JSON that it printed last."""
    began, before = time.perf_counter(), os.times()
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    facts: Facts = json.loads(done.stdout.strip().splitlines()[-1])
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return time.perf_counter() - began, used, facts


if __name__ == "__main__":
    main()
