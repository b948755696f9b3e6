"""Regions that every member has to be in at one time, or one soon after the other, and that are too far apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.disc import obstacle_of
from ensemble_ctrl.problem.checks.finding import SLACK, Finding
from ensemble_ctrl.problem.checks.presence import Presence
from ensemble_ctrl.problem.checks.reach import top_speed

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem


Floats = NDArray[np.float64]


def apart_findings(problem: Problem, way: Sequence[Presence]) -> Iterator[Finding]:
    """Pairs of regions of a way of doing the task that the slowest member can't be in as the task wants."""
    speed = top_speed(problem)
    bounded = {name: region for name, region in problem.regions.items() if not region.is_empty and region.is_bounded}
    for one, other in combinations([presence for presence in way if presence.leaf.name in bounded], 2):
        first, second = bounded[one.leaf.name], bounded[other.leaf.name]
        gap = min(one.longest_gap(other), problem.duration)
        distance = _distance(first, second)
        slack = SLACK * max(1.0, float(np.abs(first.vertices).max()), float(np.abs(second.vertices).max()))
        if distance > slack and (gap <= 0 or distance > speed * gap + slack):
            yield _too_far(one, other, distance, gap, problem)


def _distance(one: Polyhedron, other: Polyhedron) -> float:
    """A lower bound of the distance of two bounded regions, metres; what it is, but for rounding, for polygons."""
    # the widest slab between both along a side of either: max_i (min_y a_i y - h_i) for unit rows
    (G, h, corners), (F, g, others) = _outer(one), _outer(other)
    widest = max(
        float((G @ others.T - h[:, None]).min(axis=1).max()), float((F @ corners.T - g[:, None]).min(axis=1).max())
    )
    if G.shape[1] != 2 or min(len(corners), len(others)) < 3 or widest <= 0:
        return max(widest, 0.0)
    # of convex polygons that are apart, one of the two nearest points is a corner
    pairs = ((corners, others), (others, corners))
    return min(float(Obstacle.polygon(a).distance(b).min()) for a, b in pairs)


def _outer(region: Polyhedron) -> tuple[Floats, Floats, Floats]:
    """Unit rows ``G x <= h`` around a region, and the corners of a polygon around it."""
    flat = region.A.shape[1] == 1 or len(region.vertices) <= region.A.shape[1]
    shape = region if flat else obstacle_of(region)
    return *shape.unit_rows(), shape.vertices


def _too_far(one: Presence, other: Presence, distance: float, gap: float, problem: Problem) -> Finding:
    """A finding for two regions."""
    names = f"{one.leaf.name!r} and {other.leaf.name!r}"
    column = other.leaf.column or one.leaf.column
    offset = column - 1 if column else None
    if gap <= 0:
        message = f"members have to be in {names} at one time, but these regions are {distance:.3g} m apart"
        return Finding(("task",), message, "let the windows begin and end apart from each other", offset=offset)
    speed = top_speed(problem)
    message = (
        f"members have to be in {names} within {gap:.3g} s, but these regions are {distance:.3g} m apart, and at top "
        f"speed the slowest member (traction {problem.fleet.slowest:g}) drives {speed * gap:.3g} m in that time"
    )
    hint = "raise fleet.input_bounds.v"
    if speed > 0:
        hint = f"it needs {distance / speed:.3g} s: give more time between them or raise fleet.input_bounds.v"
    return Finding(("task",), message, hint, offset=offset)


__all__ = ["apart_findings"]
