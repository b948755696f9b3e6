"""Commands whose processor time `run.py` sets against that of the tuned hand-written program, in any checkout."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

PLAIN = ("--no-plots", "-q", "--json", "--overwrite")
COMMANDS: dict[str, tuple[str, ...]] = {
    "check": ("check", "configs/five_obstacles.yaml", "-q"),
    "one_obstacles": ("run", "configs/one_obstacles.yaml"),
    "three_obstacles": ("run", "configs/three_obstacles.yaml"),
    "eight_obstacles": ("run", "configs/eight_obstacles.yaml"),
    "fleets/uncertain_start": ("run", "configs/fleets/uncertain_start.yaml"),
    "fleets/two_tractions": ("run", "configs/fleets/two_tractions.yaml"),
    "stl/door_puzzle": ("run", "configs/stl/door_puzzle.yaml"),
    "five_obstacles, minlp": ("run", "configs/five_obstacles.yaml", "--set", "solve.method=minlp"),
    "50 poles": ("run", "50"),
    "400 poles": ("run", "400"),
    "800 poles": ("run", "800"),
    "online": ("online", "configs/online/five_obstacles_online.yaml"),
}
"""Arguments of ``ensemble-plan``; a number stands for the problem of a field of so many poles."""
FIELD = """
version: 1
name: poles
fleet:
  model: unicycle
  parameters: {traction: {range: [0.97, 1.03]}}
  start: {position: [2.0, 2.0], heading: 45 deg}
  input_bounds: {v: [-2, 2], omega: [-2, 2]}
  radius: 0.1 m
horizon: {duration: 40 s, steps: 200}
moments: {basis: legendre, order: auto}
regions: {goal: {box: [[35.0, 39.0], [35.0, 39.0]]}}
task: "F[36, 40] in(goal) and G avoid(obstacles)"
objective: {robustness: 1.0, terminal: {target: [37, 37], weight: 10}, effort: 0.05}
solve: {time_limit: 600 s}
obstacles:
"""


def spent(tree: Path, name: str, folder: Path) -> float:
    """Processor time of one command of a checkout, children included, seconds; its plan is proven."""
    kind, what, *more = COMMANDS[name]
    if what.isdigit():
        what = str(folder / f"poles{what}.yaml")
        Path(what).write_text("\n".join(field(int(COMMANDS[name][1]))) + "\n", encoding="utf-8")
    options = [] if kind == "check" else [*PLAIN, "-o", str(folder / "plan")]
    arguments = [kind, what, *more, *options]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(tree.resolve() / "src")}
    before = os.times()
    command = [sys.executable, "-m", "ensemble_ctrl.cli", *arguments]
    done = subprocess.run(command, cwd=tree, capture_output=True, text=True, check=True, env=environment)
    after = os.times()
    if kind == "run":
        assert json.loads(done.stdout.strip().splitlines()[-1])["certificate"]["proven"] == "yes", name
    return after.children_user + after.children_system - before.children_user - before.children_system


def field(count: int) -> Iterator[str]:
    """The problem of a field of 40 by 40 m with octagons and squares beside a winding way, always the same."""
    yield FIELD.strip()
    rng, share = np.random.default_rng(7), np.linspace(0.0, 1.0, 200)[:, None]
    way = 2.0 + 35.0 * share + 3.0 * np.sin(3 * np.pi * share) * [1.0, -1.0]
    places: list[tuple[float, float, float]] = []
    while len(places) < count:
        centre, size = rng.uniform(0.5, 39.5, 2), rng.uniform(0.12, 0.4)
        beside = np.linalg.norm(way - centre, axis=1).min() >= size + 0.75
        if beside and all(np.hypot(centre[0] - x, centre[1] - y) >= size + s + 0.1 for x, y, s in places):
            places.append((*centre.tolist(), size))
            corners = 4 if len(places) % 2 else 8
            angles = (np.arange(corners) + 0.5) * 2 * np.pi / corners
            shape = (centre + size * np.stack([np.cos(angles), np.sin(angles)], axis=1)).round(3).tolist()
            yield f"  p{len(places)}: {{polygon: {shape}}}"
