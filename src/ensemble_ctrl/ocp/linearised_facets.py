r"""Facets for any system by a mixed-integer linear program around a plan, solved by HiGHS.

The states of the node robots are linear in small changes of the commands, which are constant over blocks of steps: with
changes :math:`s_b` in half widths of the commands' bounds, :math:`X_{jk} \approx X^0_{jk} + \sum_b S_{jkb} s_b`::

    minimise    effort sum_b |u_b - rest| + terminal |p_K - target| + weight sum(short)
    over        s_b in the bounds of the commands, |s_b| <= trust
                z_fk in {0, 1}   whether the facet f keeps all points out from grid time k to the next
                w_k in {0, 1}    whether all points are in a region at grid time k

    subject to  n_f . P_ik + short + M_fk (1 - z_fk) >= level_fk      every point i, both ends of step k
                sum_f z_fk >= 1 for every piece and step,  sum_k w_k >= 1 for every region to be visited
                states within what the task requires of them all the time

For linear systems the states are exact, so that with ``trust = 2`` all ways around the obstacles are compared; for
others it is a neighbourhood of the plan.  The squares of the cost and other parts of the task are left out.

*Guarantee*: none; what is found is where the nonlinear program starts again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.constraints.stl import Always, And, Eventually, Formula, Inside, Predicate
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.quiet import quietly
from ensemble_ctrl.ocp.states import scale_of
from ensemble_ctrl.ocp.truncation import Truncation
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.integrated import needed
from ensemble_ctrl.systems.integration import rk4

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BLOCKS = 16
"""Blocks of steps, about."""
ROOM = 0.02
"""Metres to keep beyond the margin, for what happens between grid times."""
SHORT = 1e3
"""Weight of a metre by which a row falls short."""
GAP = 0.02
"""Relative gap at which the search ends."""
CHANGE = 1e-4
"""Change of a scaled command for a slope."""


@dataclass(frozen=True, eq=False)
class Chosen:
    """What the program found.

    Attributes
    ----------
    controls : ndarray, shape (steps, n_u)
        Empty if it found nothing.
    binaries : int
    message : str
        HiGHS's own word.
    cost, bound : float
        Of the linear model; infinite without a solution.
    short : float
        Metres, or a unit of the task, by which it falls short of the rows.
    """

    controls: Floats
    binaries: int
    message: str
    cost: float = np.inf
    bound: float = -np.inf
    short: float = np.inf


@dataclass(eq=False)
class _Rows:
    """Sparse rows ``low <= values . x[columns]``, and how many binaries there are besides the other variables."""

    count: int
    entries: list[tuple[int, int, float]] = field(default_factory=list)
    low: list[float] = field(default_factory=list)
    binaries: int = 0

    def binary(self) -> int:
        """The column of a new one."""
        self.binaries += 1
        return self.count + self.binaries - 1

    def at_least(self, columns: list[int], values: list[float], low: float) -> None:
        """One more row."""
        self.entries += [(len(self.low), c, v) for c, v in zip(columns, values, strict=True)]
        self.low.append(low)


@dataclass(frozen=True, eq=False)
class _Linear:
    """The points of the fleet around a plan: `middle`, shape (times, points, n_x), and `slopes`, with (changes,)."""

    problem: Problem
    edges: Ints
    middle: Floats
    slopes: Floats
    low: Floats
    high: Floats

    @property
    def times(self) -> Floats:
        """Of the grid, seconds."""
        return np.asarray(self.edges * self.problem.step)

    def least(self, row: Floats, at: int) -> Floats:
        """The smallest ``row . x`` of each point that changes within their bounds bring about, shape (points,)."""
        slope = np.einsum("x,pxb->pb", row, self.slopes[at])
        return np.asarray(self.middle[at] @ row + np.minimum(slope * self.low, slope * self.high).sum(axis=1))

    def held(self, rows: Floats, at: int, needed: Floats) -> NDArray[np.bool_]:
        """Whether ``row . x >= needed`` whatever changes, for all points, shape (rows,)."""
        least = np.array([self.least(row, at).min() for row in rows])
        return np.asarray(least >= needed)


def linearised_facets(
    problem: Problem, truncation: Truncation, controls: Floats, trust: float, time_limit: float
) -> Chosen:
    """Choose a facet of every obstacle and block, and when to be where, around a plan.

    Parameters
    ----------
    problem : Problem
    truncation : Truncation
        Whose points have to keep out.
    controls : ndarray, shape (steps, n_u)
        The plan.
    trust : float
        Largest change of a command, in half widths of its bounds; 2 is no limit.
    time_limit : float
        Seconds for HiGHS.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import csr_array

    linear = _linear(problem, truncation, controls, trust)
    changes = len(linear.low)
    # variables: changes, their sizes from rest, distances of the end from the target, one slack, then binaries
    sizes = changes + np.arange(changes)
    off = 2 * changes + np.arange(len(problem.fleet.places))
    short = 2 * changes + len(off)
    rows = _Rows(short + 1)
    _effort(problem, linear, controls, rows, sizes)
    _ending(problem, linear, truncation, rows, off)
    _keep_out(problem, linear, rows, short)
    for part in problem.specification.parts:
        _require(problem, linear, rows, part.written, part.begin, part.end, short)
    total = rows.count + rows.binaries
    lower, upper = np.zeros(total), np.full(total, np.inf)
    lower[:changes], upper[:changes] = linear.low, linear.high
    upper[rows.count :] = 1.0
    aim, cost = problem.objective, np.zeros(total)
    cost[sizes] = float(np.mean(aim.effort)) * problem.duration / max(len(linear.edges) - 1, 1)
    cost[off], cost[short] = aim.terminal, SHORT
    index = np.array(rows.entries)
    matrix = csr_array((index[:, 2], (index[:, 0].astype(int), index[:, 1].astype(int))), shape=(len(rows.low), total))
    with quietly():
        found = milp(
            cost,
            integrality=(np.arange(total) >= rows.count).astype(np.int64),
            bounds=Bounds(lower, upper),
            constraints=LinearConstraint(matrix, np.array(rows.low), np.inf),
            options={"time_limit": max(time_limit, 0.1), "mip_rel_gap": GAP},
        )
    if found.x is None:
        return Chosen(np.zeros((0, controls.shape[1])), rows.binaries, str(found.message))
    moved = controls + _spread(linear.edges, found.x[:changes], controls.shape[1]) * scale_of(problem).half
    clipped = np.clip(moved, problem.fleet.input_lower, problem.fleet.input_upper)
    bound = -np.inf if found.mip_dual_bound is None else float(found.mip_dual_bound)
    return Chosen(clipped, rows.binaries, str(found.message), float(found.fun), bound, float(found.x[short]))


def _linear(problem: Problem, truncation: Truncation, controls: Floats, trust: float) -> _Linear:
    """Points under the plan, and their slopes by differences."""
    fleet, steps, n_u = problem.fleet, len(controls), controls.shape[1]
    edges = np.unique(np.linspace(0, steps, min(BLOCKS, steps) + 1).round().astype(np.int64))
    members, scale = fleet.dynamic_members(truncation.nodes), scale_of(problem)
    substeps = min(8, max(1, needed(fleet, controls, problem.step, 1e-5, rk4)))

    def points(commands: Floats) -> Floats:
        states = fleet.integrated(commands, members, problem.step, substeps, rk4)[:, edges]
        return np.asarray(np.einsum("pj,jkx->kpx", truncation.to_points, states))

    middle = points(controls)
    changes = n_u * (len(edges) - 1)
    slopes = np.empty((*middle.shape, changes))
    for b in range(changes):
        # dX / ds_b by central differences, exact for linear systems
        off = _spread(edges, CHANGE * np.eye(changes)[b], n_u) * scale.half
        slopes[..., b] = (points(controls + off) - points(controls - off)) / (2 * CHANGE)
    scaled = scale.scaled(controls)
    # a block's change keeps all of its steps within the bounds
    low = np.array([-1.0 - scaled[a:b].min(axis=0) for a, b in pairwise(edges)]).ravel()
    high = np.array([1.0 - scaled[a:b].max(axis=0) for a, b in pairwise(edges)]).ravel()
    return _Linear(problem, edges, middle, slopes, np.minimum(np.maximum(low, -trust), 0.0),
                   np.maximum(np.minimum(high, trust), 0.0))  # fmt: skip


def _spread(edges: Ints, changes: Floats, n_u: int) -> Floats:
    """Changes of blocks as changes of steps, shape (steps, n_u)."""
    return np.repeat(changes.reshape(-1, n_u), np.diff(edges), axis=0)


def _effort(problem: Problem, linear: _Linear, controls: Floats, rows: _Rows, sizes: Ints) -> None:
    """The size of each block's mean command from rest."""
    scale, n_u = scale_of(problem), controls.shape[1]
    away = (scale.scaled(controls) - scale.rest).reshape(len(controls), n_u)
    mean = np.array([away[a:b].mean(axis=0) for a, b in pairwise(linear.edges)]).ravel()
    for b, (size, value) in enumerate(zip(sizes.tolist(), mean.tolist(), strict=True)):
        for sign in (1.0, -1.0):
            # size >= |mean + s_b|
            rows.at_least([size, b], [1.0, -sign], sign * value)


def _ending(problem: Problem, linear: _Linear, truncation: Truncation, rows: _Rows, off: Ints) -> None:
    """The distance of the mean's end from the target, coordinate by coordinate."""
    if problem.objective.place is None:
        return
    columns = problem.fleet.place_columns
    end = np.einsum("p,px->x", truncation.mean, linear.middle[-1])[columns]
    slope = np.einsum("p,pxb->xb", truncation.mean, linear.slopes[-1])[columns]
    every = list(range(len(linear.low)))
    for distance, here, by, wanted in zip(off.tolist(), end, slope, problem.objective.place.tolist(), strict=True):
        for sign in (1.0, -1.0):
            rows.at_least([distance, *every], [1.0, *(-sign * by)], float(sign * (here - wanted)))


def _keep_out(problem: Problem, linear: _Linear, rows: _Rows, short: int) -> None:
    """A facet of every piece for every step in which it is to be kept out of."""
    columns, keep = problem.fleet.place_columns, problem.solve.margin + ROOM
    for avoid in problem.specification.avoid:
        drift = avoid.offsets(linear.times)
        for piece in avoid.pieces:
            normals, levels = piece.unit_rows()
            kept = np.zeros((len(levels), linear.middle.shape[2]))
            kept[:, columns] = normals
            for k, (begin, end) in enumerate(pairwise(linear.times)):
                ends = (k, k + 1) if k else (1,)
                needed = [levels + avoid.radius + keep + normals @ drift[at] for at in ends]
                held = [linear.held(kept, at, need) for at, need in zip(ends, needed, strict=True)]
                # no row where it is not required, or where some facet holds whatever changes
                if begin > avoid.end or end < avoid.begin or np.all(held, axis=0).any():
                    continue
                chosen = [rows.binary() for _ in levels]
                for at, need in zip(ends, needed, strict=True):
                    for row, level, z in zip(kept, need.tolist(), chosen, strict=True):
                        _all_points(linear, rows, row, at, level, z, short)
                rows.at_least(chosen, [1.0] * len(chosen), 1.0)


def _all_points(linear: _Linear, rows: _Rows, row: Floats, at: int, needed: float, on: int, short: int) -> None:
    """``row . x >= needed`` for all points at a grid time where the binary `on` is 1; always if it is -1."""
    every = list(range(len(linear.low)))
    values, slopes = linear.middle[at] @ row, np.einsum("x,pxb->pb", row, linear.slopes[at])
    for value, slope, least in zip(values.tolist(), slopes, linear.least(row, at).tolist(), strict=True):
        if least >= needed:
            continue
        if on < 0:
            rows.at_least([*every, short], [*slope, 1.0], needed - value)
        else:
            # M = needed - least: the most by which the row falls short
            big = needed - least
            rows.at_least([*every, short, on], [*slope, 1.0, -big], needed - value - big)


def _require(
    problem: Problem, linear: _Linear, rows: _Rows, formula: Formula, begin: float, end: float, short: int
) -> None:
    """What the task requires of all states of a window, or of one of its times; other operators are left out."""
    times = np.flatnonzero((linear.times >= begin - 1e-9) & (linear.times <= end + 1e-9) & (linear.times > 0)).tolist()
    if isinstance(formula, Always):
        for needs in _conjunction(problem, formula.child):
            for at in times:
                _all_points(linear, rows, needs[0], at, needs[1], -1, short)
    elif isinstance(formula, Eventually) and times:
        needs_all, chosen = list(_conjunction(problem, formula.child)), []
        for at in times:
            w = rows.binary()
            chosen.append(w)
            for row, needed in needs_all:
                _all_points(linear, rows, row, at, needed, w, short)
        rows.at_least(chosen, [1.0] * len(chosen), 1.0)


def _conjunction(problem: Problem, formula: Formula) -> Iterator[tuple[Floats, float]]:
    """Half-spaces ``row . x >= needed`` of a conjunction of regions and predicates; what is neither is left out."""
    names, places = problem.fleet.states, problem.fleet.places
    if isinstance(formula, And):
        for part in formula.parts:
            yield from _conjunction(problem, part)
    elif isinstance(formula, Inside):
        for normal, level in zip(*_inner(problem.regions[formula.name]), strict=True):
            row = np.zeros(len(names))
            row[[names.index(name) for name in places]] = normal
            yield row, float(level)
    elif isinstance(formula, Predicate):
        coefficients, offset = formula.normalised()
        row = np.array([dict(coefficients).get(name, 0.0) for name in names])
        yield row, -offset


def _inner(region: Polyhedron) -> tuple[Floats, Floats]:
    """Normals that point in, and their levels."""
    # lower <= A p <= upper as A p >= lower and -A p >= -upper, where finite
    A = np.vstack([region.A, -region.A])
    levels = np.concatenate([region.lower, -region.upper])
    kept = np.isfinite(levels)
    length = np.linalg.norm(A[kept], axis=1)
    return A[kept] / length[:, None], levels[kept] / length


__all__ = ["Chosen", "linearised_facets"]
