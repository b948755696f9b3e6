"""Compare two source trees of the planner on the same problems, in turn, each in fresh processes.

    python benchmarks/compare_versions.py BEFORE AFTER [--cases FOLDER] [--only TEXT ..] [--runs N] [--keep NAME]

BEFORE and AFTER are checkouts. Each problem file under ``configs/`` of AFTER, and each ``*.yaml`` of FOLDER, is solved,
certified and replayed by both; printed are what was found, what is proven, the cost, the work, and the processor time
of each part, the least of N runs (default 1). ``--keep NAME`` writes it to ``benchmarks/measured/NAME.json``. Exits
with 1 where AFTER finds or proves less, or costs over 0.5 % more.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from record import record

Facts = dict[str, Any]

RENAMED = {"distributions": "laws"}
"""Folders of problem files that had another name before."""
PARTS = ("start", "solve", "certify", "replay")
WORSE = 0.005
"""Share of the cost by which a plan may cost more and still count as the same."""
ONE = r"""
import json, os, sys, time
spent = lambda: sum(os.times()[:4])
import ensemble_ctrl as ec
from ensemble_ctrl.planning.minimum_time import solve
problem = ec.load(sys.argv[1], trust=True)
times = {"start": spent()}
def timed(name, work):
    began = spent()
    result = work()
    times[name] = spent() - began
    return result
solution, _ = timed("solve", lambda: solve(problem))
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.problem.evaluation.sampled import replay
proof = timed("certify", lambda: certify(solution.problem, solution.controls))
seen = timed("replay", lambda: replay(solution.problem, solution.controls))
value = solution.attempt.value
print(json.dumps({
    "found": solution.status == "planned", "proven": proof.proven, "cost": value.cost,
    "clearance": proof.clearance, "satisfied": seen.satisfied, "iterations": solution.iterations,
    "horizon": solution.problem.duration, "seconds": times,
}))
"""
"""What one process does with one file."""


def main() -> int:
    """Compare, print, and keep what was measured."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--cases", type=Path)
    parser.add_argument("--only", nargs="*", default=[""], help="parts of names")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--keep")
    given = parser.parse_args()
    rows = []
    for name, old, new in files(given):
        if any(text in name for text in given.only):
            rows.append(compared(name, old, new, given))
            print("\n".join(lines(rows[-1])), flush=True)
            if given.keep:
                record(given.keep, rows)
    print("\n".join(summary(rows)))
    return int(any(worse(row) for row in rows))


def files(given: argparse.Namespace) -> Iterator[tuple[str, Path, Path]]:
    """The name of each problem, and its file for either tree."""
    for new in sorted((given.after / "configs").rglob("*.yaml")):
        name = new.relative_to(given.after / "configs")
        parts = [RENAMED.get(part, part) for part in name.parts]
        known = [given.before / "configs" / old for old in (name, Path(*parts))]
        old = next((path for path in known if path.exists()), None)
        if old is not None:
            yield str(name.with_suffix("")), old, new
    for path in sorted(given.cases.rglob("*.yaml")) if given.cases else ():
        yield f"cases/{path.relative_to(given.cases).with_suffix('')}", path, path


def compared(name: str, old: Path, new: Path, given: argparse.Namespace) -> Facts:
    """One problem by both trees, in turn."""
    turns = [(one(given.before, old), one(given.after, new)) for _ in range(given.runs)]
    before, after = (least(list(facts)) for facts in zip(*turns, strict=True))
    return {"name": name, "before": before, "after": after}


def one(tree: Path, file: Path) -> Facts:
    """What one tree makes of one file."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(tree.resolve() / "src")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    command = [sys.executable, "-W", "ignore", "-c", ONE, str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode:
        return {"failed": (done.stderr.strip().splitlines() or ["no message"])[-1]}
    facts: Facts = json.loads(done.stdout.strip().splitlines()[-1])
    return facts


def least(runs: list[Facts]) -> Facts:
    """The last run, with the least time of each part over all."""
    if "failed" in runs[-1]:
        return runs[-1]
    seconds = {part: min(run["seconds"][part] for run in runs) for part in PARTS}
    return {**runs[-1], "seconds": seconds}


def worse(row: Facts) -> bool:
    """Whether the second tree does less than the first."""
    before, after = row["before"], row["after"]
    if "failed" in before or "failed" in after:
        return "failed" in after and "failed" not in before
    if (after["found"], after["proven"] == "yes") < (before["found"], before["proven"] == "yes"):
        return True
    more = after["cost"] - before["cost"] > WORSE * max(abs(before["cost"]), 0.1)
    return bool(before["found"] and more and after["horizon"] >= before["horizon"])


def lines(row: Facts) -> Iterator[str]:
    """A problem's two columns, and the ratio of the times."""
    for which in ("before", "after"):
        facts = row[which]
        if "failed" in facts:
            yield f"{row['name']:<40} {which:<7} {facts['failed'][:80]}"
            continue
        found, proven = "found" if facts["found"] else "none", facts["proven"]
        parts = "  ".join(f"{part} {facts['seconds'][part]:.2f}" for part in PARTS)
        cost = f"cost {facts['cost']:9.4f}  iterations {facts['iterations']:4d}"
        yield f"{row['name']:<40} {which:<7} {found:<5} proven {proven:<9} {cost}  {parts}"
    if worse(row):
        yield f"{row['name']:<40} WORSE"


def summary(rows: list[Facts]) -> Iterator[str]:
    """The median ratio of each part, and how many problems are found and proven."""
    both = [row for row in rows if not {"failed"} & (row["before"].keys() | row["after"].keys())]
    for part in PARTS if both else ():
        ratios = [row["after"]["seconds"][part] / max(row["before"]["seconds"][part], 1e-3) for row in both]
        yield f"{part}: after / before {statistics.median(ratios):.2f} in the median of {len(ratios)}"
    for which in ("before", "after"):
        found, proven = sum(r[which]["found"] for r in both), sum(r[which]["proven"] == "yes" for r in both)
        yield f"{which}: {found} found, {proven} proven, of {len(both)}"


if __name__ == "__main__":
    sys.exit(main())
