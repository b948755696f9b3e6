"""Problems without a plan, each with the reason; the check of a problem file proves all of them."""

from __future__ import annotations

from typing import Any

from numpy.random import Generator

from .case import Case, text_of
from .driving import OBJECTIVE, unicycle

DURATION, STEPS = 8.0, 40


def impossible(seed: int, rng: Generator) -> Case:
    """Six reasons in turn, with sizes drawn by seed."""
    fleet = unicycle(rng, backwards=True)
    reach = float(fleet["input_bounds"]["v"][1]) * float(fleet["parameters"]["traction"]["range"][1])
    section, reason, refused = KINDS[seed % len(KINDS)](rng, reach)
    horizon = {"duration": DURATION, "steps": STEPS}
    head = {"version": 1, "name": f"impossible_{seed:02d}", "fleet": fleet, "horizon": horizon}
    return Case("impossible", seed, text_of({**head, **section, "objective": OBJECTIVE}), None, reason, refused)


Found = tuple[dict[str, Any], str, bool]
TASK = "F in(goal) and G avoid(obstacles)"


def _box(x: float, y: float, half: float) -> dict[str, Any]:
    """A square."""
    return {"box": [[x - half, x + half], [y - half, y + half]]}


def start_inside(rng: Generator, reach: float) -> Found:
    """The start is in an obstacle."""
    goal = _box(float(rng.uniform(2, 3)), 0.0, 0.4)
    return {"regions": {"goal": goal}, "obstacles": {"o": _box(0.1, 0.1, 0.4)}, "task": TASK}, "start inside", True


def goal_covered(rng: Generator, reach: float) -> Found:
    """The goal is inside an obstacle."""
    x = float(rng.uniform(2, 3))
    section = {"regions": {"goal": _box(x, 0.0, 0.3)}, "obstacles": {"o": _box(x, 0.1, 0.8)}, "task": TASK}
    return section, "goal inside an obstacle", True


def too_far(rng: Generator, reach: float) -> Found:
    """The goal is further than the fastest member drives in the whole time."""
    x = reach * DURATION * float(rng.uniform(1.1, 1.5))
    section = {"regions": {"goal": _box(x + 0.5, 0.0, 0.5)}, "task": "F in(goal)"}
    return section, "further than the top speed times the duration", True


def walled_in(rng: Generator, reach: float) -> Found:
    """Four walls that overlap are all around the goal, and the start is outside of them."""
    x, y, half = float(rng.uniform(2.5, 3.5)), float(rng.uniform(-0.5, 0.5)), 0.8
    walls = {
        "west": {"box": [[x - half - 0.2, x - half], [y - half - 0.2, y + half + 0.2]]},
        "east": {"box": [[x + half, x + half + 0.2], [y - half - 0.2, y + half + 0.2]]},
        "south": {"box": [[x - half - 0.2, x + half + 0.2], [y - half - 0.2, y - half]]},
        "north": {"box": [[x - half - 0.2, x + half + 0.2], [y + half, y + half + 0.2]]},
    }
    section = {"regions": {"goal": _box(x, y, 0.4)}, "obstacles": walls, "task": TASK}
    return section, "a closed wall around the goal", True


def two_places(rng: Generator, reach: float) -> Found:
    """At one time in two regions that are apart."""
    y = float(rng.uniform(1.0, 2.0))
    regions = {"a": _box(2.0, y, 0.5), "b": _box(2.0, -y, 0.4)}
    return {"regions": regions, "task": "G[6,7] in(a) and F[6,7] in(b)"}, "two places at one time", True


def too_soon(rng: Generator, reach: float) -> Found:
    """From one region to the other in less time than the fastest member needs."""
    gap = reach * 1.5 * float(rng.uniform(1.2, 1.6))
    regions = {"a": _box(0.0, gap / 2 + 0.4, 0.4), "b": _box(0.0, -gap / 2 - 0.4, 0.4)}
    task = "F[5,5.5] in(a) and F[6,6.5] in(b)"
    return {"regions": regions, "task": task}, "further apart than the top speed times the time between", True


KINDS = (start_inside, goal_covered, too_far, walled_in, two_places, too_soon)
