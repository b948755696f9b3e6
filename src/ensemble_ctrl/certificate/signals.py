"""Bounds of predicates at instants and throughout the time between them, for all members of cells of parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.commands import Commands
from ensemble_ctrl.certificate.disturbance import UNIT
from ensemble_ctrl.certificate.enclosure import Flow, Track, lowered
from ensemble_ctrl.certificate.masses import MASS_ERROR, Masses
from ensemble_ctrl.constraints.stl.formula import Share
from ensemble_ctrl.constraints.stl.leaves import Predicate

Floats = NDArray[np.float64]

UP = 1 + 1e-12
"""Factor by which half widths are rounded up."""


@dataclass(frozen=True, eq=False)
class CellSignals:
    """Bounds of predicates over the elements of a flow's mesh; each member is a parameter cell."""

    centres: Floats
    half: Floats
    position: Floats
    slope: Floats
    curvature: Floats
    bulge: Floats
    error: float
    away: Floats
    commands: Commands | None = None
    upper: bool = False
    masses: Masses | None = None

    @classmethod
    def of(
        cls,
        flow: Flow,
        commands: Commands | None,
        centres: Floats,
        half: Floats,
        upper: bool = False,
        masses: Masses | None = None,
    ) -> CellSignals:
        """Enclosures of the cells ``centres +- half``, both of shape (cells, parameters); `masses` if all are there."""
        # p in p(c) + sum_k +-half_k dp/dq_k + curvature at grid times, and the bulge of the curve in between
        track = Track.of(flow, centres)
        n = np.arange(flow.steps)[None, :]
        bulge = flow.growth(n, flow.step[None], flow.coefficients(centres)[:, None], half[:, None])
        curvature = flow.remainder(half)
        # upper bounds are of robots that follow their model, which is within all bounds of its errors
        away = np.zeros(flow.steps) if upper else flow.error + flow.lag
        known = track.position, track.slope, curvature, bulge, flow.rounding(), away
        return cls(centres, half, *known, commands, upper, masses)

    @property
    def members(self) -> int:
        """How many cells."""
        return len(self.centres)

    def leaf(self, predicate: Predicate, first: int, last: int) -> Floats:
        """Bounds of a predicate, shape (cells, last - first + 1)."""
        coefficients, offset = predicate.normalised()
        by_name, offset = dict(coefficients), offset + (predicate.slack if self.upper else 0.0)
        if by_name.keys() - {"x", "y"}:
            return self._commanded(by_name, offset, first, last)
        row = np.array([by_name.get("x", 0.0), by_name.get("y", 0.0)])
        # A_k -+ (R_k + eps) at grid times, A_k = mu(p(t_k, c)) -+ sum_j h_j |n . dp_j|; in between the worse end -+ D
        some = slice(first // 2, (last + 1) // 2 + 1)
        value = self.position[:, some] @ row + offset
        reach = (np.abs(self.slope[:, some] @ row) * self.half[:, None]).sum(axis=-1)
        spread = reach + self.curvature[:, some] + (self.error + 4 * UNIT * abs(offset))
        sign = 1.0 if self.upper else -1.0
        ends = value + sign * spread
        bulge = self.bulge[:, some.start : some.stop - 1] + self.away[some.start : some.stop - 1]
        between = (np.maximum if self.upper else np.minimum)(ends[:, :-1], ends[:, 1:]) + sign * bulge
        # errors of the model hold throughout a piece, its ends included: at an instant the smaller of two counts
        ends = ends + sign * np.minimum(np.append(self.away, np.inf), np.insert(self.away, 0, np.inf))[some]
        bound = _interleaved(ends, between)[:, first - 2 * some.start :][:, : last - first + 1]
        return -lowered(-bound) if self.upper else lowered(bound)

    def _commanded(self, by_name: Mapping[str, float], offset: float, first: int, last: int) -> Floats:
        """Bounds of a predicate on headings and rates; nothing is claimed of one on positions too, or of the mean."""
        worst = np.inf if self.upper else -np.inf
        if self.commands is None or not self.commands.reads(by_name):
            return np.full((self.members, last - first + 1), worst)
        between, ends = self.commands.bounds(by_name, offset, self.centres, self.half, self.upper)
        bound = _interleaved(ends, between)[:, first : last + 1]
        return -lowered(-bound) if self.upper else lowered(bound)

    def mean(self) -> CellSignals:
        """The mean member.

        With a uniform distribution cells weigh the same: centres average, and curvature over a cell averages to a
        third. With another distribution a cell's mean may be anywhere in it.
        """
        if self.masses is None or self.masses.even:
            # even mass: the linear parts cancel, and the mean of the squares of uniform [-1, 1] is 1/3
            away = self.curvature.max(axis=0, keepdims=True) / 3
            position = self.position.mean(axis=0, keepdims=True)
        else:
            # else the mean of the middles, off by the mean of the reaches, and by what masses may be wrong
            share = self.masses.mass / self.masses.total
            reach = (np.linalg.norm(self.slope, axis=-1) * self.half[:, None]).sum(axis=-1) + self.curvature
            position = np.einsum("c,ctd->td", share, self.position)[None]
            wrong = 0.0 if self.masses.counted else len(share) * MASS_ERROR
            apart = np.linalg.norm(self.position - position, axis=-1) + reach
            away = (share @ reach)[None] * UP + wrong * apart.max(axis=0, keepdims=True)
        one = replace(self, centres=self.centres[:1], half=np.zeros_like(self.half[:1]), commands=None, masses=None)
        slope, bulge = np.zeros_like(self.slope[:1]), self.bulge.max(axis=0, keepdims=True)
        error = self.error * (1 + len(self.centres))
        return replace(one, position=position, slope=slope, curvature=away, bulge=bulge, error=error)

    def ranked(self, value: Floats, share: Share) -> Floats:
        """The largest value that cells of at least this mass reach; minus infinity if no cells do.

        With upper bounds of the cells it is an upper bound, too: members that reach more are in cells that do.
        """
        if self.masses is None:
            raise AssertionError("a share is of all cells")
        return self.masses.reached(value, share, self.upper)


def _interleaved(ends: Floats, between: Floats) -> Floats:
    """Grid times and intervals in turn, shape (cells, 2 steps + 1)."""
    out = np.empty((len(ends), ends.shape[1] + between.shape[1]))
    out[:, ::2], out[:, 1::2] = ends, between
    return out
