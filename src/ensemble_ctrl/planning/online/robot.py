"""What the loop asks of a robot and of a clock."""

from __future__ import annotations

import time
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.planning.online.measurement import Seen, StateSeen

Floats = NDArray[np.float64]


class Robot(Protocol):
    """A robot that is sent blocks of commands ahead of time.

    It runs each command for one control step, and stands when it has none left: nothing that it hears, or does not
    hear, lets it drive further than what it was sent.
    """

    def read(self) -> Seen | StateSeen | None:
        """The newest pose that was measured, of several robots by name; None if there is nothing new."""

    def send(self, begin: float, controls: Floats) -> None:
        """Commands from `begin` seconds on, shape (steps, n_u), in place of what was sent for these and later times."""

    def stop(self) -> None:
        """Stand at once, and forget all commands."""


class Clock(Protocol):
    """Seconds since the plan began."""

    def now(self) -> float:
        """The time."""

    def wait(self, until: float) -> None:
        """Return at a time, or at once if it is past."""


class WallClock:
    """The computer's own clock, from when it is made."""

    def __init__(self) -> None:
        self._began = time.monotonic()

    def now(self) -> float:
        """The time."""
        return time.monotonic() - self._began

    def wait(self, until: float) -> None:
        """Sleep until a time."""
        time.sleep(max(until - self.now(), 0.0))
