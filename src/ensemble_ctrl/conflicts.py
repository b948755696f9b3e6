"""Which parts of a task fail, by how much, when and for whom: what a person needs when there is no plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import (
    Eventually,
    ExactOps,
    Formula,
    Inside,
    StateSignals,
    leaves,
    member_robustness,
)
from ensemble_ctrl.duties import grounded, other_parts, window_of
from ensemble_ctrl.errors import RunawayError
from ensemble_ctrl.fleet import Member
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.replay import replay, states

Floats = NDArray[np.float64]

MEMBERS = 201
"""About as many members are looked at, spread evenly over the parameters' ranges."""


@dataclass(frozen=True)
class Conflict:
    """One part of the task that fails.

    Attributes
    ----------
    what : str
        The obstacle, the part of the task as text, or which state runs away, when and for whom.
    amount : float
        Metres by which the worst member falls short, > 0; infinite where a state runs away.
    parameters : dict of str to float
        That member's parameters.
    time : float
        When, in seconds: the deepest moment in an obstacle, or the closest approach to what should be visited.
    """

    what: str
    amount: float
    parameters: Member
    time: float


def conflicts(problem: Problem, controls: Floats) -> tuple[Conflict, ...]:
    """Everything that fails under `controls`, worst first; where states run away, that alone."""
    try:
        return _conflicts(problem, controls)
    except RunawayError as error:
        return (Conflict(error.what, np.inf, error.parameters, error.time),)


def _conflicts(problem: Problem, controls: Floats) -> tuple[Conflict, ...]:
    """Everything that fails, where all states are known."""
    parameters = problem.fleet.grid(MEMBERS)
    paths = states(problem, controls, parameters)
    run = replay(problem, controls, parameters=parameters, substeps=4)
    found = [
        Conflict(f"avoid({c.obstacle})", -c.distance, c.parameters, c.time) for c in run.clearances if c.distance < 0
    ]
    for part in other_parts(problem):
        found += _failing(problem, part, paths, parameters)
    return tuple(sorted(found, key=lambda c: -c.amount))


def _failing(problem: Problem, part: Formula, paths: Floats, parameters: Floats) -> list[Conflict]:
    """The conflict of one conjunct, if its worst member fails it."""
    signals = StateSignals(paths, problem.fleet.states, problem.step)
    values = np.asarray(member_robustness(grounded(problem, part), signals, ExactOps()))[:, 0]
    worst = int(values.argmin())
    if values[worst] >= 0:
        return []
    at = _closest_time(problem, part, paths[worst])
    return [Conflict(str(part), -float(values[worst]), problem.fleet.named(parameters[worst]), at)]


def _closest_time(problem: Problem, part: Formula, path: Floats) -> float:
    """When one member comes closest to satisfying a visit, or is furthest from a duty; else the horizon's end."""
    inside = [leaf for leaf in leaves(part) if isinstance(leaf, Inside)]
    if len(inside) != 1:
        return problem.duration
    margin = problem.regions[inside[0].name].margin(path[:, problem.fleet.place_columns])
    low, high = _window(problem, part)
    window = margin[low : high + 1]
    best = window.argmax() if isinstance(part, Eventually) else window.argmin()
    return float(problem.times[low + int(best)])


def _window(problem: Problem, part: Formula) -> tuple[int, int]:
    """First and last step of a conjunct's own window."""
    begin, end = window_of(problem, part)
    return int(np.ceil(begin / problem.step - 1e-9)), int(np.floor(end / problem.step + 1e-9))
