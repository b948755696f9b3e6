r"""Facets by a mixed-integer linear program: the mean robot as a point with a largest speed, solved by HiGHS.

::

    minimise    sum_n length_n + sum_n |p_(n+1) - 2 p_n + p_(n-1)| + w_T |p_N - target|
    over        p_n              where the point is at the times of a coarse grid
                z_fn in {0, 1}   whether the facet f keeps the point out during step n
                w_n in {0, 1}    whether it is in a way-point at time n

    subject to  u_k . (p_(n+1) - p_n) <= length_n <= V dt cos(pi / 8)         eight directions u_k
                a_f p_n <= b_f - room + M_f (1 - z_fn)                        at both ends of step n
                sum_f z_fn >= 1 for every piece and step,  sum_n w_n >= 1 for every way-point

Headings, the fleet's spread and the cost's squares are left out, so nothing here is a bound on the problem itself; but
unlike a nonlinear program it compares all ways around the obstacles.

*Guarantee*: of this linear model alone: `bound` is below the cost of every point path, and the path keeps out of every
obstacle along the straight lines between grid times, for one facet holds at both of their ends.
"""

from __future__ import annotations

import time
from dataclasses import field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import Always, Eventually, Inside
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.facet_binaries import Facets, facets, workspace
from ensemble_ctrl.ocp.quiet import quietly
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STEPS = 16
"""Steps of the coarse grid, or a multiple of it where a window is shorter than two of them."""
ROOM = 0.1
"""Metres to keep from obstacles and from the sides of way-points, for the spread of the fleet."""
SPEED = 0.9
"""Share of the top speed of the slowest member that the point uses."""
TERMINAL = 10.0
"""Weight of a metre between the end and the target."""
GAP = 0.05
"""Relative gap at which the search ends."""
NODES = 500
"""Of its branching tree, at most: unlike seconds, nodes give the same facets on a busy machine as on an idle one."""
DIRECTIONS = np.array([[np.cos(k * np.pi / 4), np.sin(k * np.pi / 4)] for k in range(8)])


@dataclass(frozen=True, eq=False)
class LinearPlan:
    """What the linear program found.

    Attributes
    ----------
    path : ndarray, shape (steps + 1, 2)
        Metres; empty if it found nothing.
    chosen : ndarray of bool, shape (facets, steps)
        One facet for each active piece and step, in the order of `facet_binaries.facets`.
    sides : Facets
        These facets.
    cost, bound : float
        Of the linear model; infinite without a solution.
    message : str
        HiGHS's own word.
    seconds : float
    """

    path: Floats
    chosen: NDArray[np.bool_]
    sides: Facets
    cost: float
    bound: float
    message: str
    seconds: float

    @property
    def found(self) -> bool:
        """Whether there is a path."""
        return len(self.path) > 0

    def fine(self, steps: int) -> Floats:
        """The path on a finer grid, shape (steps + 1, 2)."""
        own, wanted = (np.linspace(0.0, 1.0, n + 1) for n in (len(self.path) - 1, steps))
        return np.column_stack([np.interp(wanted, own, column) for column in self.path.T])

    def of_piece(self, piece: int, times: Ints, steps: int) -> Floats:
        """Binaries of one piece at grid times of a finer grid, shape (times, facets of the piece)."""
        rows = self.chosen[self.sides.piece == piece]
        coarse = np.minimum(times * rows.shape[1] // steps, rows.shape[1] - 1)
        return np.asarray(rows[:, coarse].T, dtype=np.float64)


@dataclass(eq=False)
class _Model:
    """A linear program that grows: columns with bounds and costs, and sparse rows."""

    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    whole: list[int] = field(default_factory=list)
    entries: list[tuple[int, int, float]] = field(default_factory=list)
    most: list[float] = field(default_factory=list)

    def columns(self, lower: Floats, upper: Floats, cost: float = 0.0, whole: int = 0) -> Ints:
        """New variables, in the shape of their bounds."""
        first, count = len(self.costs), lower.size
        self.lower += lower.ravel().tolist()
        self.upper += upper.ravel().tolist()
        self.costs += [cost] * count
        self.whole += [whole] * count
        return first + np.arange(count).reshape(lower.shape)

    def at_most(self, columns: list[int], values: list[float], most: float) -> None:
        """A row ``values . x[columns] <= most``."""
        row = len(self.most)
        self.entries += [(row, c, v) for c, v in zip(columns, values, strict=True)]
        self.most.append(most)


def linear_facets(problem: Problem, time_limit: float) -> LinearPlan:
    """Choose a facet of every obstacle and step by a mixed-integer linear program.

    Parameters
    ----------
    problem : Problem
        Robots on arcs, obstacles that stand still.
    time_limit : float
        Seconds for HiGHS, which ends earlier at `GAP` or after `NODES` nodes.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import csr_array

    began, steps = time.perf_counter(), _steps(problem)
    sides, model = facets(problem, steps), _Model()
    place = _moving(problem, model, steps)
    z = _keeping_out(problem, model, sides, place)
    _visiting(problem, model, place)
    rows, columns, values = (np.array(part) for part in zip(*model.entries, strict=True))
    matrix = csr_array((values, (rows, columns)), shape=(len(model.most), len(model.costs)))
    with quietly():
        found = milp(
            np.array(model.costs),
            integrality=np.array(model.whole),
            bounds=Bounds(np.array(model.lower), np.array(model.upper)),
            constraints=LinearConstraint(matrix, -np.inf, np.array(model.most)),
            options={"time_limit": time_limit, "node_limit": NODES, "mip_rel_gap": GAP},
        )
    seconds, none = time.perf_counter() - began, np.zeros((0, 2))
    if found.x is None:
        return LinearPlan(none, z >= 0, sides, np.inf, -np.inf, str(found.message), seconds)
    path, bound = found.x[place], found.mip_dual_bound
    chosen = _best(sides, path, np.where(z >= 0, found.x[z], 0.0) > 0.5)
    return LinearPlan(path, chosen, sides, float(found.fun), float(bound), str(found.message), seconds)


def _steps(problem: Problem) -> int:
    """Of the coarse grid: at least one time of it is in every window."""
    windows = [part.end - part.begin for part in problem.specification.parts if isinstance(part.written, Eventually)]
    shortest = min(windows, default=problem.duration)
    return STEPS * max(1, int(np.ceil(problem.duration / STEPS / max(shortest, problem.step))))


def _moving(problem: Problem, model: _Model, steps: int) -> Ints:
    """Positions with their lengths, bends and the end; indices of shape (steps + 1, 2)."""
    fleet, start = problem.fleet, problem.fleet.start_place
    where = workspace(problem, np.tile(start, (steps + 1, 1, 1)))
    place = model.columns(where.low, where.high)
    top = float(np.abs([fleet.input_lower[0], fleet.input_upper[0]]).max()) * fleet.slowest
    most = SPEED * top * problem.duration / steps * np.cos(np.pi / 8)
    length = model.columns(np.zeros(steps), np.full(steps, most), cost=1.0)
    bend = model.columns(np.zeros((steps - 1, 2)), np.full((steps - 1, 2), np.inf), cost=1.0)
    for n, (here, there) in enumerate(pairwise(place.tolist())):
        for ux, uy in DIRECTIONS.tolist():
            # u . (p_(n+1) - p_n) - length_n <= 0
            model.at_most([*there, *here, int(length[n])], [ux, uy, -ux, -uy, -1.0], 0.0)
    for n, axis in np.ndindex(bend.shape):
        triple = [int(place[n + k, axis]) for k in range(3)]
        for sign in (1.0, -1.0):
            model.at_most([*triple, int(bend[n, axis])], [sign, -2 * sign, sign, -1.0], 0.0)
    _ending(problem, model, place[-1].tolist())
    return place


def _ending(problem: Problem, model: _Model, last: list[int]) -> None:
    """The distance of the end from the target, coordinate by coordinate."""
    if problem.objective.place is None:
        return
    off = model.columns(np.zeros(2), np.full(2, np.inf), cost=TERMINAL)
    for column, distance, wanted in zip(last, off.tolist(), problem.objective.place.tolist(), strict=True):
        for sign in (1.0, -1.0):
            model.at_most([column, distance], [sign, -1.0], sign * wanted)


def _keeping_out(problem: Problem, model: _Model, sides: Facets, place: Ints) -> Ints:
    """A binary for each facet and active step, shape (facets, steps); -1 where there is none."""
    z = np.full(sides.active.shape, -1, dtype=np.int64)
    count = int(sides.active.sum())
    z[sides.active] = model.columns(np.zeros(count), np.ones(count), whole=1)
    room = problem.solve.margin + ROOM
    for f, n in np.argwhere(sides.active).tolist():
        (ax, ay), level = sides.normal[f].tolist(), float(sides.offset[f]) + room
        for at in place[n : n + 2].tolist():
            # n . p >= level - M (1 - z), the least n . p over the bounds of p giving M
            short = max(0.0, level - _least(model, at, (ax, ay)))
            model.at_most([*at, int(z[f, n])], [-ax, -ay, short], short - level)
    for piece in range(sides.pieces):
        own = z[sides.piece == piece]
        for n in np.flatnonzero((own >= 0).all(axis=0)).tolist():
            model.at_most(own[:, n].tolist(), [-1.0] * len(own), -1.0)
    return z


def _least(model: _Model, at: list[int], normal: tuple[float, float]) -> float:
    """The smallest ``normal . p`` within the bounds of a position."""
    return sum(min(c * model.lower[i], c * model.upper[i]) for c, i in zip(normal, at, strict=True))


def _visiting(problem: Problem, model: _Model, place: Ints) -> None:
    """In a region at some time of a window, or at all of them."""
    grid = np.linspace(0.0, problem.duration, len(place))
    for part in problem.specification.parts:
        if not (isinstance(part.written, Always | Eventually) and isinstance(part.written.child, Inside)):
            continue
        G, h = problem.regions[part.written.child.name].unit_rows()
        times = np.flatnonzero((grid >= part.begin - 1e-9) & (grid <= part.end + 1e-9) & (grid > 0)).tolist()
        w = model.columns(np.zeros(len(times)), np.ones(len(times)), whole=1).tolist()
        for on, n in zip(w, times, strict=True):
            for (gx, gy), level in zip((-G).tolist(), (ROOM - h).tolist(), strict=True):
                at = place[n].tolist()
                short = max(0.0, level - _least(model, at, (gx, gy)))
                model.at_most([*at, on], [-gx, -gy, short], short - level)
        wanted = len(times) if isinstance(part.written, Always) else 1
        model.at_most(w, [-1.0] * len(w), -float(wanted))


def _best(sides: Facets, path: Floats, allowed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Of the allowed facets of each piece and step the one that the path is furthest behind."""
    gaps = np.where(allowed, sides.gaps(path[:, None]), -np.inf)
    best = np.zeros_like(allowed)
    for piece in range(sides.pieces):
        own = np.flatnonzero(sides.piece == piece)
        best[own[gaps[own].argmax(axis=0)], np.arange(allowed.shape[1])] = True
    return best & allowed


__all__ = ["LinearPlan", "linear_facets"]
