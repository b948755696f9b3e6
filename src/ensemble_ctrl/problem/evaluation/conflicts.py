"""Which parts of a task fail, by how much, when and for whom: for the case that there is no plan."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

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
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import RunawayError
from ensemble_ctrl.problem.evaluation.apart import closest_pairs, compared
from ensemble_ctrl.problem.evaluation.sampled import affordable, replay, states, trajectories
from ensemble_ctrl.problem.fleet import Member
from ensemble_ctrl.problem.problem import Problem
from ensemble_ctrl.problem.signals import columns, names_in, with_signals
from ensemble_ctrl.problem.specification import TaskPart
from ensemble_ctrl.problem.starts import by_start, label

Floats = NDArray[np.float64]

MEMBERS = 201
"""About as many members are evaluated, spread evenly over the parameters' ranges."""
SAMPLES = 4
"""Samples per step, of the distance from obstacles."""


@dataclass(frozen=True)
class Conflict:
    """One part of the task that fails.

    Attributes
    ----------
    what : str
        The obstacle, the part of the task as text, or which state runs away, when and for whom.
    amount : float
        By how much the worst member falls short, > 0, in `unit`; infinite where a state runs away.
    parameters : dict of str to float
        That member's parameters.
    time : float
        When, in seconds: the deepest moment in an obstacle, or the closest approach to what should be visited.
    unit : str
        What follows the amount: a unit, or words where the unit is not known or is one of several.
    start : str
        The name of the start of that member, where there are several.
    """

    what: str
    amount: float
    parameters: Member
    time: float
    unit: str = "m"
    start: str = ""


def unit_of_parts(problem: Problem, parts: Iterable[TaskPart]) -> str:
    """What follows a number that is the robustness of one of these parts of a task; of no parts, a distance.

    In the words of `Ensemble.unit_of`.
    """
    return problem.fleet.unit_of({n for part in parts for leaf in leaves(part.written) for n in _states(problem, leaf)})


def unit_of_task(problem: Problem) -> str:
    """The same for the robustness of the whole task."""
    return unit_of_parts(problem, problem.specification.parts)


def units_of_parts(problem: Problem) -> dict[str, str]:
    """The unit of each part of the task that is no avoidance, by its text, as `unit_of_parts` gives it."""
    starts = list(problem.fleet.starts) or [""]
    parts = problem.specification.parts
    return {label(str(part), start): unit_of_parts(problem, [part]) for part in parts for start in starts}


def _states(problem: Problem, leaf: Formula) -> tuple[str, ...]:
    """The states that a leaf is about."""
    return names_in(leaf) or problem.fleet.places


def conflicts(problem: Problem, controls: Floats) -> tuple[Conflict, ...]:
    """Everything that fails under `controls`, worst first; where states run away, that alone."""
    found = [
        replace(one, what=label(one.what, name), start=name)
        for name, there in by_start(problem).items()
        for one in _of_one(there, controls)
    ]
    found += _too_close(problem, controls)
    return tuple(sorted(found, key=lambda c: -c.amount))


def _too_close(problem: Problem, controls: Floats) -> list[Conflict]:
    """Members of different starts that come too close to each other."""
    some = compared(problem, problem.steps * SAMPLES + 1)
    if not some:
        return []
    members = problem.fleet.grid(some)
    try:
        paths = {name: trajectories(one, controls, members, SAMPLES) for name, one in by_start(problem).items()}
    except RunawayError:
        return []
    near = [clearance for *_, clearance, _ in closest_pairs(problem, paths, dict.fromkeys(paths, members))]
    return [Conflict(c.obstacle, -c.distance, c.parameters, c.time) for c in near if c.distance < 0]


def _of_one(problem: Problem, controls: Floats) -> tuple[Conflict, ...]:
    """Everything that fails for members of one start."""
    try:
        return _conflicts(problem, controls)
    except RunawayError as error:
        return (Conflict(error.what, np.inf, error.parameters, error.time),)


def _conflicts(problem: Problem, controls: Floats) -> tuple[Conflict, ...]:
    """Everything that fails, where all states are known."""
    parameters = problem.fleet.grid(affordable(MEMBERS, problem.steps, SAMPLES))
    paths = states(problem, controls, parameters)
    whole = with_signals(problem, paths, controls, parameters, problem.step)
    run = replay(problem, controls, parameters=parameters, substeps=SAMPLES)
    places = unit_of_parts(problem, [])
    found = [
        Conflict(f"avoid({c.obstacle})", -c.distance, c.parameters, c.time, places)
        for c in run.clearances
        if c.distance < 0
    ]
    for part in problem.specification.parts:
        found += _failing(problem, part, whole, parameters)
    return tuple(sorted(found, key=lambda c: -c.amount))


def _failing(problem: Problem, part: TaskPart, paths: Floats, parameters: Floats) -> list[Conflict]:
    """The conflict of one conjunct, if its worst member fails it."""
    signals = StateSignals(paths, columns(problem), problem.step)
    # rho of this conjunct at t = 0 for every member; the least one decides
    values = np.asarray(member_robustness(part.formula, signals, ExactOps()))[:, 0]
    worst = int(values.argmin())
    if values[worst] >= 0:
        return []
    at = _closest_time(problem, part, paths[worst])
    member, unit = problem.fleet.named(parameters[worst]), unit_of_parts(problem, [part])
    return [Conflict(str(part), -float(values[worst]), member, at, unit)]


def _closest_time(problem: Problem, part: TaskPart, path: Floats) -> float:
    """When one member comes closest to satisfying a visit, or is deepest in what it avoids; else the horizon's end."""
    inside = [leaf for leaf in leaves(part.written) if isinstance(leaf, Inside)]
    if len(inside) != 1:
        return problem.duration
    margin = problem.regions[inside[0].name].margin(path[:, problem.fleet.place_columns])
    low, high = _window(problem, part)
    window = margin[low : high + 1]
    # the largest margin of a visit, the smallest of a stay
    best = window.argmax() if isinstance(part.written, Eventually) else window.argmin()
    return float(problem.times[low + int(best)])


def _window(problem: Problem, part: TaskPart) -> tuple[int, int]:
    """First and last step of a conjunct's own window."""
    # steps ceil(a / dt) .. floor(b / dt)
    return int(np.ceil(part.begin / problem.step - 1e-9)), int(np.floor(part.end / problem.step + 1e-9))
