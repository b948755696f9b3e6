"""What robots say of themselves."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ensemble_ctrl.core.deferred import dataclass


@dataclass(frozen=True)
class Measurement:
    """A pose that was measured.

    Attributes
    ----------
    time : float
        When the pose was this, in seconds since the plan began; it may have taken a while to arrive.
    x, y : float
        Metres.
    heading : float
        Radians from +x, counter-clockwise; whole turns don't matter.
    """

    time: float
    x: float
    y: float
    heading: float

    @property
    def finite(self) -> bool:
        """Whether all of it are numbers."""
        try:
            return bool(np.isfinite([self.time, self.x, self.y, self.heading]).all())
        except TypeError:
            return False


@dataclass(frozen=True)
class StateMeasurement:
    """All states of a robot that follows an ODE, measured.

    Attributes
    ----------
    time : float
        When the states were these, at the end of a control step, in seconds since the plan began.
    states : tuple of float
        In the order and the units of the system's states.
    """

    time: float
    states: tuple[float, ...]

    @property
    def finite(self) -> bool:
        """Whether all of it are numbers."""
        try:
            return bool(np.isfinite([self.time, *self.states]).all())
        except TypeError:
            return False


StateSeen = StateMeasurement | Mapping[str, StateMeasurement]
Seen = Measurement | Mapping[str, Measurement]
"""Of one robot, or of several by name."""
