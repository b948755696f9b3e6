"""Robots that do their worst within the stated bounds, moved in short exact arcs by nothing of the package."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
PARTS = 20
"""Arcs of a control step, in each of which factors and slips are constant."""


@dataclass(frozen=True)
class Adversary:
    """How a robot is the worst.

    Attributes
    ----------
    factors : dict of str to float
        True parameters at the start.
    drift : str
        ``up`` and ``down`` at the allowed rate, ``back`` and forth, ``fall`` after a while, ``still``.
    slip : str
        Of the actuators: ``plus``, ``minus``, ``alternate``, ``random``; all but the last at the bounds.
    noise : str
        Of measurements: always in one ``corner`` of the bounds, ``alternate``, ``random``, ``late corner``.
    period : int
        Control steps between measurements.
    offset : float
        Share of a control step by which they miss grid times.
    delay : float
        Seconds that they take.
    lost : float
        Share of them that never arrive.
    repeats, shuffles : bool
        Whether some arrive twice, and some in the wrong order.
    turns : int
        Whole turns that are added to the heading.
    silent : float
        Seconds after which nothing arrives any more.
    """

    factors: dict[str, float]
    drift: str = "still"
    slip: str = "random"
    noise: str = "random"
    period: int = 1
    offset: float = 0.0
    delay: float = 0.0
    lost: float = 0.0
    repeats: bool = False
    shuffles: bool = False
    turns: int = 0
    silent: float = np.inf
    seed: int = 0


def moved(pose: Floats, v: float, turn: float, span: float) -> Floats:
    """A pose after some seconds on an arc."""
    x, y, heading = map(float, pose)
    angle = turn * span
    if abs(angle) < 1e-9:
        middle = heading + angle / 2
        return np.array([x + v * span * math.cos(middle), y + v * span * math.sin(middle), heading + angle])
    radius, after = v / turn, heading + angle
    across, along = math.sin(after) - math.sin(heading), math.cos(heading) - math.cos(after)
    return np.array([x + radius * across, y + radius * along, after])


def bounced(start: float, way: float, low: float, high: float) -> float:
    """A value that moves by `way` from `start`, and turns back at the ends of its range."""
    if high <= low:
        return low
    at = (start - low + way) % (2 * (high - low))
    return low + min(at, 2 * (high - low) - at)


@dataclass
class Body:
    """A robot's true motion on the loop's clock.

    Attributes
    ----------
    track : list of ndarray
        Poses, `PARTS` for each control step, the start first.
    saturates : bool
        Whether parameters stay at the ends of their ranges, where otherwise they turn back.
    """

    adversary: Adversary
    ranges: dict[str, tuple[float, float]]
    errors: dict[str, float]
    step: float
    pose: Floats
    track: list[Floats] = field(default_factory=list)
    saturates: bool = False

    def __post_init__(self) -> None:
        self.track = [self.pose.copy()]
        self.random = np.random.default_rng(self.adversary.seed)

    @property
    def now(self) -> float:
        """Seconds."""
        return (len(self.track) - 1) * self.step / PARTS

    def parameter(self, name: str, time: float) -> float:
        """A true parameter at a time."""
        start, (low, high), rate = self.adversary.factors[name], self.ranges[name], self.errors["drift"]
        match self.adversary.drift:
            case "up":
                way = rate * time
            case "down":
                way = -rate * time
            case "back":
                period = 0.7
                way = rate * (period / 2 - abs(time % period - period / 2)) * (1 if int(time / period) % 2 else -1)
            case "fall":
                way = rate * max(time - 1.0, 0.0)
            case _:
                way = 0.0
        return min(max(start + way, low), high) if self.saturates else bounced(start, way, low, high)

    def factors(self, time: float) -> tuple[float, float]:
        """Factors on speed and turn rate."""
        if "traction" in self.ranges:
            both = self.parameter("traction", time)
            return both, both
        names = ("linear_traction", "angular_traction")
        a, b = (self.parameter(name, time) if name in self.ranges else 1.0 for name in names)
        return a, b

    def drive(self, v: float, turn: float) -> None:
        """One part of a step."""
        step_number = (len(self.track) - 1) // PARTS
        part = self.step / PARTS
        a, b = self.factors(self.now + part / 2)
        if v or turn:
            sign = {"plus": (1.0, 1.0), "minus": (-1.0, -1.0)}.get(self.adversary.slip)
            if sign is None:
                sign = (1.0, -1.0) if self.adversary.slip == "alternate" and step_number % 2 else (-1.0, 1.0)
            if self.adversary.slip == "random":
                sign = tuple(self.random.uniform(-1, 1, 2))
            v, turn = v + sign[0] * self.errors["speed"], turn + sign[1] * self.errors["turn_rate"]
        self.pose = moved(self.pose, a * v, b * turn, part)
        self.track.append(self.pose)

    def future(self, commands: Callable[[float], Floats], parts: int, drift: str, slip: str) -> Floats:
        """Where it goes from now on if it does its worst otherwise, shape (parts + 1, 3)."""
        other = Body(self.adversary, self.ranges, self.errors, self.step, self.pose.copy())
        now = self.now
        values = {name: self.parameter(name, now) for name in self.ranges}
        other.adversary = Adversary(values, drift, slip, seed=self.adversary.seed)
        for k in range(parts):
            v, turn = commands(now + (k + 0.5) * self.step / PARTS)
            other.drive(float(v), float(turn))
        return np.array(other.track)


@dataclass
class Camera:
    """Measurements of a robot, at the bounds, that arrive when they do."""

    body: Body
    post: list[tuple[float, Floats]] = field(default_factory=list)
    taken: int = 0

    def look(self) -> None:
        """Measure, if it is time to; the first is at 0 and always arrives."""
        body, how = self.body, self.body.adversary
        part = len(body.track) - 1
        if part and (part - round(how.offset * PARTS)) % (how.period * PARTS):
            return
        now = body.now
        if part and (body.random.random() < how.lost or now > how.silent):
            return
        x, y, heading = body.pose + self._noise(now)
        seen = np.array([now, x, y, heading + 2 * np.pi * how.turns])
        late = how.delay + (0.15 if how.shuffles and body.random.random() < 0.5 else 0.0)
        self.post.append((now + (late if part else 0.0), seen))
        if how.repeats and body.random.random() < 0.5:
            self.post.append((now + late + 0.1, seen))

    def read(self) -> Floats | None:
        """The next that has arrived: the newest that has, but for those that are late."""
        arrived = sorted((item for item in self.post if item[0] <= self.body.now + 1e-9), key=lambda item: item[0])
        self.post = [item for item in self.post if item[0] > self.body.now + 1e-9]
        return arrived[-1][1] if arrived else None

    def _noise(self, time: float) -> Floats:
        """An error within the bounds."""
        errors, how = self.body.errors, self.body.adversary
        self.taken += 1
        signs = np.array([1.0, -1.0, 1.0])
        if how.noise == "alternate" and self.taken % 2:
            signs = -signs
        if how.noise == "random" or (how.noise == "late corner" and time < 1.0):
            signs = self.body.random.uniform(-1, 1, 3)
        size = np.array([errors["position"], errors["position"], min(errors["heading"], np.pi)])
        return np.asarray(signs * size * (1 - 1e-9))
