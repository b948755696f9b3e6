r"""What logs of robots on arcs say of their parameters, and of the errors of the model that are left.

Between two rows of a log the model turns by ``b omega h`` and moves by ``a v h sinc(turn / 2)`` along the heading in
the middle.  For each robot the factors `a` and `b` are those with the smallest largest residual (Chebyshev's fit, which
is convex in one number); the residuals per second are the smallest bounds of disturbances that explain the log.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.problem.uncertainty import POSITION, Uncertainty
from ensemble_ctrl.systems import ArcSystem

Floats = NDArray[np.float64]

LARGEST = 10.0
"""Largest factor that is looked for."""
ROUNDS = 80
"""Of the search for the best factor: each keeps two thirds of the interval."""
FEWEST = 3
"""Rows of one robot that say anything."""


@dataclass(frozen=True, eq=False)
class RobotLog:
    """What one robot was told, and where it was.

    Attributes
    ----------
    times : ndarray, shape (rows,)
        Seconds, increasing.
    controls : ndarray, shape (rows, 2)
        Commands that hold from each row to the next.
    poses : ndarray, shape (rows, 3)
        Place in metres, and heading in radians from +x, counter-clockwise.
    """

    times: Floats
    controls: Floats
    poses: Floats


@dataclass(frozen=True)
class Identified:
    """What explains the logs.

    Attributes
    ----------
    linear, angular : (float, float)
        Ranges of the factors on the speed and on the turn rate.
    uncertainty : Uncertainty
        The smallest disturbances of place and heading that explain every row.
    robots : int
        How many robots there are.
    """

    linear: tuple[float, float]
    angular: tuple[float, float]
    uncertainty: Uncertainty
    robots: int


def identify(system: ArcSystem, logs: Mapping[str, RobotLog]) -> Identified:
    """Ranges of the factors and bounds of disturbances from logs.

    Parameters
    ----------
    system : ArcSystem
        What turns commands into a speed and a turn rate.
    logs : mapping of str to RobotLog
        By the names of the robots.

    Raises
    ------
    ProblemError
        For logs of fewer than three rows, with times that do not increase, or in which a robot never drives or turns.

    Notes
    -----
    *Guarantee*: with the factors found for it, each robot's rows are explained by errors of the rates within the
    bounds, up to their change within one interval of the log. Errors of the sensors count as errors of the rates;
    other runs may have larger ones.
    """
    each = [_robot(system, name, log) for name, log in logs.items()]
    if not each:
        raise ProblemError("log: expected rows of at least one robot, got none")
    a, b, place, turn = np.array(each).T
    errors = Uncertainty({POSITION: float(place.max()), "heading": float(turn.max())})
    return Identified((float(a.min()), float(a.max())), (float(b.min()), float(b.max())), errors, len(each))


def _robot(system: ArcSystem, name: str, log: RobotLog) -> tuple[float, float, float, float]:
    """Factors of one robot and its largest residuals, per second."""
    steps = np.diff(log.times)
    if len(log.times) < FEWEST:
        raise ProblemError(f"log: expected {FEWEST} rows or more of {name}, got {len(log.times)}")
    if (steps <= 0).any():
        late = int(np.argmax(steps <= 0))
        times = f"{log.times[late + 1]:g} s after {log.times[late]:g} s"
        raise ProblemError(f"log: expected times of {name} that increase, got {times}")
    v, omega = system.rates(*log.controls[:-1].T)
    heading = np.unwrap(log.poses[:, 2])
    turned, moved = np.diff(heading), np.diff(log.poses[:, :2], axis=0)
    # turn rates of the log against b omega
    sign = 1.0 if system.heading_from == "x" else -1.0
    b, turn = _best(lambda factor: np.abs(turned / steps - factor * sign * omega), omega, f"{name} never turns")
    # velocities against a v sinc(turn / 2) along the heading in the middle of each interval
    middle = (heading[1:] + heading[:-1]) / 2
    along = (v * np.sinc(turned / 2 / np.pi))[:, None] * np.column_stack([np.cos(middle), np.sin(middle)])
    speed = moved / steps[:, None]
    a, place = _best(lambda factor: np.linalg.norm(speed - factor * along, axis=1), v, f"{name} never drives")
    return a, b, place, turn


def _best(residuals: Callable[[float], Floats], rates: Floats, why: str) -> tuple[float, float]:
    """The factor with the smallest largest residual, and that residual; convex, so that thirds can be left out."""
    if not rates.any():
        raise ProblemError(f"log: expected robots that drive and turn, got one: {why}")
    low, high = 0.0, LARGEST
    for _ in range(ROUNDS):
        third = (high - low) / 3
        left, right = (float(residuals(factor).max()) for factor in (low + third, high - third))
        low, high = (low, high - third) if left <= right else (low + third, high)
    factor = (low + high) / 2
    return factor, float(residuals(factor).max())
