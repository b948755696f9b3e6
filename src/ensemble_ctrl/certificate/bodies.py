r"""What a body adds to where its robot is: its corners on a cell of parameters and a piece of time, enclosed.

A corner ``beta`` of a body with heading ``phi`` is at ``p + R(phi) beta``.  With ``phi = g + b Omega`` affine in the
parameters, on a cell whose parameters differ from its centre's by at most ``h``, so that ``g`` and ``b`` differ by at
most ``G`` and ``B``:

1. *In the parameters*: ``R(phi) beta`` leaves its linear picture ``R(phi_c) beta + (phi - phi_c) R(phi_c + 90 deg)
   beta`` by at most ``|beta| (B |Omega| + G)^2 / 2``.
2. *In time*: that picture leaves its chord on a piece of length ``dt`` by at most ``dt^2/8`` times its largest second
   derivative, ``|beta| omega^2 (b^2 + 2 B |b| + (B |Omega| + G) b^2)``.

A convex body is the hull of its corners, so the bodies of the cell lie in the hull of all these points, grown by both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.disturbance import UNIT
from ensemble_ctrl.certificate.enclosure import Flow

if TYPE_CHECKING:
    from ensemble_ctrl.constraints.footprint import Footprint
    from ensemble_ctrl.constraints.obstacle import Obstacle

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Body:
    """A footprint along a flow; without one, the planned point itself as the only corner.

    Parameters
    ----------
    flow : Flow
    footprint : Footprint, optional
    """

    flow: Flow
    footprint: Footprint | None = None

    @property
    def reach(self) -> float:
        """Metres from the planned point to the farthest corner."""
        return 0.0 if self.footprint is None else self.footprint.reach

    def corners(self, n: Ints, share: Floats, coeffs: Floats) -> tuple[Floats, Floats]:
        """Corners relative to the planned point at a share of step `n`, and their derivatives by the parameters.

        Shapes (boxes, corners, 2) and (boxes, corners, parameters, 2).
        """
        if self.footprint is None:
            parameters = len(self.flow.lower)
            return np.zeros((len(n), 1, 2)), np.zeros((len(n), 1, parameters, 2))
        at = self.footprint.at(np.zeros((len(n), 2)), self._heading(n, share, coeffs))
        # d(R beta)/dq_k = dphi/dq_k R(phi + 90 deg) beta, dphi/dq_k = +-(dg/dq_k + Omega db/dq_k)
        turn = self.flow.directions[:, 2] + self._turned(n, share)[:, None] * self.flow.directions[:, 1]
        across = np.stack([-at[..., 1], at[..., 0]], axis=-1) * (-1.0 if self.flow.swapped else 1.0)
        return at, turn[:, None, :, None] * across[:, :, None]

    def sides(self, corners: Floats) -> Floats:
        """Directions of the body's sides, shape (boxes, sides, 2)."""
        return np.zeros((len(corners), 0, 2)) if self.footprint is None else np.roll(corners, -1, axis=1) - corners

    def distance(self, piece: Obstacle, places: Floats, n: Ints, share: Floats, coeffs: Floats) -> Floats:
        """Distance of the body from a piece, the planned point at `places`."""
        if self.footprint is None:
            return piece.distance(places)
        return self.footprint.distance(piece, places, self._heading(n, share, coeffs))

    def remainder(self, half: Floats, n: Ints) -> Floats:
        """How far corners leave their linear picture in cells of shape (..., parameters) up to the end of step `n`."""
        return np.asarray(self.reach / 2 * self._differ(half, n)[0] ** 2 * (1 + 64 * UNIT))

    def growth(self, n: Ints, span: Floats, coeffs: Floats, half: Floats) -> Floats:
        """How far that picture leaves its chord on a piece of `span` seconds of step `n`, metres, rounded up."""
        apart, B = self._differ(half, n)
        b = np.abs(coeffs[..., 1])
        size = b**2 + 2 * B * b + apart * b**2
        return np.asarray(span**2 / 8 * self.reach * self.flow.omega[n] ** 2 * size * (1 + 64 * UNIT))

    def rounding(self) -> float:
        """Bound in metres on the rounding error of a corner relative to the planned point."""
        # the angle's own error is at most (steps + 8) roundings of its largest value; as for `Flow.rounding`
        ends = np.abs(self.flow.origin) + np.maximum(np.abs(self.flow.lower), np.abs(self.flow.upper)) @ np.abs(
            self.flow.directions
        )
        angle = float(ends[2]) + float(ends[1]) * float(self.flow.largest.max())
        return 4 * UNIT * self.reach * ((self.flow.steps + 32) * (1 + angle) + 32)

    def _differ(self, half: Floats, n: Ints) -> tuple[Floats, Floats]:
        """By how much headings differ in a cell up to the end of step `n`, and the factors on the turn rate."""
        wide = half @ np.abs(self.flow.directions[:, 1:3])
        return wide[..., 0] * self.flow.largest[n] + wide[..., 1], wide[..., 0]

    def _turned(self, n: Ints, share: Floats) -> Floats:
        """The integral of the turn rate."""
        return np.asarray(self.flow.turned[n] + share * self.flow.step[n] * self.flow.omega[n])

    def _heading(self, n: Ints, share: Floats, coeffs: Floats) -> Floats:
        """Headings from +x, counter-clockwise, radians."""
        own = coeffs[..., 2] + coeffs[..., 1] * self._turned(n, share)
        return np.asarray(np.pi / 2 - own if self.flow.swapped else own)
