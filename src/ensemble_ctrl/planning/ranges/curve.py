"""What more channels buy: the least clearance of any channel, against their number.

Clearances are required of every channel, each twice the last one, until more channels would be needed than allowed or
no plan keeps them; then the last interval is halved a few times. What counts of each is the clearance that is proven.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ensemble_ctrl.planning.planner import Progress
from ensemble_ctrl.planning.ranges.channels import Grouped, fewest
from ensemble_ctrl.planning.ranges.oracle import Tell
from ensemble_ctrl.problem import Problem

TICKS = 25
"""Steps of a range between which it may be cut: fewer than for an answer, for there are many searches."""
HALVINGS = 2
"""Clearances tried between the largest that is kept and the smallest that is not."""
SHARE = 0.01
"""The smallest clearance required, as a share of the map's size, unless twice what is proven already is more."""


def curve(
    problem: Problem, found: Grouped, most: int, *, progress: Progress | None = None, tell: Tell | None = None
) -> tuple[Grouped, ...]:
    """Groups of each number up to `most` for which more clearance is found than for fewer.

    Parameters
    ----------
    problem : Problem
    found : Grouped
        The fewest groups.
    most : int
        Channels allowed.

    Returns
    -------
    tuple of Grouped
        Numbers and clearances increase; `found` alone where there is nothing to keep clear of. The first has as many
        groups as `found`, and may have more clearance.

    Notes
    -----
    *Guarantee*: each is a proven cover. That none is better is not proven.
    """
    points = [found]
    if np.isfinite(found.clearance):

        def keeps(clearance: float) -> bool:
            more = fewest(problem, most, TICKS, clearance, both_ends=False, progress=progress, tell=tell)
            if more.missed is None:
                points.append(more)
            return more.missed is None

        _climb(keeps, max(2 * found.clearance, SHARE * _size(problem)))
    return _frontier(points)


def _climb(keeps: Callable[[float], bool], clearance: float) -> None:
    """Try larger clearances while they are kept, then some in between."""
    kept = 0.0
    while keeps(clearance):
        kept, clearance = clearance, 2 * clearance
    for _ in range(HALVINGS):
        middle = (kept + clearance) / 2
        kept, clearance = (middle, clearance) if keeps(middle) else (kept, middle)


def _frontier(points: list[Grouped]) -> tuple[Grouped, ...]:
    """The points that no other one beats with as few groups."""
    kept: list[Grouped] = []
    for point in sorted(points, key=lambda p: (len(p.groups), -p.clearance)):
        if not kept or point.clearance > kept[-1].clearance:
            kept.append(point)
    return tuple(kept)


def _size(problem: Problem) -> float:
    """The larger side of the box around all obstacles, metres."""
    corners = np.concatenate([piece.vertices for _, piece in problem.pieces])
    return float(np.ptp(corners, axis=0).max())
