"""Where robots are that do their worst within the bounds: poses on a fine grid of time, and what they command.

Within a piece of time everything is constant, so that a robot without a loop on its heading moves on an exact arc, and
is pushed along a straight line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arcs import Motion
from ..model import ends_of
from .geometry import distance
from .world import Featured, Patch

Floats = NDArray[np.float64]
Rng = np.random.Generator

INSIDE = 1e-7
"""Metres by which a robot has to be in a patch throughout a piece of time for its ground to count."""


@dataclass(frozen=True, eq=False)
class Paths:
    """Robots at the ends of pieces of time.

    Attributes
    ----------
    times : ndarray, shape (pieces + 1,)
    place : ndarray, shape (robots, pieces + 1, 2)
    heading : ndarray, shape (robots, pieces + 1)
        From +x, counter-clockwise, not wrapped.
    rates : dict of str to ndarray of shape (robots, pieces)
        The robots' own speed and turn rate, and their commands.
    bulge : float
        Metres by which a place between two times may be off the chord.
    members : ndarray, shape (robots, parameters)
    """

    times: Floats
    place: Floats
    heading: Floats
    rates: dict[str, Floats]
    bulge: float
    members: Floats


@dataclass(frozen=True, eq=False)
class Will:
    """What each robot does in each piece of time, within the bounds: numbers of -1 to 1, shape (robots, pieces).

    `ground` of 0 is a robot's own value in a patch, and of -1 and 1 are the ends of the hull; `late` is of shape
    (robots, steps) in pieces of time.
    """

    along: Floats
    push: Floats
    turn: Floats
    first: Floats
    second: Floats
    vary: Floats
    ground: Floats
    late: NDArray[np.int64]


def members_of(case: Featured, rng: Rng, count: int) -> Floats:
    """Corners of the ranges, and members in between."""
    ends = np.array([ends_of(one) for one in case.base.distributions.values()]).reshape(-1, 2)
    low, high = ends.T
    share = np.where(rng.random((count, 1)) < 0.7, rng.integers(0, 2, (count, len(low))), rng.random((count, len(low))))
    return np.asarray(np.clip(low + share * (high - low), low, high))


def obedient(count: int, steps: int, each: int) -> Will:
    """Robots that follow their model."""
    still = np.zeros((count, steps * each))
    return Will(still, still, still, still, still, still, still, np.zeros((count, steps), dtype=np.int64))


def willful(case: Featured, rng: Rng, count: int, each: int, aims: Floats | None = None) -> Will:
    """Robots at their bounds: for all the time, or to the one side and then to the other, or back and forth.

    Parameters
    ----------
    case : Featured
    rng : Generator
    count, each : int
        Robots, and pieces of time in a step.
    aims : ndarray, shape (n,), optional
        Angles of which each robot is pushed along one; along any by default.
    """
    steps, pieces = len(case.base.controls), len(case.base.controls) * each
    kinds = [0, 1, 2, 3] if aims is None else [0, 1, 2]

    def signs() -> Floats:
        kind = rng.choice(kinds, count)[:, None]
        turned = np.where(np.arange(pieces) < rng.integers(0, pieces, count)[:, None], 1.0, -1.0)
        waves = np.sign(np.sin(np.arange(pieces) * rng.uniform(0.05, 2.0, count)[:, None] + 0.1))
        own = np.select([kind < 2, kind == 2], [np.ones((count, pieces)), turned], waves)
        return np.asarray(rng.choice([-1.0, 1.0], count)[:, None] * own)

    angles = rng.uniform(-np.pi, np.pi, count) if aims is None else rng.choice(aims, count)
    push = signs() if aims is None else np.ones((count, pieces))
    dt = case.base.duration / pieces
    delay = rng.choice([0, 1], count) * int(case.errors.delay / dt * (1 - 1e-9))
    jitter = int(case.errors.jitter / dt * (1 - 1e-9))
    late = delay[:, None] + rng.integers(-1, 2, (count, steps)) * jitter
    along = angles[:, None] + np.zeros((count, pieces))
    return Will(along, push, signs(), signs(), signs(), signs(), signs(), late)


def driven(case: Featured, members: Floats, will: Will, each: int) -> Paths:
    """The paths of members that do what they want, in `each` pieces of every step."""
    base, errors = case.base, case.errors
    pieces, dt = len(base.controls) * each, base.duration / (len(base.controls) * each)
    _, b, theta, place = (np.asarray(part, float) for part in Motion(base).drives(members))
    model, own = theta.copy(), dict(zip(base.distributions, members.T, strict=True))
    places, headings = [place], [theta]
    rates: dict[str, list[Floats]] = {name: [] for name in ("v", "omega", "first", "second")}
    bulge = 0.0
    for n in range(pieces):
        first, second, moving = _issued(case, will, n, each)
        got = (
            first + (errors.first + errors.share * np.abs(first)) * will.first[:, n],
            second + (errors.second + errors.share * np.abs(second)) * will.second[:, n],
        )
        v, w = np.where(moving, got[0], 0.0), np.where(moving, _turn_rate(case, *got), 0.0)
        factors = _factors(case, own, place, will, n, 2 * np.abs(v) * dt)
        speed, turn = factors[0] * v, factors[1] * w + errors.heading * will.turn[:, n]
        ideal = b * np.where(moving, _turn_rate(case, first, second), 0.0)
        aim = _unit(will.along[:, n]) * will.push[:, n, None]
        push = errors.place * aim + np.array([errors.x, errors.y]) * np.sign(aim)
        if errors.hold is None:
            after = theta + turn * dt
            ahead = np.asarray(np.sinc(turn * dt / 2 / np.pi))
        else:
            # e' = -e / tau + D, by its exact solution; the way is along the heading at the middle
            kept = np.exp(-dt / errors.hold)
            after = model + ideal * dt + kept * (theta - model) + (1 - kept) * errors.hold * (turn - ideal)
            ahead = np.ones(len(members))
        place = place + (speed * ahead * dt)[:, None] * _unit((theta + after) / 2) + push * dt
        rate = (after - theta) / dt
        theta, model = after, model + ideal * dt
        bulge = max(bulge, float(np.abs(speed * rate).max()) * dt**2 / 8)
        places.append(place)
        headings.append(theta)
        for name, value in (("v", speed), ("omega", rate), ("first", got[0]), ("second", got[1])):
            rates[name].append(value)
    times = np.append(np.arange(pieces) * dt, base.duration)
    found = {name: np.stack(value, axis=1) for name, value in rates.items()}
    return Paths(times, np.stack(places, axis=1), np.stack(headings, axis=1), found, bulge, members)


def _unit(angle: Floats) -> Floats:
    """Unit vectors."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _issued(case: Featured, will: Will, n: int, each: int) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """The commands that each robot follows in a piece of time, and whether any have come."""
    steps = len(case.base.controls)
    begun = np.asarray(np.arange(steps) * each + will.late <= n)
    last = np.where(begun.any(axis=1), steps - 1 - begun[:, ::-1].argmax(axis=1), 0)
    first, second = np.array(case.base.controls)[last].T
    return first, second, np.asarray(begun.any(axis=1))


def _turn_rate(case: Featured, first: Floats, second: Floats) -> Floats:
    """Counter-clockwise from +x, for a factor of 1."""
    turn = second if case.base.system == "unicycle" else first * np.tan(second) / case.base.wheelbase
    return turn if case.base.heading_from == "x" else -turn


def _factors(
    case: Featured, own: dict[str, Floats], place: Floats, will: Will, n: int, spare: Floats
) -> tuple[Floats, Floats]:
    """Factors on the speed and the turn rate of robots at some places."""
    count = len(place)
    given = {name: own.get(name, np.ones(count)) for name in ("traction", "linear_traction", "angular_traction")}
    hull = {name: (value, value) for name, value in given.items()}
    for patch in case.terrain.values():
        inside = _inside(patch, place, spare)
        for name, (low, high) in patch.ranges.items():
            least, most = hull[name]
            hull[name] = (
                np.where(inside, np.minimum(least, low), least),
                np.where(inside, np.maximum(most, high), most),
            )
    way, vary = will.ground[:, n], will.vary[:, n]
    for name, (least, most) in hull.items():
        value = given[name] + np.maximum(way, 0) * (most - given[name]) + np.minimum(way, 0) * (given[name] - least)
        given[name] = value + case.errors.varies.get(name, 0.0) * np.abs(own.get(name, np.ones(count))) * vary
    return given["traction"] * given["linear_traction"], given["traction"] * given["angular_traction"]


def _inside(patch: Patch, place: Floats, spare: Floats) -> NDArray[np.bool_]:
    """Whether robots stay inside of a patch for as long as they go no further than `spare`."""
    depth = np.max([-distance(shape, place) for shape in patch.shapes], axis=0)
    return np.asarray(depth > spare + INSIDE)
