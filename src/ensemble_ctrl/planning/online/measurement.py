"""What robots say of themselves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


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


Seen = Measurement | Mapping[str, Measurement]
"""Of one robot, or of several by name."""
