"""How an obstacle moves: its displacement over time, known beforehand and linear between given times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyArrays

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Motion(ReadOnlyArrays):
    """Displacement from where an obstacle is drawn; it does not turn.

    Parameters
    ----------
    times : array_like, shape (entries,)
        Seconds, increasing, at least two.
    offsets : array_like, shape (entries, d)
        Metres, in the plane or in space.

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
        for name, array in (("times", times), ("offsets", offsets)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    def steady(cls, velocity: ArrayLike, duration: float) -> Motion:
        """Constant velocity in m/s from time 0 to `duration`."""
        return cls(np.array([0.0, duration]), np.outer([0.0, duration], np.asarray(velocity, dtype=float)))

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
