"""Occupancy grids as convex pieces: how many, and how long it takes: ``python benchmarks/maps.py``.

Prints what was measured, and keeps it for docs/maps.md.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray
from record import record

from ensemble_ctrl.constraints.cells import Cells

SIDE = 400
CELL = 0.05
CASES = [
    (f"{SIDE} x {SIDE} cells, walls along the axes, tolerance 2 cells", 0.0, 0.0, 2),
    ("the same, turned by 17 degrees", 0.3, 0.0, 2),
    ("the same, turned, with noise along every wall and single cells", 0.3, 0.3, 2),
    ("the same, tolerance 6 cells", 0.3, 0.3, 6),
]
"""In words; turned by so many radians, share of noisy cells beside walls, tolerance in cells."""


def floor_plan(turned: float, noise: float) -> NDArray[np.bool_]:
    """A building with rooms, pillars and furniture; outside of it nothing is known."""
    rng = np.random.default_rng(0)
    row, column = np.mgrid[0:SIDE, 0:SIDE] + 0.5 - SIDE / 2
    u = np.cos(turned) * column + np.sin(turned) * row
    v = np.cos(turned) * row - np.sin(turned) * column
    half = 0.36 * SIDE
    taken = np.maximum(abs(u), abs(v)) > half
    taken |= (abs(u - 0.1 * half) < 2) & (abs(v) > 0.2 * half)
    taken |= (abs(v - 0.3 * half) < 2) & (u < -0.3 * half)
    taken |= (abs(v + 0.4 * half) < 2) & (u > 0.4 * half)
    for _ in range(12):
        (a, b), radius = rng.uniform(-half, half, 2), rng.uniform(3, 9)
        taken |= np.hypot(u - a, v - b) < radius
    for _ in range(8):
        (a, b), (wide, deep) = rng.uniform(-half, half, 2), rng.uniform(4, 20, 2)
        taken |= (abs(u - a) < wide) & (abs(v - b) < deep)
    beside = np.any([np.roll(taken, shift, axis) for axis in (0, 1) for shift in (-1, 1)], axis=0) & ~taken
    taken |= beside & (rng.random(taken.shape) < noise)
    return np.asarray(taken | (rng.random(taken.shape) < 0.002 * noise))


def main() -> None:
    """Cut every case into pieces, three times; print and keep the best times."""
    rows = []
    for what, turned, noise, tolerance in CASES:
        cells, seconds = Cells(floor_plan(turned, noise), CELL), []
        for _ in range(3):
            began = time.perf_counter()
            pieces = cells.pieces(tolerance * CELL)
            seconds.append(time.perf_counter() - began)
        rows.append({"what": what, "pieces": len(pieces), "seconds": min(seconds)})
        print(rows[-1])
    record("maps", rows)


if __name__ == "__main__":
    main()
