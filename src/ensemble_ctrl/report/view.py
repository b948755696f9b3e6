"""A plan seen from above: what every drawing of a map is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.conflicts import Conflict
from ensemble_ctrl.drawing import frame, outlines, target_lines
from ensemble_ctrl.errors import UnsupportedError
from ensemble_ctrl.problem import OdeProblem, Problem
from ensemble_ctrl.replay import trajectories
from ensemble_ctrl.report.text import PlanLike

Floats = NDArray[np.float64]

CONFLICTS = 5
"""Failures marked."""
LOOKS = 21
"""Times at which moving obstacles count for what a map has to show."""


@dataclass(frozen=True, eq=False)
class Canvas:
    """From metres to a drawing whose y runs down.

    Attributes
    ----------
    low : ndarray, shape (2,)
        What is drawn at the lower left corner, metres.
    scale : float
        Units of the drawing a metre.
    height : float
        Of the map, in units.
    left, top : float
        Room beside and above the map, in units.
    """

    low: Floats
    scale: float
    height: float
    left: float = 0.0
    top: float = 0.0

    @classmethod
    def around(cls, low: Floats, size: Floats, width: float, left: float = 0.0, top: float = 0.0) -> Canvas:
        """A map `width` units wide that shows the rectangle from `low` of `size` metres."""
        scale = width / float(size[0])
        return cls(low, scale, float(size[1]) * scale, left, top)

    def at(self, points: Floats) -> Floats:
        """Drawing coordinates, shape of `points`."""
        return np.asarray((points - self.low) * [self.scale, -self.scale] + [self.left, self.top + self.height])


def require_map(problem: Problem, what: str) -> None:
    """Say where `what` is not drawn: of fleets that follow a differential equation there is no tube and no one map.

    Raises
    ------
    UnsupportedError
        For such a fleet.
    """
    if isinstance(problem, OdeProblem):
        drawn = "the run's own figures show its trajectories, controls and spread"
        raise UnsupportedError(f"{what} is not drawn for {problem.fleet.system.name}: {drawn}")


def ways(problem: Problem, controls: Floats, members: Floats, substeps: int = 1) -> Floats:
    """Ways of members on the map, shape (members, steps * substeps + 1, 2), metres."""
    return trajectories(problem, controls, members, substeps)[..., :2]


def conflict_places(plan: PlanLike) -> list[tuple[Conflict, Floats]]:
    """What fails, worst first, with where that robot is at that time, shape (2,); nothing for a plan that is good."""
    run, certificate = plan.replayed, plan.certificate
    good = run is not None and not run.violating.any() and (certificate is None or certificate.proven == "yes")
    if good and plan.status == "planned":
        return []
    found = []
    for conflict in plan.conflicts()[:CONFLICTS]:
        way = ways(plan.problem, plan.controls, plan.problem.fleet.members([conflict.parameters]), 4)[0]
        times = np.linspace(0.0, plan.problem.duration, len(way))
        place = np.array([np.interp(conflict.time, times, column) for column in way.T])
        found.append((conflict, place))
    return found


def window(problem: Problem, paths: list[Floats]) -> tuple[Floats, Floats]:
    """Lower left corner and size of what a map has to show, metres: everything, wherever obstacles go."""
    shapes = [problem.fleet.position[None, :], *paths]
    for name, piece in problem.pieces:
        motion = problem.motions.get(name)
        offsets = np.zeros((1, 2)) if motion is None else motion.at(np.linspace(0.0, problem.duration, LOOKS))
        shapes += [piece.vertices + offset for offset in offsets]
    return frame([*shapes, *outlines(problem, paths).values(), *target_lines(problem)])


def some(count: int, most: int) -> NDArray[np.int64]:
    """At most `most` about evenly spaced indices below `count`, both ends included, shape (indices,)."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(np.int64))
