"""Two hundred runs of the loop on simulated robots that are not the model.

Each robot has a traction of its own, and measurements with 1 cm and 1 degree of noise that arrive 0.1 s late. Counted
are collisions (of true paths, ten samples per step), runs that end in the goal, time to plan again, and how far apart
the robots are at the end, with the loop and under the first plan alone. Then the same for robots whose traction is
outside the range that is assumed.

    python benchmarks/online.py [--runs 200] [--config configs/five_obstacles.yaml] [--wall] [--json FILE]

Times are those of the processor, on one thread, unless `--wall` asks for the clock's.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.planning.online.driver import drive
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.simulated import FINE, Fixed, Flaws, SimulatedRobot
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

FLAWS = Flaws(position=0.01, heading=float(np.radians(1.0)), delay=0.1)
OUTSIDE = (0.75, 0.8, 0.85, 1.17, 1.22, 1.3)
"""Tractions outside the range that is assumed."""


@dataclass(frozen=True)
class Run:
    """One robot's run."""

    traction: float
    ending: str
    clearance: float
    in_goal: bool
    end: tuple[float, float]
    open_loop_end: tuple[float, float]
    seconds: tuple[float, ...]
    sources: dict[str, int]
    noticed: bool


def one(problem: Problem, plan: Floats, loop: Receding, traction: float, seed: int) -> Run:
    """Run the loop on one robot."""
    fleet = problem.fleet
    robot = SimulatedRobot(
        fleet.system, fleet.position, fleet.heading, problem.step, Fixed(traction, traction), FLAWS, seed
    )
    outcome = drive(loop, robot, robot)
    track = np.array(robot.track)[round(outcome.start / problem.step) * FINE :, :2]
    clear = min(float(piece.distance(track).min()) for _, piece in problem.pieces) - fleet.radius
    goal = problem.regions["goal"]
    end = track[problem.steps * FINE]
    window = track[round(14.0 / problem.step) * FINE :: FINE]
    drives = fleet.drives(np.array([[traction]]))
    blind = fleet.system.positions(plan, drives, problem.step)[0, -1]
    return Run(
        traction,
        outcome.ending,
        clear,
        bool(max(float(goal.margin(p)) for p in window) >= 0),
        (float(end[0]), float(end[1])),
        (float(blind[0]), float(blind[1])),
        tuple(step.seconds for step in outcome.steps),
        outcome.sources,
        not loop.holds,
    )


def spread(ends: Floats) -> float:
    """Root mean square distance from the mean, metres."""
    return float(np.sqrt(((ends - ends.mean(axis=0)) ** 2).sum(axis=1).mean()))


def percentiles(values: Floats) -> str:
    """Median, 95th percentile and largest, in milliseconds."""
    return ", ".join(f"{1e3 * np.percentile(values, q):.0f}" for q in (50, 95, 100))


def main() -> None:
    """Run, print, and write what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--config", default="configs/five_obstacles.yaml")
    parser.add_argument("--order", type=int, default=3)
    parser.add_argument("--deadline", type=float, default=0.2, help="seconds")
    parser.add_argument("--wall", action="store_true", help="deadlines of the clock, not of the processor")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    problem = ec.load(given.config)
    plan = solve(problem).controls
    options = OnlineOptions(order=given.order, deadline=given.deadline)
    drawn = np.random.default_rng(1).uniform(problem.fleet.lower[0], problem.fleet.upper[0], given.runs)
    timer = time.perf_counter if given.wall else time.process_time
    good = Receding(problem, options, plan).plan
    runs: list[Run] = []
    try:
        for seed, traction in enumerate(drawn.tolist()):
            runs.append(one(problem, plan, Receding(problem, options, good, timer), traction, seed))
            print(f"\r{seed + 1}/{given.runs}", end="", file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        print(" interrupted", end="", file=sys.stderr)
    print(file=sys.stderr)
    report(runs)
    outside = [
        one(problem, plan, Receding(problem, options, good, timer), traction, 1000 + i)
        for i, traction in enumerate(OUTSIDE)
    ]
    print("traction outside 0.9 to 1.1, which is assumed:")
    for run in outside:
        print(f"  {run.traction:.2f}: {run.ending}, noticed: {run.noticed}, clearance {run.clearance:.3f} m")
    if given.json:
        given.json.write_text(json.dumps([vars(run) for run in (*runs, *outside)]) + "\n")


def report(runs: list[Run]) -> None:
    """What the runs came to."""
    clearance = np.array([run.clearance for run in runs])
    ends, blind = np.array([run.end for run in runs]), np.array([run.open_loop_end for run in runs])
    seconds = np.array([s for run in runs for s in run.seconds])
    endings = {name: sum(run.ending == name for run in runs) for name in sorted({run.ending for run in runs})}
    sources = {name: sum(run.sources[name] for run in runs) for name in runs[0].sources}
    print(f"{len(runs)} runs: {endings}; plans {sources}")
    print(f"collisions {int((clearance < 0).sum())}, smallest clearance {clearance.min():.4f} m")
    print(f"in the goal {sum(run.in_goal for run in runs)}")
    print(f"planning again [ms] (median, 95 %, largest): {percentiles(seconds)}")
    print(f"final spread {spread(ends):.4f} m, under the first plan alone {spread(blind):.4f} m")


if __name__ == "__main__":
    main()
