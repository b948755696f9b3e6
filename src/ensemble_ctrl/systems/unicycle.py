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

    def rates(self, first: Any, second: Any, arrays: Arrays = np) -> tuple[Any, Any]:
        """The commands themselves: speed in m/s and turn rate in rad/s."""
        return first, second

    def commands(self, v: Any, omega: Any, lower: Floats, upper: Floats) -> tuple[Any, Any]:
        """The speed and the turn rate, each within its bounds."""
        return np.clip(v, lower[0], upper[0]), np.clip(omega, lower[1], upper[1])

    def generators(self) -> tuple[Floats, Floats]:
        r"""Matrices of the bilinear form on the lifted state ``(px, py, cos, sin)``.

        Returns
        -------
        B1, B2 : ndarray, shape (4, 4)
            ``z' = psi1 v B1 z + psi2 omega B2 z``; dimensionless.

        Notes
        -----
        Arias et al., One Ring to Rule Them All, ``eq:unicycle_bilinear``, for ``heading_from="y"``.
        """
        # eq:unicycle_bilinear: d(px, py)/dt = psi v (cos, sin), d(cos, sin)/dt = psi omega (-sin, cos)
        b1, b2 = np.zeros((4, 4)), np.zeros((4, 4))
        b1[:2, 2:] = np.eye(2) if self.heading_from == "x" else np.eye(2)[::-1]
        b2[2:, 2:] = [[0.0, -1.0], [1.0, 0.0]]
        return b1, b2

    def lift(self, position: Floats, heading: Floats | float) -> Floats:
        """The lifted state ``(px, py, cos, sin)``, shape (..., 4), of a pose (metres, radians)."""
        heading = np.asarray(heading, dtype=float)
        return np.concatenate([position, np.cos(heading)[..., None], np.sin(heading)[..., None]], axis=-1)
