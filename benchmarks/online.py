"""Two hundred runs of the loop on simulated robots that are not the model.

Each robot has a traction of its own, and measurements with 1 cm and 1 degree of noise that arrive 0.1 s late. Counted
are collisions (of true paths, ten samples per step), runs that end in the goal, time to plan again, and how far apart
the robots are at the end, with the loop and under the first plan alone. Then the same for robots whose traction is
outside the range that is assumed.

    python benchmarks/online.py [--runs 200] [--wall] [--only model|errors]

Then come three robots under one broadcast, and one of them alone. Last are robots with errors of the model at the
bounds that the loop is given, in turn random, bang-bang and constant; of these is counted, too, how often something
that was proven is not so: a pose or a parameter outside its set, or a smaller clearance than that of a proof.

Times are those of the processor, on one thread, unless `--wall` asks for the clock's. Prints what was measured, and
keeps it for docs/online.md and the README.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray
from record import record

import ensemble_ctrl as ec
from ensemble_ctrl.planning.online.driver import drive
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.propagation import PoseSet
from ensemble_ctrl.planning.online.remaining import of_one_robot
from ensemble_ctrl.planning.online.settings import OnlineSettings, RobotSettings
from ensemble_ctrl.planning.online.simulated import FINE, Fixed, Flaws, SimulatedFleet, SimulatedRobot
from ensemble_ctrl.planning.online.simulated_errors import ErrorKind
from ensemble_ctrl.planning.online.step import Step
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

CONFIGS = Path(__file__).parents[1] / "configs"
CONFIG = CONFIGS / "five_obstacles.yaml"
SEVERAL = CONFIGS / "online" / "three_robots_online.yaml"
FLAWS = Flaws(position=0.01, heading=float(np.radians(1.0)), delay=0.1)
ERRORS = CONFIGS / "online" / "uncertain_five_obstacles_online.yaml"
KINDS: tuple[ErrorKind, ...] = ("random", "bang-bang", "constant")
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
        fleet.arcs, fleet.position, fleet.heading, problem.step, Fixed(traction, traction), FLAWS, seed
    )
    outcome = drive(loop, robot, robot)
    track = np.array(robot.track)[round(outcome.start / problem.step) * FINE :, :2]
    clear = min(float(piece.distance(track).min()) for _, piece in problem.pieces) - fleet.radius
    goal = problem.regions["goal"]
    end = track[problem.steps * FINE]
    window = track[round(14.0 / problem.step) * FINE :: FINE]
    coefficients = fleet.coefficients(np.array([[traction]]))
    blind = fleet.arcs.paths(plan, coefficients, problem.step)[0, -1]
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


def percentiles(values: Floats) -> list[float]:
    """Median, 95th percentile and largest, seconds."""
    return [float(np.percentile(values, q)) for q in (50, 95, 100)]


def main() -> None:
    """Run, print and keep what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--wall", action="store_true", help="deadlines of the clock, not of the processor")
    parser.add_argument("--only", choices=("model", "errors"), help="robots that follow the model, or that do not")
    given = parser.parse_args()
    timer = time.perf_counter if given.wall else time.process_time
    if given.only != "errors":
        model(given.runs, timer)
    if given.only != "model":
        errors(given.runs, timer)


def model(count: int, timer: Callable[[], float]) -> None:
    """Robots that follow the model, within the range that is assumed and outside."""
    problem = ec.load(CONFIG)
    plan = solve(problem).controls
    options = OnlineOptions(order=3, deadline=0.2)
    good = Receding(problem, options, plan).plan
    drawn = np.random.default_rng(1).uniform(problem.fleet.lower[0], problem.fleet.upper[0], count)

    def drive_one(traction: float, seed: int) -> Run:
        print(f"\rrobot {seed}", end="", file=sys.stderr, flush=True)
        return one(problem, plan, Receding(problem, options, good, timer), traction, seed)

    runs = [drive_one(traction, seed) for seed, traction in enumerate(drawn.tolist())]
    outside = [drive_one(traction, 1000 + i) for i, traction in enumerate(OUTSIDE)]
    print(file=sys.stderr)
    row = {**summary(runs), **several(timer), "outside": [told(run) for run in outside]}
    print(json.dumps(row, indent=1))
    record("online", [row])


def errors(count: int, timer: Callable[[], float]) -> None:
    """Robots with errors of the model at the bounds that the loop is given."""
    problem = of_one_robot(ec.load(ERRORS))
    options = cast(OnlineSettings, problem.online).options
    good = Receding(problem, options, solve(problem).controls).plan
    drawn = np.random.default_rng(2).uniform(problem.fleet.lower[0], problem.fleet.upper[0], count)
    rows: list[dict[str, Any]] = [{"kind": kind, "runs": []} for kind in KINDS]
    for seed, traction in enumerate(drawn.tolist()):
        print(f"\rrobot {seed} with errors", end="", file=sys.stderr, flush=True)
        row = rows[seed % len(KINDS)]
        settings = RobotSettings(Fixed(traction, traction), seed=seed, errors=row["kind"])
        fleet = OnlineSettings(options, {"robot": settings}).simulated(problem)
        row["runs"].append(with_errors(Receding(problem, options, good, timer), fleet, traction))
    print(file=sys.stderr)
    rows = [{"kind": row["kind"], **counted(row["runs"])} for row in rows]
    print(json.dumps(rows, indent=1))
    record("online_errors", rows)


def with_errors(loop: Receding, fleet: SimulatedFleet, traction: float) -> dict[str, Any]:
    """One run of a robot with errors, and what was said of it that is not so."""
    problem, robot = loop.problem, fleet.robots["robot"]
    sets: list[tuple[int, PoseSet, Step]] = []

    def listen(step: Step, controls: Floats) -> None:
        at = loop.trackers["robot"].at
        sets.append((at, cast(PoseSet, loop.robots["robot"].pose(at)), step))

    outcome = drive(loop, fleet, fleet, listener=listen)
    track = np.array(robot.track)[round(outcome.start / problem.step) * FINE :]
    clear = np.min([piece.distance(track[:, :2]) for _, piece in problem.pieces], axis=0) - problem.fleet.radius
    wrong = 0
    for at, pose, step in sets:
        true, driven = track[at * FINE], clear[step.begin * FINE : step.end * FINE + 1]
        off = abs((true[2] - pose.heading + np.pi) % (2 * np.pi) - np.pi) - pose.turn
        (low, high), *_ = step.ranges.values()
        excluded = max(*(np.abs(true[:2] - pose.position) - pose.half), off, low - traction, traction - high) > 0
        wrong += bool(excluded or (step.proof != "none" and driven.min() < step.clearance))
    goal, window = problem.regions["goal"], track[round(14.0 / problem.step) * FINE : problem.steps * FINE + 1 : FINE]
    return {
        "ending": outcome.ending,
        "clearance": float(clear[: problem.steps * FINE + 1].min()),
        "arrived": bool(max(float(goal.margin(place)) for place in window[:, :2]) >= 0),
        "wrong": wrong + (not loop.holds),
        "seconds": [step.seconds for step in outcome.steps],
    }


def counted(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """What runs with errors came to."""
    endings = [run["ending"] for run in runs]
    return {
        "runs": len(runs),
        "endings": {name: endings.count(name) for name in sorted(set(endings))},
        "collisions": sum(run["clearance"] < 0 for run in runs),
        "clearance": min(run["clearance"] for run in runs),
        "arrived": sum(run["arrived"] for run in runs),
        "wrong": sum(run["wrong"] for run in runs),
        "seconds": percentiles(np.concatenate([run["seconds"] for run in runs])),
    }


def summary(runs: list[Run]) -> dict[str, Any]:
    """What the runs of robots within the range came to."""
    clearance = np.array([run.clearance for run in runs])
    ends, blind = np.array([run.end for run in runs]), np.array([run.open_loop_end for run in runs])
    seconds = np.array([s for run in runs for s in run.seconds])
    return {
        "runs": len(runs),
        "endings": {name: sum(run.ending == name for run in runs) for name in sorted({run.ending for run in runs})},
        "collisions": int((clearance < 0).sum()),
        "clearance": float(clearance.min()),
        "in_goal": sum(run.in_goal for run in runs),
        "plans": len(seconds),
        "seconds": percentiles(seconds),
        "spread": [spread(ends), spread(blind)],
    }


def told(run: Run) -> dict[str, Any]:
    """What became of a robot outside the range."""
    return {"traction": run.traction, "ending": run.ending, "noticed": run.noticed, "clearance": run.clearance}


def several(timer: Callable[[], float]) -> dict[str, list[float]]:
    """Times to plan again for three robots under one broadcast, and for the first of them alone."""
    problem = ec.load(SEVERAL)
    plan = solve(of_one_robot(problem)).controls
    settings = problem.online
    assert settings is not None
    alone = replace(settings, robots=dict(list(settings.robots.items())[:1]))
    found = {}
    for name, few in (("three", settings), ("one", alone)):
        fleet = few.simulated(problem)
        loop = Receding(problem, few.options, plan, timer, tuple(fleet.robots))
        found[name] = percentiles(drive(loop, fleet, fleet).seconds)
    return found


if __name__ == "__main__":
    main()
