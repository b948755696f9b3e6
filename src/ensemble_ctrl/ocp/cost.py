r"""What a plan costs, written once; every program and every judge of the planner's reads it here.

.. math:: \sum_n \Bigl(\sum_i w_i (s_{n,i} - r_i)^2\Bigr) \Delta
          + \frac{w_s}{\Delta} \sum_n |s_n - s_{n-1}|^2 + \text{terminal} + \text{risk} - w_\rho\, \rho
          + w_\text{slack} \sum \text{shortfalls}

Commands are scaled, ``s = (u - middle) / half``: by nothing for robots on arcs, by their bounds for other systems.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem import Objective

Floats = NDArray[np.float64]

NARROWEST = 1e-9
"""Least half width by which a command is scaled: one whose bounds meet has none."""


@dataclass(frozen=True, eq=False)
class Scale:
    """Commands ``u = middle + half * s``.

    Attributes
    ----------
    middle, half : ndarray, shape (n_u,)
        In the units of the commands.
    rest : ndarray, shape (n_u,)
        The scaled command that takes no effort.
    """

    middle: Floats
    half: Floats
    rest: Floats

    @classmethod
    def none(cls, n_u: int = 2) -> Scale:
        """Commands as they are, and no effort at zero."""
        return cls(np.zeros(n_u), np.ones(n_u), np.zeros(n_u))

    @classmethod
    def of_bounds(cls, lower: Floats, upper: Floats, rest: Floats) -> Scale:
        """Commands in half widths of their bounds, and no effort at `rest`, in their units."""
        # u = middle + half s with s in [-1, 1]
        middle, half = (lower + upper) / 2, np.maximum((upper - lower) / 2, NARROWEST)
        return cls(middle, half, (rest - middle) / half)

    def scaled(self, controls: Floats) -> Floats:
        """Commands in their units, scaled."""
        return (controls - self.middle) / self.half

    def commands(self, scaled: Floats) -> Floats:
        """Scaled commands in their units."""
        return self.middle + self.half * scaled


@dataclass(frozen=True, eq=False)
class CommandCost:
    """Effort and smoothness of scaled commands, over whatever arrays they are."""

    weights: Floats
    smoothness: float
    rest: Floats
    step: float

    @classmethod
    def of(cls, aim: Objective, scale: Scale, step: float) -> CommandCost:
        """Of an objective, on a grid of `step` seconds."""
        return cls(aim.efforts(len(scale.rest)), aim.smoothness, scale.rest, step)

    def effort(self, commands: Iterable[Any]) -> Any:
        """``dt sum_i w_i (s_i - r_i)^2`` of one step; `commands` one after the other, arrays or expressions."""
        # dt sum_i w_i (s_i - r_i)^2, one command after the other: arrays and expressions alike
        squares = (
            w * (s - r) ** 2 for w, s, r in zip(self.weights.tolist(), commands, self.rest.tolist(), strict=True)
        )
        return self.step * sum(squares)

    def roughness(self, changes: Iterable[Any]) -> Any:
        """``w_s / dt |s_n - s_(n-1)|^2`` between two steps."""
        return self.smoothness / self.step * sum(change**2 for change in changes)

    def total(self, commands: Floats, last: Floats | None = None) -> float:
        """Of commands of shape (steps, n_u); those of the step before them count in the changes, if there was one."""
        # the change from the command before the first step counts, too
        sent = commands if last is None else np.concatenate([last[None], commands])
        return float(np.sum(self.effort(commands.T)) + np.sum(self.roughness(np.diff(sent, axis=0).T)))

    def effort_slopes(self, commands: Floats) -> tuple[Floats, Floats]:
        """Gradient ``2 dt w_i (s_ni - r_i)`` of the effort, shape (steps, n_u), and second derivatives ``2 dt w_i``."""
        bend = 2 * self.step * self.weights
        return bend * (commands - self.rest), bend

    @property
    def roughness_bend(self) -> float:
        """Second derivative ``2 w_s / dt`` of the roughness by a change."""
        return 2 * self.smoothness / self.step


def cost(aim: Objective, commands: float, terminal: float, robustness: float, risk: float = 0.0) -> float:
    """The whole cost but for shortfalls."""
    return -aim.robustness * robustness + terminal + commands + risk
