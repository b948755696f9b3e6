r"""Where every member of a parameter cell is, at every instant of a step, for fixed controls.

With ``u(a) = (cos a, sin a)`` (or sine first, when headings count from +y), the position of a unicycle is

.. math:: p(t, \psi) = p_0 + \int_0^t \psi\, v\, u(\theta_0 + \psi \Omega)\, d\tau, \quad
          \Omega(t) = \int_0^t \omega\, d\tau

1. *In the parameter*, on the cell ``[c - h, c + h]``: ``p(t, psi) = p(t, c) + (psi - c) p_psi(t, c) + r`` with
   ``|r| <= h^2/2 * int_0^t |v| (2 |Omega| + psi_max Omega^2)``.
2. *In time*, on a piece of a step of length ``dt``: a curve leaves its chord by at most ``dt^2/8`` times its largest
   second derivative, which is ``c^2 |v omega|`` for ``p(., c)`` and ``|v omega| (2 c + c^2 |Omega|)`` for
   ``p_psi(., c)``.

So during the piece the members of the cell lie in the hull of the four points ``p +- h p_psi`` at its two ends, grown
by a radius that adds these bounds and one for rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.moments import Law
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

UNIT = float(np.finfo(float).eps)
"""Twice the unit roundoff of double precision."""


@dataclass(frozen=True, eq=False)
class Flow:
    """Closed-form motion of the fleet under fixed controls.

    Attributes
    ----------
    start : ndarray, shape (2,)
        Metres.
    heading : float
        Radians, in the system's own convention.
    swapped : bool
        True when headings count from +y, so that sine comes first.
    step : float
        Seconds.
    v, omega, turned : ndarray, shape (steps,)
        Commands of each step, and the integral of omega before it.
    fastest : float
        Largest absolute parameter of the range.
    extent : float
        Largest absolute coordinate of any shape of the map, metres: rounding grows with it.
    """

    start: Floats
    heading: float
    swapped: bool
    step: float
    v: Floats
    omega: Floats
    turned: Floats
    fastest: float
    extent: float

    @classmethod
    def of(cls, problem: Problem, controls: Floats, law: Law) -> Flow:
        """The flow of a problem's fleet with parameters in `law`."""
        v, omega = np.asarray(controls, dtype=float).T
        step = problem.duration / len(v)
        fleet = problem.fleet
        turned = step * np.concatenate([[0.0], np.cumsum(omega)[:-1]])
        return cls(
            np.asarray(fleet.position),
            fleet.own_heading,
            fleet.system.heading_from == "y",
            step,
            v,
            omega,
            turned,
            max(abs(law.lower), abs(law.upper)),
            _extent(problem),
        )

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.v)

    def moved(self, n: Ints, share: Floats, c: Floats) -> tuple[Floats, Floats]:
        """Displacement and its derivative by the parameter, from the start of step `n` to a share of it, (..., 2)."""
        span = share * self.step
        half = self.omega[n] * span / 2
        y = c * half
        across = _sinc(y)
        angle = self.heading + c * (self.turned[n] + half)
        along, normal = self._direction(angle), self._normal(angle)
        length = self.v[n] * span
        move = (c * length * across)[..., None] * along
        slope = (length * (across + c * _sinc_slope(y) * half))[..., None] * along
        slope += (c * length * across * (self.turned[n] + half))[..., None] * normal
        return move, slope

    def remainder(self) -> Floats:
        """``int_0^t |v| (2 |Omega| + psi_max Omega^2)`` at the grid times, bounded above, shape (steps + 1,)."""
        largest = np.maximum(np.abs(self.turned), np.abs(self.turned + self.step * self.omega))
        rate = np.abs(self.v) * (2 * largest + self.fastest * largest**2)
        return np.concatenate([[0.0], np.cumsum(rate) * self.step]) * (1 + 64 * UNIT * self.steps)

    def rounding(self) -> float:
        """Bound in metres on the rounding error of any position computed here.

        Notes
        -----
        A sum of `steps` displacements, each with a few relative roundings and an angle whose own error is at most
        ``(steps + 8)`` roundings of its largest value.
        """
        way = float(np.abs(self.v).sum()) * self.step * self.fastest
        turned = np.abs(np.concatenate([self.turned, self.turned + self.step * self.omega])).max()
        angle = abs(self.heading) + self.fastest * float(turned)
        size = float(np.abs(self.start).max()) + way + 8 * self.extent
        return 4 * UNIT * ((self.steps + 32) * (way * (1 + angle) + size))

    def _direction(self, angle: Floats) -> Floats:
        """Unit vector of a heading."""
        parts = [np.sin(angle), np.cos(angle)] if self.swapped else [np.cos(angle), np.sin(angle)]
        return np.stack(parts, axis=-1)

    def _normal(self, angle: Floats) -> Floats:
        """Derivative of `_direction` by the angle."""
        parts = [np.cos(angle), -np.sin(angle)] if self.swapped else [-np.sin(angle), np.cos(angle)]
        return np.stack(parts, axis=-1)


@dataclass(frozen=True, eq=False)
class Track:
    """Positions and parameter derivatives at the grid times for a list of centres, grown as cells are split.

    Attributes
    ----------
    position, slope : ndarray, shape (centres, steps + 1, 2)
        Metres, and metres per unit of the parameter.
    """

    position: Floats
    slope: Floats

    @classmethod
    def of(cls, flow: Flow, centres: Floats) -> Track:
        """The track of the members at `centres`."""
        n = np.arange(flow.steps)
        move, slope = flow.moved(n[None, :], np.ones(1), np.asarray(centres)[:, None])
        zero = np.zeros((len(centres), 1, 2))
        position = flow.start + np.concatenate([zero, np.cumsum(move, axis=1)], axis=1)
        return cls(position, np.concatenate([zero, np.cumsum(slope, axis=1)], axis=1))

    def joined(self, other: Track) -> Track:
        """Both lists of centres, one after the other."""
        return Track(np.concatenate([self.position, other.position]), np.concatenate([self.slope, other.slope]))


def growth(flow: Flow, n: Ints, span: Floats, c: Floats, h: Floats, remainder: Floats) -> Floats:
    """Radius by which the hull of the four points grows on a piece of `span` seconds of step `n`, metres."""
    rate = np.abs(flow.v[n] * flow.omega[n])
    largest = np.maximum(np.abs(flow.turned[n]), np.abs(flow.turned[n] + flow.step * flow.omega[n]))
    size = np.abs(c)
    bulge = span**2 / 8 * rate * (size**2 + h * (2 * size + size**2 * largest))
    return np.asarray((h**2 / 2 * remainder[n + 1] + bulge) * (1 + 64 * UNIT))


def _extent(problem: Problem) -> float:
    """Largest coordinate of an obstacle's corner, or level of a region's face, in absolute value."""
    sizes = [float(np.abs(piece.vertices).max()) for _, piece in problem.pieces]
    levels = (np.abs(region.unit_rows()[1]) for region in problem.regions.values())
    return max([0.0, *sizes, *(float(level[np.isfinite(level)].max(initial=0.0)) for level in levels)])


def _sinc(x: Floats) -> Floats:
    """``sin(x) / x``."""
    return np.asarray(np.sinc(x / np.pi))


def _sinc_slope(x: Floats) -> Floats:
    """Derivative of ``sin(x) / x``; a series near zero, where the quotient cancels."""
    small = np.abs(x) < 0.05
    safe = np.where(small, 1.0, x)
    series = -x / 3 * (1 - x**2 / 10 * (1 - x**2 / 28 * (1 - x**2 / 54)))
    return np.asarray(np.where(small, series, (np.cos(safe) - np.sin(safe) / safe) / safe))
