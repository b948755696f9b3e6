"""What is commanded at a time, and what was measured last: the nodes' logic, without ROS."""

from __future__ import annotations

import threading
from math import atan2

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.planning.online.measurement import Measurement

Floats = NDArray[np.float64]


class Broadcast:
    """Commands in time, from whoever plans to whoever publishes; the robot that a loop is given.

    A command holds for its own step only: where none was sent, the robots stand.  Safe to use from several threads.

    Parameters
    ----------
    step : float
        Seconds of one command.
    rest : ndarray, shape (n_u,)
        The command of a fleet that stands, in the commands' units.
    """

    def __init__(self, step: float, rest: Floats) -> None:
        self.step, self.rest = step, np.asarray(rest, dtype=float)
        self._lock = threading.Lock()
        self._blocks: list[tuple[float, Floats]] = []
        self._seen: Measurement | None = None

    def observe(self, seen: Measurement) -> None:
        """Take the newest pose; one that is not of finite numbers, or older than the last, is passed over."""
        with self._lock:
            if seen.finite and (self._seen is None or seen.time > self._seen.time):
                self._seen = seen

    def read(self) -> Measurement | None:
        """The newest pose since the last call."""
        with self._lock:
            seen, self._seen = self._seen, None
            return seen

    def send(self, begin: float, controls: Floats) -> None:
        """Commands from `begin` seconds on, shape (steps, n_u), in place of those for these and later times."""
        rows = np.array(controls, dtype=float)
        with self._lock:
            kept = [(start, self._before(start, old, begin)) for start, old in self._blocks if start < begin]
            self._blocks = [*kept, (begin, rows)]

    def stop(self) -> None:
        """Stand at once, and forget all commands."""
        with self._lock:
            self._blocks = []

    def command_at(self, now: float) -> Floats:
        """The command of a time, shape (n_u,)."""
        with self._lock:
            self._blocks = [(begin, rows) for begin, rows in self._blocks if now < begin + len(rows) * self.step]
            for begin, rows in reversed(self._blocks):
                # a clock that is a millionth of a step early reads the next command, not the last
                k = int(np.floor((now - begin) / self.step + 1e-6))
                if 0 <= k < len(rows):
                    return np.asarray(rows[k])
        return self.rest

    @property
    def ends(self) -> float:
        """When the last command ends, in seconds; minus infinity where there is none."""
        with self._lock:
            return max((begin + len(rows) * self.step for begin, rows in self._blocks), default=-np.inf)

    def _before(self, start: float, rows: Floats, end: float) -> Floats:
        """The rows of a block that begin before a time."""
        return rows[: max(int(np.ceil((end - start) / self.step - 1e-6)), 0)]


def yaw_of(w: float, x: float, y: float, z: float) -> float:
    """The heading of a quaternion in radians from +x, counter-clockwise."""
    return atan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))
