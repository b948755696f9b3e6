"""Time the planner against both hand-written programs, each in fresh processes, in turn.

    python benchmarks/run.py [runs] [--only TEXT ..] [--version-0-1 CHECKOUT]

Takes, for each program, the median over `runs` (default 3) of the whole process's wall time, and the objective and the
clearance of `fleet_problem.judge`; prints them, and keeps them for docs/benchmarks.md. Then come the commands of
`commands.COMMANDS`, each over the tuned program (route between the boxes) that runs in turn with it, beside the ratios
of version 0.1, all kept for docs/performance.md. Nothing fails by being slow. `--only` leaves out the programs, and
commands without one of these texts in their name; with `--version-0-1` the ratios are those of that checkout, and kept
as version 0.1's.
"""

from __future__ import annotations

import argparse
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
from commands import COMMANDS, spent
from fleet_problem import judge
from record import MEASURED, record
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
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("runs", type=int, nargs="?", default=3)
    parser.add_argument("--only", nargs="*", help="parts of names of commands")
    parser.add_argument("--version-0-1", type=Path, metavar="CHECKOUT")
    given = parser.parse_args()
    if given.only is None and given.version_0_1 is None:
        programs(given.runs)
    for line in commands(given.version_0_1, given.only or [""], given.runs):
        print(line, flush=True)


def programs(runs: int) -> None:
    """The hand-written programs and the planner's command."""
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


def commands(before: Path | None, only: list[str], runs: int) -> Iterator[str]:
    """The processor time of each command over that of the tuned program, and version 0.1's, kept as it is measured."""
    name = "commands" if before is None else "commands_0_1"
    old = {row["command"]: row["ratio"] for row in _kept(MEASURED / "commands_0_1.json")}
    rows = {row["command"]: row for row in _kept(MEASURED / f"{name}.json")}
    for command in COMMANDS:
        if not any(text in command for text in only):
            continue
        turns = [_beside_tuned(before or HERE.parent, command) for _ in range(runs)]
        ours, tuned = (min(times) for times in zip(*turns, strict=True))
        rows[command] = {"command": command, "seconds": ours, "tuned": tuned, "ratio": ours / tuned, "runs": runs}
        if before is None and command in old:
            rows[command]["version_0_1"] = old[command]
        record(name, list(rows.values()))
        beside = f", version 0.1 {old[command]:.2f}" if command in old else ""
        yield f"{command} / tuned program: {ours / tuned:.2f}{beside}"


def _kept(path: Path) -> list[Facts]:
    """The rows of a file that a command wrote, none without one."""
    rows: list[Facts] = json.loads(path.read_text(encoding="utf-8"))["rows"] if path.exists() else []
    return rows


def _beside_tuned(tree: Path, command: str) -> tuple[float, float]:
    """Processor time of a command of a checkout, and of the tuned program right after it."""
    with tempfile.TemporaryDirectory() as folder:
        ours = spent(tree, command, Path(folder))
    return ours, _run([sys.executable, str(HERE / "tuned_opti.py")])[1]


def ratios(best: list[Facts]) -> Iterator[str]:
    """The command's processor time over that of each tuned program, now and in version 0.1."""
    before = {row["guess"]: row["ratio"] for row in _kept(VERSION_0_1)}
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
