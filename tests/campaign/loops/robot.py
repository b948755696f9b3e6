"""Robots that do their worst within the stated bounds, moved in short exact arcs by nothing of the package."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
BOUNDS = ("place", "heading", "first", "second", "share", "stray", "hold", "delay", "jitter")
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
        Of all errors beside the model: ``plus``, ``minus``, ``alternate``, ``random``; all but the last at the bounds.
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


def as_given(command: Floats) -> tuple[float, float]:
    """Commands that are speed and turn rate."""
    return float(command[0]), float(command[1])


@dataclass
class Body:
    """A robot's true motion on the loop's clock.

    Attributes
    ----------
    errors : dict of str to float
        Bounds of measurements and of the drift.
    bounds : dict of str to float
        Bounds of errors beside the model, zero where not given: of the rates of ``place`` and ``heading``, of the
        commands ``first`` and ``second``, a ``share`` of both, by how much parameters ``stray``, and the time constant
        ``hold`` of the loop on the heading; and the longest ``delay`` and the ``jitter`` of its commands.
    rates : callable
        Speed and turn rate, counter-clockwise, that a command asks for.
    off : float
        The error of its heading that such a loop drives back.
    track : list of ndarray
        Poses, `PARTS` for each control step, the start first.
    saturates : bool
        Whether parameters stay at the ends of their ranges, where otherwise they turn back.
    patches : tuple
        Corners of convex patches, counter-clockwise, with the least and the largest factor on the speed in each.
    late : int
        Parts of control steps by which all of its commands are late.
    begun : int
        Parts before the track.
    shifts : dict of int to int
        Parts by which the commands of each step are late beside that.
    """

    adversary: Adversary
    ranges: dict[str, tuple[float, float]]
    errors: dict[str, float]
    step: float
    pose: Floats
    bounds: dict[str, float] = field(default_factory=dict)
    rates: Callable[[Floats], tuple[float, float]] = as_given
    off: float = 0.0
    track: list[Floats] = field(default_factory=list)
    saturates: bool = False
    patches: tuple[tuple[tuple[tuple[float, float], ...], float, float], ...] = ()
    late: int = -1
    begun: int = 0
    shifts: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.track = [self.pose.copy()]
        self.random = np.random.default_rng(self.adversary.seed)
        if self.late < 0:
            longest = math.floor(self.bounds.get("delay", 0.0) * PARTS / self.step + 1e-9)
            self.late = int(np.random.default_rng(self.adversary.seed).choice([0, longest // 2, longest]))

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

    def due(self, given: Callable[[int], Floats]) -> tuple[Floats, Floats]:
        """The commands that are carried out in the next part, and those of the model; `given` is by control steps."""
        part = self.begun + len(self.track) - 1 - self.late
        k = part // PARTS
        begun = [n for n in (k - 1, k, k + 1) if n * PARTS + self._shift(n) <= part]
        return given(begun[-1]), given(k)

    def _shift(self, n: int) -> int:
        """Parts by which the commands of a step are late, or early."""
        most = math.floor(self.bounds.get("jitter", 0.0) * PARTS / self.step + 1e-9)
        if n not in self.shifts:
            sign = {"plus": 1, "minus": -1, "alternate": 1 - 2 * (n % 2)}.get(self.adversary.slip)
            self.shifts[n] = most * sign if sign else int(self.random.integers(-most, most + 1)) if most else 0
        return self.shifts[n]

    def drive(self, given: Callable[[int], Floats]) -> None:
        """One part of a step."""
        part = self.step / PARTS
        command, meant = self.due(given)
        a, b = self.factors(self.now + part / 2)
        v, turn = self.rates(command)
        model = b * self.rates(meant)[1]
        if v or turn:
            v, turn = a * v, b * turn
            if self.bounds:
                v, turn, push = self._disturbed(command, (a, b), model, part)
                self.pose = self.pose + part * push
            v *= self._on_ground(abs(v) * part, a if "linear_traction" in self.ranges else 1.0)
        elif self.bounds.get("hold"):
            self.off -= model * part
        self.pose = moved(self.pose, v, turn, part)
        self.track.append(self.pose)

    def _on_ground(self, way: float, own: float) -> float:
        """What the patches that it is in, and stays in, multiply its speed with; `own` is the parameter elsewhere."""
        found = 1.0
        for corners, low, high in self.patches:
            points = np.array(corners)
            edges = np.roll(points, -1, axis=0) - points
            inward = (self.pose[:2] - points) @ np.array([[0.0, -1.0], [1.0, 0.0]])
            depth = (edges * inward).sum(axis=1) / np.hypot(*edges.T)
            if float(depth.min()) > max(high / own, 1.0) * way:
                drawn = low + self.random.random() * (high - low)
                found = {"plus": high, "minus": low}.get(self.adversary.slip, drawn) / own
        return found

    def _disturbed(
        self, command: Floats, own: tuple[float, float], model: float, part: float
    ) -> tuple[float, float, Floats]:
        """Rates with all errors, and what pushes the pose, at a sign of each error that is its worst or drawn."""
        bounds, sign = {name: self.bounds.get(name, 0.0) for name in BOUNDS}, self._signs()
        most = np.array([bounds["first"], bounds["second"]]) + bounds["share"] * np.abs(command)
        v, turn = self.rates(command + sign[:2] * most)
        stray = 1 + bounds["stray"] * sign[2]
        both = "traction" in self.ranges
        v *= own[0] * (stray if both or "linear_traction" in self.ranges else 1.0)
        turn *= own[1] * (stray if both or "angular_traction" in self.ranges else 1.0)
        turn += sign[3] * bounds["heading"]
        if bounds["hold"]:
            gained = (turn - model - self.off / bounds["hold"]) / (1 + part / bounds["hold"])
            self.off, turn = self.off + part * gained, model + gained
        side = float(self.pose[2]) + sign[4] * np.pi / 2
        return v, turn, bounds["place"] * np.array([math.cos(side), math.sin(side), 0.0])

    def _signs(self) -> Floats:
        """Of every error."""
        number = (len(self.track) - 1) // PARTS
        match self.adversary.slip:
            case "plus":
                return np.ones(5)
            case "minus":
                return -np.ones(5)
            case "alternate":
                return np.array([-1.0, 1.0, -1.0, 1.0, 1.0]) * (-1.0 if number % 2 else 1.0)
        return self.random.uniform(-1, 1, 5)

    def future(self, commands: Callable[[int], Floats], parts: int, drift: str, slip: str) -> Floats:
        """Where it goes from now on if it does its worst otherwise, shape (parts + 1, 3)."""
        begun = self.begun + len(self.track) - 1
        other = replace(self, pose=self.pose.copy(), track=[], begun=begun, shifts=dict(self.shifts))
        now = self.now
        values = {name: self.parameter(name, now) for name in self.ranges}
        other.adversary = Adversary(values, drift, slip, seed=self.adversary.seed)
        for _ in range(parts):
            other.drive(commands)
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
