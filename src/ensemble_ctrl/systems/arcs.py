r"""Robots that move on arcs: what the unicycle and the bicycle have in common.

Every member is given by its *coefficients*, five numbers ``(linear, angular, heading, x, y)``: the factors on its speed
and its turn rate, and its pose at the start.  Under commands that are constant over a step it moves on an exact arc.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.systems.arrays import Arrays, cos, sin, sinc
from ensemble_ctrl.systems.system import System

Floats = NDArray[np.float64]

DRIVE = ("linear", "angular", "heading", "x", "y")
"""The five member coefficients, which distinguish one member's motion from another's, in order."""
FACTORS: Mapping[str, tuple[float, float]] = {
    "traction": (1.0, 1.0),
    "linear_traction": (1.0, 0.0),
    "angular_traction": (0.0, 1.0),
}
"""Parameters of every robot on arcs, with the rates at which each raises the linear and the angular factor."""

SIGNALS: Mapping[str, str] = {"heading": "rad", "v": "m/s", "omega": "rad/s"}
"""What a task may refer to besides the position, with units: a member's heading, speed and turn rate."""


@dataclass(frozen=True)
class ArcSystem(System):
    r"""A robot with a speed `v` and a turn rate `omega` made from its two commands.

    .. math:: \dot p_x = \psi_1 v \cos\theta, \quad \dot p_y = \psi_1 v \sin\theta, \quad \dot\theta = \psi_2 \omega

    with the heading counted from +x; with ``heading_from="y"`` cosine and sine change places, which is the paper's
    convention for the unicycle (``eq:unicycle``), and a positive `omega` then turns clockwise.

    Parameters
    ----------
    heading_from : {"x", "y"}
        The axis along which a heading of zero points.
    """

    heading_from: Literal["x", "y"] = "x"

    turns_in_place: ClassVar[bool]
    monotone: ClassVar[tuple[tuple[float, float], ...]] = ()
    """Ranges of both commands within which each of `rates` is monotone in each of them; empty if that is not known."""
    states: ClassVar[tuple[str, ...]] = ("x", "y", "heading")
    state_units: ClassVar[tuple[str, ...]] = ("m", "m", "rad")
    positions: ClassVar[tuple[str, ...]] = ("x", "y")
    heading_state: ClassVar[str] = "heading"
    signals: ClassVar[Mapping[str, str]] = SIGNALS
    transcription: ClassVar[str] = "positions"
    enclosure: ClassVar[str] = "arcs"
    on_arcs: ClassVar[bool] = True
    shifts: ClassVar[tuple[str, ...]] = ("x", "y")
    directions: ClassVar[Mapping[str, tuple[float, float]]] = FACTORS
    factors: ClassVar[tuple[str, ...]] = tuple(FACTORS)
    parameters = dict.fromkeys(FACTORS, 1.0)

    def __post_init__(self) -> None:
        if self.heading_from not in ("x", "y"):
            raise ProblemError(f"heading_from: expected 'x' or 'y', got {self.heading_from!r}")

    @property
    def spoken(self) -> tuple[str, ...]:
        """The position alone: headings are no variables of the program."""
        return self.positions

    def check_names(self, names: Collection[str]) -> None:
        """Each of the two factors is given once."""
        for place in (0, 1):
            twice = [name for name in names if name in self.directions and self.directions[name][place]]
            if len(twice) > 1:
                raise ProblemError(f"fleet.parameters: expected one of {' and '.join(twice)}, got both")

    def identity(self, start: Mapping[str, float], states: Floats) -> list[object]:
        """The system, and the pose at the start."""
        x, y, heading = (float(start.get(name, 0.0)) for name in self.states)
        return [self, [x, y], heading]

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        """Speed along the heading, and the turn rate."""
        # p' = psi_1 v (cos theta, sin theta), theta' = psi_2 omega, with theta from +x
        v, omega = self.rates(u[0], u[1])
        speed = psi["traction"] * psi["linear_traction"] * v
        turn = psi["traction"] * psi["angular_traction"] * omega
        return [speed * cos(x[2]), speed * sin(x[2]), turn if self.heading_from == "x" else -turn]

    def attitude(self, x: Floats) -> Floats:
        """Turned about the vertical by the heading."""
        # rotation by theta about z: (x, y, z, w) = (0, 0, sin(theta / 2), cos(theta / 2))
        half = x[2] / 2
        return np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)])

    def own_heading(self, heading: Any) -> Any:
        """A heading from +x, counter-clockwise, in the system's own convention, radians; and the other way round."""
        return heading if self.heading_from == "x" else np.pi / 2 - heading

    def rates(self, first: Any, second: Any, arrays: Arrays = np) -> tuple[Any, Any]:
        """Speed `v` in m/s and turn rate `omega` in rad/s that the two commands give."""
        raise NotImplementedError

    def commands(self, v: Any, omega: Any, lower: Floats, upper: Floats) -> tuple[Any, Any]:
        """The commands within bounds that come close to a speed and a turn rate."""
        raise NotImplementedError

    def turned(self, omega: Floats, step: float) -> Floats:
        """Integral of `omega` before each step, radians, shape of `omega`: the same for every member."""
        # Omega_n = dt sum_{i < n} omega_i
        return step * (np.cumsum(omega) - omega)

    def displacement(
        self,
        v: Any,
        omega: Any,
        turned: Any,
        linear: Any,
        angular: Any,
        heading: Any,
        step: float,
        arrays: Arrays = np,
    ) -> tuple[Any, Any]:
        r"""Exact displacement over one step of constant rates.

        Parameters
        ----------
        v, omega : array
            Speed in m/s and turn rate in rad/s.
        turned : array
            Integral of `omega` since the start, in radians: the same for every member.
        linear, angular : array
            The member's factors on `v` and `omega`, dimensionless.
        heading : array
            The member's heading at the start, in radians, counted from the axis of `heading_from`.
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
        The robot moves on an arc whose chord is ``linear v dt sinc(angular omega dt / 2)`` long and points along the
        heading at mid-step; at ``omega = 0`` this is the straight line.

        Examples
        --------
        A quarter turn of radius 1 m:

        >>> from ensemble_ctrl.systems import Unicycle
        >>> dx, dy = Unicycle().displacement(1.0, 1.0, 0.0, 1.0, 1.0, 0.0, np.pi / 2)
        >>> round(float(dx), 12), round(float(dy), 12)
        (1.0, 1.0)
        """
        # d(v, omega, Omega): chord psi_1 v dt sinc(psi_2 omega dt / 2) along the heading at mid-step
        half = angular * omega * (step / 2)
        chord = linear * v * step * sinc(half, arrays)
        angle = heading + angular * turned + half
        along, across = chord * arrays.cos(angle), chord * arrays.sin(angle)
        return (along, across) if self.heading_from == "x" else (across, along)

    def paths(self, controls: Floats, coefficients: Floats, step: float) -> Floats:
        """Positions of members at the ends of all steps, by exact arcs.

        Parameters
        ----------
        controls : ndarray, shape (steps, 2)
            Commands of every step.
        coefficients : ndarray, shape (members, 5)
            The coefficients of every member.
        step : float
            Length of a step in seconds.

        Returns
        -------
        ndarray, shape (members, steps + 1, 2)
            Metres.
        """
        v, omega = self.rates(*np.asarray(controls, dtype=float).T)
        linear, angular, heading = (column[:, None] for column in coefficients[:, :3].T)
        moves = self.displacement(v, omega, self.turned(omega, step), linear, angular, heading, step)
        # p_{n+1} = p_n + d_n from the start position (x, y)
        path = np.empty((len(coefficients), len(controls) + 1, 2))
        path[:, 0] = coefficients[:, 3:]
        for axis, move in enumerate(moves):
            np.cumsum(move, axis=1, out=path[:, 1:, axis])
            path[:, 1:, axis] += coefficients[:, 3 + axis, None]
        return path

    def headings(self, controls: Floats, coefficients: Floats, step: float) -> Floats:
        """Headings of members at the ends of all steps, from +x, not wrapped, shape (members, steps + 1), radians."""
        _, omega = self.rates(*np.asarray(controls, dtype=float).T)
        turned = np.concatenate([[0.0], step * np.cumsum(omega)])
        # theta_n = theta_0 + psi_2 Omega_n
        own = coefficients[:, 2, None] + coefficients[:, 1, None] * turned
        return np.asarray(own if self.heading_from == "x" else np.pi / 2 - own)

    def signal(self, name: str, controls: Floats, coefficients: Floats, step: float) -> Floats:
        """One of `signals` at the ends of all steps, shape (members, steps + 1).

        Rates are those of the step that begins there; at the end, of the last. `v` and `omega` are the member's own:
        its factors times the rates of the commands, counter-clockwise. Any other name is that of a command.
        """
        if name == "heading":
            return self.headings(controls, coefficients, step)
        v, omega = self.rates(*np.asarray(controls, dtype=float).T)
        sign = 1.0 if self.heading_from == "x" else -1.0
        one = np.ones(len(coefficients))
        rates = {"v": (coefficients[:, 0], v), "omega": (sign * coefficients[:, 1], omega)}
        factor, rate = rates.get(name) or (one, controls[:, self.controls.index(name)])
        return np.asarray(factor[:, None] * np.append(rate, rate[-1:]))

    def generators(self) -> tuple[Floats, Floats]:
        r"""Matrices of the bilinear form on the lifted state ``(px, py, cos, sin)``.

        Returns
        -------
        B1, B2 : ndarray, shape (4, 4)
            ``z' = psi1 v B1 z + psi2 omega B2 z``; dimensionless.

        Notes
        -----
        Arias et al., One Ring to Rule Them All, ``eq:unicycle_bilinear``, for ``heading_from="y"``; of a
        bicycle `omega` is ``v tan(delta) / L``.
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

    def sagitta(self, v: Any, omega: Any, linear: Any, angular: Any, step: float) -> Any:
        r"""Bound in metres on how far the arc of one step leaves its chord, ``step^2 / 8 psi_1 psi_2 |v omega|``.

        Notes
        -----
        *Guarantee*: never below the true distance: the deviation of a twice differentiable curve from its chord is at
        most ``step^2 / 8`` times its largest acceleration.
        """
        return step**2 / 8 * abs(linear * angular) * abs(v * omega)
