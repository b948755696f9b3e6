"""Robots on arcs by their equations: the enclosures of arcs and of any system hold each other.

``python -m tests.campaign.systems.twins`` takes every problem file of robots on arcs.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.certificate.certify import Certificate
from ensemble_ctrl.systems.arrays import cos, sin, tan
from tests.paths import ROOT

Floats = NDArray[np.float64]
FILES = sorted(
    path
    for path in (ROOT / "configs").rglob("*.yaml")
    if path.parent.name not in ("systems", "online", "minlp", "channels")
    and "fleet:" in path.read_text(encoding="utf-8")
)
"""Problem files of robots on arcs, one for each map and task."""
SAME = 1e-9
"""Metres by which a proven bound may be above what the other enclosure has seen."""


def twin(problem: ec.Problem) -> ec.Problem:
    """The same problem of robots that are given by their equations."""
    fleet: Any = problem.fleet
    arcs = fleet.system
    steers, from_y = arcs.controls[1] == "delta", arcs.heading_from == "y"
    own = [name for name in fleet.names if not name.startswith("start_")]

    class Twin(ec.OdeSystem):
        name, states, positions = "twin", ("x", "y", "heading"), ("x", "y")
        controls, control_units, input_bounds = arcs.controls, arcs.control_units, ((-1e3, 1e3), (-1e3, 1e3))
        parameters = dict.fromkeys(own, 1.0)

        def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
            speed, turn = u
            if steers:
                turn = speed * tan(turn) / arcs.wheelbase
            speed = psi.get("traction", 1.0) * psi.get("linear_traction", 1.0) * speed
            turn = psi.get("traction", 1.0) * psi.get("angular_traction", 1.0) * turn
            along, across = (sin(x[2]), cos(x[2])) if from_y else (cos(x[2]), sin(x[2]))
            return [speed * along, speed * across, turn]

    start = dict(zip(("heading", "x", "y"), _start(fleet), strict=True))
    robots = ec.Fleet(Twin(), dict(fleet.parameters), start=start, radius=fleet.radius)
    return ec.Problem("twin", robots, problem.duration, problem.steps, problem.task, problem.regions, problem.obstacles)


def _start(fleet: Any) -> list[float]:
    """Heading (as the system counts it) and place where every offset is zero."""
    plain = np.array([0.0 if name.startswith("start_") else 1.0 for name in fleet.names])
    heading, x, y = fleet.coefficients(plain[None])[0, 2:5].tolist()
    return [heading, x, y]


def commands(problem: ec.Problem) -> Floats:
    """Gentle turns."""
    t = np.linspace(0, 1, problem.steps)
    return np.column_stack([0.4 + 0.2 * np.sin(5 * t + 0.3), 0.3 * np.cos(7 * t + 0.1)])


def disagreements(one: Certificate, other: Certificate) -> Iterator[str]:
    """Where a bound of one enclosure is above what the other has seen, or far below its bound."""
    if other.reason:
        yield f"no enclosure: {other.reason}"
        return
    pairs: list[tuple[Any, Any]] = [
        *zip(one.clearances, other.clearances, strict=True),
        *zip(one.parts, other.parts, strict=True),
    ]
    for a, b in pairs:
        name = getattr(a, "obstacle", getattr(a, "part", ""))
        if a.proven > b.sampled + SAME or b.proven > a.sampled + SAME:
            yield f"{name}: {a.proven:.9g}..{a.sampled:.9g} and {b.proven:.9g}..{b.sampled:.9g}"
    for c, d in zip(one.clearances, other.clearances, strict=True):
        if abs(c.proven - d.proven) > 2e-3 and min(c.proven, d.proven) > 0:
            yield f"{c.obstacle}: proven is {c.proven:.6g} and {d.proven:.6g}"
    if {one.proven, other.proven} == {"yes", "no"}:
        yield f"one says {one.proven}, the other {other.proven}"


def judged(path: Path) -> list[str]:
    """What the two say differently of a problem file."""
    problem = ec.load(path)
    if problem.motions:  # a problem of such a system has none
        problem = problem.with_(motions={})
    controls = commands(problem)
    return list(disagreements(ec.certify(problem, controls, each=True), ec.certify(twin(problem), controls, each=True)))


def main() -> int:
    """All files."""
    wrong = 0
    for path in FILES:
        found = judged(path)
        wrong += bool(found)
        print(path.relative_to(ROOT), "; ".join(found) or "agree", flush=True)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
