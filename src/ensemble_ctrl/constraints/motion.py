"""How an obstacle moves: its displacement over time, linear between given times, and how well that is known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyArrays

Floats = NDArray[np.float64]

SLICE, SLICES = 0.03, 24
"""Metres that the uncertainty grows by in one slice of time, and the largest number of slices."""
SPARE = 1e-12
"""Relative error of a radius and of a time, beyond that of their rounding."""


@dataclass(frozen=True, eq=False)
class Motion(ReadOnlyArrays):
    """Displacement from where an obstacle is drawn; it does not turn.

    Parameters
    ----------
    times : array_like, shape (entries,)
        Seconds, increasing, at least two.
    offsets : array_like, shape (entries, d)
        Metres, in the plane or in space.
    uncertainty, growth, since : float
        The obstacle is anywhere within ``uncertainty + growth * max(t - since, 0)`` metres of its displacement at time
        t: metres, m/s and seconds. Without both it is where it is said to be.

    Raises
    ------
    ProblemError
        For other shapes, times that do not increase, or numbers that are not finite.

    Examples
    --------
    >>> Motion([0, 4], [[0, 0], [2, 0]]).at(1.0)
    array([0.5, 0. ])
    """

    times: Floats
    offsets: Floats
    uncertainty: float = 0.0
    growth: float = 0.0
    since: float = 0.0

    def __post_init__(self) -> None:
        try:
            times, offsets = np.array(self.times, dtype=float), np.array(self.offsets, dtype=float)
        except (TypeError, ValueError):
            raise ProblemError(f"motion: expected numbers, got {self.times!r} and {self.offsets!r}") from None
        if times.ndim != 1 or len(times) < 2 or offsets.shape not in ((len(times), 2), (len(times), 3)):
            shapes = f"{times.shape} and {offsets.shape}"
            wanted = "two or more times, each with a displacement [x, y] or [x, y, z]"
            raise ProblemError(f"motion: expected {wanted}, got shapes {shapes}")
        if not (np.isfinite(times).all() and np.isfinite(offsets).all() and (np.diff(times) > 0).all()):
            raise ProblemError(f"motion: expected finite numbers at increasing times, got {times.tolist()}")
        for name in ("uncertainty", "growth"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise ProblemError(f"motion.{name}: expected a finite number >= 0, got {getattr(self, name)!r}")
        if not math.isfinite(self.since):
            raise ProblemError(f"motion.since: expected a finite time, got {self.since!r}")
        for name, array in (("times", times), ("offsets", offsets)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    def steady(
        cls, velocity: ArrayLike, end: float, begin: float = 0.0, uncertainty: float = 0.0, growth: float = 0.0
    ) -> Motion:
        """Constant velocity in m/s from where it is drawn at `begin` to the time `end`, predicted at `begin`."""
        offsets = np.outer([0.0, end - begin], np.asarray(velocity, dtype=float))
        return cls(np.array([begin, end]), offsets, uncertainty, growth, begin)

    @property
    def known(self) -> bool:
        """Whether it is where it is said to be."""
        return not (self.uncertainty or self.growth)

    @property
    def doubt(self) -> tuple[float, ...]:
        """How well it is known: the uncertainty, its growth and since when; empty where it is known."""
        return () if self.known else (self.uncertainty, self.growth, self.since)

    def loose(self, time: float) -> float:
        """How far it may be from its displacement up to a time, metres.

        Notes
        -----
        *Guarantee*: never below the truth: rounded upwards, and it never falls with time.
        """
        # r(t) = r_0 + g max(t - s, 0), with the rounding of both times
        passed = max(time - self.since, 0.0) + SPARE * (abs(time) + abs(self.since))
        return (self.uncertainty + self.growth * passed) * (1 + SPARE)

    def slices(self, begin: float, end: float) -> Iterator[tuple[float, float, float]]:
        """The time from `begin` to `end` in pieces, each with how far it may be from its displacement in it, metres."""
        if self.known:
            yield begin, end, 0.0
            return
        count = math.ceil((self.loose(end) - self.loose(begin)) / SLICE)
        for low, high in pairwise(np.linspace(begin, end, min(max(count, 1), SLICES) + 1).tolist()):
            yield low, high, self.loose(high)

    def later(self, seconds: float) -> Motion:
        """The same on a clock that began so much later."""
        return replace(self, times=self.times - seconds, since=self.since - seconds)

    def covering(self, begin: float, end: float) -> Motion:
        """The same with times from `begin` to `end` at least; it stands beyond its own."""
        times, offsets = self.times, self.offsets
        if times[0] > begin:
            times, offsets = np.append(begin, times), np.concatenate([offsets[:1], offsets])
        if times[-1] < end:
            times, offsets = np.append(times, end), np.concatenate([offsets, offsets[-1:]])
        return replace(self, times=times, offsets=offsets)

    def at(self, time: ArrayLike) -> Floats:
        """Displacement at these times, shape (..., d), metres; beyond the ends, that of the end."""
        t = np.asarray(time, dtype=float)
        return np.stack(
            [np.interp(t, self.times, self.offsets[:, axis]) for axis in range(self.offsets.shape[1])], axis=-1
        )

    def bend(self, begin: ArrayLike, end: ArrayLike) -> Floats:
        """How far it leaves the straight line between its displacements at `begin` and `end`, metres.

        Notes
        -----
        *Guarantee*: never below the truth: between entries it is linear, so the largest deviation is at an entry.
        """
        begin, end = np.broadcast_arrays(np.asarray(begin, dtype=float), np.asarray(end, dtype=float))
        first, last, most = self.at(begin), self.at(end), np.zeros(begin.shape)
        # piecewise linear: the distance from the chord is largest at a knot in (begin, end)
        for time, offset in zip(self.times, self.offsets, strict=True):
            # |o_k - (o(begin) + share (o(end) - o(begin)))| for knot k
            inside = (time > begin) & (time < end)
            share = np.where(inside, (time - begin) / np.where(end > begin, end - begin, 1.0), 0.0)[..., None]
            away = np.linalg.norm(offset - first - share * (last - first), axis=-1)
            most = np.where(inside, np.maximum(most, away), most)
        return most
