"""The paper's own constraints on moments: polyhedra for every order, and big-M obstacles with a smooth OR.

*Guarantee*: **necessary, not sufficient**.  Every fleet whose members all keep the constraint satisfies these rows, but
these rows let members break it: for obstacles only the rows of order 0 ever bind, so in effect the *mean* robot avoids.
"""

from __future__ import annotations

from collections import defaultdict

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.constraints.stl import Always, Inside
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.parametrisation import Parametrisation
from ensemble_ctrl.ocp.program import Block, Build
from ensemble_ctrl.ocp.task import SHARPNESS
from ensemble_ctrl.ocp.truncation import Truncation
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BIG_M = 20.0
"""The paper's M, metres, for maps of up to a quarter of that; larger maps use four times their size."""
ROUNDING = 1e-12
"""Entries of a matrix to moments below which they are zero."""


@dataclass(frozen=True, eq=False)
class Read:
    """Where the moments of positions are read from: a parametrisation's variables.

    Attributes
    ----------
    at : ndarray of int, shape (steps + 1, d * count)
        Indices of the variables of the position's coordinates, one after the other.
    to_moments : ndarray, shape (moments, count)
        From the variables of a coordinate to its moments.
    mean : ndarray, shape (count,)
        From the same to its mean.
    """

    at: Ints
    to_moments: Floats
    mean: Floats

    @classmethod
    def of(cls, truncation: Truncation, model: Parametrisation) -> Read:
        """Of a parametrisation, whose variables are the points or are mapped to them."""
        layout = model.layout
        places = np.eye(layout.count) if model.places is None else model.places
        # moments that are variables themselves are read as they are, without the rounding of a product
        image = truncation.to_moments @ places
        to_moments = np.where(np.abs(image) < ROUNDING, 0.0, image)
        return cls(layout.points[:, model.position_columns], to_moments, truncation.mean @ places)

    @property
    def count(self) -> int:
        """Variables of one coordinate."""
        return len(self.mean)

    @property
    def steps(self) -> int:
        """Control steps."""
        return len(self.at) - 1

    def coordinates(self, z: ca.SX) -> ca.SX:
        """The variables of each coordinate as a column, from those at one time, shape (count, d)."""
        return ca.reshape(z, self.count, z.numel() // self.count)


def moment_blocks(problem: Problem, truncation: Truncation, read: Read, spare: float = 0.0) -> list[Block]:
    """Rows for everything that must hold all the time: obstacles to avoid, with metres to spare, and regions."""
    return [
        *_free_side_blocks(problem, read, problem.solve.margin + spare),
        *_obstacle_moment_blocks(problem, truncation, read),
        *region_blocks(problem, truncation, read),
    ]


def _free_side_blocks(problem: Problem, read: Read, margin: float) -> list[Block]:
    """``eq:setPolyObsArr`` at order 0: the mean is on the free side of some facet, by a smooth OR."""
    mean = ca.DM(read.mean).T
    by_facets: dict[int, list[tuple[int, Floats, Floats]]] = defaultdict(list)
    for avoid in problem.specification.avoid:
        times = _times(avoid.steps(read.steps, problem.duration))
        for piece in avoid.pieces:
            G, h = piece.unit_rows()
            # facets relative to where the obstacle is: n . p >= h + radius + n . c(t_k)
            moved = avoid.offsets(times * problem.duration / read.steps)
            pairs = zip(times.tolist(), moved @ G.T, strict=True)
            by_facets[len(h)] += [(k, G, h + avoid.radius + drift) for k, drift in pairs]

    def build(facets: int) -> Build:
        def rows(z: ca.SX, d: ca.SX) -> ca.SX:
            place = ca.mtimes(mean, read.coordinates(z))
            # log-sum-exp of the facets' clearances, less log(n) / K: never above the largest
            clearance = ca.mtimes(ca.reshape(d[:-facets], facets, place.numel()), place.T) - d[-facets:]
            largest: ca.SX = ca.logsumexp(SHARPNESS * clearance) / SHARPNESS
            return largest - float(np.log(facets)) / SHARPNESS

        return rows

    return [
        Block(
            "avoiding (mean)",
            build(facets),
            read.at[[k for k, _, _ in entries]],
            np.array([np.concatenate([*G.T, h]) for _, G, h in entries]),
            np.full((len(entries), 1), margin),
            np.full((len(entries), 1), np.inf),
        )
        for facets, entries in sorted(by_facets.items())
    ]


def _obstacle_moment_blocks(problem: Problem, truncation: Truncation, read: Read) -> list[Block]:
    """``eq:setPolyObsArr`` at orders 1..N; of parallel facets only the tightest row is kept, for the others follow."""
    rows: dict[tuple[float, ...], float] = {}
    big = big_m(problem)
    for avoid in problem.specification.avoid:
        for k in _times(avoid.steps(read.steps, problem.duration)).tolist():
            for piece in avoid.pieces:
                normals, levels = piece.unit_rows()
                # |m_k along n| <= (2 M - h) m_k^+ for k = 1..N: the tightest of facets with the same line and time
                moved = levels + normals @ avoid.offsets(np.array([k * problem.duration / read.steps]))[0]
                for normal, h in zip(normals, moved, strict=True):
                    sign = 1.0 if tuple(normal) > (0.0,) * len(normal) else -1.0
                    key = (k, *(round(sign * float(entry), 12) for entry in normal))
                    rows[key] = min(rows.get(key, np.inf), 2 * big - float(h))
    if not rows or truncation.basis.count == 1:
        return []
    at = np.array([k for k, *_ in rows])
    data = np.array([normal for _, *normal in rows])
    positive, _ = truncation.basis.signed_moments()
    high = np.outer(list(rows.values()), positive[1:])
    build = _moments_along(read, 1)
    return [Block("avoiding (moments)", build, read.at[at], data, -high, high)]


def region_blocks(problem: Problem, truncation: Truncation, read: Read) -> list[Block]:
    """``eq:polyhedron_moment`` for every ``G[a,b] in(region)``, all orders and all faces."""
    blocks = []
    for part in problem.specification.parts:
        if isinstance(part.written, Always) and isinstance(part.written.child, Inside):
            grid = np.linspace(0.0, problem.duration, read.steps + 1)
            # grid times of the window, but for the start
            inside = (grid >= part.begin - 1e-9) & (grid <= part.end + 1e-9)
            times = np.flatnonzero(inside & (grid > 0))
            blocks.append(_region_block(problem.regions[part.written.child.name], times, truncation, read))
    return blocks


def _region_block(region: Polyhedron, times: Ints, truncation: Truncation, read: Read) -> Block:
    """The moment rows of one region at the given grid times, one of two sides for each line along its faces."""
    # b m_k^+ - c m_k^- <= m_k <= c m_k^+ - b m_k^- for b <= a . p <= c (docs/method.md)
    region = region.two_sided()
    lower, upper = region.moment_bounds(truncation.basis)
    # an instance for each time and face: a . p on all points, its moments between their bounds
    pairs = [(k, face) for k in times.tolist() for face in range(len(region.A))]
    at, face = (np.array(part) for part in zip(*pairs, strict=True))
    build = _moments_along(read, 0)
    return Block("staying in (moments)", build, read.at[at], region.A[face], lower.T[face], upper.T[face])


def _moments_along(read: Read, first: int) -> Build:
    """The moments ``first..N`` of the position along a direction `d`."""
    image = ca.sparsify(ca.DM(read.to_moments[first:]))

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        moments: ca.SX = ca.mtimes([image, read.coordinates(z), d])
        return moments

    return build


def _times(steps: NDArray[np.bool_]) -> Ints:
    """Grid times at both ends of the active steps, without the start, which nothing can change."""
    ends = np.zeros(len(steps) + 1, dtype=bool)
    ends[:-1] |= steps
    ends[1:] |= steps
    return np.flatnonzero(ends[1:]) + 1


def big_m(problem: Problem) -> float:
    """An M that no position or facet offset on the map exceeds: start, target, regions, obstacles along their way."""
    times = np.linspace(0.0, problem.duration, problem.steps + 1)
    corners = [problem.fleet.start_place + problem.fleet.shift, problem.fleet.start_place - problem.fleet.shift]
    corners = [corner[None] for corner in corners]
    corners += [] if problem.objective.place is None else [problem.objective.place[None]]
    corners += [
        (piece.vertices[:, None] + avoid.offsets(times)).reshape(-1, piece.A.shape[1])
        for avoid in problem.specification.avoid
        for piece in avoid.pieces
    ]
    corners += [r.vertices for r in problem.regions.values() if r.is_bounded and not r.is_empty]
    return max(BIG_M, 4 * float(np.abs(np.concatenate(corners)).max()))
