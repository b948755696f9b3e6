"""An omnidirectional base: it drives along, sideways and turns, each command with a slip factor of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.systems.arrays import arc, cos, sin
from ensemble_ctrl.systems.system import System


class Mecanum(System):
    r"""A base on mecanum or omni wheels.

    .. math:: \dot p = R(\theta)\,(k_x v_x, k_y v_y), \quad \dot\theta = k_\omega \omega

    Commands are in the frame of the base: `vx` along it, `vy` to its left, `omega` counter-clockwise. A factor is the
    share of the command that is driven; 1 is no slip. Steps are exact.

    Examples
    --------
    >>> psi = {"vx_factor": 1.0, "vy_factor": 0.5, "omega_factor": 1.0}
    >>> [float(x) for x in Mecanum().exact([0.0, 0.0, 0.0], [1.0, 1.0, 0.0], psi, 2.0)]
    [2.0, 1.0, 0.0]
    """

    name: ClassVar[str] = "mecanum"
    summary: ClassVar[str] = "an omnidirectional base; a slip factor for each of its commands"
    states: ClassVar[tuple[str, ...]] = ("x", "y", "heading")
    positions: ClassVar[tuple[str, ...]] = ("x", "y")
    state_units: ClassVar[tuple[str, ...]] = ("m", "m", "rad")
    controls: ClassVar[tuple[str, ...]] = ("vx", "vy", "omega")
    control_units: ClassVar[tuple[str, ...]] = ("m/s", "m/s", "rad/s")
    input_bounds: ClassVar[tuple[tuple[float, float], ...]] = ((-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0))
    parameters: Mapping[str, float] = {"vx_factor": 1.0, "vy_factor": 1.0, "omega_factor": 1.0}
    parameter_units: ClassVar[Mapping[str, str]] = dict.fromkeys(parameters, "-")
    heading_state: ClassVar[str] = "heading"

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        """Velocity in the map's frame, and turn rate."""
        vx, vy = psi["vx_factor"] * u[0], psi["vy_factor"] * u[1]
        along, left = cos(x[2]), sin(x[2])
        return [along * vx - left * vy, left * vx + along * vy, psi["omega_factor"] * u[2]]

    def exact(self, x: Any, u: Any, psi: Mapping[str, Any], step: Any) -> Sequence[Any]:
        """An arc."""
        px, py, heading = x
        vx, vy = psi["vx_factor"] * u[0], psi["vy_factor"] * u[1]
        turn = step * psi["omega_factor"] * u[2]
        # integrals of cos and sin of the heading over the step
        along, left = arc(heading, turn)
        return [px + step * (along * vx - left * vy), py + step * (left * vx + along * vy), heading + turn]

    def check(self, psi: Mapping[str, float]) -> None:
        """Factors are above 0."""
        for name in self.parameters:
            if psi[name] <= 0:
                raise ProblemError(f"{name}: expected a factor above 0, got {psi[name]:g}")
