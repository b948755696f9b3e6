r"""The enclosure of robots whose model is wrong within bounds: a wider radius around the same polynomials.

For ``x' = f(x, u + du, psi + dpsi) + w`` and the polynomial `x~` of the model, ``e = x - x~`` has
``e' = J e + d - defect`` with

.. math:: |d| \le |w| + \sup |\partial f / \partial u|\, |du| + \sup |\partial f / \partial \psi|\, |d\psi|

over the tube and the errors, for any measurable `w`, `du` and `dpsi`.  So the radius is that of the model with a larger
defect (`growth`); the tube is assumed a little wider than the radius was last time, until the radius is within it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ensemble_ctrl.certificate.errors import Unenclosed
from ensemble_ctrl.certificate.general.basis import UP
from ensemble_ctrl.certificate.general.growth import radii
from ensemble_ctrl.certificate.general.jacobian import jacobian

if TYPE_CHECKING:
    from ensemble_ctrl.certificate.general.enclosure import Enclosure, Pieces
    from ensemble_ctrl.problem.uncertainty import Uncertainty

TRIES = 12
"""Tubes that are assumed in turn."""
WIDER = 1.15
"""How much wider the next tube is than the radius that came of the last one."""


def disturbed(pieces: Pieces, found: Enclosure, bounds: Uncertainty) -> Enclosure:
    """An enclosure of the model with the radius of robots that differ from it within bounds.

    Raises
    ------
    Unenclosed
        If the radius leaves every tube that is assumed.

    Notes
    -----
    *Guarantee*: every member is, under every disturbance within the bounds, within `Enclosure.radius` of the
    polynomial, at all times.
    """
    c, centre, half = found.c, found.centre, found.half
    defect, jump = pieces.defect(c, centre, half), pieces.jump(c, centre, half)
    tube = 2 * found.radius + 1e-12
    for _ in range(TRIES):
        matrices, drive = jacobian(pieces, c, tube, centre, half, bounds)
        wider = (defect.transpose(0, 2, 1) + drive) * UP
        radius = radii(matrices, wider, jump.transpose(0, 2, 1), pieces.step * UP).transpose(0, 2, 1)
        if not np.isfinite(radius).all():
            break
        # no member can have left a tube that is wider than what is proven within it
        if (radius < tube).all():
            return replace(found, radius=radius, model=found.radius)
        tube = np.maximum(tube, WIDER * radius)
    raise Unenclosed("the errors of the model grow beyond every tube around it that was assumed")
