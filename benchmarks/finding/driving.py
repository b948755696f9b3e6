"""Parking, doors, mazes, fields of poles and moving obstacles: commands first, then the map."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from .case import Case, text_of
from .tube import FAR, NEAR, SUBSTEPS, Tube, beside, driven, obstacles_of, pieces, rectangle, scattered

Floats = NDArray[np.float64]

STEP = 0.2
"""Seconds."""
OBJECTIVE = {"robustness": 0.5, "effort": 0.1}


def unicycle(rng: Generator, backwards: bool = False, wide: float = 0.03) -> dict[str, Any]:
    """Differential drives whose traction is known to three per cent."""
    top = round(float(rng.uniform(0.9, 1.2)), 3)
    return {
        "model": "unicycle",
        "parameters": {"traction": {"range": [1 - wide, 1 + wide]}},
        "start": {"position": [0, 0], "heading": round(float(rng.uniform(-np.pi, np.pi)), 4)},
        "input_bounds": {"v": [-top if backwards else 0, top], "omega": [-0.8, 0.8]},
    }


def bicycle(rng: Generator, wide: float = 0.02, radius: float = 0.0) -> dict[str, Any]:
    """Car-like robots that may reverse."""
    return {
        "model": "bicycle",
        "wheelbase": 0.4,
        "parameters": {"traction": {"range": [1 - wide, 1 + wide]}},
        "start": {"position": [0, 0], "heading": round(float(rng.uniform(-np.pi, np.pi)), 4)},
        "input_bounds": {"v": [-0.6, 0.8], "delta": [-0.6, 0.6]},
        "radius": radius,
    }


def case(family: str, seed: int, fleet: dict[str, Any], controls: Floats, section: dict[str, Any]) -> Case:
    """A case in the step of these families."""
    horizon = {"duration": round(len(controls) * STEP, 6), "steps": len(controls)}
    head = {"version": 1, "name": f"{family}_{seed:02d}", "fleet": fleet, "horizon": horizon}
    return Case(family, seed, text_of({**head, **section, "objective": OBJECTIVE}), controls)


def drive(fleet: dict[str, Any], controls: Floats) -> Tube:
    """The fleet under these commands."""
    return driven(fleet, len(controls) * STEP, controls)


def long_enough(fleet: dict[str, Any], draw: Callable[[], Floats], metres: float) -> tuple[Floats, Tube]:
    """Commands that end so far from the start, the best of twenty draws."""
    tried = [(controls, drive(fleet, controls)) for controls in (np.round(draw(), 4) for _ in range(20))]
    for controls, tube in tried:
        if np.hypot(*(tube.middle[-1] - tube.middle[0])) >= metres:
            return controls, tube
    return max(tried, key=lambda one: float(np.hypot(*(one[1].middle[-1] - one[1].middle[0]))))


def ends_in(tube: Tube, seconds: float, margin: float) -> tuple[dict[str, Any], str]:
    """A goal around the last seconds of the way, and its window."""
    end = float(tube.times[-1])
    return {"goal": {"box": tube.box(end - seconds, end, margin)}}, f"[{end - seconds:.6g},{end:.6g}]"


def parking(seed: int, rng: Generator) -> Case:
    """Even seeds reverse into a slot and stand there; odd ones back out of a dead end and drive on."""
    fleet = bicycle(rng, radius=0.1)
    turn, side = float(rng.uniform(0.35, 0.55)), float(rng.choice([-1.0, 1.0]))
    if seed % 2 == 0:
        first, arc = int(rng.integers(8, 13)), int(rng.integers(9, 13))
        legs = [(first, 0.5, -0.1 * side), (arc, -0.5, turn * side), (arc, -0.5, -turn * side), (8, 0.0, 0.0)]
    else:
        back, arc, on = int(rng.integers(12, 17)), int(rng.integers(7, 12)), int(rng.integers(14, 20))
        legs = [(back, -0.5, 0.0), (arc, -0.5, turn * side), (on, 0.6, -0.5 * turn * side), (8, 0.6, 0.1)]
    controls = np.round(np.concatenate([np.tile([v, delta], (n, 1)) for n, v, delta in legs]), 4)
    tube = drive(fleet, controls)
    around = _slot(tube, rng) if seed % 2 == 0 else _dead_end(tube, rng, float(fleet["start"]["heading"]))
    regions, window = ends_in(tube, 1.0, 0.08)
    task = f"{'G' if seed % 2 == 0 else 'F'}{window} in(goal) and G avoid(obstacles)"
    walls = obstacles_of([*around, *scattered(tube, rng, 4)])
    return case("parking", seed, fleet, controls, {"regions": regions, "obstacles": walls, "task": task})


def _slot(tube: Tube, rng: Generator) -> list[Floats]:
    """Cars and a kerb around the end of the way: behind it, and on both sides."""
    end, before = tube.middle[-1], tube.middle[-1 - 16 * SUBSTEPS]
    along = (end - before) / np.hypot(*(end - before))
    across, turned = np.array([-along[1], along[0]]), float(np.arctan2(along[1], along[0]))
    wanted = [(along, (0.2, 1.0)), (across, (0.9, 0.4)), (-across, (0.9, 0.4))]
    found = [beside(tube, end, way, float(rng.uniform(NEAR + 0.01, FAR)), size, turned) for way, size in wanted]
    return [corners for corners in found if corners is not None]


def _dead_end(tube: Tube, rng: Generator, heading: float) -> list[Floats]:
    """Walls on both sides of the start, and one ahead."""
    along = np.array([np.cos(heading), np.sin(heading)])
    across = np.array([-along[1], along[0]])
    back = 0.25 * along
    wanted = [(along, 0 * along, (0.2, 0.9)), (across, -back, (1.2, 0.2)), (-across, -back, (1.2, 0.2))]
    gaps = rng.uniform(NEAR + 0.01, FAR, size=3)
    found = [
        beside(tube, tube.middle[0] + shift, way, float(gap), size, heading)
        for (way, shift, size), gap in zip(wanted, gaps, strict=True)
    ]
    return [corners for corners in found if corners is not None]


def doors(seed: int, rng: Generator) -> Case:
    """Two or three walls across the way, each with a gap little wider than the fleet."""
    fleet = bicycle(rng, radius=0.1) if seed % 2 else {**unicycle(rng, wide=0.02), "radius": 0.1}
    low, high = ([0.4, -0.25], [0.7, 0.25]) if seed % 2 else ([0.5, -0.4], [0.9, 0.4])
    controls, tube = long_enough(fleet, lambda: pieces(rng, 45, np.array(low), np.array(high), 4), 3.0)
    walls = []
    for share in np.linspace(0.25, 0.8, 2 + seed % 3 // 2):
        at = int((share + rng.uniform(-0.05, 0.05)) * (len(tube.times) - 1))
        walls += door(tube, rng, at)
    regions, window = ends_in(tube, 1.0, 0.15)
    section = {"regions": regions, "obstacles": obstacles_of(walls)}
    return case("doors", seed, fleet, controls, section | {"task": f"F{window} in(goal) and G avoid(obstacles)"})


def door(tube: Tube, rng: Generator, at: int) -> list[Floats]:
    """Both parts of a wall across the way, as long as the rest of the way allows."""
    normal, parts = tube.normal(at), []
    turned = float(np.arctan2(normal[1], normal[0]))
    for side in (normal, -normal):
        gap, width = float(rng.uniform(NEAR + 0.01, FAR)), float(rng.uniform(0.1, 0.2))
        for length in (2.5, 1.5, 0.8, 0.4):
            start = tube.middle[at] + side * length / 2
            corners = beside(tube, start, side, gap, (length, width), turned)
            if corners is not None and tube.clearance(corners) < 2 * FAR:
                parts.append(corners)
                break
    return parts


def mazes(seed: int, rng: Generator) -> Case:
    """From 5 to 40 rectangles beside ways that turn, reverse, or steer."""
    kind = seed % 3
    fleet = bicycle(rng) if kind == 2 else unicycle(rng, backwards=kind == 1)
    top = fleet["input_bounds"]["v"][1]
    low = {0: [0.5 * top, -0.5], 1: [-top, -0.5], 2: [-0.5, -0.4]}[kind]
    high = {0: [top, 0.5], 1: [top, 0.5], 2: [0.75, 0.4]}[kind]
    controls, tube = long_enough(fleet, lambda: pieces(rng, 40, np.array(low), np.array(high), 5), 1.5)
    walls = scattered(tube, rng, round(5 + 35 * (seed % 30) / 29))
    regions, window = ends_in(tube, 1.6, 0.12)
    section = {"regions": regions, "obstacles": obstacles_of(walls)}
    return case("mazes", seed, fleet, controls, section | {"task": f"F{window} in(goal) and G avoid(obstacles)"})


def poles(seed: int, rng: Generator) -> Case:
    """From 50 to 400 poles on a field, thirty of them beside the way."""
    fleet = unicycle(rng, wide=0.02)
    low, high = np.array([0.7 * fleet["input_bounds"]["v"][1], -0.3]), np.array([fleet["input_bounds"]["v"][1], 0.3])
    controls, tube = long_enough(fleet, lambda: pieces(rng, 60, low, high, 5), 6.0)
    count = round(50 + 350 * (seed % 5) / 4)
    near = poles_beside(tube, rng, 30)
    (left, right), (down, up) = tube.box(0, tube.times[-1], 1.5)
    while len(near) < count:
        centre, size = rng.uniform([left, down], [right, up]), float(rng.uniform(0.06, 0.14))
        turned = float(rng.uniform(0, np.pi / 2))
        corners = rectangle(centre, size, size, turned)
        if tube.clearance(corners) > NEAR + 0.01:
            near.append(corners)
    regions, window = ends_in(tube, 1.0, 0.15)
    section = {"regions": regions, "obstacles": obstacles_of(near)}
    return case("poles", seed, fleet, controls, section | {"task": f"F{window} in(goal) and G avoid(obstacles)"})


def poles_beside(tube: Tube, rng: Generator, count: int) -> list[Floats]:
    """Poles beside the way, from end to end."""
    found = []
    for share in np.linspace(0.02, 0.98, count):
        at = int(share * (len(tube.times) - 1))
        side, size = tube.normal(at) * rng.choice([-1.0, 1.0]), float(rng.uniform(0.06, 0.14))
        turned = float(rng.uniform(0, np.pi / 2))
        corners = beside(tube, tube.middle[at], side, float(rng.uniform(NEAR + 0.01, FAR)), (size, size), turned)
        if corners is not None:
            found.append(corners)
    return found


def moving(seed: int, rng: Generator) -> Case:
    """One to three rectangles that move past the fleet, and some that stand."""
    fleet = unicycle(rng, wide=0.02)
    low, high = np.array([0.3, -0.5]), np.array([fleet["input_bounds"]["v"][1], 0.5])
    controls, tube = long_enough(fleet, lambda: pieces(rng, 40, low, high, 4), 2.5)
    named, motions = obstacles_of(scattered(tube, rng, 5)), dict[str, Any]()
    while len(motions) < 1 + seed % 3:
        velocity = np.round(rng.uniform(0.1, 0.5) * _unit(rng), 3)
        at = int(rng.uniform(0.3, 0.8) * (len(tube.times) - 1))
        # in the frame that moves with it the rectangle stands still where it is at this time
        place, side = tube.middle[at] - tube.times[at] * velocity, tube.normal(at) * rng.choice([-1.0, 1.0])
        gap, turned = float(rng.uniform(NEAR + 0.01, FAR)), float(rng.uniform(0, np.pi))
        corners = beside(tube, place, side, gap, (0.6, 0.4), turned, velocity)
        if corners is not None:
            name = f"m{len(motions)}"
            named[name], motions[name] = {"polygon": corners.tolist()}, {"velocity": velocity.tolist()}
    regions, window = ends_in(tube, 1.2, 0.12)
    section = {"regions": regions, "obstacles": named, "motions": motions}
    return case("moving", seed, fleet, controls, section | {"task": f"F{window} in(goal) and G avoid(obstacles)"})


def _unit(rng: Generator) -> Floats:
    """A direction."""
    angle = rng.uniform(-np.pi, np.pi)
    return np.array([np.cos(angle), np.sin(angle)])
