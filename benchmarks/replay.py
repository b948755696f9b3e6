"""How fast members are replayed and plans proven: ``python benchmarks/replay.py [--many N ...]``.

For each problem a plan is made, then measured are, in processor time on one thread, the least of several runs:

- the replay of 100,000 members with everything judged, in robot-steps per second, and the same with every position of
  2,000 members computed by exact arcs or by integration, with the largest difference between both;
- the certificate, as it is and with the bound of each obstacle.

``--many 1e6 1e7 1e8`` also runs ``ensemble-plan replay`` on so many members of the first problem, with its largest
resident memory (Linux). Keeps ``measured/replay.json`` and ``measured/replay_many.json`` for docs/replay.md.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from record import record

import ensemble_ctrl as ec
from ensemble_ctrl.problem.evaluation.judge import Judge, Judged
from ensemble_ctrl.problem.evaluation.streaming import SIZE

ROOT = Path(__file__).parents[1]
SYSTEMS = ("planar_slalom", "quadrotor_delivery")
MEMBERS, PLAIN = 100_000, 2_000
POLES = 400
CHILD = r"""
import json, os, pathlib, sys
from ensemble_ctrl.cli.app import invoke
began = sum(os.times()[:2])
code = invoke(["replay", sys.argv[1], "--members", sys.argv[2], "-q", "-o", sys.argv[3]])
status = dict(line.split(":", 1) for line in pathlib.Path("/proc/self/status").read_text().splitlines())
memory = int(status["VmHWM"].split()[0]) * 1024
print("\n" + json.dumps({"code": code, "spent": sum(os.times()[:2]) - began, "memory": memory}))
"""


def field() -> ec.Problem:
    """400 boxes and octagons on 40 m by 40 m, with room beside a winding way."""
    rng = np.random.default_rng(7)
    share = np.linspace(0, 1, 200)[:, None]
    bend = 3.0 * np.sin(3 * np.pi * share) * [1.0, -1.0]
    way, found = 2.0 + 35.0 * share + bend, dict[str, tuple[ec.Obstacle, ...]]()
    places: list[tuple[Any, float]] = []
    while len(found) < POLES:
        centre, size = rng.uniform(0.5, 39.5, 2), rng.uniform(0.12, 0.4)
        beside = np.linalg.norm(way - centre, axis=1).min() >= size + 0.75
        if beside and all(np.linalg.norm(centre - c) >= size + s + 0.25 for c, s in places):
            places.append((centre, size))
            angles = np.pi / 4 + np.arange(4) * np.pi / 2 if rng.random() < 0.5 else np.arange(8) * np.pi / 4
            corners = centre + size * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            found[f"p{len(found)}"] = (ec.Obstacle.polygon(corners),)
    fleet = ec.Fleet(
        ec.Unicycle("x"),
        {"traction": ec.Interval(0.97, 1.03)},
        position=[2.0, 2.0],
        heading=np.pi / 4,
        input_lower=[-2, -2],
        input_upper=[2, 2],
        radius=0.1,
    )
    goal = {"goal": ec.Polyhedron.box([[35, 39], [35, 39]])}
    task = ec.parse("F[36, 40] in(goal) and G avoid(obstacles)")
    return ec.Problem("400 poles", fleet, 40.0, 200, task, goal, found)


def least(work: Callable[[], Any], runs: int = 5) -> tuple[float, Any]:
    """Processor time of the quickest of some runs, seconds, and the result."""
    times = []
    for _ in range(runs):
        began = time.process_time()
        found = work()
        times.append(time.process_time() - began)
    return min(times), found


def differs(one: Judged, other: Judged) -> float:
    """The largest difference of any robustness and of any closest approach."""
    found = [np.abs(one.robustness - other.robustness).max(), np.abs(one.parts - other.parts).max(initial=0.0)]
    found += [abs(a.distance - b.distance) for a, b in zip(one.closest, other.closest, strict=True)]
    assert [a.inside for a in one.closest] == [b.inside for b in other.closest]
    return float(max(found))


def measured(plan: ec.Plan) -> dict[str, Any]:
    """One plan."""
    problem, controls = plan.problem, plan.controls
    members, some = problem.fleet.sample(MEMBERS, 0), problem.fleet.sample(PLAIN, 0)
    seconds, _ = least(lambda: Judge(problem, controls, 1).judge(members))
    plain = Judge(problem, controls, 1)
    plain.__dict__["curves"] = None  # every position of every member
    plain_seconds, found = least(lambda: plain.judge(some), 2)
    curves = Judge(problem, controls, 1).curves
    proof, quick = least(plan.certify, 3)
    proof_each, each = least(lambda: plan.certify(each=True), 1)
    assert quick.clearance == each.clearance
    steps = len(controls)
    return {
        "name": problem.name,
        "rate": MEMBERS * steps / seconds,
        "plain_rate": PLAIN * steps / plain_seconds,
        "difference": differs(Judge(problem, controls, 1).judge(some), found),
        "points": 0 if curves is None else len(curves.table[0]),
        "error": getattr(curves, "error", None),
        "proof": proof,
        "proof_each": proof_each,
        "proven": quick.proven,
    }


def many(plan: ec.Plan, members: str) -> dict[str, Any]:
    """``ensemble-plan replay`` on so many members, in a process of its own."""
    with tempfile.TemporaryDirectory() as place:
        plan.save(Path(place) / "plan.npz")
        command = [sys.executable, "-c", CHILD, place, members, f"{place}/found.json"]
        began = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, check=True, env={**os.environ})
        wall = time.perf_counter() - began
        facts = json.loads(done.stdout.splitlines()[-1])
        found = json.loads((Path(place) / "found.json").read_text(encoding="utf-8"))
    kept = {name: found[name] for name in ("members", "violating", "mean", "share_95")}
    rate = found["members"] * plan.problem.steps / facts["spent"]
    return kept | {"worst": found["worst"][0][0], "wall": wall, "rate": rate, "block": SIZE, **facts}


def main() -> None:
    """Measure, print and keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--many", nargs="*", default=[], metavar="N")
    parser.add_argument("--only-many", action="store_true", help="leave the first table as it is")
    given = parser.parse_args()
    five = ec.load(ROOT / "configs" / "five_obstacles.yaml")
    problems = [five, field(), *(ec.load(ROOT / "configs" / "systems" / f"{name}.yaml") for name in SYSTEMS)]
    rows = []
    for problem in [] if given.only_many else problems:
        rows.append(measured(ec.plan(problem, check=False)))
        print(rows[-1], flush=True)
    if rows:
        record("replay", rows)
    if given.many:
        plan = ec.plan(five, check=False)
        found = []
        for members in given.many:
            found.append(many(plan, members))
            print(found[-1], flush=True)
        record("replay_many", found)


if __name__ == "__main__":
    main()
