r"""The disjunction over facets with binaries: big-M rows, and which facets may be chosen where.

An obstacle is avoided in a step if one of its facets has the whole fleet on its free side at both ends of the step.
With a binary :math:`z_f \in \{0, 1\}` for each facet that may be chosen,

.. math:: n_f \cdot P_i + \text{slack} + M_f (1 - z_f) \ge b_f + \text{radius} + \text{margin} + \text{tail}
          + \text{sagitta} \quad \text{for every point } i, \qquad \sum_f z_f \ge 1 .

``M_f`` is the most by which the row can fall short where the fleet can be at that time (`Workspace`), so a binary at 0
takes nothing away, and no row is looser than it must be.  With the guarantee ``moment`` the rows are the paper's, on
moments (``eq:setPolyObsArr`` of Arias et al., One Ring to Rule Them All).

*Guarantee*: with ``hull``, a solution keeps every member of the truncated model out through the whole step, as with
separating hyperplanes; with ``nodes`` the Gauss-node robots at the grid times; with ``moment`` in effect the mean one.
"""

from __future__ import annotations

from collections import defaultdict

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.layout import Numbers
from ensemble_ctrl.ocp.margins import bulge, curvature, keeping, largest_bulge
from ensemble_ctrl.ocp.program import Block
from ensemble_ctrl.ocp.truncation import Truncation
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

ROOM = 0.1
"""Share of the map's size that is added around it for the fleet to use."""


@dataclass(frozen=True, eq=False)
class Facets:
    """Every facet of every convex piece to keep out of.

    Attributes
    ----------
    piece : ndarray of int, shape (facets,)
        Which piece a facet belongs to.
    normal : ndarray, shape (facets, 2)
        Unit normals, pointing out.
    offset : ndarray, shape (facets,)
        Metres; ``normal . p >= offset`` is the free side, robot's radius and the box of start positions included.
    active : ndarray of bool, shape (facets, steps)
        Whether the piece is to be kept out of during the step.
    """

    piece: Ints
    normal: Floats
    offset: Floats
    active: Bools

    @property
    def pieces(self) -> int:
        """How many convex pieces there are."""
        return int(self.piece.max(initial=-1)) + 1

    def gaps(self, curve: Floats) -> Floats:
        """Smallest ``normal . p - offset`` over the points at both ends of each step, shape (facets, steps), metres."""
        # min_i n_f . P_i - b_f at each grid time, then the smaller of both ends
        least = np.einsum("tpd,fd->ftp", curve, self.normal).min(axis=2) - self.offset[:, None]
        return np.asarray(np.minimum(least[:, :-1], least[:, 1:]))

    def of(self, per_facet: Bools) -> Bools:
        """Whether any facet of a piece is marked, shape (facets, steps) to (pieces, steps)."""
        any_of = np.zeros((self.pieces, per_facet.shape[1]), dtype=bool)
        np.logical_or.at(any_of, self.piece, per_facet)
        return any_of


@dataclass(frozen=True, eq=False)
class Workspace:
    """Where the program lets the points be: a box for every grid time.

    Attributes
    ----------
    low, high : ndarray, shape (steps + 1, 2)
        Metres.
    """

    low: Floats
    high: Floats

    def least(self, normal: Floats) -> Floats:
        """Smallest ``normal . p`` in the boxes at both ends of each step, shape (facets, steps)."""
        # the least n . p over a box: its lower side where n_i > 0, its upper side elsewhere
        at = np.where(normal[:, None, :] > 0, self.low[None], self.high[None])
        values = np.einsum("fd,ftd->ft", normal, at)
        return np.asarray(np.minimum(values[:, :-1], values[:, 1:]))

    def most(self, normal: Floats) -> Floats:
        """Largest ``normal . p`` in the boxes at both ends of each step, shape (facets, steps)."""
        return -self.least(-normal)


@dataclass(frozen=True, eq=False)
class FacetBinaries:
    """Rows to keep out, one for each facet that may be chosen in a step, and the binaries they read.

    Attributes
    ----------
    facet, step, piece : ndarray of int, shape (rows,)
        Of each row.
    big_m : ndarray, shape (rows,)
        Metres by which the row may fall short while its binary is 0.
    binary : ndarray of int, shape (rows,)
        Which binary it reads; -1 where the facet is the only choice, so that the row always holds.
    groups : tuple of tuple of int
        Binaries of which one at least is 1.
    """

    facet: Ints
    step: Ints
    piece: Ints
    big_m: Floats
    binary: Ints
    groups: tuple[tuple[int, ...], ...]

    @property
    def count(self) -> int:
        """How many binaries there are."""
        return int(self.binary.max(initial=-1)) + 1

    @property
    def pair(self) -> Ints:
        """The number of each row's pair of a piece and a step, shape (rows,)."""
        keys = self.piece * (int(self.step.max(initial=0)) + 1) + self.step
        return np.asarray(np.unique(keys, return_inverse=True)[1], dtype=np.int64)

    def setting(self, gaps: Floats) -> Floats:
        """1 exactly where a facet's rows hold, or fall short the least of their group, shape (count,)."""
        # the smallest gap over the rows that read each binary; the largest of a group is set to 1
        worst = np.full(self.count, np.inf)
        read = self.binary >= 0
        np.minimum.at(worst, self.binary[read], gaps[self.facet[read], self.step[read]])
        on = np.zeros(self.count)
        for group in self.groups:
            on[max(group, key=lambda s: worst[s])] = 1.0
        return on


@dataclass(frozen=True, eq=False)
class Choice:
    """A program's binaries with all they refer to.

    Attributes
    ----------
    sides : Facets
        All facets.
    where : Workspace
        Where the program lets the points be; what `rows.big_m` relies on.
    rows : FacetBinaries
        Rows and binaries.
    setting : ndarray, shape (binaries,)
        The binaries to start from.
    """

    sides: Facets
    where: Workspace
    rows: FacetBinaries
    setting: Floats

    @property
    def slacks(self) -> int:
        """How many slacks the rows need: one for each pair of a piece and a step."""
        return int(self.rows.pair.max(initial=-1)) + 1


def facets(problem: Problem, steps: int) -> Facets:
    """Every facet of what the task avoids, on a grid of `steps`."""
    pieces = [(piece, avoid) for avoid in problem.specification.avoid for piece in avoid.pieces]
    rows = [(*piece.unit_rows(), avoid) for piece, avoid in pieces]
    # b_f = h_f + radius + |n_f| . shift (the Minkowski sum with the box of starts)
    index = [np.full(len(h), i) for i, (_, h, _) in enumerate(rows)]
    active = [np.tile(avoid.steps(steps, problem.duration), (len(h), 1)) for _, h, avoid in rows]
    shift = np.zeros(2) if problem.solve.guarantee == "moment" else problem.fleet.shift
    return Facets(
        np.concatenate(index) if rows else np.zeros(0, np.int64),
        np.concatenate([G for G, _, _ in rows]) if rows else np.zeros((0, 2)),
        np.concatenate([h + avoid.radius + np.abs(G) @ shift for G, h, avoid in rows]) if rows else np.zeros(0),
        np.concatenate(active) if rows else np.zeros((0, steps), dtype=bool),
    )


def workspace(problem: Problem, curve: Floats) -> Workspace:
    """The map around start, obstacles, regions, target and a plan's points, as far as a member gets by each time.

    Parameters
    ----------
    problem : Problem
        Gives the map and the top speed.
    curve : ndarray, shape (steps + 1, points, 2)
        Points of a plan, metres; all of them are inside.
    """
    fleet = problem.fleet
    pieces = (piece for avoid in problem.specification.avoid for piece in avoid.pieces)
    corners = [fleet.start_place[None], curve.reshape(-1, 2), *(piece.vertices for piece in pieces)]
    corners += [r.vertices for r in problem.regions.values() if r.is_bounded and not r.is_empty]
    corners += [] if problem.objective.place is None else [problem.objective.place[None]]
    # the map and ROOM of its size, cut to start +- top speed * t
    every = np.concatenate(corners)
    low, high = every.min(axis=0), every.max(axis=0)
    spare = ROOM * float((high - low).max()) + fleet.radius + problem.solve.margin
    speed = max(abs(fleet.input_lower[0]), abs(fleet.input_upper[0])) * fleet.fastest[0]
    reach = speed * np.linspace(0.0, problem.duration, len(curve))[:, None]
    return Workspace(
        np.minimum(np.maximum(low - spare, fleet.start_place - reach), curve.min(axis=1)),
        np.maximum(np.minimum(high + spare, fleet.start_place + reach), curve.max(axis=1)),
    )


def facet_binaries(
    problem: Problem, truncation: Truncation, sides: Facets, where: Workspace, allowed: Bools, tail: float, block: int
) -> FacetBinaries:
    """The rows and binaries needed for a choice among the `allowed` facets.

    Parameters
    ----------
    problem : Problem
        Gives margins and inputs.
    truncation : Truncation
        Says whether the points are hulls, which have margins for truncation and arcs.
    sides : Facets
        All facets.
    where : Workspace
        Where the points can be.
    allowed : ndarray of bool, shape (facets, steps)
        Which facets may be chosen; at least one of each active piece and step.
    tail : float
        Truncation error in metres.
    block : int
        Steps that share their binaries where the same facets are allowed.

    Notes
    -----
    A pair of a piece and a step gets no row where a facet of the piece holds wherever the points can be; a facet that
    no point can get behind is not offered, unless no other is allowed.
    """
    # b_f + keep: what n . P has to reach; least and most of n . P in the boxes of the workspace
    keep = keeping(problem, truncation, tail) + largest_bulge(problem, truncation, allowed.shape[1])
    needed = sides.offset[:, None] + keep
    least, most = where.least(sides.normal), where.most(sides.normal)
    # pairs that a row is needed for: no facet of the piece holds in all of the workspace
    touched = ~sides.of(least >= needed)[sides.piece] & sides.active
    offered = allowed & touched
    reachable = offered & (most >= sides.offset[:, None])
    offered = np.where(sides.of(reachable)[sides.piece], reachable, offered)
    facet, step = np.nonzero(offered)
    options = np.zeros((sides.pieces, allowed.shape[1]), dtype=np.int64)
    np.add.at(options, sides.piece, offered)
    binary, groups = _shared(sides, offered, facet, step, options, block)
    # M_f = max(b_f + keep - least, 0): what the row can fall short by
    big_m = np.maximum(needed - least, 0.0)
    if problem.solve.guarantee == "moment":  # the paper's M is also above |a x|
        big_m = np.maximum.reduce([big_m, where.most(sides.normal), where.most(-sides.normal)])
    return FacetBinaries(facet, step, sides.piece[facet], big_m[facet, step], binary, groups)


def binary_blocks(
    problem: Problem, truncation: Truncation, layout: Numbers, choice: Choice, slack: Ints, tail: float
) -> list[Block]:
    """The rows of a choice with a `slack` for each pair, and the rows that demand a facet of each group."""
    sides, chosen = choice.sides, choice.rows
    index = layout.binary(chosen.count)
    blocks = [_choosing(index, size, groups) for size, groups in _by_size(chosen.groups).items()]
    build = _moment_rows if problem.solve.guarantee == "moment" else _point_rows
    for read in (chosen.binary >= 0, chosen.binary < 0):
        if read.any():
            columns = [slack[chosen.pair[read], None], layout.controls[chosen.step[read]]]
            columns += [layout.points[chosen.step[read]], layout.points[chosen.step[read] + 1]]
            columns += [index[chosen.binary[read], None]] if chosen.binary[read][0] >= 0 else []
            blocks.append(build(problem, truncation, sides, chosen, read, np.hstack(columns), tail))
    return blocks


def _shared(
    sides: Facets, offered: Bools, facet: Ints, step: Ints, options: Ints, block: int
) -> tuple[Ints, tuple[tuple[int, ...], ...]]:
    """Number the binaries: steps of one block in which a piece offers the same facets share theirs."""
    binary = np.full(len(facet), -1, dtype=np.int64)
    numbers: dict[tuple[int, int, bytes], int] = {}
    groups: dict[tuple[int, int, bytes], list[int]] = defaultdict(list)
    next_one = 0
    for row, (f, k) in enumerate(zip(facet.tolist(), step.tolist(), strict=True)):
        piece = int(sides.piece[f])
        if options[piece, k] < 2:
            continue
        # a binary for each facet, block of steps and set of facets offered
        menu = offered[sides.piece == piece, k].tobytes()
        key = (f, k // block, menu)
        if key not in numbers:
            numbers[key] = next_one
            groups[piece, k // block, menu].append(next_one)
            next_one += 1
        binary[row] = numbers[key]
    return binary, tuple(tuple(group) for group in groups.values())


def _by_size(groups: tuple[tuple[int, ...], ...]) -> dict[int, list[tuple[int, ...]]]:
    """Groups with the same number of binaries together."""
    found: dict[int, list[tuple[int, ...]]] = defaultdict(list)
    for group in groups:
        found[len(group)].append(group)
    return dict(sorted(found.items()))


def _choosing(index: Ints, size: int, groups: list[tuple[int, ...]]) -> Block:
    """At least one binary of each group."""
    one = np.ones((len(groups), 1))
    columns = index[np.array(groups)]
    return Block("choosing", lambda z, d: ca.sum1(z), columns, np.zeros((len(groups), 0)), one, one + size)


def _point_rows(
    problem: Problem,
    truncation: Truncation,
    sides: Facets,
    chosen: FacetBinaries,
    read: Bools,
    columns: Ints,
    tail: float,
) -> Block:
    """The rows on points, with a binary if there is a column for it."""
    n, arc = truncation.count, curvature(problem, truncation, sides.active.shape[1])
    chosen_here = columns.shape[1] > 3 + 4 * n

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        # n_f . P - b_f - keep - bulge + slack + M_f (1 - z_f) >= 0 at both ends of the step
        ends = [d[0] * p[:n] + d[1] * p[n:] for p in (z[3 : 3 + 2 * n], z[3 + 2 * n : 3 + 4 * n])]
        off = d[3] * (1 - z[3 + 4 * n]) if chosen_here else 0.0
        rows: ca.SX = ca.vertcat(*ends) - d[2] - bulge(problem, arc, z[1], z[2]) + z[0] + off
        return rows

    facet = chosen.facet[read]
    offset = sides.offset[facet] + keeping(problem, truncation, tail)
    data = np.column_stack([sides.normal[facet], offset, chosen.big_m[read]])
    low = np.zeros((len(facet), 2 * n))
    return Block("avoiding", build, columns, data, low, low + np.inf)


def _moment_rows(
    problem: Problem,
    truncation: Truncation,
    sides: Facets,
    chosen: FacetBinaries,
    read: Bools,
    columns: Ints,
    tail: float,
) -> Block:
    """The paper's rows on the moments of every order, at both ends of the step; without a binary, with z = 1."""
    n, image = truncation.count, ca.DM(truncation.to_moments)
    # m_k^+ and m_k^-; m_k^+ - m_k^- is sqrt(2) for k = 0 and 0 after
    positive, negative = truncation.basis.signed_moments()
    chosen_here = columns.shape[1] > 3 + 4 * n
    by_slack, by_binary = ca.DM(np.eye(len(positive))[0] * positive[0]), ca.DM(positive - negative)

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        # moments of a . p, a = -n_f, with M z_f and the slack on the constant moment
        along = [-d[0] * p[:n] - d[1] * p[n:] for p in (z[3 : 3 + 2 * n], z[3 + 2 * n : 3 + 4 * n])]
        on = z[3 + 4 * n] if chosen_here else 1.0
        rows = [ca.mtimes(image, a) + d[2] * by_binary * on - by_slack * z[0] for a in along]
        return ca.vertcat(*rows)

    facet = chosen.facet[read]
    offset = sides.offset[facet] + keeping(problem, truncation, tail)
    m = chosen.big_m[read]
    xi = m - offset  # b + M of a row a x <= b with a = -normal and b = -offset
    # -M <= a . p <= b + M in moments: -M m^+ - (b + M) m^- <= m_k <= (b + M) m^+ + M m^-
    lower, upper = (np.outer(-m, positive) - np.outer(xi, negative), np.outer(xi, positive) + np.outer(m, negative))
    data = np.column_stack([sides.normal[facet], m])
    return Block("avoiding (moments)", build, columns, data, np.tile(lower, 2), np.tile(upper, 2))
