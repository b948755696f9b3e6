r"""The penalty of where the fleet ends, in the program and exactly.

With the fleet's final positions :math:`p(q)` and :math:`E` the mean over the parameters' distributions, the terminal
term is ``objective.terminal`` times

- :math:`2\,E|p - r|^2` for one place r, or a place r(q) for each member (`Formation`): the paper's ``|m(T) - m_F|^2``;
- :math:`\sum_k w_k |m_k(T) - m_{F,k}|^2` for some moments (`MomentTarget`);
- :math:`2\,W_2^2` for a mean and a covariance (`SpreadTarget`), twice the squared Wasserstein distance between normal
  distributions: :math:`W_2^2 = |\mu - \mu_F|^2 + \mathrm{tr}\, C + \mathrm{tr}\, C_F - 2\, \mathrm{tr}\sqrt A` with
  :math:`A = C_F^{1/2} C\, C_F^{1/2}`; in two dimensions
  :math:`\mathrm{tr}\sqrt A = \sqrt{\mathrm{tr} A + 2\sqrt{\det A}}`.

Start positions that differ shift all of this by a constant, which is left out but for the covariance, where it belongs.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.program import Block
from ensemble_ctrl.ocp.truncation import Truncation, positions
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.target import Formation, MomentTarget, SpreadTarget, wasserstein

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUND = 1e-6
"""Added to a determinant (m^4) under a square root, which has no slope at zero."""
FINE = 24
"""Order of the rule with which a formation is projected on the moments carried."""


def terminal_blocks(problem: Problem, truncation: Truncation, final: Ints, places: Floats | None = None) -> list[Block]:
    """The terminal term of the program; none without a target.

    Parameters
    ----------
    problem : Problem
        With the target.
    truncation : Truncation
        Whose points these are.
    final : ndarray of int, shape (d * count,)
        Indices of the fleet's positions at the end, one coordinate after the other.
    places : ndarray, shape (points, count), optional
        From those variables to the points; they are the points if not given.
    """
    aim = problem.objective
    if aim.target is None:
        return []
    match aim.target:
        case MomentTarget() as target:
            error = _moments_error(target, truncation)
        case SpreadTarget() as target:
            error = _spread_error(target, truncation, problem.fleet.shift_covariance)
        case _:
            error = _places_error(_places(problem, truncation), truncation)
    n = truncation.count if places is None else places.shape[1]
    image = None if places is None else ca.DM(places)

    def terminal(z: ca.SX, d: ca.SX) -> ca.SX:
        # the points' x, then y, from the variables of each coordinate
        coordinates = [z[i : i + n] for i in range(0, len(final), n)]
        cost: ca.SX = aim.terminal * error(*(c if image is None else ca.mtimes(image, c) for c in coordinates))
        return cost

    none = np.zeros((1, 0))
    return [Block("terminal", terminal, final[None], none, none, none)]


def terminal_cost(problem: Problem, controls: Floats, order: int) -> float:
    """The terminal term under `controls`, exactly but for a Gauss rule of this order over the parameters."""
    if problem.objective.target is None:
        return 0.0
    nodes, weights = problem.fleet.rule(order + 1)
    final = positions(problem, controls, problem.fleet.dynamic_members(nodes))[:, -1]
    return terminal_of(problem, nodes, weights, final)


def terminal_of(problem: Problem, nodes: Floats, weights: Floats, final: Floats) -> float:
    """The terminal term where the members at the nodes of a rule end at `final`, shape (members, d), metres."""
    aim, fleet = problem.objective, problem.fleet
    members = fleet.dynamic_members(nodes)
    match aim.target:
        case MomentTarget() as target:
            basis = fleet.dynamic_distributions[0].basis(len(target.moments) - 1)
            # m_k - m_F,k by the Gauss rule
            off = (weights[:, None] * basis.evaluate(nodes[:, 0])).T @ final - target.moments
            cost = float(target.weights @ (off**2).sum(axis=1))
        case SpreadTarget() as target:
            # mean and covariance by the Gauss rule
            mean = weights @ final / 2
            spread = (weights[:, None] / 2 * (final - mean)).T @ (final - mean) + fleet.shift_covariance
            cost = 2 * wasserstein(mean, spread, target)
        case _:
            cost = float(weights @ ((final - aim.places(fleet, members)) ** 2).sum(axis=1))
    return aim.terminal * cost


def _places(problem: Problem, truncation: Truncation) -> Floats:
    """The points whose curve is closest to the places wanted, under the distributions, shape (points, 2)."""
    if not isinstance(problem.objective.target, Formation):
        return np.tile(np.asarray(problem.objective.place), (truncation.count, 1))
    nodes, weights = problem.fleet.rule(FINE)
    # least squares under the distributions: min_P sum_j w_j |(evaluation P)(q_j) - r(q_j)|^2 over the rule's nodes
    root = np.sqrt(weights)[:, None]
    fleet = problem.fleet
    wanted = problem.objective.places(fleet, fleet.dynamic_members(nodes))
    return np.asarray(np.linalg.lstsq(root * truncation.evaluation(nodes), root * wanted, rcond=None)[0])


def _places_error(wanted: Floats, truncation: Truncation) -> Any:
    """Twice the mean square distance from places, which are points too."""
    weight, at = ca.DM(truncation.square), ca.DM(wanted)

    def error(*coordinates: ca.SX) -> ca.SX:
        # 2 E|p - r|^2 as the quadratic form of P - R, coordinate by coordinate
        off = [c - at[:, i] for i, c in enumerate(coordinates)]
        cost: ca.SX = sum((ca.bilin(weight, one, one) for one in off), ca.SX(0))
        return cost

    return error


def _moments_error(target: MomentTarget, truncation: Truncation) -> Any:
    """Weighted squares of the errors of some moments."""
    count = len(target.moments)
    image, wanted, weights = (
        ca.DM(truncation.to_moments[:count]),
        ca.DM(target.moments),
        ca.DM(np.asarray(target.weights)),
    )

    def error(x: ca.SX, y: ca.SX) -> ca.SX:
        # sum_k w_k |m_k - m_F,k|^2
        off = [ca.mtimes(image, x) - wanted[:, 0], ca.mtimes(image, y) - wanted[:, 1]]
        cost: ca.SX = ca.dot(weights, off[0] ** 2 + off[1] ** 2)
        return cost

    return error


def _spread_error(target: SpreadTarget, truncation: Truncation, start: Floats) -> Any:
    """Twice the squared Wasserstein distance."""
    # S is half the matrix of twice the mean square: E[p p] = P^T S P
    average, square, F = ca.DM(truncation.mean), ca.DM(truncation.square / 2), target.covariance
    det_f = max(float(np.linalg.det(F)), 0.0)

    def error(x: ca.SX, y: ca.SX) -> ca.SX:
        # C = P^T S P - mean mean^T + C_start, then tr A = tr(C_F C) and det A = det C_F det C
        mean = [ca.dot(average, x), ca.dot(average, y)]
        xx = ca.bilin(square, x, x) - mean[0] ** 2 + start[0, 0]
        yy = ca.bilin(square, y, y) - mean[1] ** 2 + start[1, 1]
        xy = ca.bilin(square, x, y) - mean[0] * mean[1] + start[0, 1]
        both = F[0, 0] * xx + 2 * F[0, 1] * xy + F[1, 1] * yy
        inner = both + 2 * ca.sqrt(det_f * (xx * yy - xy**2) + ROUND**2)
        off = (mean[0] - target.mean[0]) ** 2 + (mean[1] - target.mean[1]) ** 2
        cost: ca.SX = 2 * (off + xx + yy + float(np.trace(F)) - 2 * ca.sqrt(inner + ROUND))
        return cost

    return error
