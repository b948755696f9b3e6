"""Regions that every member has to be in before the slowest one can be there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.constraints.disc import obstacle_of
from ensemble_ctrl.constraints.stl import Inside
from ensemble_ctrl.problem.checks.finding import Finding
from ensemble_ctrl.problem.checks.presence import Presence

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem

Floats = NDArray[np.float64]

SLACK = 1e-9
"""Metres, for each metre of a coordinate above one: only what is certain is a finding."""


def reach_findings(problem: Problem, way: Sequence[Presence]) -> Iterator[Finding]:
    """Regions of a way of doing the task that have to be reached before the slowest member can be there."""
    for presence in way:
        leaf, deadline = presence.leaf, min(presence.latest, problem.duration)
        region = problem.regions.get(leaf.name)
        if region is None or region.is_empty:
            continue
        # ||p - region|| > psi_min v_max t: the slowest member can't be there by then
        distance, start = _furthest(region, problem)
        slack = SLACK * max(1.0, float(np.abs(start).max()))
        if deadline <= 0.0 and distance > slack:
            yield _wrong_start(leaf, distance, start)
        elif deadline > 0.0 and distance > top_speed(problem) * deadline + slack:
            yield _out_of_reach(leaf, distance, deadline, problem)


def _furthest(region: Polyhedron, problem: Problem) -> tuple[float, Floats]:
    """Distance from a region of the start that is furthest from it, and that start: a corner of the box of starts."""
    fleet = problem.fleet
    # the distance from a convex set is convex: largest at a corner of the box of starts
    starts = fleet.start_place + np.array(list(product((-1.0, 1.0), repeat=len(fleet.places)))) * fleet.shift
    distances = _distances(region, starts)
    k = int(distances.argmax())
    return float(distances[k]), starts[k]


def _distances(region: Polyhedron, points: Floats) -> Floats:
    """Distance of points from a region; a lower bound of it where the region is flat or unbounded."""
    if region.A.shape[1] == 2 and region.is_bounded and len(region.vertices) > 2:
        return obstacle_of(region).distance(points)
    return -region.margin(points)


def top_speed(problem: Problem) -> float:
    """Speed that the slowest member can't exceed, in m/s; none is known of systems that do not move on arcs."""
    if not problem.fleet.system.on_arcs:
        return np.inf
    fastest = max(abs(float(problem.fleet.input_lower[0])), abs(float(problem.fleet.input_upper[0])))
    return problem.fleet.slowest * fastest


def _wrong_start(leaf: Inside, distance: float, start: Floats) -> Finding:
    """A finding for a region that has to hold from the start."""
    place = ", ".join(f"{x:g}" for x in start)
    message = f"members have to be in {leaf.name!r} from the start, but ({place}) is {distance:.3g} m outside"
    return Finding(("task",), message, "move the start, or let the window begin later", offset=_offset(leaf))


def _out_of_reach(leaf: Inside, distance: float, deadline: float, problem: Problem) -> Finding:
    """A finding for a region that is too far."""
    speed = top_speed(problem)
    message = (
        f"region {leaf.name!r} is {distance:.3g} m from the start, but at top speed the slowest member "
        f"(traction {problem.fleet.slowest:g}) drives {speed * deadline:.3g} m by {deadline:g} s"
    )
    hint = "raise fleet.input_bounds.v"
    if speed > 0:
        needed = f"{distance / speed:.3g} s at {speed:.3g} m/s"
        hint = f"it needs {needed}: allow more time or raise fleet.input_bounds.v"
    return Finding(("task",), message, hint, offset=_offset(leaf))


def _offset(leaf: Inside) -> int | None:
    """Place of a leaf in its text."""
    return leaf.column - 1 if leaf.column else None
