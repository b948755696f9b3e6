"""Where robots on arcs are, in extended precision, and how far that leaves the chords between sampled times."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .model import Case, Floats, Long, Longs, ends_of

EPS = Long(np.finfo(Long).eps)


@dataclass(frozen=True, eq=False)
class Motion:
    """The robots of a case; a member is a row of numbers in the order of the parameters."""

    case: Case

    @cached_property
    def rates(self) -> tuple[Longs, Longs]:
        """Speed and turn rate of each step, counter-clockwise from +x."""
        u = np.array(self.case.controls, dtype=Long)
        turn = u[:, 1] if self.case.system == "unicycle" else u[:, 0] * np.tan(u[:, 1]) / Long(self.case.wheelbase)
        return u[:, 0], turn if self.case.heading_from == "x" else -turn

    @property
    def step(self) -> np.longdouble:
        """Seconds."""
        return Long(self.case.duration) / len(self.case.controls)

    @cached_property
    def grid(self) -> Longs:
        """Times between steps."""
        return np.append(np.arange(len(self.case.controls)) * self.step, Long(self.case.duration))

    @cached_property
    def turned(self) -> Longs:
        """Integral of the turn rate up to the beginning of each step."""
        return np.concatenate([[Long(0)], np.cumsum(self.rates[1] * self.step)[:-1]])

    def drives(self, members: Floats) -> tuple[Longs, Longs, Longs, Longs]:
        """Factors on speed and turn rate, heading, and place at the start, each with one row a member."""
        count = len(members)
        a, b = np.ones(count, Long), np.ones(count, Long)
        heading = np.full(count, Long(self.case.heading))
        place = np.tile(np.array(self.case.position, dtype=Long), (count, 1))
        for name, values in zip(self.case.distributions, np.asarray(members, dtype=Long).T, strict=True):
            match name:
                case "traction":
                    a, b = values, values
                case "linear_traction":
                    a = values
                case "angular_traction":
                    b = values
                case "start_heading":
                    heading = heading + values
                case "start_x":
                    place[:, 0] += values
                case "start_y":
                    place[:, 1] += values
        return a, b, heading, place

    def paths(self, members: Floats, times: Longs) -> Longs:
        """Places of members at some times, shape (members, times, 2)."""
        v, _ = self.rates
        a, b, heading, place = (part[:, None] for part in self.drives(members))
        n = np.clip(np.searchsorted(self.grid, times, side="right") - 1, 0, len(v) - 1)
        span = np.clip(times - self.grid[n], 0, self.step)
        whole = self._moves(a, b, heading, np.arange(len(v)), np.full(len(v), self.step))
        grid = np.concatenate([np.zeros((len(members), 1, 2), Long), np.cumsum(whole, axis=1)[:, :-1]], axis=1)
        return np.asarray(place + (grid[:, n] + self._moves(a, b, heading, n, span)))

    def _moves(self, a: Longs, b: Longs, heading: Longs, n: np.ndarray, span: Longs) -> Longs:
        """What members move within a step, shape (members, times, 2)."""
        v, w = self.rates
        half = b * w[n] * span / 2
        chord = np.where(half == 0, Long(1), np.sin(half) / np.where(half == 0, Long(1), half))
        angle = heading + b * self.turned[n] + half
        length = a * v[n] * span * chord
        return np.stack([length * np.cos(angle), length * np.sin(angle)], axis=-1)

    def slack(self, members: Floats) -> np.longdouble:
        """Rounding of the places, metres: of each move a few and its angle's, and one of every sum."""
        a, b, heading, place = self.drives(members)
        way = np.abs(self.rates[0]).sum() * self.step * np.abs(a).max()
        angle = (
            np.abs(heading).max() + np.abs(b).max() * np.abs(self.turned).max(initial=0) + np.abs(self.rates[1]).max()
        )
        steps = len(self.case.controls) + 8
        return Long(2 * EPS * steps * (way * (1 + angle) + np.abs(place).max()))

    def knots(self, extra: list[np.longdouble], fine: float, most: int) -> tuple[Longs, Longs]:
        """Times between which chords are close to the arcs of members, and how long the pieces of each step are.

        Parameters
        ----------
        extra : list
            Times that have to be among them.
        fine : float
            Metres that a chord may leave its arc by, as far as `most` times are enough.
        most : int
            About so many times.
        """
        v, w = self.rates
        sag = self.fastest * np.abs(v * w) * self.step**2 / 8
        parts = np.clip(np.ceil(np.sqrt((sag / fine).astype(float))), 1, max(1, most // len(v))).astype(int)
        shares = np.concatenate([np.arange(k, dtype=Long) / k for k in parts])
        base = np.repeat(self.grid[:-1], parts) + self.step * shares
        extra = [t for t in extra if 0 <= t <= self.grid[-1]]
        return np.unique(np.concatenate([base, np.array([*extra, self.grid[-1]], Long)])), self.step / parts

    @cached_property
    def fastest(self) -> np.longdouble:
        """Largest product of the factors of any member."""
        a, b, *_ = self.drives(
            np.array([[max(map(abs, ends_of(distribution))) for distribution in self.case.distributions.values()]])
        )
        return Long(np.abs(a * b).max())

    def sagitta(self, pieces: Longs) -> np.longdouble:
        """By how much chords over `pieces` of each step leave the arcs at most, metres."""
        v, w = self.rates
        return Long((self.fastest * np.abs(v * w) * pieces**2 / 8).max())
