"""A robot on two driven wheels, commanded by their speeds, each wheel with a factor of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.systems.arrays import arc, cos, sin
from ensemble_ctrl.systems.system import System


@dataclass(frozen=True)
class DifferentialDrive(System):
    r"""Two wheels of radius `r`, a track `b` apart, with speeds :math:`w_l, w_r`; the position is between them.

    .. math::
        v = \tfrac r2 (k_l w_l + k_r w_r), \quad \dot p = v\,(\cos\theta, \sin\theta), \quad
        \dot\theta = \frac{r\,(k_r w_r - k_l w_l)}{k_b b}

    Wheels of unequal size bend every straight line, which no factor on speed and turn rate says. Steps are exact.

    Parameters
    ----------
    wheel_radius : float
        Nominal radius of the wheels, metres; a wheel's factor scales it.
    track : float
        Nominal distance between the wheels, metres; `track_factor` scales it.

    Examples
    --------
    >>> psi = {"left_factor": 1.0, "right_factor": 1.0, "track_factor": 1.0}
    >>> [float(x) for x in DifferentialDrive(wheel_radius=0.1).exact([0.0, 0.0, 0.0], [5.0, 5.0], psi, 2.0)]
    [1.0, 0.0, 0.0]
    """

    wheel_radius: float = 0.05
    track: float = 0.3

    name: ClassVar[str] = "differential_drive"
    summary: ClassVar[str] = "two wheels, commanded by their speeds; a factor for each wheel and for the track"
    states: ClassVar[tuple[str, ...]] = ("x", "y", "heading")
    positions: ClassVar[tuple[str, ...]] = ("x", "y")
    state_units: ClassVar[tuple[str, ...]] = ("m", "m", "rad")
    controls: ClassVar[tuple[str, ...]] = ("w_left", "w_right")
    control_units: ClassVar[tuple[str, ...]] = ("rad/s", "rad/s")
    input_bounds: ClassVar[tuple[tuple[float, float], ...]] = ((-20.0, 20.0), (-20.0, 20.0))
    parameters: ClassVar[Mapping[str, float]] = {"left_factor": 1.0, "right_factor": 1.0, "track_factor": 1.0}  # type: ignore[misc]
    parameter_units: ClassVar[Mapping[str, str]] = {"left_factor": "-", "right_factor": "-", "track_factor": "-"}
    heading_state: ClassVar[str] = "heading"

    def __post_init__(self) -> None:
        for name, length in (("wheel_radius", self.wheel_radius), ("track", self.track)):
            if not (np.isfinite(length) and length > 0):
                raise ProblemError(f"{name}: expected a length above 0 m, got {length:g} m")

    def _rates(self, u: Any, psi: Mapping[str, Any]) -> tuple[Any, Any]:
        """Speed and turn rate."""
        left, right = psi["left_factor"] * u[0], psi["right_factor"] * u[1]
        return self.wheel_radius / 2 * (left + right), self.wheel_radius * (right - left) / (
            self.track * psi["track_factor"]
        )

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        """Velocity and turn rate."""
        speed, omega = self._rates(u, psi)
        return [speed * cos(x[2]), speed * sin(x[2]), omega]

    def exact(self, x: Any, u: Any, psi: Mapping[str, Any], step: Any) -> Sequence[Any]:
        """An arc."""
        speed, omega = self._rates(u, psi)
        along, left = arc(x[2], step * omega)
        return [x[0] + step * speed * along, x[1] + step * speed * left, x[2] + step * omega]

    def check(self, psi: Mapping[str, float]) -> None:
        """Factors are above 0."""
        for name in self.parameters:
            if psi[name] <= 0:
                raise ProblemError(f"{name}: expected a factor above 0, got {psi[name]:g}")

    def settings(self) -> Mapping[str, Any]:
        """The lengths."""
        return {"wheel_radius": self.wheel_radius, "track": self.track}
