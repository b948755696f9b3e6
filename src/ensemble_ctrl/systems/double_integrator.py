"""A point mass pushed by a force, the smallest system with an unknown mass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.systems.system import System


class DoubleIntegrator(System):
    r"""A point of mass `m` in the plane under a force: :math:`m \ddot p = f`; its steps are exact.

    Examples
    --------
    >>> DoubleIntegrator().exact([0.0, 0.0, 1.0, 0.0], [2.0, 0.0], {"mass": 1.0}, 1.0)
    [2.0, 0.0, 3.0, 0.0]
    """

    name: ClassVar[str] = "double_integrator"
    summary: ClassVar[str] = "a point mass in the plane under a force"
    states: ClassVar[tuple[str, ...]] = ("x", "y", "vx", "vy")
    positions: ClassVar[tuple[str, ...]] = ("x", "y")
    state_units: ClassVar[tuple[str, ...]] = ("m", "m", "m/s", "m/s")
    controls: ClassVar[tuple[str, ...]] = ("fx", "fy")
    control_units: ClassVar[tuple[str, ...]] = ("N", "N")
    input_bounds: ClassVar[tuple[tuple[float, float], ...]] = ((-2.0, 2.0), (-2.0, 2.0))
    parameters: Mapping[str, float] = {"mass": 1.0}
    parameter_units: ClassVar[Mapping[str, str]] = {"mass": "kg"}

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        """Velocity and acceleration."""
        _, _, vx, vy = x
        return [vx, vy, u[0] / psi["mass"], u[1] / psi["mass"]]

    def exact(self, x: Any, u: Any, psi: Mapping[str, Any], step: Any) -> Sequence[Any]:
        """A parabola."""
        px, py, vx, vy = x
        ax, ay = u[0] / psi["mass"], u[1] / psi["mass"]
        # p + v dt + (f / m) dt^2 / 2 and v + (f / m) dt
        half = step * step / 2
        return [px + step * vx + half * ax, py + step * vy + half * ay, vx + step * ax, vy + step * ay]

    def gain(self, psi: Mapping[str, float]) -> float:
        """Forces move a mass by their double integral over it."""
        return 1.0 / psi["mass"]

    def check(self, psi: Mapping[str, float]) -> None:
        """The mass is positive."""
        if psi["mass"] <= 0:
            raise ProblemError(f"mass: expected a mass above 0 kg, got {psi['mass']:g} kg")
