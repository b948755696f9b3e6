"""The unicycle ensemble: one pair of commands, and for each member its own traction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.errors import ProblemError
from ensemble_ctrl.systems.arrays import Arrays, sinc

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Unicycle:
    r"""Differential-drive robot with commanded speed `v` and turn rate `omega`.

    .. math:: \dot p_x = \psi_1 v \cos\theta, \quad \dot p_y = \psi_1 v \sin\theta, \quad \dot\theta = \psi_2 \omega

    with the heading counted from +x; with ``heading_from="y"`` cosine and sine change places, which is the paper's
    convention (``eq:unicycle``), and a positive `omega` then turns clockwise.

    Parameters
    ----------
    heading_from : {"x", "y"}
        The axis along which a heading of zero points.
    """

    heading_from: Literal["x", "y"] = "x"

    name: ClassVar[str] = "unicycle"
    controls: ClassVar[tuple[str, ...]] = ("v", "omega")
    control_units: ClassVar[tuple[str, ...]] = ("m/s", "rad/s")
    parameters: ClassVar[tuple[str, ...]] = ("traction",)
    summary: ClassVar[str] = "differential drive; traction scales the commanded speed and turn rate"

    def __post_init__(self) -> None:
        if self.heading_from not in ("x", "y"):
            raise ProblemError(f"heading_from: expected 'x' or 'y', got {self.heading_from!r}")

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
        b1, b2 = np.zeros((4, 4)), np.zeros((4, 4))
        b1[:2, 2:] = np.eye(2) if self.heading_from == "x" else np.eye(2)[::-1]
        b2[2:, 2:] = [[0.0, -1.0], [1.0, 0.0]]
        return b1, b2

    def lift(self, position: Floats, heading: Floats | float) -> Floats:
        """The lifted state ``(px, py, cos, sin)``, shape (..., 4), of a pose (metres, radians)."""
        heading = np.asarray(heading, dtype=float)
        return np.concatenate([position, np.cos(heading)[..., None], np.sin(heading)[..., None]], axis=-1)

    def displacement(
        self,
        v: Any,
        omega: Any,
        turned: Any,
        heading: Any,
        traction: Any,
        step: float,
        arrays: Arrays = np,
    ) -> tuple[Any, Any]:
        r"""Exact displacement over one step of constant commands.

        Parameters
        ----------
        v, omega : array
            Commands in m/s and rad/s.
        turned : array
            Integral of `omega` since the start, in radians: the same for every member.
        heading : array
            Heading at the start, in radians, counted from the axis of `heading_from`.
        traction : array
            The member's parameter, dimensionless.
        step : float
            Length of the step in seconds.
        arrays : Arrays
            The array library of the arguments, which broadcast.

        Returns
        -------
        dx, dy : array
            Displacement in metres.

        Notes
        -----
        The robot moves on an arc whose chord is ``psi v dt sinc(psi omega dt / 2)`` long and points along the heading
        at mid-step; at ``omega = 0`` this is the straight line.

        Examples
        --------
        A quarter turn of radius 1 m:

        >>> dx, dy = Unicycle().displacement(1.0, 1.0, 0.0, 0.0, 1.0, np.pi / 2)
        >>> round(float(dx), 12), round(float(dy), 12)
        (1.0, 1.0)
        """
        half = traction * omega * (step / 2)
        chord = traction * v * step * sinc(half, arrays)
        angle = heading + traction * turned + half
        along, across = chord * arrays.cos(angle), chord * arrays.sin(angle)
        return (along, across) if self.heading_from == "x" else (across, along)

    def positions(self, controls: Floats, start: Floats, heading: float, traction: Floats, step: float) -> Floats:
        """Positions of members at the ends of all steps, by exact arcs.

        Parameters
        ----------
        controls : ndarray, shape (steps, 2)
            Commands `v` and `omega` of every step.
        start : ndarray, shape (2,)
            Common start position in metres.
        heading : float
            Common start heading in radians, in this system's own convention.
        traction : ndarray, shape (members,)
            Parameter of every member.
        step : float
            Length of a step in seconds.

        Returns
        -------
        ndarray, shape (members, steps + 1, 2)
            Metres.
        """
        v, omega = controls.T
        turned = step * (np.cumsum(omega) - omega)
        moves = self.displacement(v, omega, turned, heading, np.asarray(traction)[:, None], step)
        path = np.empty((len(traction), len(controls) + 1, 2))
        path[:, 0] = start
        for axis, move in enumerate(moves):
            np.cumsum(move, axis=1, out=path[:, 1:, axis])
            path[:, 1:, axis] += start[axis]
        return path

    def sagitta(self, v: Any, omega: Any, traction: Any, step: float) -> Any:
        r"""Bound in metres on how far the arc of one step leaves its chord, ``step^2 / 8 psi^2 |v omega|``.

        Notes
        -----
        *Guarantee*: never below the true distance: the deviation of a twice differentiable curve from its chord is at
        most ``step^2 / 8`` times its largest acceleration.
        """
        return step**2 / 8 * traction**2 * abs(v * omega)
