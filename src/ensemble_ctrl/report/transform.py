"""From metres to a drawing, and where on a map a plan fails."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem.evaluation.conflicts import Conflict
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from ensemble_ctrl.problem.starts import by_start
from ensemble_ctrl.report.text import PlanLike

Floats = NDArray[np.float64]

CONFLICTS = 5
"""Failures marked."""


@dataclass(frozen=True, eq=False)
class Canvas:
    """From metres to a drawing whose y runs down.

    Attributes
    ----------
    low : ndarray, shape (2,)
        What is drawn at the lower left corner, metres.
    scale : float
        Units of the drawing a metre.
    across : float
        The same along x: not the same number where x is time, then units a second.
    height : float
        Of the map, in units.
    left, top : float
        Room beside and above the map, in units.
    """

    low: Floats
    scale: float
    across: float
    height: float
    left: float = 0.0
    top: float = 0.0

    @classmethod
    def around(
        cls, low: Floats, size: Floats, width: float, left: float = 0.0, top: float = 0.0, shape: float | None = None
    ) -> Canvas:
        """A drawing `width` units wide of the rectangle from `low` of a size, undistorted or `shape` times as high."""
        # drawing units per metre: equal in x and y, unless the drawing's shape is given
        across = width / float(size[0])
        scale = across if shape is None else shape * width / float(size[1])
        return cls(low, scale, across, float(size[1]) * scale, left, top)

    def at(self, points: Floats) -> Floats:
        """Drawing coordinates, shape of `points`."""
        return np.asarray((points - self.low) * [self.across, -self.scale] + [self.left, self.top + self.height])


def conflict_places(plan: PlanLike) -> list[tuple[Conflict, Floats]]:
    """What fails, worst first, with where that robot is at that time, shape (d,); nothing for a plan that is good."""
    run, certificate = plan.replayed, plan.certificate
    good = run is not None and not run.violating.any() and (certificate is None or certificate.proven == "yes")
    if good and plan.status == "planned":
        return []
    found = []
    for conflict in plan.conflicts()[:CONFLICTS]:
        there = by_start(plan.problem).get(conflict.start)
        if there is None:
            continue  # of two members that come too close
        way = trajectories(there, plan.controls, there.fleet.members([conflict.parameters]), 4)[0]
        times = np.linspace(0.0, plan.problem.duration, len(way))
        # position at the conflict's time, linear between samples
        place = np.array([np.interp(conflict.time, times, column) for column in way.T])
        found.append((conflict, place))
    return found


def some(count: int, most: int) -> NDArray[np.int64]:
    """At most `most` about evenly spaced indices below `count`, both ends included, shape (indices,)."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(np.int64))


def telling(values: Floats, most: int) -> NDArray[np.int64]:
    """Indices to draw of a curve with more than `most` values: both ends and both extremes of equal stretches.

    Examples
    --------
    >>> telling(np.array([0.0, 0, 0, 9, 0, 0, 0, -7, 0, 0]), 8).tolist()
    [0, 3, 4, 5, 7, 9]
    """
    if len(values) <= most:
        return np.arange(len(values))
    # four indices a stretch: first, last, least, largest
    width = -(-4 * len(values) // most)
    stretches = np.minimum(np.arange(-(-len(values) // width) * width), len(values) - 1).reshape(-1, width)
    known, rows = np.nan_to_num(values)[stretches], np.arange(len(stretches))
    extremes = [stretches[rows, known.argmin(axis=1)], stretches[rows, known.argmax(axis=1)]]
    kept = [stretches[:, 0], *extremes, stretches[:, -1]]
    return np.unique(np.concatenate(kept))
