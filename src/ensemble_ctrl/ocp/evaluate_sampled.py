"""What controls are worth for any system, from a finer replay of many members."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import ExactOps, StateSignals, reads_fleet, robustness
from ensemble_ctrl.ocp.apart import apart_gap
from ensemble_ctrl.ocp.cost import CommandCost, cost
from ensemble_ctrl.ocp.disturbance import Growth, growth, lowered
from ensemble_ctrl.ocp.evaluate import Value, rate_excess
from ensemble_ctrl.ocp.risk import MEMBERS as MEMBERS_AT_RISK
from ensemble_ctrl.ocp.risk import risk_of
from ensemble_ctrl.ocp.states import scale_of
from ensemble_ctrl.ocp.terminal import terminal_of
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

SUBSTEPS = 4
"""Samples per step at which the distance from obstacles is measured."""
MEMBERS = {0: 1, 1: 17, 2: 7, 3: 4}
"""Chebyshev points for each of so many parameters, else 3, ends included: the members sampled."""
FLEET = 400
"""Members drawn for a task that speaks of the fleet as a whole."""
RULE = 8
"""Points of the rule over one parameter for means, half of them for each of several."""
INFINITE = 1e6
"""Metres of shortfall where a state is not finite."""


def evaluate(problem: Problem, controls: Floats) -> Value:
    """Evaluate `controls` of shape (steps, n_u) for the whole fleet."""
    return with_middle(problem, controls)[0]


def with_middle(problem: Problem, controls: Floats) -> tuple[Value, Value]:
    """Evaluate `controls` for the whole fleet, and for the middle member alone.

    With the guarantee ``moment``, whose rows are about the mean, the whole fleet stands for its mean state.
    """
    fleet, step = problem.fleet, problem.duration / len(controls)
    members = np.concatenate([fleet.dynamic_members(_spread(len(fleet.names))), fleet.center[None]])
    # all trajectories at once, sampled SUBSTEPS times per step; the middle member's is the last
    states = fleet.integrated(np.repeat(controls, SUBSTEPS, axis=0), members, step / SUBSTEPS, 1)
    scale = scale_of(problem)
    effort = CommandCost.of(problem.objective, scale, step).total(scale.scaled(controls))
    excess = rate_excess(fleet.rate_bounds, controls, step)
    terminal = _terminal(problem, controls) if np.isfinite(states[-1]).all() else 0.0
    risk = _risk(problem, controls) if np.isfinite(states).all() else 0.0

    errors = growth(problem, controls)

    def value(seen: Floats, draws: bool) -> Value:
        if not np.isfinite(seen).all():
            return Value(INFINITE, -INFINITE, 0.0, effort, -INFINITE, excess)
        worst = _robustness(problem, seen[:, ::SUBSTEPS], controls, draws, errors)
        gap = _gap(problem, seen[..., fleet.place_columns], errors)
        whole = cost(problem.objective, effort, terminal, worst, risk)
        return Value(whole, worst, terminal, effort, gap, excess, risk)

    middle = value(states[-1:], draws=False)
    if problem.solve.guarantee == "moment":
        return value(_mean(problem, controls), draws=False), middle
    return value(states[:-1], draws=True), middle


def _mean(problem: Problem, controls: Floats) -> Floats:
    """The mean state of the fleet, by a rule over the parameters, shape (1, SUBSTEPS * steps + 1, n_x)."""
    fleet, step = problem.fleet, problem.duration / len(controls)
    nodes, weights = fleet.rule(RULE if len(fleet.names) < 2 else RULE // 2)
    members = fleet.dynamic_members(nodes)
    states = fleet.integrated(np.repeat(controls, SUBSTEPS, axis=0), members, step / SUBSTEPS, 1)
    # E x(t) by the distributions' Gauss rule, whose weights sum to 2
    return np.asarray(np.einsum("j,jtx->tx", weights / 2, states))[None]


def _spread(parameters: int) -> Floats:
    """Scaled members on a tensor grid of Chebyshev points, corners and middle included."""
    axis = np.cos(np.linspace(0.0, np.pi, MEMBERS.get(parameters, 3)))
    return np.array(list(product(*[axis] * parameters)), dtype=float).reshape(len(axis) ** parameters, parameters)


def _robustness(problem: Problem, states: Floats, controls: Floats, draws: bool, errors: Growth | None) -> float:
    """Exact robustness of the task's other parts than avoidance, worst of the members at the grid times."""
    fleet, step = problem.fleet, problem.duration / len(controls)
    formulas = [part.formula for part in problem.specification.parts]
    signals, ops = lowered(StateSignals(states, fleet.states, step), errors), ExactOps()
    whole = signals
    if draws and any(map(reads_fleet, formulas)):
        # what speaks of the fleet as a whole is read on members drawn from the distributions
        drawn = fleet.integrated(controls, fleet.sample(FLEET, seed=0), step, 1)
        whole = lowered(StateSignals(drawn, fleet.states, step), errors)
    values = [float(robustness(part, whole if reads_fleet(part) else signals, ops)) for part in formulas]
    return min(values, default=0.0)


def _gap(problem: Problem, paths: Floats, errors: Growth | None) -> float:
    """Smallest distance, beyond the radius, of any member from what it is to keep out of at the sampled times."""
    times = np.linspace(0.0, problem.duration, paths.shape[1])
    # each sample less the growth of its step
    away = np.zeros(len(times)) if errors is None else np.append(np.repeat(errors.within, SUBSTEPS), errors.within[-1:])
    found = (
        (avoid.distances(paths, times) - away[avoid.during(times)]).min(initial=np.inf)
        for avoid in problem.specification.avoid
    )
    return min(*map(float, found), apart_gap(problem, paths.swapaxes(0, 1)), np.inf)


def _terminal(problem: Problem, controls: Floats) -> float:
    """The terminal term, by a rule over the parameters."""
    fleet = problem.fleet
    if problem.objective.target is None:
        return 0.0
    nodes, weights = fleet.rule(RULE if len(fleet.names) < 2 else RULE // 2)
    final = fleet.integrated(controls, fleet.dynamic_members(nodes), problem.duration / len(controls), 1)[:, -1]
    return terminal_of(problem, nodes, weights, final[:, fleet.place_columns])


def _risk(problem: Problem, controls: Floats) -> float:
    """The risk penalty, for the members that stand for the fleet in the program."""
    fleet, risk = problem.fleet, problem.objective.cvar
    if risk is None:
        return 0.0
    members = fleet.representatives(MEMBERS_AT_RISK[risk.of])
    states = fleet.integrated(controls, members, problem.duration / len(controls), 1)
    return risk_of(problem, members, states[..., fleet.place_columns])
