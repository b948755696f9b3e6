r"""Risk: the mean of a loss over the worst part of a fleet.

The *conditional value at risk* of a loss L at a level :math:`\alpha` is the mean loss of the worst part,
:math:`1 - \alpha` of the members,

.. math:: \mathrm{CVaR}_\alpha(L) = \min_t\; t + \frac{1}{1 - \alpha} E[\max(L - t, 0)]

(R. T. Rockafellar and S. Uryasev, Optimization of conditional value-at-risk, 2000). The least t is the value at risk,
the loss that a share :math:`\alpha` does not exceed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import exact, number

Floats = NDArray[np.float64]
Loss = Literal["terminal", "clearance"]

LOSSES = ("terminal", "clearance")
"""What can be lost: distance from the target at the end, or clearance on the way."""
CLEARANCE_CAP = 1.0
"""Metres; a member further from every obstacle than this throughout counts as this far."""


@dataclass(frozen=True)
class Risk:
    """A penalty on the worst part of the fleet.

    Parameters
    ----------
    of : {"terminal", "clearance"}
        The loss, in metres: a member's distance from its place at the end, or minus its smallest clearance on the way.
    level : float
        The share of the fleet that is left out, 0 to below 1: 0.9 is about the worst tenth, 0 about all members.
    weight : float
        Weight per metre.

    Raises
    ------
    ProblemError
        For another loss, or numbers out of range.
    """

    of: Loss
    level: float = 0.9
    weight: float = 1.0

    def __post_init__(self) -> None:
        if not isinstance(self.of, str) or self.of not in LOSSES:
            raise ProblemError(f"cvar: expected one of {', '.join(LOSSES)}, got {self.of!r}")
        for name in ("level", "weight"):
            object.__setattr__(self, name, number(f"cvar.{name}", getattr(self, name)))
        if not 0 <= self.level < 1:
            raise ProblemError(f"cvar: expected a level from 0 to below 1, got {self.level:g}")
        if not (np.isfinite(self.weight) and self.weight >= 0):
            raise ProblemError(f"cvar: expected a finite weight >= 0, got {self.weight:g}")


def value_at_risk(losses: ArrayLike, level: float) -> tuple[float, float]:
    """Value at risk, and conditional value at risk, of losses of members that weigh the same.

    Parameters
    ----------
    losses : array_like, shape (members,)
        In any unit.
    level : float
        0 to below 1.

    Examples
    --------
    >>> value_at_risk([1.0, 2.0, 3.0, 4.0], 0.5)
    (2.0, 3.5)
    """
    # VaR: the ceil(level n)-th smallest loss; CVaR = VaR + E[(loss - VaR)+] / (1 - level) (Rockafellar and Uryasev)
    ordered = np.sort(np.asarray(losses, dtype=float))
    n = len(ordered)
    threshold = float(ordered[max(ceil(exact(level) * n) - 1, 0)])
    return threshold, threshold + float(np.maximum(ordered - threshold, 0.0).mean()) / (1 - level)
