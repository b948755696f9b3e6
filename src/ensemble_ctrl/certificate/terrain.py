r"""How far a robot on arcs may be from its model's place where patches of terrain change its factors.

In a patch a parameter may be anything in the hull of the member's own value and the patch's range, so that the product
of the parameters that make a factor is off by at most

.. math:: \delta = \prod_p (m_p + r_p) - \prod_p m_p

for own values of size `m_p` and changes of at most `r_p`.  That is one more error of the rates (`disturbance`), in the
steps in which the member may be inside.  Which these are depends on the errors themselves.  For each cell of members,
marks of (patch, step) begin with none.  A step is marked where the distance of the cell's model from the patch is not
above the errors that follow from the marks, and this is repeated until no mark is new.  Errors during a step follow
from the steps up to it alone.  So no member is inside during a step without a mark: at the first instant at which one
was, its error would be at most that of the marks before, and it is further away than that.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.chords import chords, chords_of
from ensemble_ctrl.certificate.clearance import separation
from ensemble_ctrl.certificate.disturbance import UNIT, Errors, arc_errors
from ensemble_ctrl.certificate.enclosure import Flow, Track, first_cells, lowered, signs_of

if TYPE_CHECKING:
    from ensemble_ctrl.problem import Problem
    from ensemble_ctrl.problem.terrain import Patch

Floats = NDArray[np.float64]

CELLS = {0: 1, 1: 16, 2: 4, 3: 3}
"""Cells of each of so many parameters; else 2, and with more than `MOST` one for all."""
MOST = 6
"""Parameters beyond which members are one cell."""


def errors_of(flow: Flow, problem: Problem, controls: Floats) -> Errors:
    """The errors of a fleet of robots on arcs, those of its uncertainty and of the terrain together.

    Parameters
    ----------
    flow : Flow
        Without errors, members that start elsewhere included.
    problem : Problem
    controls : ndarray, shape (steps, 2)

    Notes
    -----
    *Guarantee*: upper bounds for every member, every disturbance, and every function of time that a parameter may be in
    a patch, rounding included.
    """
    rates = problem, controls, float(flow.step.max()), flow.fastest, flow.sharpest
    if not problem.terrain:
        return arc_errors(*rates, lambda: chords(flow.bent()))
    places, changes = list[Floats](), list[Floats]()
    for cell in _cells(flow, problem):
        marks = np.zeros(cell.gap.shape, dtype=bool)
        while True:
            strays = cell.strays(marks)
            errors = arc_errors(*rates, lambda cell=cell: iter([cell.away]), strays)
            # what is no number is no distance
            more = marks | ~(cell.gap > errors.place)
            if (more == marks).all():
                break
            marks = more
        places.append(errors.place)
        changes.append(strays)
    return Errors(np.max(places, axis=0), errors.lag, errors.delay, np.max(changes, axis=0))


@dataclass(frozen=True, eq=False)
class _Cell:
    """Members of neighbouring parameters.

    Attributes
    ----------
    away : ndarray, shape (steps + 1, steps + 1)
        Upper bounds of the distances of a member's places from each other, metres.
    gap : ndarray, shape (patches, steps)
        Lower bounds of the distance of any member's model from each patch during each step, metres.
    size : ndarray, shape (parameters,)
        Upper bounds of the parameters' own absolute values.
    change : ndarray, shape (patches, parameters)
        By how much each parameter may be off in each patch.
    directions : ndarray, shape (parameters, 2)
        Which factors each parameter is a part of.
    """

    away: Floats
    gap: Floats
    size: Floats
    change: Floats
    directions: Floats

    def strays(self, marks: NDArray[np.bool_]) -> Floats:
        """By how much the factors may be off in each step, shape (2, steps)."""
        # r_p: where patches overlap, the largest; delta_k = prod (m + r) - prod m over the parameters of factor k
        most = np.where(marks[..., None], self.change[:, None], 0.0).max(axis=0)
        found = np.empty((2, marks.shape[1]))
        for k, part in enumerate(self.directions.T != 0):
            whole = np.prod((self.size + most)[:, part], axis=1) * (1 + 16 * UNIT)
            off = whole - float(np.prod(self.size[part])) * (1 - 16 * UNIT)
            found[k] = np.where(most[:, part].any(axis=1), off, 0.0)
        return found


def _cells(flow: Flow, problem: Problem) -> Iterator[_Cell]:
    """Cells that hold all members of a flow."""
    count = len(flow.lower)
    centres, half = first_cells(flow.lower, flow.upper, CELLS.get(count, 2 if count <= MOST else 1))
    track, steps = Track.of(flow, centres), np.arange(flow.steps)
    patches, arcs, names = list(problem.terrain.values()), problem.fleet.arcs, problem.fleet.names
    directions = np.array([arcs.directions[name] for name in arcs.factors])
    for k, centre in enumerate(centres):
        place, slope, width = track.position[k], track.slope[k], half[k]
        coeffs = np.broadcast_to(flow.coefficients(centre), (flow.steps, 5))
        wide = np.broadcast_to(width, (flow.steps, count))
        # hull of p + sum_k +-half_k dp/dq_k at both ends of each step, and what the linear picture misses
        corners = place[:, None] + signs_of(count) @ (width[:, None] * slope)
        hulls = np.concatenate([corners[:-1], corners[1:]], axis=1)
        radius = flow.remainder_at(wide, steps + 1) + flow.growth(steps, flow.step, coeffs, wide) + flow.rounding()
        gap = np.stack([_gap(hulls, patch) - radius for patch in patches])
        own = {name: (c - h, c + h) for name, c, h in zip(names, centre.tolist(), width.tolist(), strict=True)}
        ranges = np.array([own.get(name, (1.0, 1.0)) for name in arcs.factors])
        size = np.abs(ranges).max(axis=1) * (1 + 4 * UNIT)
        change = np.stack([_changes(patch, arcs.factors, ranges) for patch in patches])
        yield _Cell(chords_of(flow, place, slope, width), lowered(gap), size, change, directions)


def _gap(hulls: Floats, patch: Patch) -> Floats:
    """Lower bounds of the distance of hulls of shape (steps, points, 2) from a patch, shape (steps,)."""
    sides = np.diff(hulls, axis=1)
    return np.asarray(np.min([separation(hulls, sides, piece.core) - piece.rounding for piece in patch.pieces], axis=0))


def _changes(patch: Patch, names: tuple[str, ...], ranges: Floats) -> Floats:
    """By how much parameters with own values in some ranges may be off in a patch, shape (parameters,)."""
    found = np.zeros(len(names))
    for k, (name, (low, high)) in enumerate(zip(names, ranges.tolist(), strict=True)):
        if name in patch.parameters:
            least, most = patch.parameters[name]
            # from the own value furthest from each end of the patch's range, rounded up
            size = max(abs(low), abs(high), abs(least), abs(most))
            found[k] = max(most - low, high - least, 0.0) + 8 * UNIT * size
    return found
