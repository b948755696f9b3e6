"""How a fleet is spread over parameter cells, and which value a share of it reaches."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import ceil, floor
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl.formula import Share
from ensemble_ctrl.core.values import exact

if TYPE_CHECKING:
    from ensemble_ctrl.problem.ensemble import Ensemble

Floats = NDArray[np.float64]
MASS_ERROR = 1e-9
"""Share of the fleet by which a mass from distribution functions may be too high."""


@dataclass(frozen=True, eq=False)
class Masses:
    """How the fleet is spread over cells.

    Attributes
    ----------
    mass : ndarray, shape (cells,)
        Whole numbers where members can be counted, else shares of the fleet.
    total : float
        That of the whole fleet.
    counted : bool
        Whether they are whole numbers.
    even : bool
        Whether the distribution is uniform within cells, too.
    """

    mass: Floats
    total: float
    counted: bool
    even: bool

    def reached(self, value: Floats, share: Share, upper: bool) -> Floats:
        """The largest value that cells of at least a share reach, shape (1, elements); minus infinity if none do."""
        # from the largest value down, the first cells whose masses sum to the share
        order = np.argsort(value, axis=0)
        mass = self.mass[order]
        below = np.cumsum(mass, axis=0) - mass
        enough = self.total - below >= self.needed(share, upper)
        last = np.where(enough.any(axis=0), len(enough) - 1 - enough[::-1].argmax(axis=0), 0)
        found = np.take_along_axis(np.take_along_axis(value, order, axis=0), last[None], axis=0)
        return np.where(enough.any(axis=0), found, -np.inf)

    def needed(self, share: Share, upper: bool) -> float:
        """The mass that is a share of the fleet, or more than it if that is strict; rounded up, or down for `upper`."""
        if not self.counted:
            return share.p - MASS_ERROR if upper else min(share.p + MASS_ERROR, 1.0 + MASS_ERROR * share.strict)
        # the least whole number of members that is p of all of them, or more than p
        p = exact(share.p)
        if share.strict:  # it is 1 - p of another share, and that has been rounded
            return float(floor((p + Fraction(-1 if upper else 1, 10**12)) * Fraction(self.total)) + 1)
        return float(ceil(p * Fraction(self.total)))


def masses(fleet: Ensemble, centres: Floats, half: Floats) -> Masses:
    """The distributions' mass of each of the equal cells that make up the fleet's box.

    Cells share their edges, and what lies on an edge belongs to the lower cell, so that nothing counts twice.
    """
    distributions, samples = list(fleet.parameters.items()), fleet.samples or {}
    counted = all(distribution.uniform or distribution.measured is not None for _, distribution in distributions)
    # the mass of a cell is a product over independent parameters; joint samples are counted
    mass, total, robots = np.ones(len(centres)), 1.0, None
    for k, (name, distribution) in enumerate(distributions):
        # index of each cell along this parameter, of `count` equal ones, and their inner edges
        width = distribution.upper - distribution.lower
        count = max(1, round(width / (2 * half[0, k]))) if width else 1
        index = np.clip(((centres[:, k] - distribution.lower) / max(width, 1e-300) * count).astype(int), 0, count - 1)
        edges = distribution.lower + width * np.arange(1, count) / count
        if name in samples:
            place = np.searchsorted(edges, samples[name], side="left")
            inside = index[:, None] == place
            robots = inside if robots is None else robots & inside
        elif distribution.measured is not None:
            place = np.searchsorted(edges, distribution.measured, side="left")
            mass, total = mass * np.bincount(place, minlength=count)[index], total * len(distribution.measured)
        elif distribution.uniform:
            total *= count
        else:
            mass *= np.diff(np.concatenate([[0.0], distribution.cdf(edges), [1.0]]))[index]
    if robots is not None:
        mass, total = mass * robots.sum(axis=1), total * robots.shape[1]
    even = all(distribution.uniform for _, distribution in distributions)
    return Masses(mass, total, counted, even) if counted else Masses(mass / total, 1.0, counted, even)
