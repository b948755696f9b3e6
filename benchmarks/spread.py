"""How unequal quadrotors drift apart under one control, for docs/systems.md: ``python benchmarks/spread.py``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.problem.evaluation.sampled import trajectories

Floats = NDArray[np.float64]

CONFIG = Path(__file__).parents[1] / "configs" / "systems" / "quadrotor_delivery.yaml"
MASSES = (2.0, 4.0, 6.0, 10.0)
TIMES = (0.5, 1.0, 1.6, 2.0, 4.0)
STEP = 0.1


def hover(mass: float) -> list[float]:
    """Metres between quadrotors without a load and with 0.5 kg under the thrust that holds 0.25 kg, at `TIMES`."""
    fleet = ec.OdeFleet(ec.Quadrotor(mass=mass), {"payload": ec.Interval(0.0, 0.5)}, {})
    controls = np.tile(fleet.rest(fleet.center), (round(TIMES[-1] / STEP), 1))
    height = fleet.trajectories(controls, fleet.corners, STEP)[..., 2]
    return [float(np.ptp(height[:, round(t / STEP)])) for t in TIMES]


def planned(problem: ec.Problem) -> Iterator[tuple[float, Floats]]:
    """Times, and the spread of a plan in each coordinate then, metres."""
    plan = ec.plan(problem, check=False)
    paths = trajectories(problem, plan.controls, problem.fleet.grid(21))
    for share in (0.25, 0.5, 0.75, 1.0):
        k = round(share * problem.steps)
        yield float(problem.times[k]), np.ptp(paths[:, k], axis=0)


def main() -> None:
    """Print the tables."""
    print("| mass | " + " | ".join(f"{t:g} s" for t in TIMES) + " |")
    for mass in MASSES:
        print(f"| {mass:g} kg | " + " | ".join(f"{x:.2f} m" for x in hover(mass)) + " |")
    delivery = ec.load(CONFIG)
    arrive = delivery.with_(task=parse("G avoid(obstacles) and G[1.5, 1.6] in(goal)"))
    for name, problem in (("hover at the goal", delivery), ("only be there", arrive)):
        for time, (x, _, z) in planned(problem):
            print(f"{name}: {time:g} s, {x:.2f} m in x, {z:.2f} m in z", flush=True)


if __name__ == "__main__":
    main()
