"""A point whose velocity is commanded, such as kilobots and magnetic micro-robots under one broadcast field."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.systems.arrays import cos, sin
from ensemble_ctrl.systems.system import System


class SingleIntegrator(System):
    r"""A point in the plane that follows a velocity in its own scale and direction: :math:`\dot p = k R(\alpha) u`.

    The position is the start plus :math:`k R(\alpha) \int u`: what the fleet can do depends on the integral of the
    command alone, and members with equal parameters keep their offsets. Steps are exact.

    Examples
    --------
    >>> [float(x) for x in SingleIntegrator().exact([0.0, 1.0], [1.0, 0.0], {"gain": 0.5, "angle": 0.0}, 2.0)]
    [1.0, 1.0]
    """

    name: ClassVar[str] = "single_integrator"
    summary: ClassVar[str] = "a point in the plane that follows a velocity, with a gain and an angle of its own"
    states: ClassVar[tuple[str, ...]] = ("x", "y")
    positions: ClassVar[tuple[str, ...]] = ("x", "y")
    state_units: ClassVar[tuple[str, ...]] = ("m", "m")
    controls: ClassVar[tuple[str, ...]] = ("ux", "uy")
    control_units: ClassVar[tuple[str, ...]] = ("m/s", "m/s")
    input_bounds: ClassVar[tuple[tuple[float, float], ...]] = ((-1.0, 1.0), (-1.0, 1.0))
    parameters: Mapping[str, float] = {"gain": 1.0, "angle": 0.0}
    parameter_units: ClassVar[Mapping[str, str]] = {"gain": "-", "angle": "rad"}

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        """The command, scaled and turned."""
        gain, along, left = psi["gain"], cos(psi["angle"]), sin(psi["angle"])
        return [gain * (along * u[0] - left * u[1]), gain * (left * u[0] + along * u[1])]

    def exact(self, x: Any, u: Any, psi: Mapping[str, Any], step: Any) -> Sequence[Any]:
        """A straight line."""
        vx, vy = self.xdot(x, u, psi)
        return [x[0] + step * vx, x[1] + step * vy]

    def gain(self, psi: Mapping[str, float]) -> float | None:
        """Velocities are integrated, and scaled; members that turn them move in directions of their own."""
        return None if psi["angle"] else psi["gain"]

    def check(self, psi: Mapping[str, float]) -> None:
        """The gain is above 0."""
        if psi["gain"] <= 0:
            raise ProblemError(f"gain: expected a factor above 0, got {psi['gain']:g}")
