"""How close a fleet comes to where it should end, from exact trajectories."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem.evaluation.sampled import headings, trajectories
from ensemble_ctrl.problem.problem import Problem
from ensemble_ctrl.problem.risk import CLEARANCE_CAP, value_at_risk
from ensemble_ctrl.problem.specification import clearances
from ensemble_ctrl.problem.starts import by_start
from ensemble_ctrl.problem.target import MomentTarget, SpreadTarget, wasserstein

Floats = NDArray[np.float64]

COUNT = 24
"""Points of the rule for each parameter that bends trajectories; a quarter as many with several."""
SUBSTEPS = 4
"""Samples per step for clearances."""
MEMBERS = 2000
"""About as many members are evaluated for the largest distance."""


def arrival(problem: Problem, controls: Floats) -> dict[str, Any]:
    """Distance from the target at the end of a plan.

    Parameters
    ----------
    problem : Problem
        With the target and the parameters' distributions.
    controls : ndarray, shape (steps, n_u)
        Broadcast commands.

    Returns
    -------
    dict
        Empty without a target. For places ``rms`` and ``largest``, metres; for mean and covariance these of the fleet
        and ``distance``, the Wasserstein distance of normal distributions in metres; for moments ``moments``, the
        fleet's. Means are exact up to the rule; the largest distance is that of about 2,000 members.
    """
    fleet, target = problem.fleet, problem.objective.target
    if target is None:
        return {}
    if fleet.starts:
        each = [arrival(one, controls) for one in by_start(problem).values()]
        square = float(np.mean([one["rms"] ** 2 for one in each]))
        return {"rms": square**0.5, "largest": max(one["largest"] for one in each)}
    distributions = fleet.dynamic_distributions
    nodes, weights = fleet.rule(COUNT if len(distributions) < 2 else COUNT // 4)
    final = _final(problem, controls, fleet.dynamic_members(nodes))
    if isinstance(target, MomentTarget):
        # m_k = sum_n w_n phi_k(s_n) p(T; s_n)
        phi = distributions[0].basis(len(target.moments) - 1).evaluate(nodes[:, 0])
        return {"moments": ((weights[:, None] * phi).T @ final).tolist()}
    if isinstance(target, SpreadTarget):
        # mean and covariance by quadrature (weights sum to 2); starts add theirs, independent of the rest
        mean = weights @ final / 2
        covariance = (weights[:, None] / 2 * (final - mean)).T @ (final - mean) + fleet.shift_covariance
        distance = float(np.sqrt(max(wasserstein(mean, covariance, target), 0.0)))
        return {"mean": mean.tolist(), "covariance": covariance.tolist(), "distance": distance}
    # E|p(T) - target|^2, the start's variance included
    off = final - problem.objective.places(fleet, fleet.dynamic_members(nodes))
    square = float(weights @ (off**2).sum(axis=1) / 2 + np.trace(fleet.shift_covariance))
    members = np.concatenate([fleet.grid(MEMBERS), fleet.corners])
    each = np.linalg.norm(_final(problem, controls, members) - problem.objective.places(fleet, members), axis=1)
    return {"rms": float(np.sqrt(square)), "largest": float(each.max())}


def risk(problem: Problem, controls: Floats) -> dict[str, Any]:
    """Value at risk and conditional value at risk of what the problem penalises, metres; empty without.

    For about 2,000 members of equal weight: distances at the end, or clearances at `SUBSTEPS` times per step.
    """
    penalty = problem.objective.cvar
    if penalty is None:
        return {}
    members = problem.fleet.representatives(MEMBERS)
    if penalty.of == "terminal":
        places = problem.objective.places(problem.fleet, members)
        losses = np.linalg.norm(_final(problem, controls, members) - places, axis=1)
    else:
        blocks = np.array_split(members, 10)
        near = [
            clearances(
                problem,
                trajectories(problem, controls, block, SUBSTEPS),
                CLEARANCE_CAP,
                headings(problem, controls, block, SUBSTEPS),
            )
            for block in blocks
        ]
        losses = -np.concatenate(near)
    # both from the sorted losses of members of equal weight (Rockafellar and Uryasev 2000)
    at_risk, mean = value_at_risk(losses, penalty.level)
    return {"of": penalty.of, "level": penalty.level, "value_at_risk": at_risk, "cvar": mean}


def _final(problem: Problem, controls: Floats, members: Floats) -> Floats:
    """Final positions of members, shape (members, d), metres."""
    return trajectories(problem, controls, members)[:, -1]
