"""How time and memory grow with the size of a problem: ``python benchmarks/scaling.py [AXIS ...] [--largest FACTOR]``.

Takes the five obstacles' problem and changes one size at a time: control steps, obstacles, truncation order, uncertain
parameters, and members of a replay. Every run is a process of its own; its processor time, children included, and its
largest resident set are kept with the outcome. The tuned hand-written program (`tuned_opti.py`) does the same job where
it can: other numbers of steps and of boxes, and a replay of all members at once.

Runs are kept in ``benchmarks/measured/scaling.json`` as they end; those that are there are not run again unless they
are named by ``--again``. ``python docs/make_tables.py --write`` writes the page.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from fleet_problem import OBSTACLES, Array
from record import MEASURED, record

HERE = Path(__file__).parent
Facts = dict[str, Any]
Box = tuple[float, float, float, float]
SIZES: dict[str, tuple[int, ...]] = {
    "steps": (80, 160, 320, 640, 1280, 2560),
    "obstacles": (5, 20, 50, 100, 200, 400),
    "order": (2, 4, 8, 16),
    "parameters": (1, 2, 3, 4),
    "members": (10**4, 10**5, 10**6, 10**7, 10**8),
}
"""What is changed, and to which sizes."""
BASE = {"steps": 160, "obstacles": 5, "order": 8, "parameters": 1}
"""The sizes of the others."""
LIMIT = 600
"""Seconds after which the planner returns its best plan."""
HAND_WRITTEN: dict[str, int] = {"steps": 640, "obstacles": 400, "members": 10**5}
"""The largest size that the hand-written program is tried at: its time grows with the third power of the steps, and its
replay holds every position of every member."""
WAY = ((1.0, 1.0), (1.8, 3.2), (3.5, 3.3), (3.7, 4.7), (5.0, 4.7), (6.5, 5.5))
"""Where no further box is put, with `ROOM` to spare."""
ROOM, SIDE = 0.7, 0.2
"""Metres."""
UNCERTAIN = (
    "traction: {range: [0.9, 1.1]}",
    "start_heading: {range: [-1 deg, 1 deg]}",
    "start_x: {range: [-2 cm, 2 cm]}",
    "start_y: {range: [-2 cm, 2 cm]}",
)
"""Parameters, in the order in which they are added."""
PROBLEM = """
name: scaling
fleet:
  model: unicycle
  parameters: {{{parameters}}}
  start: {{position: [1.0, 1.0], heading: 45 deg}}
  input_bounds: {{v: [-2, 2], omega: [-2, 2]}}
horizon: {{duration: 16 s, steps: {steps}}}
moments: {{order: {order}}}
regions: {{goal: {{box: [[6.0, 7.0], [5.0, 6.0]]}}}}
obstacles:
{obstacles}
task: "F[14, 16] in(goal) and G avoid(obstacles)"
objective: {{robustness: 1.0, terminal: {{target: [6.5, 5.5], weight: 10}}, effort: 0.1}}
solve: {{time_limit: {limit} s}}
verify: {{members: 1000}}
"""


def main() -> None:
    """Run what is missing, smallest first."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("axes", nargs="*", choices=[[], *SIZES], help="only these")
    parser.add_argument("--again", action="store_true", help="run these again")
    given = parser.parse_args()
    axes = given.axes or list(SIZES)
    kept = MEASURED / "scaling.json"
    rows = json.loads(kept.read_text(encoding="utf-8"))["rows"] if kept.exists() else []
    rows = [row for row in rows if not (given.again and row["axis"] in axes)]
    for axis, size, program in wanted(axes):
        if (axis, size, program) in [(row["axis"], row["size"], row["program"]) for row in rows]:
            continue
        rows.append({"axis": axis, "size": size, "program": program, **measured(axis, size, program)})
        print(rows[-1], flush=True)
        record("scaling", rows)


def wanted(axes: list[str]) -> list[tuple[str, int, str]]:
    """Every run."""
    ours = [(axis, size, "ensemble-plan") for axis in axes for size in SIZES[axis]]
    theirs = [(axis, size, "tuned") for axis in axes for size in SIZES[axis] if size <= HAND_WRITTEN.get(axis, 0)]
    return ours + theirs


def measured(axis: str, size: int, program: str) -> Facts:
    """One run."""
    sizes = BASE | ({axis: size} if axis in BASE else {})
    with tempfile.TemporaryDirectory() as folder:
        if program == "tuned":
            return tuned(sizes, size if axis == "members" else 0, Path(folder))
        config = Path(folder) / "scaling.yaml"
        config.write_text(problem(sizes), encoding="utf-8")
        command = [sys.executable, "-m", "ensemble_ctrl.cli"]
        plan = [*command, "run", str(config), "-q", "--json", "--no-plots", "--no-suggest", "-o", f"{folder}/plan"]
        found = spent(plan)
        if axis == "members":
            found = spent([*command, "replay", f"{folder}/plan", "--members", str(size), "--json", "-q"])
    facts = found.pop("facts")
    if axis == "members":
        return {**found, "good": facts["violating"] == 0 and facts["members"] == size}
    proven = facts["certificate"] is not None and facts["certificate"]["proven"] == "yes"
    return {**found, "good": proven, "iterations": facts["details"].get("iterations")}


def tuned(sizes: dict[str, int], members: int, folder: Path) -> Facts:
    """The hand-written program; its plan is good if its nine robots keep out of the boxes at grid times."""
    asked = {"steps": sizes["steps"], "boxes": boxes(sizes["obstacles"]), "members": members}
    found = spent([sys.executable, str(HERE / "scaling_tuned.py"), json.dumps(asked)])
    facts = found.pop("facts")
    good = facts["members"] == members if members else facts["min_clearance"] >= 0
    return {**found, "good": good, "iterations": facts.get("iterations")}


def spent(command: list[str]) -> Facts:
    """Processor time of a process and its children, the largest resident set of any, and the JSON it printed last."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryFile() as out:
        child = subprocess.Popen(command, stdout=out, stderr=subprocess.DEVNULL, env=environment)
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        printed = out.read().decode().strip().splitlines()
    facts = json.loads(printed[-1])
    return {"seconds": used.ru_utime + used.ru_stime, "megabytes": used.ru_maxrss / 1024, "facts": facts}


def problem(sizes: dict[str, int]) -> str:
    """The problem file."""
    listed = [
        f"  b{k}: {{box: [[{x0}, {x1}], [{y0}, {y1}]]}}" for k, (x0, x1, y0, y1) in enumerate(boxes(sizes["obstacles"]))
    ]
    return PROBLEM.format(
        parameters=", ".join(UNCERTAIN[: sizes["parameters"]]),
        steps=sizes["steps"],
        order=sizes["order"],
        obstacles="\n".join(listed),
        limit=LIMIT,
    )


def boxes(count: int) -> list[Box]:
    """The five boxes, and small ones around the way, always the same."""
    found = [tuple(map(float, box)) for box in OBSTACLES]
    random = np.random.default_rng(0)
    while len(found) < count:
        x, y = random.uniform(-2.0, 10.0, 2).round(2).tolist()
        if off(np.array([x, y])) > ROOM and max(abs(x - 6.5), abs(y - 5.5)) > 1.0:
            found.append((x - SIDE / 2, x + SIDE / 2, y - SIDE / 2, y + SIDE / 2))
    return [(round(a, 3), round(b, 3), round(c, 3), round(d, 3)) for a, b, c, d in found[:count]]


def off(point: Array) -> float:
    """Distance of a point from the way."""
    distances = []
    for a, b in zip(np.array(WAY), np.array(WAY)[1:], strict=False):
        share = np.clip((point - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        distances.append(float(np.hypot(*(a + share * (b - a) - point))))
    return min(distances)


if __name__ == "__main__":
    main()
