"""Robots that are not the model: other parameters, noise, delays, and commands that come late, cut or not at all.

Time is simulated: a robot is its own clock, and moves when it is waited for.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.planning.online.measurement import Measurement
from ensemble_ctrl.planning.online.simulated_errors import SimulatedErrors
from ensemble_ctrl.systems import ArcSystem, Bicycle

Floats = NDArray[np.float64]
Factors = Callable[[float, Floats], tuple[float, float]]
"""Factors on speed and turn rate at a time (seconds) and a place (shape (2,), metres)."""

FINE = 10
"""Parts of a control step in each of which factors are constant."""


@dataclass(frozen=True)
class Fixed:
    """The same factors always and everywhere."""

    speed: float = 1.0
    turn_rate: float = 1.0

    def __call__(self, time: float, place: Floats) -> tuple[float, float]:
        return self.speed, self.turn_rate


@dataclass(frozen=True)
class Drifting:
    """Both factors swing about `middle` by `amplitude`, once in `period` seconds, from `middle` at time 0."""

    middle: float
    amplitude: float
    period: float

    def __call__(self, time: float, place: Floats) -> tuple[float, float]:
        value = self.middle + self.amplitude * float(np.sin(2 * np.pi * time / self.period))
        return value, value

    @property
    def fastest(self) -> float:
        """Largest change per second."""
        return 2 * np.pi * abs(self.amplitude) / self.period


@dataclass(frozen=True, eq=False)
class Terrain:
    """Both factors are those of the first patch that the robot is in, else `elsewhere`."""

    patches: Sequence[tuple[Polyhedron, float]]
    elsewhere: float = 1.0

    def __call__(self, time: float, place: Floats) -> tuple[float, float]:
        for patch, value in self.patches:
            if float(patch.margin(place)) >= 0:
                return value, value
        return self.elsewhere, self.elsewhere


@dataclass(frozen=True)
class Flaws:
    """What is wrong with a simulated robot.

    Parameters
    ----------
    position, heading : float
        Largest errors of a measurement, metres and radians, uniform.
    delay : float
        Seconds that a measurement takes to arrive.
    command_delay : float
        Seconds by which every command is carried out late.
    saturation : tuple of float or None
        Largest absolute commands that are carried out.
    quantum : tuple of float or None
        Commands are rounded to multiples of these.
    lost_measurements, lost_commands : float
        Share of the messages that are lost, 0 to 1.
    """

    position: float = 0.0
    heading: float = 0.0
    delay: float = 0.0
    command_delay: float = 0.0
    saturation: tuple[float, float] | None = None
    quantum: tuple[float, float] | None = None
    lost_measurements: float = 0.0
    lost_commands: float = 0.0

    def __post_init__(self) -> None:
        for name in ("position", "heading", "delay", "command_delay"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise ProblemError(f"robot.{name}: expected a finite number >= 0, got {getattr(self, name)!r}")
        for name in ("lost_measurements", "lost_commands"):
            if not 0 <= getattr(self, name) < 1:
                raise ProblemError(f"robot.{name}: expected a share from 0 to below 1, got {getattr(self, name)!r}")


@dataclass(eq=False)
class SimulatedRobot:
    """One robot, and its clock.

    Parameters
    ----------
    system : ArcSystem
    position : array_like, shape (2,)
        Start, metres.
    heading : float
        Radians from +x, counter-clockwise.
    step : float
        Length of a control step, seconds.
    factors : Factors
        The true factors on speed and turn rate.
    flaws : Flaws
    seed : int
        Of noise and losses.
    errors : SimulatedErrors or None
        What it does beside its model while it drives; nothing if not given.

    Attributes
    ----------
    track : list of ndarray
        True poses ``(x, y, heading)`` so far, `FINE` for each control step, the start first.
    """

    system: ArcSystem
    position: Floats
    heading: float
    step: float
    factors: Factors = field(default_factory=Fixed)
    flaws: Flaws = field(default_factory=Flaws)
    seed: int = 0
    errors: SimulatedErrors | None = None

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(self.seed)
        self.pose = np.array([*np.asarray(self.position, dtype=float), float(self.heading)])
        self.track: list[Floats] = [self.pose.copy()]
        self._commands: dict[int, Floats] = {}
        self._parts = 0
        self._post: deque[tuple[float, Measurement]] = deque()
        self._measure()

    def now(self) -> float:
        """Simulated seconds."""
        return self._parts * self.step / FINE

    def wait(self, until: float) -> None:
        """Let the robot drive until a time."""
        while self.now() < until - 1e-9:
            self._drive()
            if self._parts % FINE == 0:
                self._measure()

    def read(self) -> Measurement | None:
        """The newest measurement that has arrived, each once."""
        newest = None
        while self._post and self._post[0][0] <= self.now() + 1e-9:
            newest = self._post.popleft()[1]
        return newest

    def send(self, begin: float, controls: Floats) -> None:
        """Take commands, unless the message is lost."""
        if self._random.random() < self.flaws.lost_commands:
            return
        first = round(begin / self.step)
        self._commands = {k: u for k, u in self._commands.items() if k < first}
        self._commands |= {first + i: np.array(u, dtype=float) for i, u in enumerate(controls)}

    def stop(self) -> None:
        """Stand at once."""
        self._commands = {}

    def put(self, x: float, y: float, heading: float | None = None) -> None:
        """Take the robot elsewhere, as a child might."""
        self.pose = np.array([x, y, self.pose[2] if heading is None else heading])

    def _measure(self) -> None:
        """Send the present pose off."""
        flaws, noise = self.flaws, self._random.uniform(-1.0, 1.0, 3)
        lost = self._random.random() < flaws.lost_measurements
        # uniform errors within their bounds; the message arrives after the delay
        x, y, heading = self.pose + noise * [flaws.position, flaws.position, flaws.heading]
        now = round(self.now(), 9)
        if not lost:
            arrives = now + flaws.delay if now else 0.0  # it has been standing, and was seen before
            self._post.append((arrives, Measurement(now, float(x), float(y), float(heading))))

    def _drive(self) -> None:
        """Move for one part of a step."""
        if self._parts % FINE == 0 and self.errors is not None:
            self.errors.advance()  # errors are constant in each step
        now, end = self.now(), (self._parts + 1) * self.step / FINE
        while now < end:
            # the command that has begun, and the one that the model carries out; they change by the next beginnings
            due, meant = self._due(now, True), self._due(now, False)
            until = min(end, *(t for t in (self._begin(due + 1, True), self._begin(meant + 1, False)) if t > now))
            self._move(self._commands.get(due), self._commands.get(meant), now, until - now)
            now = until
        self._parts += 1
        self.track.append(self.pose.copy())

    def _begin(self, n: int, shifted: bool) -> float:
        """When the commands of a step begin, seconds."""
        late = self.flaws.command_delay
        if self.errors is not None:
            late += self.errors.delay + (self.errors.shift(n) if shifted else 0.0)
        return n * self.step + late

    def _due(self, now: float, shifted: bool) -> int:
        """The last step whose commands have begun."""
        n = int(np.floor((now - self._begin(0, False)) / self.step + 1e-9))
        # begun early, or not yet
        found = [k for k in (n - 1, n, n + 1) if self._begin(k, shifted) <= now + 1e-9 * self.step]
        return found[-1] if found else n - 1

    def _move(self, command: Floats | None, meant: Floats | None, now: float, span: float) -> None:
        """Carry a command out for some seconds; a robot that is told to stand stands."""
        sign = 1.0 if self.system.heading_from == "x" else -1.0
        v, omega = self._rates(command)
        a, b = self.factors(now, self.pose[:2])
        model = b * sign * self._rates(meant)[1]
        if not (v or omega):
            if self.errors is not None:
                self.errors.stands(model, span)
            return
        if self.errors is None:
            self.pose = moved(self.pose, a * v, b * sign * omega, span)
            return
        # rates with their errors; what a loop on the heading holds is that of the model, b omega
        assert command is not None
        off_v, off_omega = map(float, self.system.rates(*self.errors.command(self._carried_out(command))))
        stray_a, stray_b = self.errors.strays()
        push = self.errors.pushes()
        way = (abs(a * stray_a * off_v) + float(np.hypot(*push[:2]))) * span
        more_a, more_b = self.errors.grounds(self.pose[:2], way, (a, b))
        if abs(more_a) > 1.0:  # faster on the patch: it may leave it after all
            more_a, more_b = self.errors.grounds(self.pose[:2], abs(more_a) * way, (a, b))
        turned = self.errors.turn(model, b * sign * stray_b * more_b * off_omega - model + sign * push[2], span)
        self.pose = moved(self.pose, a * stray_a * more_a * off_v, turned / span, span)
        self.pose[:2] += push[:2] * span

    def _rates(self, command: Floats | None) -> tuple[float, float]:
        """Speed and turn rate of a command as the actuators understand it; none without one."""
        if command is None:
            return 0.0, 0.0
        v, omega = map(float, self.system.rates(*self._carried_out(command)))
        return v, omega

    def _carried_out(self, command: Floats) -> Floats:
        """A command as the actuators understand it."""
        quantum, most = self.flaws.quantum, self.flaws.saturation
        if quantum is not None:
            # quantised, then saturated
            command = np.round(command / quantum) * quantum
        return command if most is None else np.clip(command, -np.asarray(most), most)


class SimulatedFleet:
    """Several robots under one broadcast, and their clock; each hears it, and is measured, on a link of its own.

    Parameters
    ----------
    robots : mapping of str to SimulatedRobot or SimulatedStates
        By name, all with the same control step.
    """

    def __init__(self, robots: Mapping[str, Any]) -> None:
        self.robots = dict(robots)

    def now(self) -> float:
        """Simulated seconds."""
        return float(next(iter(self.robots.values())).now())

    def wait(self, until: float) -> None:
        """Let the robots drive until a time."""
        for robot in self.robots.values():
            robot.wait(until)

    def read(self) -> dict[str, Any]:
        """The newest measurement of each robot of which one has arrived."""
        seen = {name: robot.read() for name, robot in self.robots.items()}
        return {name: each for name, each in seen.items() if each is not None}

    def send(self, begin: float, controls: Floats) -> None:
        """The same commands to all."""
        for robot in self.robots.values():
            robot.send(begin, controls)

    def stop(self) -> None:
        """All stand at once."""
        for robot in self.robots.values():
            robot.stop()


def moved(pose: Floats, v: float, omega: float, span: float) -> Floats:
    """A pose after `span` seconds of constant speed and turn rate, on the exact arc."""
    # chord of an arc: v span sinc(omega span / 2) at the heading in its middle
    half = omega * span / 2
    chord, angle = v * span * np.sinc(half / np.pi), pose[2] + half
    return np.asarray(pose + np.array([chord * np.cos(angle), chord * np.sin(angle), 2 * half]))


SMALL_CAR = Bicycle(wheelbase=0.33)
"""A car at a tenth of its size, like the paper's vehicle."""
SMALL_CAR_FLAWS = Flaws(
    position=0.01,
    heading=float(np.radians(1.0)),
    delay=0.1,
    saturation=(3.0, 0.36),
    quantum=(0.01, 0.005),
)
"""What such a car does to commands and measurements: steering ends at 0.36 rad, and a camera takes 0.1 s."""
