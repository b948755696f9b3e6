r"""Which parameters and poses are consistent with what was commanded and what was measured, errors being bounded.

Between two measurements j and k of one robot, with :math:`W(b) = \int v\, e^{i b \Omega}\, dt` over the time between,

.. math::

    \theta_k - \theta_j = b\, \Delta\Omega \pm e_\theta, \qquad
    \lvert p_k - p_j \rvert = a\, \lvert W(b) \rvert \pm e_p, \qquad
    p_k - p_j = a\, e^{i(\theta_k - b\,\Omega_k)} W(b) \pm e_p

The first bounds the factor b on the turn rate, the second, which no heading enters, the factor a on the speed, and all
of them the pose at k.  Every pair of the newest measurement with an older one is used: the bounds are intersected, so
the set of consistent values only shrinks, but for what a parameter may drift.

The errors hold the measurements' own, what a drifting parameter may have differed by on the way, and errors of the
actuators.  *Guarantee*: as long as all of these are within their bounds, the true values are never excluded; an empty
set therefore shows that some assumption is wrong.

F. C. Schweppe, Recursive state estimation: unknown but bounded errors and system inputs, 1968.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.errors import ProblemError
from ensemble_ctrl.fleet import Fleet
from ensemble_ctrl.systems import ArcSystem

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

UP = 1e-9
"""By how much every bound is widened for rounding: metres and radians, and the factors relatively."""
ROUNDS = 2
"""How often the bounds of both factors and of the pose are intersected, one after the other, for a measurement."""


@dataclass(frozen=True)
class Errors:
    """Bounds of everything that differs from the model.

    Parameters
    ----------
    position : float
        Largest error of a measured x or y, metres.
    heading : float
        Largest error of a measured heading, radians.
    drift : float
        Largest change of a factor on speed or turn rate, per second.
    speed, turn_rate : float
        Largest errors of the actuators, m/s and rad/s.
    """

    position: float = 0.01
    heading: float = float(np.radians(1.0))
    drift: float = 0.0
    speed: float = 0.0
    turn_rate: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0):
                raise ProblemError(f"errors.{name}: expected a finite bound >= 0, got {value!r}")

    def slip(self, a: float, b: float, span: Floats, way: Floats, turn: Floats) -> tuple[Floats, Floats]:
        """What drift and actuators may add to heading and place, radians and metres.

        Parameters
        ----------
        a, b : float
            Largest factors of speed and turn rate.
        span, way, turn : ndarray of one shape
            Seconds, and the way and the turn at factor 1 in these, without signs.
        """
        drift = self.drift * span
        turned = drift * turn + b * self.turn_rate * span
        return turned, np.asarray(drift * way + (a + drift) * (way * turned + self.speed * span * (1.0 + turned)))


@dataclass(frozen=True, eq=False)
class PoseSet:
    """All poses within a box and a range of headings.

    Attributes
    ----------
    position : ndarray, shape (2,)
        Middle, metres.
    half : ndarray, shape (2,)
        Half the sides of the box, metres.
    heading, turn : float
        Middle and half range, radians, from +x counter-clockwise.
    """

    position: Floats
    half: Floats
    heading: float
    turn: float

    @property
    def away(self) -> float:
        """Largest distance of a place in the set from its middle, metres."""
        return float(np.hypot(*self.half))


class Commands:
    """The commands that a robot was sent, as integrals over time.

    Parameters
    ----------
    system : ArcSystem
    controls : ndarray, shape (steps, 2)
        From time 0 on; after them the robot stands.
    step : float
        Seconds.
    """

    def __init__(self, system: ArcSystem, controls: Floats, step: float) -> None:
        self.step = step
        sign = 1.0 if system.heading_from == "x" else -1.0
        v, omega = system.rates(*np.asarray(controls, dtype=float).reshape(-1, 2).T)
        self.v, self.omega = np.append(v, 0.0), np.append(sign * omega, 0.0)
        self.grid = step * np.arange(len(self.v))
        self.turned = step * np.concatenate([[0.0], np.cumsum(self.omega)[:-1]])

    def at(self, times: Floats, b: float) -> tuple[Floats, Complexes]:
        """The integral of the turn rate, and that of ``v exp(i b turned)``, up to some times."""
        n, share = self._place(times)
        turned = self.turned[n] + share * self.omega[n]
        whole = self._chords(np.arange(len(self.v)), np.full(len(self.v), self.step), b)
        sums = np.concatenate([[0.0], np.cumsum(whole)])
        return turned, sums[n] + self._chords(n, share, b)

    def turns(self, times: Floats) -> Floats:
        """The integral of the turn rate up to some times."""
        n, share = self._place(times)
        return np.asarray(self.turned[n] + share * self.omega[n])

    def driven(self, times: Floats) -> tuple[Floats, Floats]:
        """The integrals of the absolute speed and of the absolute turn rate up to some times."""
        return self._total(np.abs(self.v), times), self._total(np.abs(self.omega), times)

    def swing(self, begin: Floats, end: float, about: float) -> Floats:
        """Upper bounds of the integrals of ``|v| |turned - about|`` from some times to one later."""
        reach = np.abs(self.turned - about) + self.step * np.abs(self.omega)
        total = self._total(np.abs(self.v) * reach, np.append(begin, end))
        return np.asarray(total[-1] - total[:-1])

    def _total(self, rate: Floats, times: Floats) -> Floats:
        """The integral up to some times of a rate that is constant in each step."""
        n, share = self._place(times)
        sums = self.step * np.concatenate([[0.0], np.cumsum(rate)])
        return np.asarray(sums[n] + share * rate[n])

    def _place(self, times: Floats) -> tuple[NDArray[np.int64], Floats]:
        """The step that holds each time, and the seconds since it began."""
        n = np.clip((np.asarray(times) / self.step + 1e-9).astype(np.int64), 0, len(self.v) - 1)
        return n, np.asarray(times) - self.grid[n]

    def _chords(self, n: NDArray[np.int64], span: Floats, b: float) -> Complexes:
        """The integral of ``v exp(i b turned)`` over the first `span` seconds of steps."""
        half = b * self.omega[n] * span / 2
        middle = b * self.turned[n] + half
        return np.asarray(self.v[n] * span * np.sinc(half / np.pi) * np.exp(1j * middle))


class Membership:
    """The sets of parameters and poses of one robot.

    Parameters
    ----------
    fleet : Fleet
        The ranges that are assumed; parameters of the start are ignored.
    errors : Errors
    """

    def __init__(self, fleet: Fleet, errors: Errors) -> None:
        self.fleet, self.errors = fleet, errors
        rows = [(k, name) for k, name in enumerate(fleet.names) if name in fleet.system.parameters]
        self.names = tuple(name for _, name in rows)
        self.directions = np.array([fleet.system.parameters[name] for name in self.names]).reshape(-1, 2)
        self.assumed = np.array([[fleet.lower[k], fleet.upper[k]] for k, _ in rows]).reshape(-1, 2)
        self.ranges = self.assumed.copy()
        self.restart(self.ranges)

    def restart(self, ranges: Floats) -> None:
        """Forget all measurements, and assume `ranges`, shape (parameters, 2)."""
        self.assumed, self.ranges = np.array(ranges, dtype=float), np.array(ranges, dtype=float)
        self.times, self.places, self.headings = np.zeros(0), np.zeros(0, dtype=complex), np.zeros(0)

    @property
    def factors(self) -> tuple[Floats, Floats]:
        """Ranges of the factors on speed and on turn rate, each shape (2,)."""
        linear, angular = (self._factor(self.ranges, place) for place in (0, 1))
        return linear, angular

    def observe(self, commands: Commands, time: float, position: Floats, heading: float) -> bool:
        """Take a measurement, later than all before, into account; returns False if nothing is consistent any more.

        Parameters
        ----------
        commands : Commands
            What was sent, at least up to `time`.
        time : float
            When the pose was this, seconds.
        position, heading
            Metres and radians, from +x counter-clockwise.
        """
        if len(self.times):
            spread = self.errors.drift * (time - self.times[-1])
            self.ranges = self.ranges + spread * np.array([-1.0, 1.0])
            self.ranges = np.stack(
                [np.maximum(self.ranges[:, 0], self.assumed[:, 0]), np.minimum(self.ranges[:, 1], self.assumed[:, 1])],
                axis=1,
            )
        self.times = np.append(self.times, time)
        self.places = np.append(self.places, complex(*position))
        self.headings = np.append(self.headings, heading)
        for _ in range(ROUNDS):
            if not (self._turns(commands) and self._ways(commands)):
                return False
        return self.pose(commands, time) is not None

    def pose(self, commands: Commands, time: float) -> PoseSet | None:
        """The set of poses at a time from the last measurement on; None if it is empty."""
        errors = self.errors
        (a0, a1), (b0, b1) = self.factors
        a, da, b, db = (a0 + a1) / 2, (a1 - a0) / 2, (b0 + b1) / 2, (b1 - b0) / 2
        turn, slip_turn, way, slip = self._window(commands, time)
        turned = turn[0]
        heading = self._heading(turned, b, db, slip_turn, commands, time)
        if heading is None:
            return None
        middle, half = heading
        here, W = commands.at(np.append(self.times, time), b)
        reach = W[-1] - W[:-1]
        swing = commands.swing(self.times, time, float(here[-1]))
        moved = a * np.exp(1j * (middle - b * here[-1])) * reach
        error = errors.position + slip + da * np.abs(reach) + a1 * (db * swing + 2 * np.sin(min(half, 3.0) / 2) * way)
        guess, error = self.places + moved, error + UP * (1 + np.abs(self.places))
        sides = []
        for value in (guess.real, guess.imag):
            low, high = (value - error).max(), (value + error).min()
            if low > high:
                return None
            sides.append((low, high))
        box = np.array(sides)
        return PoseSet(box.mean(axis=1), (box[:, 1] - box[:, 0]) / 2, middle, half)

    def _heading(
        self, turned: Floats, b: float, db: float, slip: Floats, commands: Commands, time: float
    ) -> tuple[float, float] | None:
        """Middle and half range of the heading at a time."""
        middle = self.headings + b * turned
        around = float(middle[-1])
        offset = _wrapped(middle - around)
        error = self.errors.heading + db * np.abs(turned) + slip + UP
        use = error < np.pi / 2
        if not use.any():
            return around, np.pi
        low, high = (offset - error)[use].max(), (offset + error)[use].min()
        return None if low > high else (around + (low + high) / 2, float(high - low) / 2)

    def _turns(self, commands: Commands) -> bool:
        """Intersect the range of the factor on the turn rate; False if it becomes empty."""
        b0, b1 = self.factors[1]
        b = (b0 + b1) / 2
        (turned, _), slip, _, _ = self._window(commands, float(self.times[-1]))
        turned, slip = turned[:-1], slip[:-1]
        seen = _wrapped(self.headings[-1] - self.headings[:-1] - b * turned) + b * turned
        error = 2 * self.errors.heading + slip + UP
        sure = ((b1 - b0) / 2 * np.abs(turned) + error < np.pi) & (np.abs(turned) > 1e-6)
        seen, turned, error = seen[sure], turned[sure], error[sure]
        ends = np.sort(np.stack([(seen - error) / turned, (seen + error) / turned]), axis=0)
        return self._intersect(1, ends[0].max(initial=-np.inf), ends[1].min(initial=np.inf))

    def _ways(self, commands: Commands) -> bool:
        """Intersect the range of the factor on the speed; False if it becomes empty."""
        (b0, b1), time = self.factors[1], float(self.times[-1])
        b, db = (b0 + b1) / 2, (b1 - b0) / 2
        here, W = commands.at(self.times, b)
        reach = np.abs(W[-1] - W[:-1])
        swing = commands.swing(self.times[:-1], time, float(here[-1]))
        slip = self._window(commands, time)[3]
        seen = np.abs(self.places[-1] - self.places[:-1])
        error = 2 * np.sqrt(2.0) * self.errors.position + slip[:-1] + UP
        longest, shortest = reach + db * swing + UP, reach - db * swing - UP
        low = ((seen - error) / longest).max(initial=-np.inf)
        sure = shortest > 1e-6
        high = ((seen + error)[sure] / shortest[sure]).min(initial=np.inf)
        return self._intersect(0, low, high)

    def _window(self, commands: Commands, time: float) -> tuple[tuple[Floats, Floats], Floats, Floats, Floats]:
        """From each measurement to a time: (turned, its absolute), and errors.

        The errors are those of heading and place that drift and actuators may have added; between them stands the way
        driven at factor 1.
        """
        errors = self.errors
        a1, b1 = float(self.factors[0][1]), float(np.abs(self.factors[1]).max())
        span = time - self.times
        turned = commands.turns(np.append(self.times, time))
        ways, turns = commands.driven(np.append(self.times, time))
        way, turn = ways[-1] - ways[:-1], turns[-1] - turns[:-1]
        slip_turn, slip = errors.slip(a1, b1, span, way, turn)
        return (turned[-1] - turned[:-1], turn), slip_turn, way, slip

    def _factor(self, ranges: Floats, place: int) -> Floats:
        """The range of one factor under ranges of the parameters; 1 where no parameter tells it."""
        told = self.directions[:, place]
        return np.asarray(told @ ranges) if told.any() else np.ones(2)

    def _intersect(self, place: int, low: float, high: float) -> bool:
        """Intersect the range of the parameter that tells a factor; False if nothing is left."""
        told = np.flatnonzero(self.directions[:, place])
        low, high = low - UP * abs(low), high + UP * abs(high)
        if not len(told):
            return bool(low <= 1.0 <= high)
        k = int(told[0])
        self.ranges[k] = max(self.ranges[k, 0], low), min(self.ranges[k, 1], high)
        return bool(self.ranges[k, 0] <= self.ranges[k, 1])


def _wrapped(angle: Floats) -> Floats:
    """Angles in [-pi, pi)."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
