r"""How far members of different starts are from each other, over all pairs of their parameters, at every instant.

On a piece of time and a cell of parameters, every member is within a radius of a point that moves in a straight
line: ``|p(t) - (1 - s) A - s B| <= R`` with the share ``s`` of the piece.  So two members of cells of different starts
are, at one instant, at least

.. math:: \min_{0 \le s \le 1} |(1 - s)(A_i - A_j) + s (B_i - B_j)| - R_i - R_j

apart: the distance of the origin from a segment, less both radii.  Every cell of one start is compared with every cell
of the other, for members of different starts have parameters of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.bound import Bound
from ensemble_ctrl.certificate.disturbance import UNIT
from ensemble_ctrl.certificate.enclosure import Flow, Track, first_cells, lowered, signs_of
from ensemble_ctrl.certificate.errors import Unenclosed
from ensemble_ctrl.certificate.instants import Mesh

if TYPE_CHECKING:
    from ensemble_ctrl.moments import Distribution
    from ensemble_ctrl.problem import Problem
    from ensemble_ctrl.problem.specification import ApartConstraint

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LEVELS = ((4, 1), (8, 1), (16, 2), (32, 4), (64, 8), (128, 8))
"""Cells of each parameter's range and parts of each piece of time, in turn, until the distance is decided."""
WELL = 2
"""The level from which on what is proven is left as it is."""
MOST = 100_000
"""Pairs of cells of two starts at most: beyond, no finer cells are tried."""
TIGHT = 1e-3
"""Metres within which what is proven has to be of what was seen, to be left as it is before."""
INSTANT = 1e-9
"""Seconds by which an end of a piece may miss the window by rounding."""


@dataclass(frozen=True, eq=False)
class Lines:
    """Where the members of some cells are during some pieces of time: near points that move in straight lines.

    Attributes
    ----------
    first, last : ndarray, shape (pieces, cells, d)
        The points at both ends of each piece, metres.
    radius : ndarray, shape (pieces, cells)
        No member of the cell is further from its point at any instant of the piece.
    real : ndarray, shape (pieces, cells)
        Some member of the cell is no further than this from `first` when the piece begins, and `last` when it ends.
    members : ndarray, shape (cells, parameters)
        Middles of the cells.
    begin, end : ndarray, shape (pieces,)
        Seconds.
    """

    first: Floats
    last: Floats
    radius: Floats
    real: Floats
    members: Floats
    begin: Floats
    end: Floats

    def cut(self, parts: int) -> Lines:
        """The same with each piece in so many equal parts: the lines are straight, and the radius holds on all of one.

        Members are near the ends of the parts as they are near the line.
        """
        if parts == 1:
            return self
        share = np.linspace(0.0, 1.0, parts + 1)
        count, way, span = len(self.begin), self.last - self.first, self.end - self.begin
        # points at all shares, rounded, shape (pieces, parts + 1, cells, d)
        points = self.first[:, None] + share[:, None, None] * way[:, None]
        times = self.begin[:, None] + share * span[:, None]
        size = np.abs(self.first).max(initial=0.0) + np.abs(way).max(initial=0.0)
        radius = np.repeat(self.radius + 16 * UNIT * size, parts, axis=0)
        first, last = (ends.reshape(count * parts, *way.shape[1:]) for ends in (points[:, :-1], points[:, 1:]))
        return Lines(first, last, radius, radius, self.members, times[:, :-1].ravel(), times[:, 1:].ravel())


Enclosed = Callable[[int, int], Lines]
"""The lines of one start's members, with at least so many cells of each parameter and parts of each piece of time."""


def apart_bounds(
    problems: Mapping[str, Problem],
    constraints: Sequence[ApartConstraint],
    controls: Floats,
    distributions: Mapping[str, Distribution],
) -> Iterator[Bound]:
    """Proven and sampled distance beyond what is wanted, for every two starts and every constraint.

    Notes
    -----
    *Guarantee*: `Bound.proven` is at most the least distance of two members of these starts, whatever their parameters
    in the ranges, at any instant of the window, less what is wanted; rounding included.
    """
    if constraints and any(one.uncertain for one in problems.values()):
        raise Unenclosed("distances between members of different starts do not count errors of the model")
    enclosed = {name: _enclosed(one, controls, distributions) for name, one in problems.items()}
    for constraint in constraints:
        for one, other in combinations(problems, 2):
            name = f"{constraint} of {one} and {other}"
            yield _bound(name, constraint, (one, other), (enclosed[one], enclosed[other]), tuple(distributions))


def _bound(
    name: str, wanted: ApartConstraint, starts: tuple[str, str], pair: tuple[Enclosed, Enclosed], names: tuple[str, ...]
) -> Bound:
    """The bound of one pair of starts, with finer cells until it is decided."""
    proven, sampled, seen, time = -np.inf, np.inf, dict[str, float](), np.nan
    for level, (each, cut) in enumerate(LEVELS):
        here, there = _matched(*(lines(each, cut) for lines in pair))
        # pieces that touch the window, or miss it by rounding: looking at more can only take from the distance
        during = np.flatnonzero((here.end >= wanted.begin - INSTANT) & (here.begin <= wanted.end + INSTANT)).tolist()
        proven = max(proven, min(_least(here, there, n) for n in during) - wanted.distance)
        for away, i, j, at in _seen(here, there, wanted, during):
            if away - wanted.distance < sampled:
                sampled, time = away - wanted.distance, at
                rows = zip(starts, (here.members[i], there.members[j]), strict=True)
                pairs = (
                    (f"{what} of {start}", float(v)) for start, row in rows for what, v in zip(names, row, strict=True)
                )
                seen = dict(pairs)
        finer = len(here.members) * len(there.members) * 4 ** len(names)
        if sampled < 0 or sampled - proven < TIGHT or (proven >= 0 and level >= WELL) or finer > MOST:
            break
    return Bound(name, proven, sampled, seen, time)


def _matched(here: Lines, there: Lines) -> tuple[Lines, Lines]:
    """Both on the same pieces of time: an enclosure may need shorter ones at one start than at another."""
    count = max(len(here.begin), len(there.begin))
    # each has a power of two of equal pieces in each step
    return here.cut(count // len(here.begin)), there.cut(count // len(there.begin))


def _seen(
    here: Lines, there: Lines, wanted: ApartConstraint, during: Sequence[int]
) -> Iterator[tuple[float, int, int, float]]:
    """The closest of members that exist at the ends of the pieces: how far, in which cells, and when."""
    ends = [(n, here.first, there.first, float(here.begin[n])) for n in during]
    ends += [(n, here.last, there.last, float(here.end[n])) for n in during[-1:]]
    for n, one, other, at in ends:
        if not wanted.begin - INSTANT <= at <= wanted.end + INSTANT:
            continue
        # distance of the middles, rounded up, and what members move within the rounding of the instant
        away = np.linalg.norm(one[n][:, None] - other[n], axis=-1) * (1 + 1e-12)
        moved = sum(np.abs(lines.last[n] - lines.first[n]).max() for lines in (here, there))
        away += here.real[n][:, None] + there.real[n] + 2 * INSTANT * moved / (here.end[n] - here.begin[n])
        i, j = np.unravel_index(int(away.argmin()), away.shape)
        yield float(away[i, j]), int(i), int(j), at


def _least(here: Lines, there: Lines, n: int) -> float:
    """The least distance of two members during a piece, over all pairs of cells, rounded down."""
    # difference of the points at both ends, for every pair of cells
    a = here.first[n][:, None] - there.first[n]
    b = here.last[n][:, None] - there.last[n]
    way = b - a
    long = (way**2).sum(axis=-1)
    # the share at which |a + s way| is least; any share in [0, 1] that is near it costs little, see `spare`
    share = np.clip(-(a * way).sum(axis=-1) / np.where(long > 0, long, 1.0), 0.0, 1.0)
    nearest = np.linalg.norm(a + share[..., None] * way, axis=-1)
    # the share is rounded: the least is lower by at most the way times its rounding, and the sums' own roundings
    size = np.abs(here.first[n]).max() + np.abs(there.first[n]).max() + np.abs(way).max(initial=0.0)
    spare = 1e-9 * np.sqrt(long) + 64 * UNIT * size
    found = nearest * (1 - 1e-12) - here.radius[n][:, None] - there.radius[n] - spare
    return float(lowered(found).min())


def _enclosed(problem: Problem, controls: Floats, distributions: Mapping[str, Distribution]) -> Enclosed:
    """The lines of one start's members, by the enclosure of its system."""
    if problem.fleet.enclosure == "arcs":
        return _of_arcs(Flow.of(problem, controls, distributions), problem.duration)
    from ensemble_ctrl.certificate.general.lines import of_states

    return of_states(problem, controls, distributions)


def _of_arcs(whole: Flow, duration: float) -> Enclosed:
    """Of robots on arcs: chords of the cells' middles, and all that leaves them (`enclosure`)."""

    def lines(each: int, cut: int) -> Lines:
        steps = whole.steps
        flow = whole if cut == 1 else whole.on(Mesh.of(duration, steps, range(steps * cut + 1), cut))
        centres, half = first_cells(flow.lower, flow.upper, each)
        # members at the corners of the ranges, as cells without a width: the closest pair is often one of them
        corners = np.where(signs_of(len(flow.lower)) > 0, flow.upper, flow.lower)
        centres, half = np.concatenate([centres, corners]), np.concatenate([half, np.zeros_like(corners)])
        track, n = Track.of(flow, centres), np.arange(flow.steps)
        # linear part of the cell at both ends of a step: sum_k half_k |dp/dq_k|
        arms = (half[:, None, :] * np.linalg.norm(track.slope, axis=-1)).sum(axis=-1)
        shape = (len(centres), flow.steps)
        coeffs = np.broadcast_to(flow.coefficients(centres)[:, None], (*shape, 5))
        halves = np.broadcast_to(half[:, None], (*shape, half.shape[1]))
        bent = flow.growth(n, np.broadcast_to(flow.step, shape), coeffs, halves)
        rounding = 2 * flow.rounding()
        radius = np.maximum(arms[:, :-1], arms[:, 1:]) * (1 + 1e-12) + flow.remainder_at(halves, n + 1) + bent
        points = track.position.swapaxes(0, 1)
        real = np.full(radius.T.shape, rounding)
        return Lines(points[:-1], points[1:], radius.T + rounding, real, centres, flow.begin, flow.begin + flow.step)

    return lines
