"""A corridor with gates too narrow to turn into for a vehicle that can't stop: the way on is around its end."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from .case import Case, text_of
from .driving import OBJECTIVE, STEP, ends_in
from .tube import FAR, NEAR, Tube, driven, obstacles_of

Floats = NDArray[np.float64]

WALL = 0.25
"""Thickness, metres."""
SPEED, MOMENT = 0.75, 0.5


def gates(seed: int, rng: Generator) -> Case:
    """Straight on, half a turn to one side, and back along the outside of the corridor; the map at a random angle."""
    ahead, back, side = int(rng.integers(18, 24)), int(rng.integers(8, 14)), float(rng.choice([-1.0, 1.0]))
    turn = half_turn(rng)
    legs = [(ahead, 0.0), (turn, MOMENT * side), (3, -0.3 * side), (back, 0.0)]
    controls = np.concatenate([np.tile([SPEED, moment], (n, 1)) for n, moment in legs])
    angle = round(float(rng.uniform(-np.pi, np.pi)), 4)
    fleet: dict[str, Any] = {
        "model": {"python": "plants.py:Glider"},
        "parameters": {"load": {"range": [0.99, 1.01]}},
        "start": {"x": 0.0, "y": 0.0, "yaw": angle},
        "radius": 0.1,
    }
    tube = driven(fleet, len(controls) * STEP, controls)
    regions, window = ends_in(tube, 1.0, 0.12)
    data = {
        "version": 1,
        "name": f"gates_{seed:02d}",
        "fleet": fleet,
        "horizon": {"duration": round(len(controls) * STEP, 6), "steps": len(controls)},
        "regions": regions,
        "obstacles": obstacles_of(_corridor(tube, rng, ahead * SPEED * STEP, side, angle)),
        "task": f"F{window} in(goal) and G avoid(obstacles)",
        "objective": OBJECTIVE,
    }
    return Case("gates", seed, text_of(data), controls)


def half_turn(rng: Generator) -> int:
    """Steps of the moment for about half a turn."""
    return int(rng.integers(32, 36))


def _corridor(tube: Tube, rng: Generator, length: float, side: float, angle: float) -> list[Floats]:
    """Walls along the way out, the one towards the goal with two or three gates, and one behind the start."""
    half = 0.1 + float(rng.uniform(NEAR + 0.02, FAR)) + 0.05
    begin, end = -0.4, length - 0.1
    openings = np.sort(rng.uniform(begin + 0.6, end - 0.5, size=int(rng.integers(3, 5))))
    width = 0.2 + float(rng.uniform(0.16, 0.24))
    ends = [begin, *np.concatenate([[at - width / 2, at + width / 2] for at in openings]), end]
    parts = [(a, b, side * half, side * (half + WALL)) for a, b in zip(ends[::2], ends[1::2], strict=True)]
    parts += [(begin, end, -side * half, -side * (half + WALL)), (begin - WALL, begin, -half - WALL, half + WALL)]
    c, s = np.cos(angle), np.sin(angle)
    turned = np.array([[c, s], [-s, c]])
    boxes = [np.array([[a, low], [b, low], [b, high], [a, high]]) @ turned for a, b, low, high in parts if b > a + 0.02]
    assert all(tube.clearance(box) >= NEAR for box in boxes)
    return [np.round(box, 4) for box in boxes]
