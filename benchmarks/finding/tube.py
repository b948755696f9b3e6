"""A fleet driven by known commands, and obstacles and regions drawn around where it goes.

Commands come first: the middle and the ends of the ranges are driven exactly, and all that is put on the map after that
leaves them room. So there is a plan, whatever a planner finds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray

import ensemble_ctrl as ec

from .case import HERE, text_of

Floats = NDArray[np.float64]

NEAR, FAR = 0.04, 0.15
"""Metres from a robot's edge to an obstacle that is drawn beside it: at least, and at most."""
SUBSTEPS = 8
"""Places looked at in one step."""
MEMBERS = 9
"""Members driven, from one end of the range to the other."""


@dataclass(frozen=True, eq=False)
class Tube:
    """Where members go under known commands.

    Attributes
    ----------
    times : ndarray, shape (times,)
        Seconds.
    states : ndarray, shape (members, times, states)
        Those that a task speaks of.
    places : ndarray, shape (members, times, 2)
        Metres; the middle member is the one halfway.
    radius : float
        Of a robot, metres.
    """

    times: Floats
    states: Floats
    places: Floats
    radius: float

    @property
    def middle(self) -> Floats:
        """The way of the middle member, shape (times, 2)."""
        return np.asarray(self.places[len(self.places) // 2])

    def during(self, begin: float, end: float) -> Floats:
        """Places of all members within a window, shape (members, times in it, 2)."""
        inside = (self.times >= begin - 1e-9) & (self.times <= end + 1e-9)
        return np.asarray(self.places[:, inside])

    def box(self, begin: float, end: float, margin: float) -> list[list[float]]:
        """The box ``[[xmin, xmax], [ymin, ymax]]`` around everybody within a window."""
        found = self.during(begin, end).reshape(-1, self.places.shape[-1])
        low, high = found.min(axis=0) - margin, found.max(axis=0) + margin
        return [[float(a), float(b)] for a, b in zip(low, high, strict=True)]

    def clearance(self, corners: Floats, velocity: Floats | None = None) -> float:
        """Metres from the closest robot's edge to a polygon, which may move; its own radius below zero inside."""
        moved = self.places if velocity is None else self.places - self.times[:, None] * velocity
        return float(shapely.distance(shapely.points(moved), shapely.Polygon(corners)).min()) - self.radius

    def normal(self, at: int) -> Floats:
        """Unit vector to the left of the middle member's way at a time."""
        low, high = max(at - SUBSTEPS, 0), min(at + SUBSTEPS, len(self.times) - 1)
        way = self.middle[high] - self.middle[low]
        length = float(np.hypot(*way))
        return np.array([-way[1], way[0]]) / length if length > 1e-6 else np.array([1.0, 0.0])


def driven(fleet: Mapping[str, Any], duration: float, controls: Floats) -> Tube:
    """The fleet of a problem file, with one parameter, under some commands."""
    horizon = {"duration": duration, "steps": len(controls)}
    first = "first" if "first" in fleet["start"] else "x"
    text = text_of({"version": 1, "fleet": fleet, "horizon": horizon, "task": f"F {first} <= 1000000"})
    made = ec.load_text(text, str(HERE / "plants.yaml"), trust=True).fleet
    (distribution,) = made.parameters.values()
    members = np.linspace(distribution.lower, distribution.upper, MEMBERS)[:, None]
    fine = np.repeat(controls, SUBSTEPS, axis=0)
    states = made.trajectories(fine, members, duration / len(fine))
    times = np.linspace(0.0, duration, len(fine) + 1)
    return Tube(times, states, states[..., made.place_columns], made.radius)


def rectangle(centre: Floats, length: float, width: float, turned: float) -> Floats:
    """Corners of a rectangle, shape (4, 2), rounded to a tenth of a millimetre."""
    along = np.array([np.cos(turned), np.sin(turned)])
    across = np.array([-along[1], along[0]])
    signs = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    corners = [centre + a * length / 2 * along + b * width / 2 * across for a, b in signs]
    return np.asarray(np.round(np.array(corners), 4), dtype=float)


def beside(
    tube: Tube,
    place: Floats,
    direction: Floats,
    gap: float,
    size: tuple[float, float],
    turned: float,
    velocity: Floats | None = None,
) -> Floats | None:
    """A rectangle moved from a place along a direction until it leaves a gap to the fleet; None if that is too far."""
    low, high = 0.0, 0.0
    reach = max(size) + 1.0
    while tube.clearance(rectangle(place + high * direction, *size, turned), velocity) < gap:
        low, high = high, high + 0.1
        if high > reach:
            return None
    for _ in range(8):
        half = (low + high) / 2
        free = tube.clearance(rectangle(place + half * direction, *size, turned), velocity) >= gap
        low, high = (low, half) if free else (half, high)
    found = rectangle(place + high * direction, *size, turned)
    return found if tube.clearance(found, velocity) >= NEAR else None


def scattered(tube: Tube, rng: Generator, count: int, part: tuple[float, float] = (0.0, 1.0)) -> list[Floats]:
    """Rectangles beside a part of the way, `NEAR` to `FAR` from the fleet."""
    found: list[Floats] = []
    for _ in range(40 * count):
        if len(found) == count:
            break
        at = int(rng.uniform(*part) * (len(tube.times) - 1))
        side = tube.normal(at) * rng.choice([-1.0, 1.0])
        size = (float(rng.uniform(0.3, 0.9)), float(rng.uniform(0.2, 0.6)))
        turned = float(np.arctan2(side[1], side[0]) + rng.uniform(-0.6, 0.6))
        corners = beside(tube, tube.middle[at], side, float(rng.uniform(NEAR + 0.01, FAR)), size, turned)
        if corners is not None:
            found.append(corners)
    return found


def obstacles_of(corners: Sequence[Floats]) -> dict[str, Any]:
    """The section ``obstacles`` of a problem file."""
    return {f"o{k}": {"polygon": polygon.tolist()} for k, polygon in enumerate(corners)}


def pieces(rng: Generator, steps: int, low: Floats, high: Floats, count: int) -> Floats:
    """Commands that change at `count` - 1 instants, shape (steps, n_u)."""
    cuts = np.sort(rng.choice(np.arange(3, steps - 3), size=count - 1, replace=False))
    values = rng.uniform(low, high, size=(count, len(low)))
    return np.asarray(values[np.searchsorted(cuts, np.arange(steps), side="right")])
