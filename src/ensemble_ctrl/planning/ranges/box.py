r"""The largest certified box of two parameters, and how much of one range the other costs.

A box has half widths :math:`(h_1, h_2) = t (L_1 \cos a, L_2 \sin a)` around the nominal values, where :math:`L_k` is
the widest half width of one parameter with the other at its nominal value. The largest t is searched for each of a few
angles a, from the plan of the nearest box; then between those of the largest areas.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field

import numpy as np

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.planning.ranges.oracle import Found, Oracle
from ensemble_ctrl.planning.ranges.parts import furthest, widened
from ensemble_ctrl.planning.ranges.scaled import Scaled

ANGLES = (45.0, 22.5, 67.5)
"""Degrees: 0 and 90 are the two parameters alone."""
FINER = 2
"""How often the largest area is narrowed down between its neighbours."""
PRECISION = 0.02
"""Share of the size within which a box is found and none was found."""


@dataclass(frozen=True, eq=False)
class Box:
    """A certified box.

    Attributes
    ----------
    angle : float
        Degrees.
    halves : tuple of float
        Half widths of the two parameters.
    found : Found
    """

    angle: float
    halves: tuple[float, float]
    found: Found

    @property
    def area(self) -> float:
        """Product of the two widths."""
        return 4 * self.halves[0] * self.halves[1]


@dataclass(eq=False)
class Boxes:
    """One search.

    Parameters
    ----------
    oracle : Oracle
    names : tuple of str
        The two parameters.

    Attributes
    ----------
    boxes : list of Box
        By angle; the first and the last are one parameter alone.
    """

    oracle: Oracle
    names: tuple[str, str]
    boxes: list[Box] = field(default_factory=list)

    def run(self) -> Boxes:
        """Search; without boxes where not even a single parameter has a range with a plan.

        Once the oracle is stopped, the boxes are those found so far.
        """
        self.boxes = [box for box in map(self._single, (0, 1)) if box is not None]
        if len(self.boxes) < 2:
            return self
        whole = self.boxes[0].halves[0], self.boxes[1].halves[1]
        for angle in ANGLES:
            self._along(angle, whole)
        for _ in range(FINER):
            self._along(self._between(), whole)
        return self

    @property
    def largest(self) -> Box | None:
        """The box with the largest area."""
        return max(self.boxes, key=lambda box: box.area, default=None)

    def _single(self, k: int) -> Box | None:
        """The widest range of one parameter with the other at its nominal value; None where none has a plan."""
        fleet, (name, other) = self.oracle.problem.fleet, (self.names[k], self.names[1 - k])
        limit = furthest(fleet, name)
        own = fleet.parameters[name].half_width or limit / 10
        search = Scaled(self.oracle, lambda half: widened(fleet, {name: half, other: 0.0}))
        size = search.run(min(own, limit), limit, min(PRECISION * limit, own / 10))
        if search.best is None or size <= 0:
            return None
        return Box(90.0 * k, (0.0, size) if k else (size, 0.0), search.best)

    def _along(self, angle: float, whole: tuple[float, float]) -> None:
        """The largest box along an angle, from the plan of the nearest one; none where no small one has a plan."""
        fleet, names = self.oracle.problem.fleet, self.names
        near = min(self.boxes, key=lambda box: abs(box.angle - angle))
        halves = _halves(angle, whole)
        search = Scaled(
            self.oracle,
            lambda size: widened(fleet, dict(zip(names, halves(size), strict=True))),
            (near.found.solution.controls,),
            looked=True,  # routes were looked for with each parameter alone
        )
        # a convex set of boxes holds at least t = 1 / (cos a + sin a), a rectangle t = 1 / max(cos a, sin a)
        radians = np.radians(angle)
        limit = float(1 / max(np.cos(radians), np.sin(radians)))
        size = search.run(float(1 / (np.cos(radians) + np.sin(radians))), limit, PRECISION)
        if search.best is not None:
            self.boxes = sorted([*self.boxes, Box(angle, halves(size), search.best)], key=lambda box: box.angle)

    def _between(self) -> float:
        """The middle of the wider gap beside the box of the largest area."""
        angles = [box.angle for box in self.boxes]
        at = max(range(1, len(angles) - 1), key=lambda k: self.boxes[k].area, default=0)
        if not at:
            return 45.0
        below, above = angles[at] - angles[at - 1], angles[at + 1] - angles[at]
        return angles[at] - below / 2 if below > above else angles[at] + above / 2


def _halves(angle: float, whole: tuple[float, float]) -> Callable[[float], tuple[float, float]]:
    """Half widths of sizes along an angle."""
    cosine, sine = float(np.cos(np.radians(angle))), float(np.sin(np.radians(angle)))
    return lambda size: (size * whole[0] * cosine, size * whole[1] * sine)
