"""Draw the office of ``configs/maps``, an occupancy grid as a robot makes it: ``python docs/make_office.py``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

MAPS = Path(__file__).resolve().parents[1] / "configs" / "maps"
CELL = 0.05
WIDTH, HEIGHT = 12.0, 8.0
OUTSIDE = 0.5
FREE, UNKNOWN, TAKEN = 254, 205, 0
WALLS = [
    (0.0, 0.0, 12.0, 0.15),
    (0.0, 7.85, 12.0, 8.0),
    (0.0, 0.0, 0.15, 8.0),
    (11.85, 0.0, 12.0, 8.0),
    (0.0, 3.1, 2.6, 3.2),
    (4.0, 3.1, 8.4, 3.2),
    (9.8, 3.1, 12.0, 3.2),
    (5.9, 0.0, 6.0, 3.1),
    (0.0, 4.9, 1.6, 5.0),
    (3.0, 4.9, 5.2, 5.0),
    (6.6, 4.9, 8.6, 5.0),
    (10.0, 4.9, 12.0, 5.0),
    (3.9, 5.0, 4.0, 8.0),
    (8.2, 5.0, 8.3, 8.0),
]
"""Left, low, right, high, metres: three rooms above a corridor and two below."""
FURNITURE = [
    (0.4, 0.4, 1.2, 1.8),
    (4.6, 0.3, 5.7, 1.1),
    (6.3, 0.3, 8.0, 1.0),
    (10.6, 1.2, 11.6, 2.6),
    (0.4, 6.9, 2.2, 7.6),
    (4.3, 7.1, 6.6, 7.6),
    (8.6, 7.0, 10.4, 7.6),
]
ROUND = [(6.9, 2.2, 0.35), (1.9, 6.0, 0.3), (10.9, 6.2, 0.45), (5.4, 4.1, 0.2), (9.2, 1.9, 0.25)]
"""Middles and radii of tables and a pillar, metres."""


def pixels() -> np.ndarray:
    """The image, top row first."""
    rng = np.random.default_rng(7)
    margin = round(OUTSIDE / CELL)
    rows, columns = round(HEIGHT / CELL) + 2 * margin, round(WIDTH / CELL) + 2 * margin
    y, x = (np.mgrid[0:rows, 0:columns] + 0.5 - margin) * CELL
    image = np.where((x > 0) & (x < WIDTH) & (y > 0) & (y < HEIGHT), FREE, UNKNOWN)
    for left, low, right, high in WALLS + FURNITURE:
        image[(x > left) & (x < right) & (y > low) & (y < high)] = TAKEN
    for middle_x, middle_y, radius in ROUND:
        image[np.hypot(x - middle_x, y - middle_y) < radius] = TAKEN
    taken = image == TAKEN
    beside = sum(np.roll(taken, shift, axis) for axis in (0, 1) for shift in (-1, 1)) > 0
    image[beside & (image == FREE) & (rng.random(image.shape) < 0.08)] = TAKEN
    return image[::-1].astype(np.uint8)


def main() -> None:
    """Write the image and the file that goes with it."""
    Image.fromarray(pixels()).save(MAPS / "office_map.pgm")
    text = f"image: office_map.pgm\nresolution: {CELL}\norigin: [-0.5, -0.5, 0.0]\n"
    text += "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    (MAPS / "office_map.yml").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
