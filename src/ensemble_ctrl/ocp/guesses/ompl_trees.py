"""Commands that lead somewhere, found by trees in the space of commands, by OMPL.

Nothing is asked of the system but what a command does to a state, so the state may be that of several members.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass

Floats = NDArray[np.float64]
State = Sequence[float]
Planner = Literal["RRT", "KPIECE1"]
"""RRT grows towards samples (LaValle, Kuffner 2001), KPIECE where cells of a grid are new (Sucan, Kavraki 2009)."""

TOWARDS = 0.1
"""Share of the samples that are the goal itself, of RRT."""
SHORTEST, LONGEST = 2, 10
"""Steps for which a command is kept."""
MOST = 1e9
"""States of a tree."""
CELLS = 30
"""Of KPIECE's grid, along each side of the box."""


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
    growth: Growth,
    start: State,
    goal: Floats,
    near: float,
    iterations: int,
    seed: int,
    stop: Callable[[], bool],
    planner: Planner = "RRT",
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
    planner : {"RRT", "KPIECE1"}
        How the tree grows.

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
    d = len(goal)
    # OMPL holds a place and the number of the whole state, which is kept here; only places count as distances
    states: list[State] = [start]
    space = base.CompoundStateSpace()
    space.addSubspace(_box(base, np.stack([growth.low, growth.high], axis=1)), 1.0)
    space.addSubspace(_box(base, np.array([[0.0, MOST]])), 0.0)
    places = base.RealVectorIdentityProjectionEvaluator(space.getSubspace(0), list((growth.high - growth.low) / CELLS))
    space.registerDefaultProjection(base.SubspaceProjectionEvaluator(space, 0, places))
    commands = control.RealVectorControlSpace(space, len(growth.bounds))
    commands.setBounds(_bounds(base, growth.bounds))
    setup = control.SimpleSetup(commands)
    information = setup.getSpaceInformation()

    def read(state: Any) -> State:
        return states[int(state[1][0])]

    def write(state: Any, place: State, number: int) -> None:
        for k in range(d):
            state[0][k] = float(place[k])
        state[1][0] = float(number)

    def propagate(state: Any, command: Any, seconds: float, result: Any) -> None:
        after = growth.propagate(read(state), [command[k] for k in range(len(growth.bounds))], seconds)
        write(result, after, len(states))
        states.append(after)

    setup.setStateValidityChecker(lambda state: growth.free(read(state)))
    setup.setStatePropagator(propagate)
    information.setPropagationStepSize(growth.step)
    information.setMinMaxControlDuration(SHORTEST, LONGEST)
    begin, end = space.allocState(), space.allocState()
    write(begin, start, 0)
    write(end, goal.tolist(), 0)
    setup.setStartState(begin)
    setup.setGoalState(end, near)
    grower = control.RRT(information) if planner == "RRT" else control.KPIECE1(information)
    if planner == "RRT":  # that of KPIECE can't be set from Python
        grower.setGoalBias(TOWARDS)
    setup.setPlanner(grower)
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


__all__ = ["Growth", "Planner", "tree"]
