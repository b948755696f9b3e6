r"""Where every member of a cell of parameters is, at every instant of a step, for fixed controls.

A member is given by its *coefficients*: the factors ``a`` and ``b`` on speed and turn rate, its heading ``g`` and its
place at the start.  With ``u(x) = (cos x, sin x)`` (or sine first, when headings count from +y), its position is

.. math:: p(t) = p_0 + \int_0^t a\, v\, u(g + b\, \Omega)\, d\tau, \quad \Omega(t) = \int_0^t \omega\, d\tau

Coefficients are affine in the parameters.  On a cell, the parameters differ from its centre's by at most ``h``, so that
``a``, ``b`` and ``g`` differ by at most ``A``, ``B`` and ``G``.

1. *In the parameters*: ``p = p(centre) + sum_k (q_k - c_k) dp/dq_k + r`` with
   ``|r| <= int_0^t |v| (A (B |Omega| + G) + a_max (B |Omega| + G)^2 / 2)``.
2. *In time*, on a piece of a step of length ``dt``: a curve leaves its chord by at most ``dt^2/8`` times its largest
   second derivative, which is ``|v omega| |a b|`` for the centre, and for all the derivatives together, times their
   ``h``, ``|v omega| (A |b| + |a| B + |a b| (B |Omega| + G))``.

So during the piece the members of the cell lie in the hull of the points ``p +- h_1 dp/dq_1 +- h_2 dp/dq_2 ...`` at its
two ends, grown by a radius that adds these bounds and one for rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.disturbance import UNIT
from ensemble_ctrl.certificate.instants import Mesh

if TYPE_CHECKING:
    from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

START = slice(3, 5)
"""The place at the start, among the coefficients."""
CELLS = {0: 1, 1: 16, 2: 5, 3: 3}
"""Cells of each of so many parameters to begin with; else 2."""


class Ranged(Protocol):
    """A parameter's range; a distribution has one."""

    @property
    def lower(self) -> float:
        """Smallest value."""

    @property
    def upper(self) -> float:
        """Largest value."""


@dataclass(frozen=True)
class Range:
    """A range, whatever the distribution in it."""

    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class Flow:
    """Closed-form motion of the fleet under fixed controls.

    Attributes
    ----------
    lower, upper : ndarray, shape (parameters,)
        Ranges of the parameters.
    origin, directions : ndarray, shapes (5,) and (parameters, 5)
        The coefficients of parameters ``q`` are ``origin + q @ directions``.
    swapped : bool
        True when headings count from +y, so that sine comes first.
    step, begin : ndarray, shape (steps,)
        Length of each step, and when it begins, seconds.
    v, omega, turned : ndarray, shape (steps,)
        Speed and turn rate of each step, and the integral of the turn rate before it.
    extent : float
        Largest absolute coordinate of any shape of the map, metres: rounding grows with it.
    error, lag : ndarray, shape (steps,)
        Metres by which robots may be away from this motion during each step (`disturbance.Errors`).
    delay : float
        Seconds by which a robot may be late.
    strays : ndarray, shape (2, steps), optional
        By how much terrain may change the factors on speed and turn rate in each step of the controls.
    errors : ndarray, shape (cells, steps), optional
        `error` for the members of each cell of `grid`, which is nowhere above `error`; none if that is not known.
    """

    lower: Floats
    upper: Floats
    origin: Floats
    directions: Floats
    swapped: bool
    step: Floats
    begin: Floats
    v: Floats
    omega: Floats
    turned: Floats
    extent: float
    error: Floats
    lag: Floats
    delay: float = 0.0
    strays: Floats | None = None
    errors: Floats | None = None

    @classmethod
    def of(
        cls, problem: Problem, controls: Floats, ranges: Mapping[str, Ranged] | None = None, mesh: Mesh | None = None
    ) -> Flow:
        """The flow of a problem's fleet, or of one with other ranges of all its parameters.

        Its steps are those of the controls, or the pieces of a mesh of them.
        """
        fleet = problem.fleet
        each = [(fleet.parameters if ranges is None else ranges)[name] for name in fleet.names]
        lower, upper = (np.array([getattr(one, end) for one in each], dtype=float) for end in ("lower", "upper"))
        controls = np.asarray(controls, dtype=float)
        v, omega = fleet.arcs.rates(*controls.T)
        plain, still = Mesh.of(problem.duration, len(v)), np.zeros(len(v))
        affine = lower, upper, fleet.origin, fleet.directions, fleet.arcs.heading_from == "y"
        flow = cls(
            *affine, plain.length, plain.begin, v, omega, _turned(plain.length, omega), _extent(problem), still, still
        )
        flow = flow._disturbed(problem, controls) if problem.uncertain else flow
        return flow if mesh is None else flow.on(mesh)

    def _disturbed(self, problem: Problem, controls: Floats) -> Flow:
        """The same with the errors of the fleet's uncertainty, and of patches of terrain."""
        from ensemble_ctrl.certificate.terrain import errors_of

        found = errors_of(self, problem, controls)
        times = replace(self, error=found.place, lag=found.lag, delay=found.delay)
        return replace(times, strays=found.strays, errors=found.cells)

    @property
    def grid(self) -> int:
        """Cells of each parameter to begin with."""
        return CELLS.get(len(self.lower), 2)

    def on(self, mesh: Mesh) -> Flow:
        """The same motion on the pieces of a mesh of its steps; after the last one robots stand."""
        some, moving = np.minimum(mesh.owner, self.steps - 1), mesh.owner < self.steps
        v, omega = (np.where(moving, rate[some], 0.0) for rate in (self.v, self.omega))
        # after the end, for an instant of rounding, the last step's error again: more than it gains in that instant
        error, lag = np.where(moving, 1.0, 2.0) * self.error[some], self.lag[some]
        turned = _turned(mesh.length, omega)
        errors = None if self.errors is None else np.where(moving, 1.0, 2.0) * self.errors[:, some]
        times = replace(self, step=mesh.length, begin=mesh.begin, error=error, lag=lag, errors=errors)
        return replace(times, v=v, omega=omega, turned=turned)

    def bent(self) -> Flow:
        """The flow of the members that start in the middle of their box: only parameters that bend the curve remain."""
        bends = self.directions[:, :3].any(axis=1)
        # parameters with no part in a, b, g only move the start: fix them in the middle
        middle = (self.lower + self.upper) / 2
        origin = self.origin + middle[~bends] @ self.directions[~bends]
        rest = self.lower[bends], self.upper[bends], origin, self.directions[bends]
        return replace(self, lower=rest[0], upper=rest[1], origin=rest[2], directions=rest[3])

    def shift(self) -> Floats:
        """Half the sides of the box of start positions, shape (2,), metres, rounded up."""
        # half sides of the start box: |D|' (half range), rounded up
        half = (self.upper - self.lower) / 2 + UNIT * np.maximum(np.abs(self.lower), np.abs(self.upper))
        return np.asarray(half @ np.abs(self.directions[:, START]) * (1 + 4 * UNIT))

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.v)

    @cached_property
    def fastest(self) -> float:
        """Largest absolute factor on the speed."""
        return float(np.abs(self.coefficients(self.corners))[:, 0].max())

    @cached_property
    def sharpest(self) -> float:
        """Largest absolute factor on the turn rate."""
        return float(np.abs(self.coefficients(self.corners))[:, 1].max())

    def coefficients(self, members: Floats) -> Floats:
        """Coefficients of members of shape (..., parameters), shape (..., 5)."""
        return np.asarray(self.origin + members @ self.directions)

    def moved(self, n: Ints, share: Floats, coeffs: Floats) -> tuple[Floats, Floats]:
        """Displacement from the start of step `n` to a share of it, (..., 2), and its derivatives by the parameters.

        The derivatives have shape (..., parameters, 2); those by the place at the start are zero.
        """
        # an arc is its chord: v span sinc(b omega span / 2) along the heading g + b Omega at its middle
        a, b, g = coeffs[..., 0], coeffs[..., 1], coeffs[..., 2]
        span = share * self.step[n]
        half = self.omega[n] * span / 2
        turned = self.turned[n] + half
        across, slope = _sinc(b * half), _sinc_slope(b * half)
        along, normal = self._axes(g + b * turned)
        length = self.v[n] * span
        # d(move)/da, d(move)/dg and d(move)/db; the last by the chain rule, through sinc and through the heading
        by_linear = (length * across)[..., None] * along
        by_heading = (a * length * across)[..., None] * normal
        by_angular = (a * length * slope * half)[..., None] * along + turned[..., None] * by_heading
        move = a[..., None] * by_linear
        rates = np.stack([by_linear, by_angular, by_heading], axis=-2)
        # chain rule: (a, b, g) are affine in the parameters
        return move, self.directions[:, :3] @ rates

    def remainder(self, half: Floats) -> Floats:
        """How far members leave their cell's linear picture, at the grid times.

        Parameters
        ----------
        half : ndarray, shape (cells, parameters)
            Half widths of the cells.

        Returns
        -------
        ndarray, shape (cells, steps + 1)
            Metres, rounded up.
        """
        return self.remainder_at(half[:, None], np.arange(self.steps + 1))

    def remainder_at(self, half: Floats, n: Ints) -> Floats:
        """The same for cells of shape (..., parameters) at the grid times `n`, which broadcast with the cells."""
        A, B, G = self._reach(half)
        # Taylor remainder of second order: A (B I1 + G I0) mixed, a/2 (B^2 I2 + 2 B G I1 + G^2 I0) in the angle
        I0, I1, I2 = self._integrals[:, n]
        quadratic = B**2 * I2 + 2 * B * G * I1 + G**2 * I0
        return np.asarray((A * (B * I1 + G * I0) + self.fastest / 2 * quadratic) * (1 + 64 * UNIT * self.steps))

    def growth(self, n: Ints, span: Floats, coeffs: Floats, half: Floats) -> Floats:
        """How far the hull's curves leave their chords on a piece of `span` seconds of step `n`, metres, rounded up.

        Parameters
        ----------
        n : ndarray of int, shape S
            Steps.
        span : ndarray, shape S
            Seconds.
        coeffs : ndarray, shape (*S, 5)
            Coefficients of the centres.
        half : ndarray, shape (*S, parameters)
            Half widths of the cells.
        """
        A, B, G = self._reach(half)
        # a curve leaves its chord by at most span^2/8 sup |p''|, |p''| = |v omega| a b, and what the cell adds to it
        a, b = np.abs(coeffs[..., 0]), np.abs(coeffs[..., 1])
        largest = self.largest[n]
        size = a * b + A * b + a * B + a * b * (B * largest + G)
        return np.asarray(span**2 / 8 * np.abs(self.v[n] * self.omega[n]) * size * (1 + 64 * UNIT))

    def rounding(self) -> float:
        """Bound in metres on the rounding error of any position computed here.

        Notes
        -----
        A position is the start and a sum of `steps` displacements, each with a few relative roundings and an angle
        whose own error is at most ``(steps + 8)`` roundings of its largest value: no partial sum is longer than the
        way. Coordinates are not in that sum. They come in where the start is added to it, and in a distance or level
        of what is then a place beside a shape: fewer than 32 roundings, however many steps there are.
        """
        # |origin| + sum |q| |direction|: what the terms of a coefficient come to, also where they cancel
        ends = np.abs(self.origin) + np.maximum(np.abs(self.lower), np.abs(self.upper)) @ np.abs(self.directions)
        way = float(np.abs(self.v) @ self.step) * float(ends[0])
        angle = float(ends[2]) + float(ends[1]) * float(self.largest.max())
        place = float(ends[START].max()) + way + 8 * self.extent
        return 4 * UNIT * ((self.steps + 32) * way * (1 + angle) + 32 * place)

    @property
    def corners(self) -> Floats:
        """Members at the corners of the ranges, shape (corners, parameters)."""
        # the factors are affine in the parameters: their extremes are at corners of the box
        signs = signs_of(len(self.lower))
        return np.where(signs > 0, self.upper, self.lower)

    def _reach(self, half: Floats) -> tuple[Floats, Floats, Floats]:
        """By how much `a`, `b` and `g` differ in cells of shape (..., parameters)."""
        A, B, G = np.moveaxis(half @ np.abs(self.directions[:, :3]), -1, 0)
        return A, B, G

    @cached_property
    def largest(self) -> Floats:
        """Largest ``|Omega|`` of each step."""
        return np.maximum(np.abs(self.turned), np.abs(self.turned + self.step * self.omega))

    @cached_property
    def _integrals(self) -> Floats:
        """Upper bounds of ``int |v| |Omega|^k`` for k = 0, 1, 2 up to the grid times, shape (3, steps + 1)."""
        # |Omega|^k is largest at an end of a step: a sum of rectangles above the integral
        powers = self.largest ** np.arange(3)[:, None]
        sums = np.cumsum(self.step * np.abs(self.v) * powers, axis=1)
        return np.concatenate([np.zeros((3, 1)), sums], axis=1)

    def _axes(self, angle: Floats) -> tuple[Floats, Floats]:
        """Unit vector of a heading, and its derivative by the angle."""
        s, c = np.sin(angle), np.cos(angle)
        if self.swapped:
            return np.stack([s, c], axis=-1), np.stack([c, -s], axis=-1)
        return np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)


@dataclass(frozen=True, eq=False)
class Track:
    """Positions and their derivatives at the grid times for a list of centres, grown as cells are split.

    Attributes
    ----------
    position : ndarray, shape (centres, steps + 1, 2)
        Metres.
    slope : ndarray, shape (centres, steps + 1, parameters, 2)
        Metres per unit of each parameter.
    """

    position: Floats
    slope: Floats

    @classmethod
    def of(cls, flow: Flow, centres: Floats) -> Track:
        """The track of the members at `centres`, shape (centres, parameters)."""
        coeffs = flow.coefficients(centres)[:, None]
        # positions and slopes at the grid times: the start and the running sum of the steps' displacements
        move, slope = flow.moved(np.arange(flow.steps)[None, :], np.ones(1), coeffs)
        position = np.concatenate([coeffs[..., START], coeffs[..., START] + np.cumsum(move, axis=1)], axis=1)
        start = np.broadcast_to(flow.directions[:, START], (len(centres), 1, *flow.directions[:, START].shape))
        return cls(position, np.concatenate([start, start + np.cumsum(slope, axis=1)], axis=1))

    def joined(self, other: Track) -> Track:
        """Both lists of centres, one after the other."""
        return Track(np.concatenate([self.position, other.position]), np.concatenate([self.slope, other.slope]))


def lowered(bound: Floats) -> Floats:
    """Lower bounds, of which those that are no numbers claim nothing."""
    return np.where(np.isnan(bound), -np.inf, bound)


def signs_of(count: int) -> Floats:
    """Every choice of `count` signs, shape (2^count, count)."""
    return np.asarray(1.0 - 2.0 * ((np.arange(2**count)[:, None] >> np.arange(count)) & 1))


def first_cells(lower: Floats, upper: Floats, each: int | Ints) -> tuple[Floats, Floats]:
    """Centres and half widths (rounded up) of a grid of equal cells, `each` to a range; ranges without width get one.

    Returns
    -------
    centres, half : ndarray, shape (cells, parameters)
    """
    counts = np.where(upper > lower, each, 1)
    edges = [np.linspace(a, b, n + 1) for a, b, n in zip(lower, upper, counts, strict=True)]
    middles = np.meshgrid(*((e[:-1] + e[1:]) / 2 for e in edges), indexing="ij")
    centres = np.stack(middles, axis=-1).reshape(-1, len(lower)) if len(lower) else np.zeros((1, 0))
    # half widths a few roundings up, so that the cells cover the ranges without gaps
    size = np.maximum(np.abs(lower), np.abs(upper))
    half = (upper - lower) / counts / 2 * (1 + 1e-12) + 4 * UNIT * size
    return centres, np.tile(half, (len(centres), 1))


def _extent(problem: Problem) -> float:
    """Largest coordinate of an obstacle's corner, or level of a region's face, in absolute value.

    With the way that a moving obstacle would go at its greatest speed, as times are rounded too.
    """
    # X: corners, levels of faces, offsets of motions and the way at their greatest speed (docs/proof.md, section 5)
    areas = [zone.pieces for zone in problem.zones.values()] + [patch.pieces for patch in problem.terrain.values()]
    pieces = [piece for _, piece in problem.pieces] + [piece for area in areas for piece in area]
    sizes = [float(np.abs(piece.vertices).max()) for piece in pieces]
    levels = (np.abs(region.unit_rows()[1]) for region in problem.regions.values())
    for motion in problem.motions.values():
        speed = np.abs(np.diff(motion.offsets, axis=0)) / np.diff(motion.times)[:, None]
        sizes += [float(np.abs(motion.offsets).max()), problem.duration * float(speed.max())]
    return max([0.0, *sizes, *(float(level[np.isfinite(level)].max(initial=0.0)) for level in levels)])


def _turned(length: Floats, omega: Floats) -> Floats:
    """The turn up to each piece of time for a member of factor b = 1."""
    # Omega_n = sum_{m<n} h_m omega_m
    return np.concatenate([[0.0], np.cumsum(length * omega)[:-1]])


def _sinc(x: Floats) -> Floats:
    """``sin(x) / x``."""
    return np.asarray(np.sinc(x / np.pi))


def _sinc_slope(x: Floats) -> Floats:
    """Derivative of ``sin(x) / x``; a series near zero, where the quotient cancels."""
    small = np.abs(x) < 0.05
    safe = np.where(small, 1.0, x)
    series = -x / 3 * (1 - x**2 / 10 * (1 - x**2 / 28 * (1 - x**2 / 54)))
    return np.asarray(np.where(small, series, (np.cos(safe) - np.sin(safe) / safe) / safe))
