"""The unicycle ensemble: one pair of commands, and for each member its own traction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.systems.arcs import ArcSystem
from ensemble_ctrl.systems.arrays import Arrays

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Unicycle(ArcSystem):
    """Differential-drive robot with commanded speed `v` and turn rate `omega`, ``eq:unicycle``.

    Parameters
    ----------
    heading_from : {"x", "y"}
        The axis along which a heading of zero points.
    """

    name: ClassVar[str] = "unicycle"
    summary: ClassVar[str] = "differential drive; traction scales the commanded speed and turn rate"
    controls: ClassVar[tuple[str, ...]] = ("v", "omega")
    control_units: ClassVar[tuple[str, ...]] = ("m/s", "rad/s")
    input_bounds: ClassVar[tuple[tuple[float, float], ...]] = ((-2.0, 2.0), (-2.0, 2.0))
    command_kind: ClassVar[str] = "twist"
    turns_in_place: ClassVar[bool] = True
    monotone: ClassVar[tuple[tuple[float, float], ...]] = ((-np.inf, np.inf), (-np.inf, np.inf))

    def rates(self, first: Any, second: Any, arrays: Arrays = np) -> tuple[Any, Any]:
        """The commands themselves: speed in m/s and turn rate in rad/s."""
        return first, second

    def commands(self, v: Any, omega: Any, lower: Floats, upper: Floats) -> tuple[Any, Any]:
        """The speed and the turn rate, each within its bounds."""
        return np.clip(v, lower[0], upper[0]), np.clip(omega, lower[1], upper[1])
