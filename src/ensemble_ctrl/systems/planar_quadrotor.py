"""A quadrotor in a vertical plane: thrust along its axis, and a torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.systems.arrays import cos, sin
from ensemble_ctrl.systems.quadrotor import GRAVITY
from ensemble_ctrl.systems.system import Floats, System


@dataclass(frozen=True)
class PlanarQuadrotor(System):
    r"""A rigid body in the plane of `x` (along) and `z` (up), with linear drag.

    .. math::
        m \ddot x = -T \sin\theta - d\,\dot x, \quad m \ddot z = T \cos\theta - m g - d\,\dot z, \quad
        J \ddot\theta = \tau

    Parameters
    ----------
    inertia : float
        Moment of inertia, kg m^2.

    Examples
    --------
    >>> PlanarQuadrotor().rest({"mass": 1.0, "drag": 0.0})
    [9.81, 0.0]
    """

    inertia: float = 0.02

    name: ClassVar[str] = "planar_quadrotor"
    summary: ClassVar[str] = "a rigid body in a vertical plane under thrust and a torque"
    states: ClassVar[tuple[str, ...]] = ("x", "z", "vx", "vz", "tilt", "rate")
    positions: ClassVar[tuple[str, ...]] = ("x", "z")
    state_units: ClassVar[tuple[str, ...]] = ("m", "m", "m/s", "m/s", "rad", "rad/s")
    controls: ClassVar[tuple[str, ...]] = ("thrust", "torque")
    control_units: ClassVar[tuple[str, ...]] = ("N", "N m")
    input_bounds: ClassVar[tuple[tuple[float, float], ...]] = ((0.0, 25.0), (-0.5, 0.5))
    parameters: ClassVar[Mapping[str, float]] = {"mass": 1.0, "drag": 0.0}  # type: ignore[misc]
    parameter_units: ClassVar[Mapping[str, str]] = {"mass": "kg", "drag": "N s/m"}

    def __post_init__(self) -> None:
        if not (np.isfinite(self.inertia) and self.inertia > 0):
            raise ProblemError(f"inertia: expected a moment above 0 kg m^2, got {self.inertia:g} kg m^2")

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        """Velocity, acceleration, turn rate and angular acceleration."""
        _, _, vx, vz, tilt, rate = x
        thrust, torque = u
        # m dv/dt = thrust (-sin tilt, cos tilt) - drag v - m g e_z, and J d(rate)/dt = torque
        mass, drag = psi["mass"], psi["drag"]
        return [
            vx,
            vz,
            (-sin(tilt) * thrust - drag * vx) / mass,
            (cos(tilt) * thrust - drag * vz) / mass - GRAVITY,
            rate,
            torque / self.inertia,
        ]

    def check(self, psi: Mapping[str, float]) -> None:
        """The mass is positive."""
        if psi["mass"] <= 0:
            raise ProblemError(f"mass: expected a mass above 0 kg, got {psi['mass']:g} kg")

    def rest(self, psi: Mapping[str, float]) -> Sequence[float]:
        """The thrust of a hover."""
        return [GRAVITY * psi["mass"], 0.0]

    def attitude(self, x: Floats) -> Floats:
        """Turned by the tilt, from z to -x."""
        # rotation by -tilt about y, which turns z towards -x
        half, none = x[4] / 2, np.zeros_like(x[4])
        return np.stack([none, -np.sin(half), none, np.cos(half)])

    def settings(self) -> Mapping[str, Any]:
        """The moment of inertia."""
        return {"inertia": self.inertia}
