"""Curves that a robot of a smallest turning radius can drive, with cusps where it may reverse, by OMPL.

OMPL (Sucan, Moll, Kavraki 2012) is not a dependency: it has no wheels for Windows, nor for every Python. It is imported
where it is needed only, and prints nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.footprint import Footprint
from ensemble_ctrl.core.deferred import dataclass

Floats = NDArray[np.float64]

RESOLUTION = 0.005
"""Largest distance of the poses at which a path is checked, as a share of the map."""
POSES = 600
"""Poses of a path."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Where a robot may be.

    Attributes
    ----------
    blocked : shapely geometry
        Where its centre, or its body, may not be.
    low, high : ndarray, shape (2,)
        The box that paths stay in, metres.
    corridor : shapely geometry, optional
        Where its centre stays.
    body : Footprint, optional
        The robot's shape.
    """

    blocked: Any
    low: Floats
    high: Floats
    corridor: Any = None
    body: Footprint | None = None

    def free(self, x: float, y: float, heading: float) -> bool:
        """Whether the robot may be there."""
        import shapely

        if self.corridor is not None and not bool(shapely.contains_xy(self.corridor, x, y)):
            return False
        if self.body is not None:
            shape = shapely.polygons(self.body.at(np.array([x, y]), np.array(heading)))
            return not bool(shapely.intersects(self.blocked, shape))
        return not bool(shapely.contains_xy(self.blocked, x, y))


def available() -> bool:
    """Whether OMPL is installed."""
    return find_spec("ompl") is not None


def curve(
    around: Surroundings,
    radius: float,
    reversing: bool,
    start: Floats,
    goals: Floats,
    iterations: int,
    seed: int,
    stop: Callable[[], bool],
) -> Floats | None:
    """A short Reeds-Shepp path, or a Dubins path where the robot may not reverse, to one of some poses.

    Parameters
    ----------
    around : Surroundings
    radius : float
        The smallest of a turn, metres.
    reversing : bool
        Whether the robot may drive backwards.
    start : ndarray, shape (3,)
        Position in metres, heading in radians from +x.
    goals : ndarray, shape (goals, 3)
        Poses of which one is to be reached.
    iterations : int
        Of BIT* (Gammell, Barfoot, Srinivasa 2020): counted, not timed, so that a search repeats.
    seed : int
        Above 0; the same one gives the same path.
    stop : callable
        Asked in every iteration; returning True ends the search.

    Returns
    -------
    ndarray of shape (POSES, 3), or None
        Poses along the path; None where none was found.
    """
    goals = np.array([goal for goal in goals if around.free(*goal)])
    if not len(goals) or not around.free(*start):
        return None
    from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed)
    space = base.ReedsSheppStateSpace(radius) if reversing else base.DubinsStateSpace(radius)
    bounds = base.RealVectorBounds(2)
    for axis in (0, 1):
        bounds.setLow(axis, float(around.low[axis]))
        bounds.setHigh(axis, float(around.high[axis]))
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: around.free(state.getX(), state.getY(), state.getYaw()))
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(RESOLUTION)
    setup.setStartState(_state(space, start))
    wanted = base.GoalStates(information)
    for goal in goals:
        wanted.addState(_state(space, goal))
    setup.setGoal(wanted)
    setup.setPlanner(geometric.BITstar(information))
    count = iter(range(iterations))
    setup.solve(base.PlannerTerminationCondition(lambda: next(count, None) is None or stop()))
    if not setup.haveExactSolutionPath():
        return None
    path = setup.getSolutionPath()
    path.interpolate(POSES)
    return np.array([(state.getX(), state.getY(), state.getYaw()) for state in path.getStates()])


def _state(space: Any, pose: Floats) -> Any:
    """A pose as a state."""
    state = space.allocState()
    state.setX(float(pose[0]))
    state.setY(float(pose[1]))
    state.setYaw(float((pose[2] + np.pi) % (2 * np.pi) - np.pi))
    return state


__all__ = ["Surroundings", "available", "curve"]
