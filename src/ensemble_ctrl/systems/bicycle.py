"""The bicycle ensemble: a car with a steering angle, reference point between the rear wheels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import number
from ensemble_ctrl.systems.arcs import SIGNALS, ArcSystem
from ensemble_ctrl.systems.arrays import Arrays

Floats = NDArray[np.float64]

STEEPEST = 1.5
"""Largest steering angle that a problem may allow, radians; the turn rate has a pole at pi/2."""


@dataclass(frozen=True)
class Bicycle(ArcSystem):
    r"""Car-like robot with commanded speed `v` and steering angle `delta`, ``eq:bicycle``.

    .. math:: \dot p_x = \psi_1 v \cos\theta, \quad \dot p_y = \psi_1 v \sin\theta, \quad
              \dot\theta = \psi_2 v \tan(\delta) / L

    It is a unicycle whose turn rate is ``v tan(delta) / L``: exact arcs, driven forwards or backwards, and at ``v = 0``
    it stands whatever the steering angle.

    Parameters
    ----------
    heading_from : {"x", "y"}
        The axis along which a heading of zero points.
    wheelbase : float
        L, metres between the axles, > 0.
    """

    wheelbase: float = 0.3

    name: ClassVar[str] = "bicycle"
    summary: ClassVar[str] = "car-like; traction scales the speed and the turn rate v tan(delta) / wheelbase"
    controls: ClassVar[tuple[str, ...]] = ("v", "delta")
    control_units: ClassVar[tuple[str, ...]] = ("m/s", "rad")
    input_bounds: ClassVar[tuple[tuple[float, float], ...]] = ((-2.0, 2.0), (-0.6, 0.6))
    command_kind: ClassVar[str] = "drive"
    turns_in_place: ClassVar[bool] = False
    signals: ClassVar[Mapping[str, str]] = {**SIGNALS, "delta": "rad"}
    monotone: ClassVar[tuple[tuple[float, float], ...]] = ((-np.inf, np.inf), (-1.57, 1.57))

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "wheelbase", number("wheelbase", self.wheelbase))
        if not np.isfinite(self.wheelbase) or self.wheelbase <= 0:
            raise ProblemError(f"wheelbase: expected a finite length above 0 m, got {self.wheelbase!r}")

    def settings(self) -> Mapping[str, Any]:
        """The wheelbase."""
        return {"wheelbase": self.wheelbase}

    def rates(self, first: Any, second: Any, arrays: Arrays = np) -> tuple[Any, Any]:
        """Speed in m/s, and turn rate ``v tan(delta) / L`` in rad/s."""
        return first, first * arrays.tan(second) / self.wheelbase

    def commands(self, v: Any, omega: Any, lower: Floats, upper: Floats) -> tuple[Any, Any]:
        """The speed, and the steering angle that turns at `omega`, each within its bounds."""
        v = np.clip(v, lower[0], upper[0])
        # v tan(delta) / L = omega, with the sign of v moved to omega so that |delta| < pi/2
        sign = np.where(np.asarray(v) < 0, -1.0, 1.0)
        delta = np.arctan2(sign * omega * self.wheelbase, np.maximum(np.abs(v), 1e-9))
        return v, np.clip(delta, lower[1], upper[1])
