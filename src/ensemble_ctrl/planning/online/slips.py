r"""What a robot's errors may add on the way, by the bounds of `fleet.uncertainty`, for the commands that it was sent.

With factors ``a``, ``b`` of its own, a robot is off by at most ``a A + W`` in its speed and its place's rate, and by
``b B + w`` in its heading's, where `A` and `B` are what errors of the commands and strays of the factors come to in
each step (`ensemble_ctrl.certificate.disturbance.slips`).  A step whose commands begin up to `J` seconds early or late
adds ``J`` times the change of the rates, and of their bounds, where it begins.  Where a robot may be in patches of
terrain (`ensemble_ctrl.planning.online.ground`), the factors are off by what these allow.
"""

from __future__ import annotations

from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.disturbance import pushes, slips
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]

UP = 1e-9
"""By how much every bound is widened for rounding: metres and radians, and the factors relatively."""


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
    step, jitter : float
        Length of a step, and `J`, seconds.
    speed_jumps, turn_jumps : ndarray, shape (steps,)
        ``J`` times what rates and their bounds change by where each step begins, m and rad for factors of one.
    ground : ndarray, shape (2, steps)
        What terrain may add to the rates of place and heading, m/s and rad/s.
    """

    speed: Floats
    turn_rate: Floats
    place: float
    heading: float
    hold: float | None
    step: float
    jitter: float
    speed_jumps: Floats
    turn_jumps: Floats
    ground: Floats

    @classmethod
    def of(cls, fleet: Fleet, controls: Floats, step: float, strays: Floats | None = None) -> Slips:
        """Those of a fleet's robots under some commands, and none of the commands after the last one.

        `strays`, shape (2, steps), is by how much terrain may change the factors on speed and turn rate.
        """
        rates = fleet.arcs.rates(*controls.T)
        off = slips(fleet, controls)
        speed, turn_rate = (np.append(each, 0.0) for each in off)
        jitter = fleet.uncertainty.jitter
        # J (|change of the rate| + |change of its bound|), from and to standing
        jumps = [
            jitter * np.sum([np.abs(np.diff(each, prepend=0.0, append=0.0)) for each in (rate, error)], axis=0)
            for rate, error in zip(rates, off, strict=True)
        ]
        most = np.stack([np.abs(rate) + error for rate, error in zip(rates, off, strict=True)])
        if jitter:  # a command of a step beside may be early or late
            wide = np.pad(most, ((0, 0), (1, 1)))
            most = np.maximum(most, np.maximum(wide[:, :-2], wide[:, 2:]))
        # delta (|rate| + its bound), where there is any
        ground = np.zeros_like(most) if strays is None else np.where(strays > 0, strays * most, 0.0)
        ground = np.pad(ground, ((0, 0), (0, 1)))
        hold = fleet.uncertainty.heading_hold
        return cls(speed, turn_rate, *pushes(fleet), hold, step, jitter, jumps[0], jumps[1], ground)

    def __bool__(self) -> bool:
        """Whether anything is off."""
        steady = self.place or self.heading or self.jitter
        return bool(self.speed.any() or self.turn_rate.any() or steady or self.ground.any())

    def worst(self, b: float) -> float:
        """The largest rate of a heading's error in any step, for factors up to `b`, rad/s; without that of jumps."""
        return float((b * self.turn_rate + self.ground[1]).max()) + self.heading

    def let_go(self, b: float) -> float:
        r"""The largest error of a heading that is held, over its time constant, rad/s.

        ``|e|`` is at most :math:`\tau \max D`, and what jumps leave: each counts in full until the step after it
        has ended, and falls with time from then on.
        """
        assert self.hold is not None
        return self.worst(b) + b * self._left / self.hold

    @cached_property
    def _left(self) -> float:
        """The most that jumps leave of a held heading's error, radians for a factor of one."""
        kept = 0.0 if self.hold is None else float(np.exp(-self.step / self.hold))
        new, old, most = 0.0, 0.0, 0.0
        for jump in self.turn_jumps.tolist() if self.jitter else ():
            old, new = kept * old + new, jump
            most = max(most, old + new)
        return most * (1 + UP)

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
        :math:`2 (1 - e^{-\Delta t / \tau})\, \tau \max D`. Jumps and terrain of the time are not in it.
        """
        free = b * swerved + self.heading * span
        if self.hold is None:
            return np.asarray(free)
        kept = -np.expm1(-span / self.hold)
        return np.asarray(kept * self.hold * self.let_go(most) + np.minimum(free, kept * self.hold * self.worst(most)))


def fastest(fleet: Fleet) -> tuple[float, float]:
    """The largest speed and turn rate that a command can ask for, with their errors, for factors of one."""
    ends = product(*zip(fleet.input_lower.tolist(), fleet.input_upper.tolist(), strict=True))
    corners = np.array(list(ends))
    v, omega = (
        np.abs(rate) + off for rate, off in zip(fleet.arcs.rates(*corners.T), slips(fleet, corners), strict=True)
    )
    return float(v.max()), float(omega.max())
