r"""What a robot's errors may add on the way, by the bounds of `fleet.uncertainty`, for the commands that it was sent.

With factors ``a``, ``b`` of its own, a robot is off by at most ``a A + W`` in its speed and its place's rate, and by
``b B + w`` in its heading's, where `A` and `B` are what errors of the commands and strays of the factors come to in
each step (`ensemble_ctrl.certificate.disturbance.slips`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.disturbance import pushes, slips
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Slips:
    """Bounds of what is off, in each step.

    Attributes
    ----------
    speed, turn_rate : ndarray, shape (steps,)
        A and B, m/s and rad/s.
    place, heading : float
        W and w, m/s and rad/s.
    hold : float or None
        Time constant of the robot's own loop on its heading, seconds.
    """

    speed: Floats
    turn_rate: Floats
    place: float
    heading: float
    hold: float | None

    @classmethod
    def of(cls, fleet: Fleet, controls: Floats) -> Slips:
        """Those of a fleet's robots under some commands, and none of the commands after the last one."""
        speed, turn_rate = (np.append(each, 0.0) for each in slips(fleet, controls))
        return cls(speed, turn_rate, *pushes(fleet), fleet.uncertainty.heading_hold)

    def __bool__(self) -> bool:
        """Whether anything is off."""
        return bool(self.speed.any() or self.turn_rate.any() or self.place or self.heading)

    def worst(self, b: float) -> float:
        """The largest rate of a heading's error in any step, for factors up to `b`, rad/s."""
        return b * float(self.turn_rate.max()) + self.heading

    def turned(self, b: Floats, swerved: Floats, span: Floats, most: float) -> Floats:
        r"""How much the error of a heading may change, radians.

        Parameters
        ----------
        b, swerved, span : ndarray of one shape
            Largest factor on the turn rate within a time, the integral of `B` over it, and its length in seconds.
        most : float
            Largest factor at any time.

        Notes
        -----
        Without a loop, :math:`b \int B + w \Delta t`. With one, :math:`\dot e = -e / \tau + D` has kept ``|e|`` below
        :math:`\tau \max D` ever since the robot began, so that it changes by at most
        :math:`2 (1 - e^{-\Delta t / \tau})\, \tau \max D`.
        """
        free = b * swerved + self.heading * span
        if self.hold is None:
            return np.asarray(free)
        kept, away = -np.expm1(-span / self.hold), self.hold * self.worst(most)
        return np.asarray(np.minimum(free + kept * away, 2 * kept * away))
