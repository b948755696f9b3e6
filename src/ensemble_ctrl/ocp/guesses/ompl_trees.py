"""Commands that lead somewhere, found by trees in the space of commands (RRT), by OMPL.

Nothing is asked of the system but what a command does to a state, so the state may be that of several members.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass

Floats = NDArray[np.float64]
State = Sequence[float]

TOWARDS = 0.1
"""Share of the samples that are the goal itself."""
SHORTEST, LONGEST = 2, 10
"""Steps for which a command is kept."""


@dataclass(frozen=True, eq=False)
class Growth:
    """What a tree grows in.

    Attributes
    ----------
    propagate : callable
        ``propagate(state, command, seconds)`` is the state after a command.
    free : callable
        Whether a state may be entered.
    low, high : ndarray, shape (d,)
        The box of places, metres.
    bounds : ndarray, shape (n_u, 2)
        Of the commands.
    step : float
        Seconds after which a state is checked.
    """

    propagate: Callable[[State, State, float], State]
    free: Callable[[State], bool]
    low: Floats
    high: Floats
    bounds: Floats
    step: float


def tree(
    growth: Growth, start: State, goal: Floats, near: float, iterations: int, seed: int, stop: Callable[[], bool]
) -> list[tuple[list[float], int]] | None:
    """Commands that lead from a state to a place, or near it.

    Parameters
    ----------
    growth : Growth
    start : sequence of float
        A state, whose first numbers are a place.
    goal : ndarray, shape (d,)
        Metres.
    near : float
        How near is near enough, metres.
    iterations : int
        Counted, not timed, so that a search repeats.
    seed : int
        Above 0; the same one gives the same commands.
    stop : callable
        Asked in every iteration; returning True ends the search.

    Returns
    -------
    list of (command, steps), or None
        Those that come nearest, where none is near enough; None where nothing is free.
    """
    if not growth.free(start):
        return None
    from ompl import base, control, util

    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed)
    d, rest = len(goal), len(start) - len(goal)
    # only places count as distances
    space = base.CompoundStateSpace()
    space.addSubspace(_box(base, np.stack([growth.low, growth.high], axis=1)), 1.0)
    space.addSubspace(_box(base, np.tile([-1e3, 1e3], (rest, 1))), 0.0)
    commands = control.RealVectorControlSpace(space, len(growth.bounds))
    commands.setBounds(_bounds(base, growth.bounds))
    setup = control.SimpleSetup(commands)
    information = setup.getSpaceInformation()

    def read(state: Any) -> list[float]:
        return [*(state[0][k] for k in range(d)), *(state[1][k] for k in range(rest))]

    def write(state: Any, values: State) -> None:
        for k in range(d):
            state[0][k] = float(values[k])
        for k in range(rest):
            state[1][k] = float(values[d + k])

    def propagate(state: Any, command: Any, seconds: float, result: Any) -> None:
        write(result, growth.propagate(read(state), [command[k] for k in range(len(growth.bounds))], seconds))

    setup.setStateValidityChecker(lambda state: growth.free(read(state)))
    setup.setStatePropagator(propagate)
    information.setPropagationStepSize(growth.step)
    information.setMinMaxControlDuration(SHORTEST, LONGEST)
    begin, end = space.allocState(), space.allocState()
    write(begin, start)
    write(end, [*goal, *([0.0] * rest)])
    setup.setStartState(begin)
    setup.setGoalState(end, near)
    planner = control.RRT(information)
    planner.setGoalBias(TOWARDS)
    setup.setPlanner(planner)
    count = iter(range(iterations))
    setup.solve(base.PlannerTerminationCondition(lambda: next(count, None) is None or stop()))
    if not setup.haveSolutionPath():  # not even a way towards the goal
        return None
    path = setup.getSolutionPath()
    used = range(path.getControlCount())
    parts = [(path.getControl(i), round(path.getControlDuration(i) / growth.step)) for i in used]
    return [([command[k] for k in range(len(growth.bounds))], steps) for command, steps in parts]


def _box(base: Any, bounds: Floats) -> Any:
    """A real vector space within bounds."""
    space = base.RealVectorStateSpace(len(bounds))
    space.setBounds(_bounds(base, bounds))
    return space


def _bounds(base: Any, bounds: Floats) -> Any:
    """Bounds of a real vector, shape (n, 2)."""
    found = base.RealVectorBounds(len(bounds))
    for k, (low, high) in enumerate(bounds):
        found.setLow(k, float(low))
        found.setHigh(k, float(high))
    return found


__all__ = ["Growth", "tree"]
