r"""The quadrotor with a payload, ``eq:quad_dynamics``, its attitude a quaternion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.systems.system import Floats, System

GRAVITY = 9.81
"""m/s^2."""


@dataclass(frozen=True)
class Quadrotor(System):
    r"""A rigid body with a thrust along its own z axis and three body torques, in six degrees of freedom.

    .. math::
        \dot p = v, \quad m(\psi)\,\dot v = m(\psi)\,g + R\,e_z\,T, \quad \dot R = R\,S(\omega), \quad
        J(\psi)\,\dot\omega = J(\psi)\,\omega \times \omega + \tau

    Parameters
    ----------
    mass : float
        Without a payload, kg.
    inertia : tuple of float
        Principal moments of inertia about x, y, z without a payload, kg m^2.
    payload_arm : float
        Radius of gyration of the payload about the body's centre, metres: a payload of mass `w` adds
        ``w payload_arm^2`` to each moment of inertia. Its weight acts at the centre.

    Notes
    -----
    Arias et al., One Ring to Rule Them All, ``eq:quad_dynamics``. The attitude is a quaternion
    ``(qw, qx, qy, qz)``, which has no singularity, and every use of it is divided by its squared length: the rotation
    is exact whatever the length, so that its drift by rounding and by the integration rule does no harm. States are
    the position (m), the velocity (m/s), the quaternion, and the body rates (rad/s).
    """

    mass: float = 4.0
    inertia: tuple[float, float, float] = (0.08, 0.08, 0.14)
    payload_arm: float = 0.1

    name: ClassVar[str] = "quadrotor"
    summary: ClassVar[str] = "a rigid body in space under thrust and body torques, with a payload"
    states: ClassVar[tuple[str, ...]] = ("x", "y", "z", "vx", "vy", "vz", "qw", "qx", "qy", "qz", "wx", "wy", "wz")
    positions: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    state_units: ClassVar[tuple[str, ...]] = (*("m",) * 3, *("m/s",) * 3, *("1",) * 4, *("rad/s",) * 3)
    controls: ClassVar[tuple[str, ...]] = ("thrust", "tau_x", "tau_y", "tau_z")
    control_units: ClassVar[tuple[str, ...]] = ("N", "N m", "N m", "N m")
    input_bounds: ClassVar[tuple[tuple[float, float], ...]] = ((0.0, 90.0), (-2.0, 2.0), (-2.0, 2.0), (-0.5, 0.5))
    parameters: ClassVar[Mapping[str, float]] = {"payload": 0.0}  # type: ignore[misc]
    parameter_units: ClassVar[Mapping[str, str]] = {"payload": "kg"}

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mass) and self.mass > 0):
            raise ProblemError(f"mass: expected a mass above 0 kg, got {self.mass:g} kg")
        moments = np.asarray(self.inertia, dtype=float)
        if moments.shape != (3,) or not np.isfinite(moments).all() or (moments <= 0).any():
            raise ProblemError(f"inertia: expected three moments above 0 kg m^2, got {list(self.inertia)}: singular")
        if not (np.isfinite(self.payload_arm) and self.payload_arm >= 0):
            raise ProblemError(f"payload_arm: expected a length of at least 0 m, got {self.payload_arm:g} m")
        object.__setattr__(self, "inertia", tuple(moments.tolist()))

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        """Velocity, acceleration, turn of the quaternion, and Euler's equations."""
        _, _, _, vx, vy, vz, qw, qx, qy, qz, wx, wy, wz = x
        thrust, tau_x, tau_y, tau_z = u
        # thrust over mass along the body's z axis, the third column of R(q) for q of any length
        lift = thrust / (self.mass + psi["payload"]) / (qw * qw + qx * qx + qy * qy + qz * qz)
        # the payload adds m_p arm^2 to each moment of inertia
        jx, jy, jz = (moment + psi["payload"] * self.payload_arm**2 for moment in self.inertia)
        return [
            vx,
            vy,
            vz,
            2 * (qx * qz + qw * qy) * lift,
            2 * (qy * qz - qw * qx) * lift,
            (qw * qw - qx * qx - qy * qy + qz * qz) * lift - GRAVITY,
            # dq/dt = q (0, omega) / 2
            -(qx * wx + qy * wy + qz * wz) / 2,
            (qw * wx + qy * wz - qz * wy) / 2,
            (qw * wy + qz * wx - qx * wz) / 2,
            (qw * wz + qx * wy - qy * wx) / 2,
            # Euler's equations: J domega/dt = tau - omega x J omega
            (tau_x + (jy - jz) * wy * wz) / jx,
            (tau_y + (jz - jx) * wz * wx) / jy,
            (tau_z + (jx - jy) * wx * wy) / jz,
        ]

    def check(self, psi: Mapping[str, float]) -> None:
        """Mass and moments of inertia stay positive with the payload."""
        if self.mass + psi["payload"] <= 0:
            raise ProblemError(f"payload: expected a total mass above 0 kg, got {self.mass + psi['payload']:g} kg")
        least = min(self.inertia) + psi["payload"] * self.payload_arm**2
        if least <= 0:
            raise ProblemError(f"payload: expected an inertia above 0 kg m^2, got {least:g} kg m^2: singular")

    def rest(self, psi: Mapping[str, float]) -> Sequence[float]:
        """The thrust of a hover."""
        return [GRAVITY * (self.mass + psi["payload"]), 0.0, 0.0, 0.0]

    def start(self) -> Mapping[str, float]:
        """Level."""
        return {"qw": 1.0}

    def attitude(self, x: Floats) -> Floats:
        """The states' quaternion, its length divided out."""
        w, *vector = x[6:10]
        turn = np.stack([*vector, w])
        return np.asarray(turn / np.linalg.norm(turn, axis=0))

    def settings(self) -> Mapping[str, Any]:
        """Mass, inertia and the payload's arm."""
        return {"mass": self.mass, "inertia": list(self.inertia), "payload_arm": self.payload_arm}
