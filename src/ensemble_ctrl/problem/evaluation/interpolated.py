r"""Positions of thousands of members by one matrix product.

Under given controls a robot on arcs is at :math:`p_n = p_0 + a R(g) s_n(b)`: its linear factor, its start heading and
its start enter as they are, and only the angular factor b bends the curve, by a function that is entire in b. The exact
arcs of a few robots at Chebyshev points of b therefore give those of all others, to rounding.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem.evaluation.chebyshev import coefficients, interpolation_error, points, polynomials
from ensemble_ctrl.problem.evaluation.group_signals import GroupSignals
from ensemble_ctrl.problem.evaluation.groups import ROUNDING
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST = 96
"""Interpolation points beyond which exact arcs are as quick."""
MEMORY = 10_000_000
"""Points times sampled times, at most: 160 MB of coefficients."""
UNIT = float(np.finfo(float).eps) / 2
"""Rounding unit."""


@dataclass(frozen=True, eq=False)
class ArcCurves:
    r"""The curves :math:`s_n(b)` of a fleet on arcs, as polynomials of the angular factor.

    Attributes
    ----------
    fleet : Fleet
        On arcs.
    table : ndarray, shape (2, count, times)
        Coefficients of the Chebyshev polynomials, metres for a linear factor of 1.
    middle, half : float
        The range of the angular factor is ``middle`` plus and minus ``half``.
    step : float
        Seconds between two times.
    error : float
        Metres.
    controls : ndarray, shape (steps, 2)
        Commands.
    signals : tuple of str
        What is read besides the position (`ArcSystem.signal`), exactly.

    Notes
    -----
    *Guarantee*: for members in the fleet's ranges, positions by the polynomials are within `error` of exact arithmetic:
    the interpolation error (`interpolation_error`), the rounding of the arcs at the interpolation points, amplified by
    Lebesgue's constant, and that of the product.
    """

    fleet: Fleet
    table: Floats
    middle: float
    half: float
    step: float
    error: float
    controls: Floats
    signals: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, fleet: Fleet, controls: Floats, step: float, members: Floats, signals: tuple[str, ...] = ()
    ) -> ArcCurves | None:
        """The curves for angular factors up to those of some members, under controls of one row a step.

        None where too many polynomials are needed, or there are too many times for all of them.
        """
        robots = fleet.coefficients(members)
        low, high = float(robots[:, 1].min()), float(robots[:, 1].max())
        middle, half = low / 2 + high / 2, high / 2 - low / 2
        v, omega = fleet.arcs.rates(*controls.T)
        turned = np.concatenate([[0.0], step * np.cumsum(omega)])
        turn = float(np.abs(turned).max())
        count = _count(half * turn)
        if count > MOST or count * len(turned) > MEMORY:
            return None
        # exact arcs of robots with linear factor 1 from the origin, at the Chebyshev points of b
        unit = np.zeros((count, 5))
        unit[:, 0], unit[:, 1] = 1.0, middle + half * points(count)
        table = np.ascontiguousarray(coefficients(fleet.arcs.paths(controls, unit, step)).transpose(2, 0, 1))
        length = float(step * np.abs(v).sum())
        error = interpolation_error(half * turn, count) * length + _rounding(
            table, length, turn * (abs(middle) + half), len(v)
        )
        factor, start = float(np.abs(robots[:, 0]).max()), float(np.abs(robots[:, 3:]).max())
        error = factor * error + 4 * UNIT * (start + factor * length)
        return cls(fleet, table, middle, half, step, error, controls, signals)

    def covers(self, members: Floats) -> bool:
        """Whether the polynomials are for members of shape (members, parameters)."""
        apart = np.abs(self.fleet.coefficients(members)[:, 1] - self.middle)
        return bool((apart <= self.half + 4 * UNIT * abs(self.middle)).all())

    @property
    def steps(self) -> int:
        """How many steps there are between the times."""
        return len(self.table[0, 0]) - 1

    @cached_property
    def sizes(self) -> Floats:
        """Length of every coefficient, shape (count, times), metres."""
        return np.asarray(np.hypot(*self.table))

    @cached_property
    def turns(self) -> bool:
        """Whether members differ in the heading at the start."""
        return bool(self.fleet.directions[:, 2].any())

    def group(self, members: Floats) -> ArcGroup:
        """The group of members of shape (members, parameters)."""
        robots = self.fleet.coefficients(members)
        linear, angular, heading, *start = robots.T
        z = np.zeros_like(angular) if self.half == 0.0 else (angular - self.middle) / self.half
        weights = polynomials(z, self.table.shape[1])
        weights *= linear
        turn = heading if self.fleet.arcs.heading_from == "x" else -heading
        return ArcGroup(self, weights.T, turn, np.stack(start), robots)


@dataclass(frozen=True, eq=False)
class ArcGroup:
    """A group of robots on arcs, whose positions are computed where they are needed.

    Attributes
    ----------
    curves : ArcCurves
        The curves that all robots share.
    weights : ndarray, shape (members, count)
        The linear factor times every polynomial.
    turn : ndarray, shape (members,)
        Angle by which the shared curve is turned, radians.
    start : ndarray, shape (2, members)
        Metres.
    robots : ndarray, shape (members, 5)
        The member coefficients.
    """

    curves: ArcCurves
    weights: Floats
    turn: Floats
    start: Floats
    robots: Floats

    @cached_property
    def _among(self) -> int:
        """The member whose curve is the middle."""
        return len(self.turn) // 2

    @cached_property
    def middle(self) -> Floats:
        """The curve of one member."""
        k = self._among
        one = ArcGroup(self.curves, self.weights[[k]], self.turn[[k]], self.start[:, [k]], self.robots[[k]])
        return np.asarray(one.places(np.arange(self.curves.table.shape[2]))[:, 0].T)

    @cached_property
    def reach(self) -> Floats:
        """How far another member can be from that curve."""
        k = self._among
        # |sum_k (w_k - w0_k) c_k| <= sum_k max |w_k - w0_k| |c_k|, over the members
        apart = np.abs(self.weights - self.weights[k]).max(axis=0)
        bent = apart @ self.curves.sizes
        # chord of the largest angle between two headings, at the distance from the start
        chord = 2 * np.sin(np.minimum(np.abs(self.turn - self.turn[k]).max(), np.pi) / 2)
        from_start = np.linalg.norm(self.middle - self.start[:, k], axis=1)
        moved = np.linalg.norm(self.start - self.start[:, [k]], axis=0).max()
        return np.asarray((bent + chord * from_start + moved) * (1 + ROUNDING) + ROUNDING)

    @property
    def signals(self) -> GroupSignals:
        """Coordinates, and what else is read, at the times that a formula reads."""
        names = (*self.curves.fleet.states, *self.curves.signals)
        return GroupSignals(self.during, names, self.curves.step, len(self.turn), self.curves.steps)

    def places(self, when: Ints) -> Floats:
        """Positions at some of the times."""
        return self._moved(np.stack([self.weights @ axis for axis in self.curves.table[:, :, when]]))

    def during(self, first: int, last: int) -> Floats:
        """Positions and signals at the times first..last, shape (columns, members, last - first + 1)."""
        places = self._moved(np.stack([self.weights @ axis for axis in self.curves.table[:, :, first : last + 1]]))
        more = [signal[None, :, first : last + 1] for signal in self._signals]
        return np.concatenate([places, *more]) if more else places

    @cached_property
    def _signals(self) -> list[Floats]:
        """What is read besides the position at all times, each of shape (members, times)."""
        curves = self.curves
        arcs = curves.fleet.arcs
        return [arcs.signal(name, curves.controls, self.robots, curves.step) for name in curves.signals]

    def _moved(self, curves: Floats) -> Floats:
        """Curves from the origin along the heading of zero, turned and moved to where each robot starts."""
        if self.curves.turns:
            cos, sin = np.cos(self.turn)[:, None], np.sin(self.turn)[:, None]
        else:
            cos, sin = np.cos(self.turn[0]), np.sin(self.turn[0])
        x, y = curves
        return np.stack([cos * x - sin * y, sin * x + cos * y]) + self.start[:, :, None]


def _count(turn: float) -> int:
    """Interpolation points for an error below one rounding of the path's length; more than `MOST` if there are none."""
    enough = (int(count) for count in range(2, MOST + 1) if interpolation_error(turn, count) <= UNIT)
    return next(enough, MOST + 1)


def _rounding(table: Floats, length: float, turn: float, steps: int) -> float:
    """Metres that rounding adds, for a path of a length and a largest angle at linear factor 1."""
    count = table.shape[1]
    # the arcs at the points: running sums of `steps` chords and angles, times Lebesgue's constant of the points
    arcs = (2 * steps + 16) * UNIT * (1 + turn) * length * (2 / np.pi * np.log(count) + 1)
    # the sum over the points, that over the polynomials with |T_k| <= 1, and the turn by the start heading
    sizes = float(np.hypot(*table).sum(axis=0).max())
    return float(arcs + 4 * count * UNIT * length + (4 * count + 16) * UNIT * sizes)
