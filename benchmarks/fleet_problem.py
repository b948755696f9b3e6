"""The benchmark problem and the judge shared by the hand-written programs.

Nine heterogeneous unicycles with traction ``psi`` receive one broadcast command ``(v, omega)``::

    x' = psi v cos(theta)    y' = psi v sin(theta)    theta' = psi omega

All must keep out of five boxes and each must visit the goal box at some time in [14, 16] s.  The score, to be
made as large as possible, is

    robustness - 10 * mean |p(16) - (6.5, 5.5)|^2 - 0.1 * integral (v^2 + omega^2) dt.

:func:`judge` replays a control with the exact arc of a unicycle under constant commands and scores it with
true minima and maxima, so it shares neither an integrator nor a smooth approximation with the optimisers.
"""

from __future__ import annotations

import json
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEPS = 160
HORIZON = 16.0
DT = HORIZON / STEPS
START = (1.0, 1.0, float(np.pi / 4))
LIMIT = 2.0
PSI: Array = np.linspace(0.9, 1.1, 9)
#: Boxes as (xmin, xmax, ymin, ymax).
OBSTACLES = (
    (2.0, 3.0, 1.5, 3.0),
    (3.6, 4.6, 0.2, 2.2),
    (4.0, 5.0, 3.2, 4.4),
    (1.2, 2.2, 3.8, 5.0),
    (5.6, 6.6, 2.2, 3.4),
)
GOAL = (6.0, 7.0, 5.0, 6.0)
CENTRE = (6.5, 5.5)
#: First step of the goal window [14, 16] s; the last one is ``STEPS``.
WINDOW = 140
W_TERMINAL = 10.0
W_EFFORT = 0.1


class Verdict(NamedTuple):
    """What the replay found."""

    objective: float
    rho: float
    min_clearance: float


def simulate(v: Array, omega: Array, psi: Array = PSI) -> Array:
    """Positions of the robots at every grid time, shape ``(STEPS + 1, robots, 2)``, by exact arcs."""
    turned = np.concatenate([[0.0], np.cumsum(omega) * DT])
    half = np.outer(omega, psi) * (DT / 2)
    heading = START[2] + np.outer(turned[:-1], psi) + half
    chord = np.outer(v, psi) * DT * np.sinc(half / np.pi)
    moves = np.stack([chord * np.cos(heading), chord * np.sin(heading)], axis=-1)
    start = np.broadcast_to(np.array(START[:2]), (1, psi.size, 2))
    return np.concatenate([start, start + np.cumsum(moves, axis=0)])


def depths(p: Array, box: tuple[float, float, float, float]) -> Array:
    """Signed distance of points to the four faces of a box, positive on the inner side."""
    x, y = p[..., 0], p[..., 1]
    return np.stack([x - box[0], box[1] - x, y - box[2], box[3] - y], axis=-1)


def judge(v: Array, omega: Array) -> Verdict:
    """Score a control by an independent replay, without any smoothing."""
    p = simulate(v, omega)
    rho = float(depths(p[WINDOW:], GOAL).min(axis=-1).max(axis=0).min())
    clearance = min(float((-depths(p, box)).max(axis=-1).min()) for box in OBSTACLES)
    terminal = float(((p[-1] - np.array(CENTRE)) ** 2).sum(axis=-1).mean())
    effort = float((v**2 + omega**2).sum()) * DT
    return Verdict(rho - W_TERMINAL * terminal - W_EFFORT * effort, rho, clearance)


def report(
    program: str,
    marks: tuple[float, float, float, float],
    iterations: int,
    status: str,
    v: Array,
    omega: Array,
) -> None:
    """Print the one JSON line; ``marks`` are the clock at start, imported, built and solved."""
    start, imported, built, solved = marks
    verdict = judge(v, omega)
    line: dict[str, str | int | float] = {
        "program": program,
        "import_s": round(imported - start, 4),
        "build_s": round(built - imported, 4),
        "solve_s": round(solved - built, 4),
        "total_s": round(solved - start, 4),
        "iterations": iterations,
        "status": status,
        "objective": round(verdict.objective, 5),
        "min_clearance": round(verdict.min_clearance, 5),
        "rho": round(verdict.rho, 5),
    }
    print(json.dumps(line))
