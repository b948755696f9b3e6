"""Tours from place to place with a stay at each, and tasks that they do.

The scenarios are those of stlpy (Kurtz and Lin 2022) and of STLPlanning (Sun et al. 2022), drawn anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray

from .case import Case, text_of
from .driving import OBJECTIVE, STEP, door, drive, unicycle
from .tube import Tube, driven, obstacles_of, scattered

Floats = NDArray[np.float64]

STAY = 5
"""Steps at each place."""
MARGIN = 0.25
"""Metres between the fleet at a place and the edge of its region."""
ROOM = 0.6
"""Metres between the way and a region that the fleet does not visit."""


@dataclass(frozen=True, eq=False)
class Tour:
    """A fleet that drives from place to place.

    Attributes
    ----------
    fleet : dict
        The section of a problem file.
    controls : ndarray, shape (steps, 2)
    tube : Tube
    stays : tuple of (float, float)
        When everybody stands at each place, seconds.
    """

    fleet: dict[str, Any]
    controls: Floats
    tube: Tube
    stays: tuple[tuple[float, float], ...]

    @property
    def end(self) -> float:
        """Seconds."""
        return float(self.tube.times[-1])

    def region(self, place: int) -> dict[str, Any]:
        """The box around a place."""
        return {"box": self.tube.box(*self.stays[place], MARGIN)}

    def recurrence(self, places: Sequence[int]) -> tuple[float, float]:
        """``(H, W)``: from every instant up to H, one of these places is visited within W seconds."""
        visits = [self.stays[place] for place in places]
        gaps = [visits[0][0], *(after[0] - before[1] for before, after in pairwise(visits))]
        wait = max(*gaps, self.end - visits[-1][1]) + 2 * STEP
        return round(self.end - wait, 6), round(wait, 6)


def tour(rng: Generator, places: Sequence[Floats], wide: float) -> Tour:
    """Turn on the spot, drive straight, stay: from each place to the next."""
    fleet = unicycle(rng, wide=wide) | {"input_bounds": {"v": [-1.5, 1.5], "omega": [-2.0, 2.0]}}
    here, heading = np.zeros(2), float(fleet["start"]["heading"])
    rows: list[tuple[int, float, float]] = []
    stays = []
    for place in places:
        way = np.asarray(place) - here
        turn = (np.arctan2(way[1], way[0]) - heading + np.pi) % (2 * np.pi) - np.pi
        turning = max(1, int(np.ceil(abs(turn) / (1.6 * STEP))))
        driving = max(1, int(np.ceil(np.hypot(*way) / (1.2 * STEP))))
        rows += [(turning, 0.0, turn / (turning * STEP)), (driving, float(np.hypot(*way)) / (driving * STEP), 0.0)]
        done = sum(n for n, *_ in rows)
        rows.append((STAY, 0.0, 0.0))
        stays.append((round(done * STEP, 6), round((done + STAY) * STEP, 6)))
        here, heading = np.asarray(place), heading + turn
    controls = np.round(np.concatenate([np.tile([v, omega], (n, 1)) for n, v, omega in rows]), 6)
    return Tour(fleet, controls, drive(fleet, controls), tuple(stays))


def case(family: str, seed: int, way: Tour, section: dict[str, Any]) -> Case:
    """The case of a tour."""
    horizon = {"duration": round(way.end, 6), "steps": len(way.controls)}
    head = {"version": 1, "name": f"{family}_{seed:02d}", "fleet": way.fleet, "horizon": horizon}
    return Case(family, seed, text_of({**head, **section, "objective": OBJECTIVE}), way.controls)


def apart(rng: Generator, count: int, size: float, least: float) -> list[Floats]:
    """Places in a square around the start, each so far from the one before, and from the start."""
    found = [np.zeros(2)]
    while len(found) <= count:
        place = np.round(rng.uniform(-size, size, size=2), 3)
        if all(np.hypot(*(place - other)) >= least for other in found):
            found.append(place)
    return found[1:]


def elsewhere(way: Tour, rng: Generator, size: float) -> dict[str, Any]:
    """A region that the fleet does not come near."""
    while True:
        low = rng.uniform(-size, size, size=2)
        box = shapely.box(*low, *(low + 1.0))
        if shapely.distance(shapely.points(way.tube.places), box).min() > ROOM:
            return {"box": [[low[0], low[0] + 1.0], [low[1], low[1] + 1.0]]}


def stlpy(seed: int, rng: Generator) -> Case:
    """One of stlpy's seven scenarios, three draws of each."""
    scenarios = (reach_avoid, points_reach_avoid, either_or, narrow_passage, stepping_stones, multitarget, door_puzzle)
    return scenarios[seed % len(scenarios)]("stlpy", seed, rng)


def stlplanning(seed: int, rng: Generator) -> Case:
    """STLPlanning's rover, wall and doors, two draws of each."""
    return (rover, wall, door_puzzle)[seed % 3]("stlplanning", seed, rng)


def reach_avoid(family: str, seed: int, rng: Generator) -> Case:
    """Reach the goal around obstacles."""
    way = tour(rng, apart(rng, 2, 4.0, 2.5), 0.03)
    walls = obstacles_of(scattered(way.tube, rng, 4))
    section = {"regions": {"goal": way.region(-1)}, "obstacles": walls}
    return case(family, seed, way, section | {"task": "F in(goal) and G avoid(obstacles)"})


def points_reach_avoid(family: str, seed: int, rng: Generator) -> Case:
    """The same for point masses that are pushed."""
    fleet = {
        "model": "double_integrator",
        "parameters": {"mass": {"range": [0.97, 1.03]}},
        "start": {"x": 0, "y": 0, "vx": 0, "vy": 0},
        "input_bounds": {"fx": [-1, 1], "fy": [-1, 1]},
    }
    pushes = rng.uniform([0.3, 0.3], [0.9, 0.9], size=(2, 2)) * rng.choice([-1.0, 1.0], size=(2, 2))
    controls = np.round(np.concatenate([np.tile(push, (10, 1)) for push in (*pushes, -pushes[0], -pushes[1])]), 4)
    duration = round(len(controls) * STEP, 6)
    tube = driven(fleet, duration, controls)
    way = Tour(fleet, controls, tube, ((duration - 0.4, duration),))
    section = {"regions": {"goal": way.region(0)}, "obstacles": obstacles_of(scattered(tube, rng, 4, (0.2, 1.0)))}
    return case(family, seed, way, section | {"task": "F in(goal) and G avoid(obstacles)"})


def either_or(family: str, seed: int, rng: Generator) -> Case:
    """Hold one of two targets, then reach the goal."""
    way = tour(rng, apart(rng, 2, 4.0, 2.5), 0.03)
    hold = round((STAY - 1) * STEP, 6)
    latest = round(way.end - hold, 6)
    regions = {"target1": way.region(0), "target2": elsewhere(way, rng, 4.0), "goal": way.region(1)}
    held = " or ".join(f"F[0,{latest:g}] G[0,{hold:g}] in({name})" for name in ("target1", "target2"))
    section = {"regions": regions, "obstacles": obstacles_of(scattered(way.tube, rng, 3))}
    return case(family, seed, way, section | {"task": f"({held}) and F in(goal) and G avoid(obstacles)"})


def narrow_passage(family: str, seed: int, rng: Generator) -> Case:
    """Through two gaps to one of two goals."""
    way = tour(rng, apart(rng, 2, 4.0, 3.0), 0.02)
    walls = [part for place in (0, 1) for part in door(way.tube, rng, _halfway(way, place))]
    regions = {"goal1": way.region(1), "goal2": elsewhere(way, rng, 6.0)}
    section = {"regions": regions, "obstacles": obstacles_of(walls)}
    return case(family, seed, way, section | {"task": "F (in(goal1) or in(goal2)) and G avoid(obstacles)"})


def _halfway(way: Tour, place: int) -> int:
    """The time halfway from the stay before to a place, as the middle member drives."""
    begin = way.stays[place - 1][1] if place else 0.0
    before, after = np.searchsorted(way.tube.times, [begin, way.stays[place][0]])
    middle = (way.tube.middle[before] + way.tube.middle[after]) / 2
    return int(before + np.hypot(*(way.tube.middle[before:after] - middle).T).argmin())


def stepping_stones(family: str, seed: int, rng: Generator) -> Case:
    """Stand on a stone at every instant."""
    way = tour(rng, apart(rng, 2, 4.0, 2.5), 0.03)
    edges = np.linspace(0.0, way.end, 8)
    spans = zip(np.maximum(edges[:-1] - 0.5, 0.0), np.minimum(edges[1:] + 0.5, way.end), strict=True)
    stones = {f"s{k}": {"box": way.tube.box(*span, 0.3)} for k, span in enumerate(spans)}
    stones |= {"far": elsewhere(way, rng, 6.0), "goal": way.region(1)}
    standing = " or ".join(f"in({name})" for name in stones)
    return case(family, seed, way, {"regions": stones, "task": f"F in(goal) and G ({standing})"})


def multitarget(family: str, seed: int, rng: Generator) -> Case:
    """One target of each of three groups of two."""
    way = tour(rng, apart(rng, 3, 4.5, 2.5), 0.02)
    regions: dict[str, Any] = {}
    parts = []
    for place, colour in enumerate(("red", "green", "blue")):
        regions |= {f"{colour}1": way.region(place), f"{colour}2": elsewhere(way, rng, 6.0)}
        parts.append(f"F (in({colour}1) or in({colour}2))")
    section = {"regions": regions, "obstacles": obstacles_of(scattered(way.tube, rng, 4))}
    return case(family, seed, way, section | {"task": f"{' and '.join(parts)} and G avoid(obstacles)"})


def door_puzzle(family: str, seed: int, rng: Generator) -> Case:
    """Fetch a key before the door that it opens, for two doors."""
    while True:
        way = tour(rng, apart(rng, 4, 5.0, 3.0), 0.01)
        doors = {}
        for key in (0, 1):
            centre = way.tube.middle[_halfway(way, key + 2)]
            doors[f"door{key + 1}"] = {"box": [[c - 0.5, c + 0.5] for c in centre]}
        if all(_untouched(way, doors[f"door{key + 1}"], way.stays[key][1]) for key in (0, 1)):
            break
    walls = [part for place in (2, 3) for part in door(way.tube, rng, _halfway(way, place))]
    regions = {"key1": way.region(0), "key2": way.region(1), "goal": way.region(3), **doors}
    keys = " and ".join(f"not in(door{k}) U in(key{k})" for k in (1, 2))
    section = {"regions": regions, "obstacles": obstacles_of(walls)}
    return case(family, seed, way, section | {"task": f"{keys} and F in(goal) and G avoid(obstacles)"})


def _untouched(way: Tour, region: dict[str, Any], until: float) -> bool:
    """Whether nobody comes near a region up to some time."""
    (left, right), (down, up) = region["box"]
    before = way.tube.during(0.0, until)
    return bool(shapely.distance(shapely.points(before), shapely.box(left, down, right, up)).min() > 0.1)


def wall(family: str, seed: int, rng: Generator) -> Case:
    """Through a gap in a wall into one's own bay, never into the bays of others."""
    way = tour(rng, apart(rng, 1, 4.0, 3.5), 0.03)
    regions = {"bay0": way.region(0), **{f"bay{k}": elsewhere(way, rng, 5.0) for k in (1, 2, 3)}}
    others = " or ".join(f"in(bay{k})" for k in (1, 2, 3))
    section = {"regions": regions, "obstacles": obstacles_of(door(way.tube, rng, _halfway(way, 0)))}
    task = f"F in(bay0) and G not ({others}) and G avoid(obstacles)"
    return case(family, seed, way, section | {"task": task})


def rover(family: str, seed: int, rng: Generator) -> Case:
    """See two sites, charge again and again, and report after each site."""
    charge, radio, one, two = apart(rng, 4, 3.0, 2.0)
    way = tour(rng, [charge, one, radio, charge, two, radio, charge], 0.005)
    last, wait = way.recurrence([0, 3, 6])
    reported = round(max(way.stays[2][0] - way.stays[1][0], way.stays[5][0] - way.stays[4][0]) + 3.0, 6)
    names = {"charge": 0, "site1": 1, "radio": 2, "site2": 4}
    regions = {name: {"box": _around(way, way.tube.middle[_at(way, place)])} for name, place in names.items()}
    task = (
        f"G[0,{last:g}] F[0,{wait:g}] in(charge) and F in(site1) and F in(site2) and "
        f"G[0,{way.end - reported:g}] (in(site1) or in(site2) => F[0,{reported:g}] in(radio)) and G avoid(obstacles)"
    )
    section = {"regions": regions, "obstacles": obstacles_of(scattered(way.tube, rng, 4))}
    return case(family, seed, way, section | {"task": task})


def visits(seed: int, rng: Generator) -> Case:
    """Two or three posts that are seen again and again."""
    posts = apart(rng, 2 + seed % 2, 3.0, 2.5)
    rounds = 3 if len(posts) == 2 else 2
    way = tour(rng, posts * rounds, 0.005)
    regions: dict[str, Any] = {}
    parts = []
    for k in range(len(posts)):
        last, wait = way.recurrence(range(k, len(way.stays), len(posts)))
        regions[f"post{k}"] = {"box": _around(way, way.tube.middle[_at(way, k)])}
        parts.append(f"G[0,{last:g}] F[0,{wait:g}] in(post{k})")
    section = {"regions": regions, "obstacles": obstacles_of(scattered(way.tube, rng, 3 + seed % 6))}
    return case("visits", seed, way, section | {"task": f"{' and '.join(parts)} and G avoid(obstacles)"})


def _at(way: Tour, place: int) -> int:
    """The time in the middle of a stay."""
    return int(np.searchsorted(way.tube.times, np.mean(way.stays[place])))


def _around(way: Tour, centre: Floats) -> list[list[float]]:
    """A box around a place that holds every stay there of everybody."""
    half = 0.4
    for begin, end in way.stays:
        found = np.abs(way.tube.during(begin, end) - centre)
        if np.hypot(*found.reshape(-1, 2).mean(axis=0)) < 1.0:
            half = max(half, float(found.max()) + MARGIN / 2)
    return [[c - half, c + half] for c in centre]
