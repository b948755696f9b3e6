"""First guesses: a geometric route through the task's regions in order, driven by a nominal robot."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import Eventually, Inside
from ensemble_ctrl.duties import duties, other_parts
from ensemble_ctrl.ocp.routes import Route, routes
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

CLEARANCES = (0.3, 0.15, 0.05, 0.01)
"""Clearances beyond radius and margin that a route tries to keep, as shares of a tenth of the map's size, widest first."""
TOP_SPEED_SHARE = 0.95
"""Share of the input bounds that a guess uses, so that it starts inside them."""


@dataclass(frozen=True, eq=False)
class Seed:
    """A guess: the controls, shape (steps, 2), and the route they follow."""

    controls: Floats
    corners: Floats
    length: float


@dataclass(frozen=True, eq=False)
class Stop:
    """A place to be at, and when (seconds)."""

    place: Floats
    time: float


def seeds(problem: Problem, steps: int, most: int) -> list[Seed]:
    """Up to `most` guesses on a grid of `steps`, shortest route first; a straight line where there is no route."""
    stops = itinerary(problem)
    legs = [problem.fleet.position, *(stop.place for stop in stops)]
    found = [_leg_routes(problem, a, b, most) for a, b in zip(legs[:-1], legs[1:], strict=True)]
    chains = sorted(product(*found), key=lambda chain: sum(r.length for r in chain))[:most]
    return [_seed(problem, chain, [stop.time for stop in stops], steps) for chain in chains]


def itinerary(problem: Problem) -> list[Stop]:
    """Where the task sends the fleet, by time: the regions it must visit, then the terminal target."""
    visits = [
        Stop(_inside(problem, leaf.name), _arrival(problem, part))
        for part in other_parts(problem)
        if isinstance(part, Eventually) and isinstance(leaf := part.child, Inside)
    ]
    stops = sorted(visits, key=lambda stop: stop.time)
    target = problem.objective.target
    if not stops or (target is not None and np.linalg.norm(stops[-1].place - target) > 1e-6):
        last = problem.fleet.position if target is None else target
        stops.append(Stop(np.asarray(last), problem.duration))
    return stops


def _inside(problem: Problem, region: str) -> Floats:
    """A point of the region: the terminal target if it is there, else the middle."""
    area, target = problem.regions[region], problem.objective.target
    if target is not None and bool(area.contains(target)):
        return np.asarray(target)
    return np.asarray(area.vertices.mean(axis=0))


def _arrival(problem: Problem, visit: Eventually) -> float:
    """The middle of the window, within the horizon."""
    a, b = visit.a or 0.0, visit.b
    end = problem.duration if b is None else min(b, problem.duration)
    return (a + end) / 2


def _leg_routes(problem: Problem, start: Floats, goal: Floats, most: int) -> list[Route]:
    """Routes of different kinds for one leg; each kind with the widest clearance that admits it."""
    pieces = [piece for duty in duties(problem) for piece in duty.pieces]
    base = problem.fleet.radius + problem.solve.margin
    corners = np.concatenate([[start, goal], *(piece.vertices for piece in pieces)])
    scale = float(np.ptp(corners, axis=0).max()) / 10
    kinds: dict[tuple[int, ...], Route] = {}
    for share in CLEARANCES:
        for route in routes(start, goal, pieces, base + share * scale, most):
            kinds.setdefault(route.word, route)
        if len(kinds) >= most:
            break
    straight = Route(np.stack([start, goal]), float(np.linalg.norm(goal - start)), ())
    return sorted(kinds.values(), key=lambda route: route.length) or [straight]


def _seed(problem: Problem, chain: tuple[Route, ...], arrivals: list[float], steps: int) -> Seed:
    """Controls that follow a chain of routes, each arriving at its time."""
    times, places = [0.0], [chain[0].corners[:1]]
    for route, arrival in zip(chain, arrivals, strict=True):
        along = np.linalg.norm(np.diff(route.corners, axis=0), axis=1).cumsum()
        share = along / max(along[-1], 1e-12)
        times.extend(times[-1] + share * max(arrival - times[-1], 1e-6))
        places.append(route.corners[1:])
    grid = np.linspace(0.0, problem.duration, steps + 1)
    corners = np.concatenate(places)
    path = np.stack([np.interp(grid, times, corners[:, axis]) for axis in (0, 1)], axis=1)
    return Seed(_follow(problem, _smoothed(path)), corners, sum(route.length for route in chain))


def _smoothed(path: Floats) -> Floats:
    """A moving average over a sixteenth of the horizon, ends kept."""
    half = max(len(path) // 32, 1)
    padded = np.concatenate([np.repeat(path[:1], half, axis=0), path, np.repeat(path[-1:], half, axis=0)])
    kernel = np.full(2 * half + 1, 1 / (2 * half + 1))
    return np.stack([np.convolve(padded[:, axis], kernel, "valid") for axis in (0, 1)], axis=1)


def _follow(problem: Problem, path: Floats) -> Floats:
    """Commands with which the nominal robot follows `path`, within the input bounds."""
    fleet, step = problem.fleet, problem.duration / (len(path) - 1)
    nominal = float(fleet.parameter.center)
    low = np.maximum(TOP_SPEED_SHARE * fleet.input_lower, fleet.input_lower)
    high = np.minimum(TOP_SPEED_SHARE * fleet.input_upper, fleet.input_upper)
    sign = 1.0 if fleet.system.heading_from == "x" else -1.0
    place, heading = fleet.position.copy(), fleet.heading
    controls = np.zeros((len(path) - 1, 2))
    for n in range(len(controls)):
        ahead = path[n + 1] - place
        distance = float(np.hypot(*ahead))
        wanted = np.arctan2(ahead[1], ahead[0]) if distance > 1e-3 else heading
        error = (wanted - heading + np.pi) % (2 * np.pi) - np.pi
        turn = np.clip(sign * 2 * error / (step * nominal), low[1], high[1]) if distance > 1e-3 else 0.0
        speed = np.clip(distance * max(np.cos(error), 0.0) / (step * nominal), low[0], high[0])
        controls[n] = speed, np.clip(0.7 * turn, low[1], high[1])
        half = sign * nominal * controls[n, 1] * step / 2
        place = place + nominal * speed * step * np.array([np.cos(heading + half), np.sin(heading + half)])
        heading += 2 * half
    return controls
