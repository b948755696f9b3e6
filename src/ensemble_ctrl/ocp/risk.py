r"""The risk penalty in the program, by the form of Rockafellar and Uryasev, and exactly.

Members of equal weight stand for the distributions. With their losses :math:`L_i`, new variables t and
:math:`e_i \ge 0`:

.. math:: w \Bigl(t + \frac{1}{n (1 - \alpha)} \sum_i e_i\Bigr), \qquad e_i + t \ge L_i

The loss of a member is its distance from its place at the end; or minus a clearance :math:`c_i`, a variable below what
each separating hyperplane leaves it, and below `ensemble_ctrl.problem.risk.CLEARANCE_CAP`.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.hyperplanes import Hyperplanes
from ensemble_ctrl.ocp.layout import Numbers
from ensemble_ctrl.ocp.program import Block
from ensemble_ctrl.ocp.truncation import Truncation, positions
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.risk import CLEARANCE_CAP, Risk, value_at_risk
from ensemble_ctrl.problem.specification import clearances

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Pairs = NDArray[np.bool_]

MEMBERS = {"terminal": 64, "clearance": 16}
"""Members that stand for the fleet; a clearance costs two rows for each of them, obstacle and step."""
ROUND = 1e-3
"""Metres; a distance is replaced by the larger ``hypot(distance, ROUND)``, which has a slope at zero."""


@dataclass(frozen=True, eq=False)
class RiskRows:
    """Rows and terms, and the new variables: their indices, bounds, and values at the guess."""

    blocks: list[Block]
    terms: list[Block]
    index: Ints
    lower: Floats
    upper: Floats
    guess: Floats


def risk_rows(
    problem: Problem,
    truncation: Truncation,
    layout: Numbers,
    ends: Ints,
    curve: Floats,
    hyperplanes: Hyperplanes,
    pairs: Pairs,
    places: Floats | None = None,
) -> RiskRows | None:
    """The risk penalty around a guess whose points are `curve`; None where there is none.

    Parameters
    ----------
    problem : Problem
        With ``objective.cvar``.
    truncation : Truncation
        Whose points these are.
    layout : Numbers
        Hands out the new variables.
    ends : ndarray of int, shape (steps + 1, d * points)
        Where the points' coordinates stand at the grid times, one coordinate after the other.
    curve : ndarray, shape (steps + 1, points, d)
        Metres.
    hyperplanes : Hyperplanes
        Separating hyperplanes at the guess.
    pairs : ndarray of bool, shape (sides, steps)
        Which of them count.
    places : ndarray, shape (points, variables), optional
        From the variables of a coordinate to the points; `curve` holds the variables.
    """
    risk = problem.objective.cvar
    if risk is None or not risk.weight:
        return None
    # places of the representatives: p_i = (evaluation at psi_i) P + offset_i
    members = problem.fleet.representatives(MEMBERS[risk.of])
    seen = truncation.evaluation(_scaled(problem, members))
    seen = seen if places is None else seen @ places
    offset = (members - problem.fleet.center) @ problem.fleet.shifting
    level, excess = layout.more(1), layout.more(len(members))
    if risk.of == "terminal":
        offset = offset - problem.objective.places(problem.fleet, members)
        # L_i at the guess: the distance at the end, or minus the clearance; t its quantile, e_i what exceeds t
        loss = np.hypot(np.linalg.norm(seen @ curve[-1] + offset, axis=1), ROUND)
        blocks = [_distances(ends[-1], seen, offset, int(level[0]), excess)]
        clear, value = np.zeros(0, dtype=np.int64), np.zeros(0)
    else:
        clear = layout.more(len(members))
        path = np.einsum("ij,tjd->tid", seen, curve) + offset
        value = np.clip(
            _left(path, hyperplanes, pairs).min(axis=(1, 2), initial=CLEARANCE_CAP), -CLEARANCE_CAP, CLEARANCE_CAP
        )
        loss = -value
        blocks = [_losses(int(level[0]), excess, clear), *_clearances(ends, seen, offset, hyperplanes, pairs, clear)]
    # start: t at the quantile of the losses, e_i at max(L_i - t, 0), and e_i and c_i a little inside
    threshold, _ = value_at_risk(loss, risk.level)
    return RiskRows(
        blocks,
        [_penalty(risk, int(level[0]), excess)],
        np.concatenate([level, excess, clear]),
        np.concatenate([[-np.inf], np.zeros(len(excess)), np.full(len(clear), -np.inf)]),
        np.concatenate([[np.inf], np.full(len(excess), np.inf), np.full(len(clear), CLEARANCE_CAP)]),
        np.concatenate([[threshold], np.maximum(loss - threshold, 0.0) + ROUND, value - ROUND]),
    )


def risk_cost(problem: Problem, controls: Floats) -> float:
    """The risk penalty under `controls`, for the same members, on exact paths at the grid times."""
    risk = problem.objective.cvar
    if risk is None:
        return 0.0
    members = problem.fleet.representatives(MEMBERS[risk.of])
    return risk_of(problem, members, positions(problem, controls, members))


def risk_of(problem: Problem, members: Floats, paths: Floats) -> float:
    """The risk penalty of members on these paths, shape (members, times, d), metres."""
    risk = problem.objective.cvar
    assert risk is not None
    if risk.of == "terminal":
        losses = np.linalg.norm(paths[:, -1] - problem.objective.places(problem.fleet, members), axis=1)
    else:
        losses = -clearances(problem, paths, CLEARANCE_CAP)
    return risk.weight * value_at_risk(losses, risk.level)[1]


def _scaled(problem: Problem, members: Floats) -> Floats:
    """The dynamic parameters of members, scaled."""
    fleet = problem.fleet
    columns = [
        distribution.to_scaled(members[:, k])
        for k, distribution in zip(fleet.dynamic, fleet.dynamic_distributions, strict=True)
    ]
    return np.column_stack(columns) if columns else np.zeros((len(members), 0))


def _penalty(risk: Risk, level: int, excess: Ints) -> Block:
    """The threshold and what exceeds it."""
    share = len(excess) * (1 - risk.level)

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        # w (t + sum_i e_i / (n (1 - alpha))) (Rockafellar and Uryasev 2000)
        cost: ca.SX = risk.weight * (z[0] + ca.sum1(z[1:]) / share)
        return cost

    none = np.zeros((1, 0))
    return Block("risk", build, np.concatenate([[level], excess])[None], none, none, none)


def _distances(final: Ints, seen: Floats, offset: Floats, level: int, excess: Ints) -> Block:
    """``e + t >= distance`` from its place, for each member."""
    (count, n), dims = seen.shape, offset.shape[1]

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        # p_i - place_i, and the row e_i + t - |p_i - place_i| >= 0
        off = [ca.dot(d[dims:], z[k * n : (k + 1) * n]) + d[k] for k in range(dims)]
        square = sum((one**2 for one in off[1:]), off[0] ** 2)
        row: ca.SX = z[dims * n] + z[dims * n + 1] - ca.sqrt(square + ROUND**2)
        return row

    # an instance for each member: all final points, t, and its own e_i
    columns = np.column_stack([np.tile(final, (count, 1)), np.full(count, level), excess])
    low = np.zeros((count, 1))
    return Block("risk", build, columns, np.column_stack([offset, seen]), low, low + np.inf)


def _losses(level: int, excess: Ints, clear: Ints) -> Block:
    """``e + t >= -c`` for each member."""
    # t + e_i + c_i >= 0
    columns = np.column_stack([np.full(len(excess), level), excess, clear])
    low = np.zeros((len(excess), 1))
    none = np.zeros((len(excess), 0))
    return Block("risk", lambda z, d: z[0] + z[1] + z[2], columns, none, low, low + np.inf)


def _left(path: Floats, hyperplanes: Hyperplanes, pairs: Pairs) -> Floats:
    """What each hyperplane that counts leaves each member at both ends of its step, shape (members, pairs, 2)."""
    side, at = np.nonzero(pairs)
    # n . p_i - drift - (support + radius) at the begin and at the end of the step
    normal, keep = hyperplanes.normal[side, at], (hyperplanes.support + hyperplanes.radius[:, None])[side, at]
    ends = [np.einsum("kid,kd->ik", path[at + end], normal) - hyperplanes.drift[side, at, end] - keep for end in (0, 1)]
    return np.stack(ends, axis=-1)


def _clearances(
    ends: Ints, seen: Floats, offset: Floats, hyperplanes: Hyperplanes, pairs: Pairs, clear: Ints
) -> list[Block]:
    """Each member's clearance is below what every hyperplane leaves it at both ends of the step."""
    side, at = np.nonzero(pairs)
    if not len(side):
        return []
    # a row pair for each member and pair: n . p_i - drift - (support + radius) - c_i >= 0 at both ends of the step
    (members, n), dims = seen.shape, offset.shape[1]
    keep = (hyperplanes.support + hyperplanes.radius[:, None])[side, at][:, None] + hyperplanes.drift[side, at]
    who, pair = (index.ravel() for index in np.meshgrid(np.arange(members), np.arange(len(side)), indexing="ij"))
    normal = hyperplanes.normal[side, at][pair]
    levels = keep[pair] - (normal * offset[who]).sum(axis=1, keepdims=True)

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        both = [z[1 + dims * n * end : 1 + dims * n * (end + 1)] for end in (0, 1)]
        weight = d[dims + 2 :]
        reached = [[d[k] * ca.dot(weight, p[k * n : (k + 1) * n]) for k in range(dims)] for p in both]
        return ca.vertcat(*(sum(one[1:], one[0]) - d[dims + k] - z[0] for k, one in enumerate(reached)))

    columns = np.column_stack([clear[who], ends[at[pair]], ends[at[pair] + 1]])
    low = np.zeros((len(who), 2))
    return [Block("risk", build, columns, np.column_stack([normal, levels, seen[who]]), low, low + np.inf)]
