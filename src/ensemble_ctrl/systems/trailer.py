"""A car that pulls or pushes one trailer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.systems.arrays import cos, sin, tan
from ensemble_ctrl.systems.system import System


@dataclass(frozen=True)
class Trailer(System):
    r"""A car with one trailer; the position is the middle of the trailer's axle, or of the car's rear axle.

    .. math::
        \dot\theta = \frac{k v \tan\delta}{l} =: \Omega, \quad
        \dot\phi = \Omega - \frac{k v \sin\phi - h\,\Omega \cos\phi}{d}

    The car's rear axle moves with :math:`k v` along :math:`\theta`; the hitch is :math:`h` behind it, the trailer's
    axle :math:`d` behind the hitch. It moves with :math:`k v \cos\phi + h\,\Omega\sin\phi` along the trailer's heading
    :math:`\theta - \phi`. Backwards, `hitch` is unstable.

    Parameters
    ----------
    wheelbase : float
        Distance between the car's axles, metres.
    hitch_offset : float
        How far the hitch is behind the car's rear axle, metres; negative in front of it.
    axle : {"trailer", "car"}
        Which axle the position is. Obstacles and regions are about this one point, with the fleet's `radius` around it.

    Examples
    --------
    >>> psi = {"traction": 1.0, "trailer_length": 4.0}
    >>> [float(x) for x in Trailer(axle="car").xdot([0.0, 0.0, 0.0, 0.0], [1.0, 0.0], psi)]
    [1.0, 0.0, 0.0, 0.0]
    """

    wheelbase: float = 3.0
    hitch_offset: float = 0.0
    axle: str = "trailer"

    name: ClassVar[str] = "trailer"
    summary: ClassVar[str] = "a car with one trailer; traction scales the speed, trailers differ in length"
    states: ClassVar[tuple[str, ...]] = ("x", "y", "heading", "hitch")
    positions: ClassVar[tuple[str, ...]] = ("x", "y")
    state_units: ClassVar[tuple[str, ...]] = ("m", "m", "rad", "rad")
    controls: ClassVar[tuple[str, ...]] = ("v", "delta")
    control_units: ClassVar[tuple[str, ...]] = ("m/s", "rad")
    input_bounds: ClassVar[tuple[tuple[float, float], ...]] = ((-2.0, 2.0), (-0.6, 0.6))
    parameters: ClassVar[Mapping[str, float]] = {"traction": 1.0, "trailer_length": 4.0}  # type: ignore[misc]
    parameter_units: ClassVar[Mapping[str, str]] = {"traction": "-", "trailer_length": "m"}
    heading_state: ClassVar[str] = "heading"

    def __post_init__(self) -> None:
        if not (np.isfinite(self.wheelbase) and self.wheelbase > 0):
            raise ProblemError(f"wheelbase: expected a length above 0 m, got {self.wheelbase:g} m")
        if not np.isfinite(self.hitch_offset):
            raise ProblemError(f"hitch_offset: expected a finite length, got {self.hitch_offset:g} m")
        if self.axle not in ("trailer", "car"):
            raise ProblemError(f"axle: expected trailer or car, got {self.axle!r}")

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        """Velocity, turn rate, and the rate of the angle between car and trailer."""
        speed = psi["traction"] * u[0]
        turn = speed * tan(u[1]) / self.wheelbase
        offset = self.hitch_offset * turn
        # the hitch moves by `speed` along the car and -`offset` to its left: along and across the trailer
        along = speed * cos(x[3]) + offset * sin(x[3])
        across = speed * sin(x[3]) - offset * cos(x[3])
        pace, way = (along, x[2] - x[3]) if self.axle == "trailer" else (speed, x[2])
        return [pace * cos(way), pace * sin(way), turn, turn - across / psi["trailer_length"]]

    def check(self, psi: Mapping[str, float]) -> None:
        """The traction and the trailer's length are above 0."""
        if psi["traction"] <= 0:
            raise ProblemError(f"traction: expected a factor above 0, got {psi['traction']:g}")
        if psi["trailer_length"] <= 0:
            raise ProblemError(f"trailer_length: expected a length above 0 m, got {psi['trailer_length']:g} m")

    def settings(self) -> Mapping[str, Any]:
        """The lengths of the car, and which axle the position is."""
        return {"wheelbase": self.wheelbase, "hitch_offset": self.hitch_offset, "axle": self.axle}
