"""How heterogeneous quadrotors drift apart under one control."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import ensemble_ctrl as ec
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from printed import ROOT
from printed.table import Row, Rows, Table, header

DELIVERY = "systems/quadrotor_delivery"
MASSES = (2.0, 4.0, 6.0, 10.0)
TIMES = (0.5, 1.0, 1.6, 2.0, 4.0)
STEP = 0.1


def hover_rows(problems: tuple[str, ...]) -> Rows:
    """Metres between no load and 0.5 kg under the thrust that holds 0.25 kg, at `TIMES`."""
    return [{"mass": mass, "apart": _hover(mass)} for mass in MASSES]


def _hover(mass: float) -> list[float]:
    """One mass."""
    fleet = ec.Fleet(ec.Quadrotor(mass=mass), {"payload": ec.Interval(0.0, 0.5)})
    controls = np.tile(fleet.rest(fleet.center), (round(TIMES[-1] / STEP), 1))
    height = fleet.trajectories(controls, fleet.corners, STEP)[..., 2]
    return [float(np.ptp(height[:, round(t / STEP)])) for t in TIMES]


def hover_lines(rows: Rows) -> Iterator[str]:
    """A line each."""
    yield from header("mass", *(f"{t:g} s" for t in TIMES))
    for row in rows:
        yield f"| {row['mass']:g} kg | {' | '.join(f'{x:.2f} m' for x in row['apart'])} |"


def spread_rows(problems: tuple[str, ...]) -> Rows:
    """Spread of two plans in each coordinate: one that hovers in the goal, and one that only has to be there."""
    hover = ec.load(ROOT / "configs" / f"{problems[0]}.yaml")
    be_there = hover.with_(task=parse("G avoid(obstacles) and G[1.5, 1.6] in(goal)"))
    paths = [_paths(problem) for problem in (hover, be_there)]
    found: Rows = []
    for share in (0.25, 0.5, 0.75, 1.0):
        k = round(share * hover.steps)
        row: Row = {"time": float(hover.times[k])}
        for name, states in zip(("hover", "there"), paths, strict=True):
            x, _, z = np.ptp(states[:, k, :3], axis=0)
            row[name] = [float(z), float(x)]
        found.append(row)
    return found


def _paths(problem: ec.Problem) -> np.ndarray:
    """Positions of 21 members under the problem's plan."""
    return trajectories(problem, ec.plan(problem, check=False).controls, problem.fleet.grid(21))


def spread_lines(rows: Rows) -> Iterator[str]:
    """A line each."""
    yield from header("time", "height, hover", "along, hover", "height, be there", "along, be there")
    for row in rows:
        cells = " | ".join(f"{x:.2f} m" for x in (*row["hover"], *row["there"]))
        yield f"| {row['time']:g} s | {cells} |"


TABLES = {
    "hover": Table("docs/systems.md", (DELIVERY,), hover_rows, hover_lines),
    "spread": Table("docs/systems.md", (DELIVERY,), spread_rows, spread_lines),
}
