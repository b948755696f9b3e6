r"""Where a robot can be at one time, given where it can be at another: forward and backward, with bounded errors.

The factors at time T lie in ranges, :math:`a(T) \in [a_0, a_1]` and :math:`b(T) \in [b_0, b_1]`, and change by at most
d per second; what `fleet.uncertainty` bounds adds at most :math:`A` and :math:`B` to the rates of the commands, and
:math:`W` and :math:`w` to those of place and heading (`ensemble_ctrl.planning.online.slips`):

.. math:: \dot\theta = b(\tau)\,(\omega + e_\omega(\tau)) + w(\tau), \qquad
    \dot p = a(\tau)\,(v + e_v(\tau))\, u(\theta) + W(\tau)

Two statements are all that is used, and both hold in either direction of time (`docs/online_proof.md`):

- `departure`: from one time to another, such a robot departs from the one that keeps the factors ``a(T)`` and ``b(T)``
  and has no errors, by at most so many radians and metres.
- `propagated`: the set of poses at a time that follows from sets of poses at others, for all factors in the ranges.

Everything that speaks of a robot at a time at which it was not measured calls these: learning, the sets of poses, the
past, proofs and the growth that plans account for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.planning.online.slips import UP, Slips
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

NOWHERE = (0.0, 0.0)
"""No radians and no metres more."""


@dataclass(frozen=True)
class Errors:
    """Bounds of measurements, and of what the factors may change by; other errors are bounds of the fleet.

    Parameters
    ----------
    position : float
        Largest error of a measured x or y, metres.
    heading : float
        Largest error of a measured heading, radians; from pi on, headings say nothing.
    drift : float
        Largest change of a factor on speed or turn rate, per second.
    """

    position: float = 0.01
    heading: float = float(np.radians(1.0))
    drift: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0):
                raise ProblemError(f"errors.{name}: expected a finite bound >= 0, got {value!r}")


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
        Middle and half range, radians, from +x counter-clockwise; every heading for half a range of pi.
    """

    position: Floats
    half: Floats
    heading: float
    turn: float

    @property
    def away(self) -> float:
        """Largest distance of a place in the set from its middle, metres."""
        return float(np.hypot(*self.half))

    def widened(self, turn: float, away: float) -> PoseSet:
        """All poses that are up to so many radians and metres from one of the set."""
        return PoseSet(self.position, self.half + away, self.heading, self.turn + turn)


@dataclass(frozen=True, eq=False)
class Factors:
    """What is known of the factors on speed and turn rate.

    Attributes
    ----------
    time : float
        T, when they are in these ranges, seconds.
    speed, turn_rate : ndarray, shape (2,)
        Ranges at that time, dimensionless.
    most : tuple of float
        Largest sizes of both at any time.
    """

    time: float
    speed: Floats
    turn_rate: Floats
    most: tuple[float, float]

    def at_most(self, drift: float, since: Floats, until: Floats, jump: float) -> tuple[Floats, Floats]:
        """Largest sizes of both factors between two times, under a drift that is ahead by up to `jump` seconds."""
        # |a(t)| <= |a(T)| + d |t - T|, and never above the most
        span = np.maximum(np.abs(since - self.time), np.abs(until - self.time)) + jump
        ranges = zip((self.speed, self.turn_rate), self.most, strict=True)
        a, b = (np.minimum(np.abs(ends).max() + drift * span, most) for ends, most in ranges)
        return a, b


class Commands:
    """The commands that a robot was sent, as integrals over time.

    Parameters
    ----------
    fleet : Fleet
        On arcs.
    controls : ndarray, shape (steps, 2)
        From time 0 on; after them the robot stands.
    step : float
        Seconds.
    strays : ndarray, shape (2, steps), optional
        By how much terrain may change the factors on speed and turn rate in each step.
    """

    def __init__(self, fleet: Fleet, controls: Floats, step: float, strays: Floats | None = None) -> None:
        self.step, system = step, fleet.arcs
        sign = 1.0 if system.heading_from == "x" else -1.0
        # rates of each step, turning counter-clockwise, 0 after the last; Omega at the begin of each
        controls = np.asarray(controls, dtype=float).reshape(-1, 2)
        v, omega = system.rates(*controls.T)
        self.slips = Slips.of(fleet, controls, step, strays)
        self.v, self.omega = np.append(v, 0.0), np.append(sign * omega, 0.0)
        self.grid = step * np.arange(len(self.v))
        self.turned = step * np.concatenate([[0.0], np.cumsum(self.omega)[:-1]])

    def at(self, times: Floats, b: float) -> tuple[Floats, Complexes]:
        """The integral of the turn rate, and that of ``v exp(i b turned)``, up to some times."""
        n, share = self._place(times)
        turned = self.turned[n] + share * self.omega[n]
        # W(t): the sum of the chords of whole steps and that of the step begun
        whole = self._chords(np.arange(len(self.v)), np.full(len(self.v), self.step), b)
        sums = np.concatenate([[0.0], np.cumsum(whole)])
        return turned, sums[n] + self._chords(n, share, b)

    def turns(self, times: Floats) -> Floats:
        """The integral of the turn rate up to some times."""
        n, share = self._place(times)
        return np.asarray(self.turned[n] + share * self.omega[n])

    def driven(self, since: Floats, until: Floats) -> tuple[Floats, Floats]:
        """The integrals of the absolute speed and of the absolute turn rate between times in any order."""
        v, omega = (
            np.abs(self._total(rate, until) - self._total(rate, since)) for rate in np.abs([self.v, self.omega])
        )
        return v, omega

    def weighted(self, since: Floats, until: Floats, about: float) -> tuple[Floats, Floats]:
        """The integrals of ``|v| |t - about|`` and ``|omega| |t - about|`` between times in any order."""
        v, omega = (
            np.abs(self._leant(rate, until, about) - self._leant(rate, since, about))
            for rate in np.abs([self.v, self.omega])
        )
        return v, omega

    def slipped(self, since: Floats, until: Floats) -> tuple[Floats, Floats]:
        """The integrals of the bounds A and B of `slips` between times in any order."""
        speed, turn_rate = (
            np.abs(self._total(rate, until) - self._total(rate, since))
            for rate in (self.slips.speed, self.slips.turn_rate)
        )
        return speed, turn_rate

    def jumps(self, since: Floats, until: Floats) -> tuple[Floats, Floats]:
        """What early and late commands may add between times in any order, m and rad for factors of one."""
        if not (jitter := self.slips.jitter):
            return np.zeros(len(until)), np.zeros(len(until))
        # all beginnings of steps in [since - J, until + J]
        low, high = np.minimum(since, until) - jitter, np.maximum(since, until) + jitter
        first = np.clip(np.ceil(low / self.step - 1e-6), 0, len(self.v)).astype(np.int64)
        last = np.clip(np.floor(high / self.step + 1e-6) + 1, 0, len(self.v)).astype(np.int64)
        sums = (np.concatenate([[0.0], np.cumsum(each)]) for each in (self.slips.speed_jumps, self.slips.turn_jumps))
        speed, turn_rate = (total[np.maximum(first, last)] - total[first] for total in sums)
        return speed, turn_rate

    def grounds(self, since: Floats, until: Floats) -> tuple[Floats, Floats]:
        """What terrain may add between times in any order, metres and radians."""
        place, heading = (np.abs(self._total(rate, until) - self._total(rate, since)) for rate in self.slips.ground)
        return place, heading

    def swing(self, begin: Floats, end: float, about: float) -> Floats:
        """Upper bounds of the integrals of ``|v| |turned - about|`` between some times and one, in any order."""
        # |Omega(t) - about| is at most its value where the step begins plus h |omega|
        reach = np.abs(self.turned - about) + self.step * np.abs(self.omega)
        total = self._total(np.abs(self.v) * reach, np.append(begin, end))
        return np.asarray(np.abs(total[-1] - total[:-1]))

    def _total(self, rate: Floats, times: Floats) -> Floats:
        """The integral up to some times of a rate that is constant in each step."""
        n, share = self._place(times)
        sums = self.step * np.concatenate([[0.0], np.cumsum(rate)])
        return np.asarray(sums[n] + share * rate[n])

    def _leant(self, rate: Floats, times: Floats, about: float) -> Floats:
        """An antiderivative of ``rate |t - about|`` for a rate that is constant in each step."""
        begin = self.grid - about
        # M(t) = int_0^t rate (tau - about) dtau; wanted is |M(t) - M(about)| with the sign of t - about
        moments = np.concatenate([[0.0], np.cumsum(rate * self.step * (begin + self.step / 2))])
        n, share = self._place(np.append(times, about))
        up_to = moments[n] + rate[n] * share * (begin[n] + share / 2)
        signed = up_to[:-1] - up_to[-1]  # of rate (t - about), from `about` on: never negative
        return np.asarray(np.where(np.asarray(times) >= about, signed, -signed))

    def _place(self, times: Floats) -> tuple[NDArray[np.int64], Floats]:
        """The step that holds each time, and the seconds since it began."""
        n = np.clip((np.asarray(times) / self.step + 1e-9).astype(np.int64), 0, len(self.v) - 1)
        return n, np.asarray(times) - self.grid[n]

    def _chords(self, n: NDArray[np.int64], span: Floats, b: float) -> Complexes:
        """The integral of ``v exp(i b turned)`` over the first `span` seconds of steps."""
        # chord of an arc: v span sinc(b omega span / 2) exp(i b Omega) at its middle
        half = b * self.omega[n] * span / 2
        middle = b * self.turned[n] + half
        return np.asarray(self.v[n] * span * np.sinc(half / np.pi) * np.exp(1j * middle))


def departure(
    commands: Commands, errors: Errors, factors: Factors, since: Floats, until: Floats, beyond: bool = False
) -> tuple[Floats, Floats]:
    r"""How far drift and the fleet's errors lead a robot away from one that keeps the factors of time T.

    Both robots have one pose at `since`, or at `until`; the bound is of their poses at the other time.

    Parameters
    ----------
    since, until : ndarray of one shape
        Seconds, in any order.
    beyond : bool
        Leave out what a certificate counts by itself: the fleet's errors, of robots that keep the factors of time T.

    Returns
    -------
    heading, place : ndarray
        Radians and metres.

    Notes
    -----
    With :math:`a_m, b_m` the largest factors between both times,

    .. math::

        \delta\theta = d \int |\omega|\,|\tau - T|'\,d\tau + \int (b_m B + w)\,d\tau, \qquad
        \delta p = d \int |v|\,|\tau - T|'\,d\tau + \int (a_m A + W)\,d\tau
        + |a(T)|\,\min(\delta\theta, 2) \int |v|\,d\tau

    where the prime adds half a control step: factors may also change in jumps, one a step. A robot that holds its
    heading has another second term (`Slips.turned`). Early and late commands add their jumps to `A` and `B`, and
    terrain what it may, which no certificate of the loop counts.
    """
    since, until = np.asarray(since, dtype=float), np.asarray(until, dtype=float)
    if not (errors.drift or commands.slips):
        return np.zeros(len(until)), np.zeros(len(until))
    jump, slips = commands.step / 2, commands.slips
    a, b = factors.at_most(errors.drift, since, until, jump)
    fastest, sharpest = np.abs(factors.speed).max(), np.abs(factors.turn_rate).max()
    span = np.abs(until - since)
    # the integrals of the formula above: lags against T, way and turn, and what is off in each step
    v_lag, omega_lag = commands.weighted(since, until, factors.time)
    way, turn = commands.driven(since, until)
    slipped, swerved = commands.slipped(since, until)
    jumps, jumps_of_turn = commands.jumps(since, until)
    heading, place = errors.drift * (omega_lag + jump * turn), errors.drift * (v_lag + jump * way)
    if beyond:
        heading = heading + np.maximum(b - sharpest, 0.0) * (swerved + jumps_of_turn)
        place = place + np.maximum(a - fastest, 0.0) * (slipped + jumps)
    else:
        heading = heading + slips.turned(b, swerved, span, factors.most[1]) + b * jumps_of_turn
        place = place + a * (slipped + jumps) + slips.place * span
    strayed, swayed = commands.grounds(since, until)
    heading, place = heading + swayed, place + strayed
    return heading, np.asarray(place + fastest * np.minimum(heading, 2.0) * way)


def propagated(
    commands: Commands,
    errors: Errors,
    factors: Factors,
    times: Floats,
    places: Complexes,
    headings: Floats,
    time: float,
    more: tuple[Floats | float, Floats | float] = NOWHERE,
) -> PoseSet | None:
    r"""The set of poses at a time that is consistent with measurements at others, earlier or later.

    Parameters
    ----------
    times : ndarray, shape (measurements,)
        Seconds.
    places : ndarray of complex, shape (measurements,)
        Measured, metres.
    headings : ndarray, shape (measurements,)
        Measured, radians from +x.
    time : float
        Seconds.
    more : tuple
        Radians and metres by which each measurement may be off beyond its errors, each of shape (measurements,).

    Returns
    -------
    PoseSet or None
        None if nothing is consistent.

    Notes
    -----
    *Guarantee*: as long as all errors are within their bounds, the true pose is in the set.
    """
    (a0, a1), (b0, b1) = factors.speed, factors.turn_rate
    a, da, b, db = (a0 + a1) / 2, (a1 - a0) / 2, (b0 + b1) / 2, (b1 - b0) / 2
    until = np.full(len(times), time)
    slip_turn, slip = departure(commands, errors, factors, times, until)
    here, W = commands.at(np.append(times, time), b)
    turned = here[-1] - here[:-1]
    # each measurement's arc of headings: theta_j + b (Omega(t) - Omega(t_j)); the set is their intersection
    found = common_arc(headings + b * turned, errors.heading + more[0] + db * np.abs(turned) + slip_turn + UP)
    if found is None:
        return None
    middle, half = found
    # p(t) = p_j + a exp(i (theta - b Omega)) (W(t) - W(t_j)), and what factors, heading and departure add to it
    reach = W[-1] - W[:-1]
    moved = a * np.exp(1j * (middle - b * here[-1])) * reach
    # error of each guess: measurement, departure, a's half range, b's swing, and the heading's swing over the way
    swing = commands.swing(times, time, float(here[-1]))
    way, _ = commands.driven(times, until)
    error = errors.position + more[1] + slip + da * np.abs(reach) + np.abs(a1) * (db * swing + swung(half) * way)
    guess, error = places + moved, error + UP * (1 + np.abs(places))
    sides = []
    # intersect the boxes of all measurements, coordinate by coordinate
    for value in (guess.real, guess.imag):
        low, high = (value - error).max(), (value + error).min()
        if low > high:
            return None
        sides.append((low, high))
    box = np.array(sides)
    return PoseSet(box.mean(axis=1), (box[:, 1] - box[:, 0]) / 2 + UP, middle, half)


def swung(turn: float) -> float:
    """How far a way of one metre ends from where it would, turned by up to `turn` radians, metres."""
    return 2 * float(np.sin(min(turn, np.pi) / 2))


def common_arc(middles: Floats, halves: Floats) -> tuple[float, float] | None:
    """Middle and half range of the headings that are in every arc; None if there are none.

    Parameters
    ----------
    middles, halves : ndarray, shape (arcs,)
        Radians; whole turns don't matter, and from pi on an arc is the whole circle.

    Notes
    -----
    *Guarantee*: no common heading is left out. An arc that meets the narrowest one from both sides is not used.
    """
    k = int(halves.argmin())
    around, least = float(middles[k]), float(halves[k])
    if least >= np.pi:
        return around, float(np.pi)
    # arcs relative to the narrowest; one that could overlap it from both sides is left out
    offset = wrapped(middles - around)
    use = halves + least + np.abs(offset) < 2 * np.pi
    use[k] = True
    low, high = (offset - halves)[use].max(), (offset + halves)[use].min()
    return None if low > high else (around + (low + high) / 2, float(high - low) / 2 + UP)


def wrapped(angle: Floats) -> Floats:
    """Angles in [-pi, pi)."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
