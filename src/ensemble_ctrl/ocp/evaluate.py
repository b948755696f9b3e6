"""What a plan is worth, from exact trajectories of a set of members and nothing the solver said."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import ExactOps, StateSignals, reads_fleet, robustness
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.moments import LegendreBasis, TensorBasis
from ensemble_ctrl.ocp.apart import apart_gap
from ensemble_ctrl.ocp.chance import all_hyperplanes, members_within, reach, required_parts
from ensemble_ctrl.ocp.cost import CommandCost, Scale, cost
from ensemble_ctrl.ocp.disturbance import growth, lowered
from ensemble_ctrl.ocp.hyperplanes import separate
from ensemble_ctrl.ocp.risk import risk_cost
from ensemble_ctrl.ocp.terminal import terminal_cost
from ensemble_ctrl.ocp.truncation import Range, Truncation, occupied, positions
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.signals import columns, with_signals
from ensemble_ctrl.problem.specification import TaskPart

Floats = NDArray[np.float64]

QUADRATURE = {0: 0, 1: 16, 2: 6, 3: 3}
"""Order of the Gauss rules for each of so many parameters, else 2: Legendre's, whose robots are evaluated with the
corners, and the distributions'."""


@dataclass(frozen=True)
class Value:
    """Cost as minimised and its parts, and how far the constraints are kept.

    Attributes
    ----------
    cost : float
        ``-w robustness + terminal + effort + risk``.
    robustness : float
        Exact robustness in metres of the task without its ``G avoid`` parts, worst of some members at the grid times:
        those of a Gauss rule and the corners of the ranges.
    gap : float
        Smallest distance in metres, beyond the robot's radius, between an obstacle and the fleet's hull (of the mean
        robot, for the guarantee ``moment``); a lower bound where every obstacle is far.
    excess : float
        By how much a command changes faster than it may, per second; negative where all rates are kept.
    risk : float
        The risk penalty (`ensemble_ctrl.ocp.risk`).
    """

    cost: float
    robustness: float
    terminal: float
    effort: float
    gap: float
    excess: float = -np.inf
    risk: float = 0.0

    def keeps(self, margin: float) -> bool:
        """Whether the task holds, every obstacle is at least `margin` metres away, and rates are kept."""
        return self.robustness >= 0 and self.gap >= margin and self.excess <= 0


def evaluate(problem: Problem, controls: Floats, truncation: Truncation) -> Value:
    """Evaluate `controls` of shape (steps, 2)."""
    aim, step = problem.objective, problem.duration / len(controls)
    fleet, dynamic = problem.fleet, len(problem.fleet.dynamic)
    order = QUADRATURE.get(dynamic, 2)
    in_moments, ops = problem.solve.guarantee == "moment", ExactOps()
    if in_moments:
        nodes, weights = fleet.rule(order + 1)
        spread = positions(problem, controls, fleet.dynamic_members(nodes))
        # the mean path by the distribution's Gauss rule, whose weights sum to 2
        average = np.einsum("j,jtd->td", weights / 2, spread)
        signals = StateSignals(average[None], ("x", "y"), step)
    else:
        signals = _worst(problem, controls, order, None)
    errors = None if in_moments else growth(problem, controls)
    signals = lowered(signals, errors)
    formulas, fewer = required_parts(problem, truncation.within)
    of_fleet = not in_moments and any(reads_fleet(part.written) for part in formulas)
    whole = lowered(_fleet(problem, controls), errors) if of_fleet else signals
    values = [
        _counted(part, float(robustness(part.formula, whole if reads_fleet(part.written) else signals, ops)))
        for part in formulas
    ]
    if fewer:
        within = lowered(_worst(problem, controls, order, truncation.within), errors)
        values += [float(robustness(part.formula, within, ops)) for part in fewer]
    worst = min(values, default=0.0)
    worst = worst if np.isfinite(worst) else 0.0
    terminal = terminal_cost(problem, controls, order)
    effort = CommandCost.of(aim, Scale.none(), step).total(controls)
    risk = risk_cost(problem, controls)
    if in_moments:
        mean = average[:, None]
        avoid, near = problem.specification.avoid, reach(problem, mean)
        hyperplanes = separate(mean, avoid, problem.duration, near=near)
    else:
        curve = occupied(problem, controls, truncation)
        hyperplanes = all_hyperplanes(problem, truncation, curve, reach(problem, curve), controls)
    # clearance of the hull from separating hyperplanes, a lower bound; the largest change of a command
    gap, excess = float(hyperplanes.gap.min(initial=np.inf)), rate_excess(fleet.rate_bounds, controls, step)
    gap = gap if in_moments else min(gap, apart_gap(problem, curve))
    return Value(cost(aim, effort, terminal, worst, risk), worst, terminal, effort, gap, excess, risk)


def _counted(part: TaskPart, value: float) -> float:
    """The robustness of a part; of the rule of a zone, only what it falls short."""
    return value if value < 0 or not part.limit else np.inf


def rate_excess(bounds: Floats | None, controls: Floats, step: float) -> float:
    """By how much a command changes faster than it may, per second; minus infinity where it may change at any rate."""
    if bounds is None:
        return -np.inf
    return float((np.abs(np.diff(controls, axis=0) / step) - bounds).max(initial=-np.inf))


def _worst(problem: Problem, controls: Floats, order: int, within: Range | None) -> StateSignals:
    """Members of a Gauss rule and the corners of the ranges, or those of a box in scaled dynamic parameters."""
    fleet, dynamic = problem.fleet, len(problem.fleet.dynamic)
    # members at Gauss nodes and corners, each also at the corners of the box of starts
    shifts = fleet.shift * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]] if fleet.shift.any() else [[0, 0]])
    nodes = TensorBasis((LegendreBasis(order),) * dynamic).nodes
    corners = fleet.corners
    if within is not None:
        nodes = members_within(np.concatenate([nodes, list(product(*[(-1.0, 1.0)] * dynamic))]), within)
        corners = corners[:0]
    inner = fleet.dynamic_members(nodes)
    paths = positions(problem, controls, inner)
    members = np.concatenate([corners, *[inner] * len(shifts)])
    ends = positions(problem, controls, corners) if len(corners) else paths[:0]
    return _signals(problem, np.concatenate([ends, *(paths + shift for shift in shifts)]), controls, members)


def _signals(problem: Problem, paths: Floats, controls: Floats, members: Floats) -> StateSignals:
    """Positions of members with what else the task reads of them."""
    step = problem.duration / len(controls)
    return StateSignals(with_signals(problem, paths, controls, members, step), columns(problem), step)


def _fleet(problem: Problem, controls: Floats) -> StateSignals:
    """Members of equal weight, for what a task says of the fleet as a whole, drawn from the parameters' distributions.

    With one parameter they are its quantiles.
    """
    # every 50th of 20,000 draws, in order of a single parameter: its quantiles
    members = problem.fleet.sample(20_000, seed=0)
    if members.shape[1] == 1:
        members = np.sort(members, axis=0)
    some = members[25::50]
    return _signals(problem, positions(problem, controls, some), controls, some)
