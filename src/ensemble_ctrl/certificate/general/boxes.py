"""Parts of an enclosure: pieces of time and cells of parameters, cut further, with polynomials on each part."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.general.basis import UNIT, UP, Basis, restriction, restriction_error
from ensemble_ctrl.certificate.general.enclosure import Enclosure

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

GRID = 2.0**30
"""Ends of parts of a piece of time are moved outwards to multiples of one over this, scaled to [-1, 1].

That is more than all roundings of a time in up to 800,000 pieces, and lets pieces that are cut alike share their
matrices.
"""

ROWS = ("c", "pad", "off", "piece", "begin", "end", "centre", "half")
"""The fields of `Boxes` with a row for each box."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """Polynomials of some quantities on parts of pieces of time and of cells of parameters, as rows.

    Attributes
    ----------
    basis : Basis
    wide : ndarray of int
        The parameters with a width: those that the terms are of.
    c : ndarray, shape (boxes, quantities, times, terms)
        Coefficients on the box, scaled to [-1, 1] in time and in each parameter.
    pad : ndarray, shape (boxes, quantities)
        Every member is within it of the polynomial.
    off : ndarray, shape (boxes, quantities)
        What of it is for errors of the model.
    piece : ndarray of int, shape (boxes,)
        The piece of time.
    begin, end : ndarray, shape (boxes,)
        The part of the piece, -1 to 1.
    centre, half : ndarray, shape (boxes, parameters)
        The cell, for showing members; the polynomials hold for it whatever its rounding.
    """

    basis: Basis
    wide: Ints
    c: Floats
    pad: Floats
    off: Floats
    piece: Ints
    begin: Floats
    end: Floats
    centre: Floats
    half: Floats

    def __len__(self) -> int:
        return len(self.c)

    @classmethod
    def of(cls, enclosure: Enclosure, rows: Floats, piece: Ints, begin: Floats, end: Floats) -> Boxes:
        """All cells at parts of pieces; `rows`, shape (quantities, states), are the quantities in the states."""
        cells = len(enclosure.centre)
        weights = np.abs(rows)
        shape = (len(piece) * cells, len(rows))
        # quantities: rows times coefficients; pad: |rows| times radii, and (n + 4) u sum |c| for rounding
        c = np.einsum("qs,ksctp->kcqtp", rows, enclosure.c[piece]).reshape(*shape, *enclosure.basis.shape)
        size = np.einsum("qs,ksctp->kcq", weights, np.abs(enclosure.c[piece])).reshape(shape)
        pad = np.einsum("qs,ksc->kcq", weights, enclosure.radius[piece]).reshape(shape)
        pad = (pad + (rows.shape[1] + 4) * UNIT * size) * UP
        off = np.einsum("qs,ksc->kcq", weights, enclosure.radius[piece] - enclosure.model[piece]).reshape(shape) / UP
        cell = [np.tile(part, (len(piece), 1)) for part in (enclosure.centre, enclosure.half)]
        all_ = np.repeat(piece, cells), -np.ones(shape[0]), np.ones(shape[0])
        whole = cls(enclosure.basis, enclosure.wide, c, pad, off, *all_, *cell)
        return whole._in_time(np.repeat(begin, cells), np.repeat(end, cells))

    def where(self, mask: NDArray[np.bool_] | Ints) -> Boxes:
        """Some of the boxes."""
        return replace(self, **{name: getattr(self, name)[mask] for name in ROWS})

    def joined(self, other: Boxes) -> Boxes:
        """Both lists."""
        rows: dict[str, Any] = {n: np.concatenate([getattr(self, n), getattr(other, n)]) for n in ROWS}
        return replace(self, **rows)

    def _in_time(self, begin: Floats, end: Floats) -> Boxes:
        """Whole pieces cut to a part of each."""
        c, pad = self.c.copy(), self.pad.copy()
        for low, high in set(zip(begin.tolist(), end.tolist(), strict=True)) - {(-1.0, 1.0)}:
            some = (begin == low) & (end == high)
            c[some] = restriction(self.basis.times, low, high) @ self.c[some]
            pad[some] += restriction_error(self.basis.times) * np.abs(self.c[some]).sum(axis=(2, 3))
        return replace(self, c=c, pad=pad * UP, begin=begin, end=end)

    def halved(self, side: Ints) -> Boxes:
        """Each box in two: side 0 is time, side k + 1 the parameter k among those with a width."""
        parts = []
        for k in np.unique(side).tolist():
            some = self.where(side == k)
            for low, high in ((-1.0, 0.0), (0.0, 1.0)):
                parts.append(some._half_of_time(low, high) if k == 0 else some._half_of_cell(k - 1, low, high))
        found = parts[0]
        for part in parts[1:]:
            found = found.joined(part)
        return found

    def _half_of_time(self, low: float, high: float) -> Boxes:
        """The earlier or the later half of each box."""
        # coefficients in time on the half, and the rounding of that change of basis
        c = restriction(self.basis.times, low, high) @ self.c
        pad = self.pad + restriction_error(self.basis.times) * np.abs(self.c).sum(axis=(2, 3))
        middle = (self.begin + self.end) / 2
        ends = (self.begin, middle) if high == 0.0 else (middle, self.end)
        return replace(self, c=c, pad=pad * UP, begin=ends[0], end=ends[1])

    def _half_of_cell(self, parameter: int, low: float, high: float) -> Boxes:
        """The lower or the upper half of each box's range of a parameter."""
        # coefficients in the parameter on the half, and the rounding of that change of basis
        c = self.c @ self.basis.in_parameter(parameter, low, high).T
        pad = self.pad + restriction_error(self.basis.degrees[parameter] + 1) * np.abs(self.c).sum(axis=(2, 3))
        k = int(self.wide[parameter])
        centre, half = self.centre.copy(), self.half.copy()
        # the middle of [low, high] in half widths of the cell
        centre[:, k] += (low + high) / 2 * half[:, k]
        half[:, k] /= 2
        return replace(self, c=c, pad=pad * UP, centre=centre, half=half)

    def middle(self) -> Floats:
        """The polynomials in the middle of each box, shape (boxes, quantities)."""
        return np.asarray(np.einsum("bqtp,t,p->bq", self.c, self.basis.middle_time, self.basis.middle_cell))

    def members(self, s: Floats) -> Floats:
        """The parameters of one member of each box, shape of `centre`; `s` is -1 to 1 in each with a width."""
        found = self.centre.copy()
        found[:, self.wide] += s * self.half[:, self.wide]
        return found

    def at(self, tau: Floats, s: Floats) -> Floats:
        """The polynomials at one time and member of each box, shape (boxes, quantities), right to some roundings."""
        # T_k(x) = cos(k arccos x)
        times = np.cos(np.arccos(tau)[:, None] * np.arange(self.basis.times))
        terms = np.cos(np.arccos(s)[:, None, :] * self.basis.exponents).prod(axis=2)
        return np.asarray(np.einsum("bqtp,bt,bp->bq", self.c, times, terms))

    def sizes(self) -> Floats:
        """How much time and each parameter move the quantities, shape (boxes, 1 + parameters)."""
        size = np.abs(self.c)
        # sum |c| of the terms that depend on time, and of those that depend on each parameter
        in_time = size[:, :, 1:].sum(axis=(2, 3))
        parts = [in_time] + [size[..., uses].sum(axis=(2, 3)) for uses in (self.basis.exponents > 0).T]
        return np.stack([np.linalg.norm(part, axis=1) for part in parts], axis=1)


def outwards(begin: Floats, end: Floats) -> tuple[Floats, Floats]:
    """Parts of pieces, -1 to 1, moved outwards by more than the rounding of their times, within the piece."""
    low = np.floor(begin * GRID - 1.0) / GRID
    high = np.ceil(end * GRID + 1.0) / GRID
    return np.clip(low, -1.0, 1.0), np.clip(high, -1.0, 1.0)
