r"""How far a robot on arcs may be from its model's place, for all disturbances within their bounds.

Write `theta` and `p` for the heading and the place of the member's model, and ``e`` for the error of the heading.  The
true robot has ``|e'| <= D`` and ``q' = (a v + d) u(theta + e) + w`` with ``|d| <= V`` and ``|w| <= W``, where

.. math::
   V = a\,(dv + \alpha (|v| + dv)), \qquad D = b\,(d\omega + \beta (|\omega| + d\omega)) + w_\theta

collect the errors of the commands, ``dv`` and ``domega``, and of the factors, shares ``alpha`` and ``beta`` of them;
where a patch of terrain may take factors away by ``da`` and ``db``, with ``da (1 + alpha) (|v| + dv)`` and its like.
Hence ``|q - p| <= int V + W + H``, where `H` is what the heading adds, and both of these bound it:

1. *by the way*: ``H <= int a |v| min(|e|, 2)``;
2. *by chords*: integration by parts turns ``int (R(e) - 1) dp`` into ``int e'(s) R(e(s)) J (p(t) - p(s)) ds``, without
   any remainder, so that ``H <= |e(0)| |p(t) - p(0)| + int D(s) |p(t) - p(s)| ds``.

A loop on the heading, ``e' = -e / tau + ..``, keeps ``|e|`` below ``tau D``; then the first bound alone is used.  A
step whose commands, all together, begin up to `J` seconds early or late adds ``J`` times the change of the rates: a
bicycle whose speed is early and whose steering is late may have a turn rate of neither step.  A robot that waits for
``delta <= Delta`` is where its undelayed self was ``delta`` before, but for a drift while it waits; it lags behind by
at most ``a Delta max |v|`` over the last `Delta` seconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from math import ceil
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

UNIT = float(np.finfo(float).eps)
"""Twice the unit roundoff of double precision."""
MOST_CHORDS = 1_200
"""Steps beyond which the heading's error is bounded by the way alone."""


class Chords(Protocol):
    """Distances of a fleet's places from each other."""

    def __call__(self) -> Iterator[Floats]:
        """For each cell of members upper bounds of ``|p(t_n) - p(t_k)|``, shape (steps + 1, steps + 1), metres."""


@dataclass(frozen=True, eq=False)
class Errors:
    """What the bounds come to for one plan, by steps.

    Attributes
    ----------
    place : ndarray, shape (steps,)
        Metres by which a robot may be away, during each step, from where its model was, at most `delay` before.
    lag : ndarray, shape (steps,)
        Metres by which it may be behind for its delay, in addition.
    delay : float
        Seconds.
    strays : ndarray, shape (2, steps), optional
        By how much terrain may change the factors on speed and turn rate.
    cells : ndarray, shape (cells, steps), optional
        `place` for the members of each cell of those that the chords are of.
    """

    place: Floats
    lag: Floats
    delay: float
    strays: Floats | None = None
    cells: Floats | None = None


def arc_errors(
    problem: Problem,
    controls: Floats,
    step: float,
    fastest: float,
    sharpest: float,
    chords: Chords,
    strays: Floats | None = None,
) -> Errors:
    """The errors of a fleet of robots on arcs.

    Parameters
    ----------
    problem : Problem
        Whose fleet's uncertainty counts.
    controls : ndarray, shape (steps, 2)
    step : float
        Seconds of each step.
    fastest, sharpest : float
        Largest absolute factors `a` on the speed and `b` on the turn rate.
    chords : callable
    strays : ndarray, shape (2, steps), optional
        By how much the factors on the speed and on the turn rate may be off in each step, in addition.

    Notes
    -----
    *Guarantee*: upper bounds for every member and every disturbance within the bounds, rounding included.
    """
    bounds, rates = problem.fleet.uncertainty, _Rates.of(problem, controls, fastest, sharpest)
    rates = rates if strays is None else rates.straying(strays)
    if bounds.jitter > step / 2:  # commands might change places
        return Errors(np.full(len(controls), np.inf), _lags(rates, step), bounds.delay, strays)
    turn, count = _turns(rates, step), len(controls)
    by_way = np.concatenate([[0.0], np.cumsum(step * rates.way * np.minimum(turn, 2.0))])
    within = by_way[None, 1:]
    if bounds.heading_hold is None and rates.turns and count <= MOST_CHORDS:
        ends = np.minimum(by_way, _by_chords(rates, step, chords))
        # H is Lipschitz within a step, from both of its ends
        slope = step * rates.way * np.minimum(turn, 2.0)
        within = np.minimum(ends[:, :-1] + slope, (ends[:, :-1] + ends[:, 1:] + slope) / 2)
    # int V + W, the wait before the start, and all commands that began early or late so far
    driven = rates.drift * bounds.delay + np.cumsum(step * (rates.drift + rates.speed))
    place = within + driven + _counted(rates.speed_jumps)
    up = 1 + 64 * UNIT * (count + 8)
    cells = np.where(np.isnan(place), np.inf, place * up)
    each = cells if len(cells) > 1 else None
    return Errors(cells.max(axis=0), _lags(rates, step) * up, bounds.delay, strays, each)


def signal_errors(
    problem: Problem, controls: Floats, step: float, fastest: float, sharpest: float, strays: Floats | None = None
) -> dict[str, Floats]:
    """By how much headings, speeds, turn rates and commands of a robot may be off in each step, shape (steps,).

    Arguments are those of `arc_errors`.

    Notes
    -----
    *Guarantee*: upper bounds; infinite for rates and commands of robots that may be early or late, and for the turn
    rate under a loop on the heading, which nothing here bounds.
    """
    names, still = problem.fleet.system.controls, np.zeros(len(controls))
    bounds = problem.fleet.uncertainty
    if not problem.uncertain:
        return dict.fromkeys((*names, "v", "omega", "heading"), still)
    rates = _Rates.of(problem, controls, fastest, sharpest)
    if problem.terrain:
        rates = rates.straying(np.full((2, len(controls)), np.inf) if strays is None else strays)
    up = 1 + 64 * UNIT * (len(controls) + 8)
    untimely = still + (np.inf if bounds.delay or bounds.jitter else 0.0)
    held = still + (0.0 if bounds.heading_hold is None else np.inf)
    found = dict(zip(names, bounds.command_errors(names, controls).T * up + untimely[:, None].T, strict=True))
    # who lags behind has turned less by at most b Delta max |omega|; commands that may change places give no bound
    omega = problem.fleet.arcs.rates(*controls.T)[1]
    lag = bounds.delay * sharpest * float(np.abs(omega).max())
    heading = _turns(rates, step) * up + lag * up
    heading = heading + (np.inf if bounds.jitter > step / 2 else 0.0)
    found |= {"v": rates.speed * up + untimely, "omega": rates.turn * up + untimely + held, "heading": heading}
    return {name: np.where(np.isnan(error), np.inf, error) for name, error in found.items()}


@dataclass(frozen=True, eq=False)
class _Rates:
    """Bounds by step: `way` is ``a |v|``, `speed` V, `turn` D; `drift` W; jumps are of early and late commands.

    `bend` is ``a |v| b |omega|``, a bound of ``|p''|``; `most` is what a change of each factor by one changes its rate
    by, shape (2, steps).
    """

    way: Floats
    bend: Floats
    speed: Floats
    turn: Floats
    speed_jumps: Floats
    turn_jumps: Floats
    drift: float
    wait: float
    delay: float
    jitter: float
    hold: float | None
    most: Floats

    @classmethod
    def of(cls, problem: Problem, controls: Floats, fastest: float, sharpest: float) -> _Rates:
        """The rates of a problem's fleet."""
        fleet, bounds = problem.fleet, problem.fleet.uncertainty
        v, omega = fleet.arcs.rates(*controls.T)
        slipped, swerved = slips(fleet, controls)
        drift, wait = pushes(fleet)
        speed, turn = fastest * slipped, sharpest * swerved + wait
        # J times the change of the rates, and of their bounds, where each command begins
        jumps, jumps_of_turn = (
            bounds.jitter * (factor * np.abs(np.diff(rate, prepend=0.0)) + np.abs(np.diff(error, prepend=0.0)))
            for factor, rate, error in ((fastest, v, speed), (sharpest, omega, turn))
        )
        way = fastest * np.abs(v)
        times = bounds.delay, bounds.jitter, bounds.heading_hold
        # (1 + alpha) (|v| + dv) and (1 + beta) (|omega| + domega); a command of a step beside may be early or late
        most = np.stack([np.abs(v) + slipped, np.abs(omega) + swerved])
        if bounds.jitter:
            wide = np.pad(most, ((0, 0), (1, 1)))
            most = np.maximum(most, np.maximum(wide[:, :-2], wide[:, 2:]))
        bend = way * sharpest * np.abs(omega)
        return cls(way, bend, speed, turn, jumps, jumps_of_turn, drift, wait, *times, most)

    def straying(self, strays: Floats) -> _Rates:
        """The same where the factors may be off by more, by `strays` of shape (2, steps)."""
        more = np.where(strays > 0, strays * self.most, 0.0)
        return replace(self, speed=self.speed + more[0], turn=self.turn + more[1])

    @property
    def turns(self) -> bool:
        """Whether headings have any error."""
        return bool(self.turn.any() or self.turn_jumps.any())


def slips(fleet: Any, controls: Floats) -> tuple[Floats, Floats]:
    """Bounds of ``V / a`` and ``(D - w_theta) / b`` in each step: what commands and factors are off by.

    Parameters
    ----------
    fleet : Fleet
        On arcs.
    controls : ndarray, shape (steps, 2)

    Returns
    -------
    speed, turn_rate : ndarray, shape (steps,)
        m/s and rad/s; infinite where commands with their errors are beyond what is known of the rates.
    """
    v, omega = fleet.arcs.rates(*controls.T)
    dv, domega = _command_errors(fleet, controls)
    alpha, beta = (_strays(fleet, place) for place in (0, 1))
    return dv + alpha * (np.abs(v) + dv), domega + beta * (np.abs(omega) + domega)


def pushes(fleet: Any) -> tuple[float, float]:
    """Bounds `W` and ``w_theta`` of what disturbs the place and the heading, m/s and rad/s."""
    given = fleet.uncertainty.disturbance
    place = given.get("position", 0.0) + float(np.hypot(given.get("x", 0.0), given.get("y", 0.0)))
    return place, given.get("heading", 0.0)


def _command_errors(fleet: Any, controls: Floats) -> tuple[Floats, Floats]:
    """Largest errors of speed and turn rate; infinite where they are not known to be extreme at corners."""
    spread = fleet.uncertainty.command_errors(fleet.system.controls, controls)
    v, omega = fleet.arcs.rates(*controls.T)
    if not spread.any():
        return np.zeros_like(v), np.zeros_like(v)
    # rates that are monotone in each command are extreme where both are
    low, high = np.array(fleet.arcs.monotone or ((np.inf, -np.inf),) * 2).T
    known = ((controls - spread >= low) & (controls + spread <= high)).all(axis=1)
    corners = [fleet.arcs.rates(*(controls + np.array(signs) * spread).T) for signs in product((-1.0, 1.0), repeat=2)]
    found = []
    for k, rate in enumerate((v, omega)):
        # the largest change, and some roundings of the rates themselves
        change, size = (np.max([np.abs(corner[k] - zero) for corner in corners], axis=0) for zero in (rate, 0.0))
        found.append(np.where(known, (change + 16 * UNIT * size) * (1 + 16 * UNIT), np.inf))
    return found[0], found[1]


def _strays(fleet: Any, place: int) -> float:
    """The largest share by which the factor on the speed (0) or on the turn rate (1) strays from its own value."""
    factors = [1 + share for name, share in fleet.uncertainty.varies.items() if fleet.arcs.directions[name][place]]
    return float(np.prod(factors)) - 1 if factors else 0.0


def _turns(rates: _Rates, step: float) -> Floats:
    """The largest heading error during each step, radians."""
    if rates.hold is None:
        # |e| <= |e(0)| + int D, and what early and late commands add
        ends = rates.wait * rates.delay + np.cumsum(step * rates.turn)
        return np.asarray(ends + _counted(rates.turn_jumps))
    # e' = -e / tau + D: over a step e falls to q e and gains tau (1 - q) D
    up = 1 + 16 * UNIT
    kept = float(np.exp(-step / rates.hold)) * up
    gained = -float(np.expm1(-step / rates.hold)) * rates.hold * up
    e, old, found = rates.wait * min(rates.delay, rates.hold), 0.0, np.empty(len(rates.turn))
    after = np.append(rates.turn_jumps[1:], 0.0)
    for n, rate in enumerate(rates.turn):
        end = (kept * e + gained * rate) * up
        # a jump counts in full from the step before it to the end of its own, and falls from then on
        found[n] = max(e, end) + old + rates.turn_jumps[n] + after[n]
        e, old = end, kept * (old + rates.turn_jumps[n]) * up
    return found


def _counted(jumps: Floats) -> Floats:
    """The sum of all jumps up to the end of each step, that of the next one included."""
    return np.asarray(np.append(np.cumsum(jumps)[1:], jumps.sum()))


def _by_chords(rates: _Rates, step: float, chords: Chords) -> Floats:
    """The second bound of `H` at all grid times, for the members of each cell, shape (cells, steps + 1)."""
    count = len(rates.turn)
    before = np.tri(count + 1, count, -1)  # steps k < n
    # masses of |e'|: D in each step, e(0) at the start, jumps near their grid times
    late = np.tri(count + 1, count, 1) * rates.turn_jumps
    near = rates.jitter * float(rates.way.max(initial=0.0))
    found = []
    for away in chords():
        # a place in a step is off by at most |p''| h^2 / 8 from the one between its ends, whose distance is convex
        mean = (away[:, :-1] + away[:, 1:]) / 2 + rates.bend * step**2 / 8
        total = (before * mean) @ (step * rates.turn) + rates.wait * rates.delay * away[:, 0]
        if rates.turn_jumps.any():
            total += (late * (away[:, :-1] + near)).sum(axis=1)
        found.append(total)
    return np.array(found)


def _lags(rates: _Rates, step: float) -> Floats:
    """``a Delta max |v|`` over the last `Delta` seconds of each step."""
    if not rates.delay:
        return np.zeros(len(rates.way))
    back = min(ceil(rates.delay / step) + 1, len(rates.way))
    padded = np.concatenate([np.zeros(back), rates.way])
    windows = np.lib.stride_tricks.sliding_window_view(padded, back + 1)
    return np.asarray(rates.delay * windows.max(axis=1))
