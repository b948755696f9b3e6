r"""The penalty of where the fleet ends, in the program and exactly.

With the fleet's final positions :math:`p(q)` and :math:`E` the mean over the parameters' distributions, the terminal
term is ``objective.terminal`` times

- :math:`2\,E|p - r|^2` for one place r, or a place r(q) for each member (`Formation`): the paper's ``|m(T) - m_F|^2``;
- :math:`\sum_k w_k |m_k(T) - m_{F,k}|^2` for some moments (`MomentTarget`);
- :math:`2\,W_2^2` for a mean and a covariance (`SpreadTarget`), twice the squared Wasserstein distance between normal
  distributions: :math:`W_2^2 = |\mu - \mu_F|^2 + \mathrm{tr}\, C + \mathrm{tr}\, C_F - 2t` with the trace
  :math:`t = \mathrm{tr}\sqrt A` of :math:`A = C_F^{1/2} C\, C_F^{1/2}`.  From the invariants of A it is the fixed point
  of :math:`t = \sqrt{I_1 + 2 \sqrt{I_2 + 2 \sqrt{I_3}\, t}}`, which in the plane (:math:`I_3 = 0`) is explicit and in
  space contracts by 1/9 or better.

Start positions that differ shift all of this by a constant, which is left out but for the covariance, where it belongs.
"""

from __future__ import annotations

from itertools import combinations, product
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
ITERATIONS = 8
"""Of the fixed point in space, whose error falls ninefold in each: below 1e-7 of its value."""
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

    def error(*coordinates: ca.SX) -> ca.SX:
        # sum_k w_k |m_k - m_F,k|^2
        off = [ca.mtimes(image, c) - wanted[:, i] for i, c in enumerate(coordinates)]
        cost: ca.SX = ca.dot(weights, sum((one**2 for one in off), ca.SX(0)))
        return cost

    return error


def _spread_error(target: SpreadTarget, truncation: Truncation, start: Floats) -> Any:
    """Twice the squared Wasserstein distance."""
    # S is half the matrix of twice the mean square: E[p p] = P^T S P
    average, square, F = ca.DM(truncation.mean), ca.DM(truncation.square / 2), target.covariance

    def error(*coordinates: ca.SX) -> ca.SX:
        # C = P^T S P - mean mean^T + C_start
        mean = [ca.dot(average, c) for c in coordinates]
        d = len(coordinates)
        covariance = ca.SX(d, d)
        for i, j in product(range(d), repeat=2):
            covariance[i, j] = ca.bilin(square, coordinates[i], coordinates[j]) - mean[i] * mean[j] + start[i, j]
        off: ca.SX = sum(((m - f) ** 2 for m, f in zip(mean, target.mean.tolist(), strict=True)), ca.SX(0))
        return 2 * (off + ca.trace(covariance) + float(np.trace(F)) - 2 * _trace_of_root(F, covariance))

    return error


def _trace_of_root(F: Floats, C: ca.SX) -> ca.SX:
    """The trace of the square root of ``F^(1/2) C F^(1/2)`` for symmetric matrices of up to three rows."""
    d, wanted = len(F), ca.DM(F)
    # I_1 = tr(F C), I_2 = tr of the products of second-order minors (Cauchy and Binet), I_3 = det F det C
    first = ca.trace(ca.mtimes(wanted, C))
    pairs = list(combinations(range(d), 2))
    second = sum((_minor(F, a, b) * _minor(C, b, a) for a in pairs for b in pairs), ca.SX(0))
    if d < 3:
        root: ca.SX = ca.sqrt(first + 2 * ca.sqrt(second + ROUND**2) + ROUND)
        return root
    third = max(float(np.linalg.det(F)), 0.0) * ca.det(C)
    # t = sqrt(I_1 + 2 sqrt(I_2 + 2 sqrt(I_3) t)), from above: t^2 <= 3 I_1
    root = ca.sqrt(3 * first + ROUND)
    for _ in range(ITERATIONS):
        root = ca.sqrt(first + 2 * ca.sqrt(second + 2 * ca.sqrt(third + ROUND**4) * root + ROUND**2) + ROUND)
    return root


def _minor(matrix: Any, rows: tuple[int, int], columns: tuple[int, int]) -> Any:
    """The determinant of two rows and two columns."""
    (i, k), (j, m) = rows, columns
    return matrix[i, j] * matrix[k, m] - matrix[i, m] * matrix[k, j]
