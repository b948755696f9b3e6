"""States of systems that an ODE defines, as polynomials of the members' parameters.

Where the flow depends smoothly on a few parameters, the trajectories of some tens of members at Chebyshev points give
those of all others by one matrix product.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import RunawayError
from ensemble_ctrl.problem.evaluation.chebyshev import coefficients, points, polynomials
from ensemble_ctrl.problem.evaluation.group_signals import GroupSignals
from ensemble_ctrl.problem.evaluation.groups import ROUNDING
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FIRST, TRIES = 3, 16
"""Interpolation points in each parameter to begin with, and how often there are more in one of them."""
MOST = 400
"""Points in all; beyond, members are integrated one by one."""
ERROR = 1e-10
"""Largest difference from integrated members, relative to a state's size where that is above 1."""
CHECKS = 12
"""Members at which that is measured, besides the corners of the ranges."""
MEMORY = 4_000_000
"""Numbers in the table of coefficients, at most."""


@dataclass(frozen=True, eq=False)
class ParameterCurves:
    """The states of a fleet as polynomials of the parameters that bend its trajectories.

    Attributes
    ----------
    fleet : Fleet
    table : ndarray, shape (n_x, count, times)
        Coefficients of the products of Chebyshev polynomials.
    counts : tuple of int
        Polynomials in each of the parameters that bend trajectories.
    low, high : ndarray, shape (bending parameters,)
        Their ranges.
    step : float
        Seconds between two times.

    Notes
    -----
    No bound is known for any ODE: the difference from integrated members is measured, at the corners and at `CHECKS`
    members between the interpolation points, and is at most `ERROR`, a hundredth of what the integration is off by.
    """

    fleet: Fleet
    table: Floats
    counts: tuple[int, ...]
    low: Floats
    high: Floats
    step: float

    @classmethod
    def of(cls, fleet: Fleet, controls: Floats, step: float, members: Floats) -> ParameterCurves | None:
        """The states of members with parameters up to those of some, under controls of one row a step.

        None where they are no polynomials of a moderate degree, and for systems with an exact flow, which is as quick.
        """
        if fleet.system.has_exact or not fleet.dynamic:
            return None
        bending = members[:, list(fleet.dynamic)]
        low, high = bending.min(axis=0, initial=np.inf), bending.max(axis=0, initial=-np.inf)
        rows = np.random.default_rng(0).uniform(size=(CHECKS, len(low)))
        corners = np.array(np.meshgrid(*[(0.0, 1.0)] * len(low))).reshape(len(low), -1).T[:64]
        checks = _members(fleet, low + np.concatenate([rows, corners]) * (high - low))
        counts = [FIRST if b > a else 1 for a, b in zip(low, high, strict=True)]
        try:
            wanted = fleet.trajectories(controls, checks, step)
            for _ in range(TRIES):
                if np.prod(counts) > MOST or np.prod(counts) * wanted[0].size > MEMORY:
                    return None
                values = _table(fleet, controls, step, counts, low, high)
                table = np.ascontiguousarray(values.reshape(-1, *wanted.shape[1:]).transpose(2, 0, 1))
                found = cls(fleet, table, tuple(counts), low, high, step)
                states = found.group(checks).during(0, len(controls)).transpose(1, 2, 0)
                if (np.abs(states - wanted) <= ERROR * np.maximum(1.0, np.abs(wanted))).all():
                    return found
                # more points along the parameter whose last coefficients are largest
                last = [np.abs(np.take(values, n - 1, axis=k)).max() if n > 1 else 0.0 for k, n in enumerate(counts)]
                side = int(np.argmax(last))
                counts[side] += max(1, counts[side] // 3)
        except RunawayError:  # found again for the members themselves
            return None
        return None

    @property
    def steps(self) -> int:
        """How many steps there are between the times."""
        return len(self.table[0, 0]) - 1

    def covers(self, members: Floats) -> bool:
        """Whether the polynomials are for members of shape (members, parameters)."""
        bending = members[:, list(self.fleet.dynamic)]
        return bool(((bending >= self.low) & (bending <= self.high)).all())

    @cached_property
    def sizes(self) -> Floats:
        """Length of every coefficient of the position, shape (count, times), metres."""
        return np.asarray(np.linalg.norm(self.table[self.fleet.place_columns], axis=0))

    def group(self, members: Floats) -> ParameterGroup:
        """The group of members of shape (members, parameters)."""
        bending = members[:, list(self.fleet.dynamic)].T
        middle, half = (self.low + self.high) / 2, (self.high - self.low) / 2
        each = [
            polynomials((values - m) / h if h > 0 else np.zeros_like(values), count)
            for values, m, h, count in zip(bending, middle, half, self.counts, strict=True)
        ]
        # weights of the product basis, T_i(z_1) T_j(z_2) ..., the last parameter running fastest
        ones = np.ones((1, len(members)))
        weights = reduce(lambda a, b: (a[:, None] * b).reshape(-1, len(members)), each, ones)
        center = self.fleet.center
        return ParameterGroup(self, weights.T, ((members - center) @ self.fleet.shifting).T)


@dataclass(frozen=True, eq=False)
class ParameterGroup:
    """A group of members, whose states are computed where they are needed.

    Attributes
    ----------
    curves : ParameterCurves
    weights : ndarray, shape (members, count)
        Every product of polynomials.
    shift : ndarray, shape (d, members)
        By how much parameters shift the position, metres.
    """

    curves: ParameterCurves
    weights: Floats
    shift: Floats

    @cached_property
    def _among(self) -> int:
        """The member whose curve is the middle."""
        return len(self.weights) // 2

    @cached_property
    def middle(self) -> Floats:
        """The curve of one member."""
        k = self._among
        one = ParameterGroup(self.curves, self.weights[[k]], self.shift[:, [k]])
        return np.asarray(one.places(np.arange(self.curves.steps + 1))[:, 0].T)

    @cached_property
    def reach(self) -> Floats:
        """How far another member can be from that curve."""
        k = self._among
        # |sum_k (w_k - w0_k) c_k| <= sum_k max |w_k - w0_k| |c_k|, over the members
        apart = np.abs(self.weights - self.weights[k]).max(axis=0)
        moved = np.linalg.norm(self.shift - self.shift[:, [k]], axis=0).max()
        return np.asarray((apart @ self.curves.sizes + moved) * (1 + ROUNDING) + ROUNDING)

    @property
    def signals(self) -> GroupSignals:
        """States at the times that a formula reads."""
        curves = self.curves
        return GroupSignals(self.during, curves.fleet.states, curves.step, len(self.weights), curves.steps)

    def places(self, when: Ints) -> Floats:
        """Positions at some of the times."""
        table = self.curves.table[self.curves.fleet.place_columns][:, :, when]
        return np.stack([self.weights @ axis for axis in table]) + self.shift[:, :, None]

    def during(self, first: int, last: int) -> Floats:
        """States at the times first..last, shape (n_x, members, last - first + 1)."""
        found = np.stack([self.weights @ state for state in self.curves.table[:, :, first : last + 1]])
        found[self.curves.fleet.place_columns] += self.shift[:, :, None]
        return found


def _members(fleet: Fleet, bending: Floats) -> Floats:
    """Members with these parameters that bend trajectories; the others are at their middles."""
    members = np.tile(fleet.center, (len(bending), 1))
    members[:, list(fleet.dynamic)] = bending
    return members


def _table(fleet: Fleet, controls: Floats, step: float, counts: Sequence[int], low: Floats, high: Floats) -> Floats:
    """Coefficients of the states in the product basis, shape (*counts, times, n_x)."""
    axes = [(a + b) / 2 + (b - a) / 2 * points(n) for a, b, n in zip(low, high, counts, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    states = fleet.trajectories(controls, _members(fleet, nodes), step)
    values = states.reshape(*counts, *states.shape[1:])
    # one transform after the other, along each parameter
    for axis in range(len(counts)):
        values = np.moveaxis(coefficients(np.moveaxis(values, axis, 0)), 0, axis)
    return values
