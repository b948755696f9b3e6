"""Bodies: a start that overlaps an obstacle, and gaps that are too narrow."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.disc import disc_of
from ensemble_ctrl.constraints.footprint import Footprint
from ensemble_ctrl.problem.checks.finding import SLACK, Finding
from ensemble_ctrl.problem.checks.reach import required

if TYPE_CHECKING:
    from shapely import Geometry

    from ensemble_ctrl.constraints import Polyhedron
    from ensemble_ctrl.problem.problem import Problem

Floats = NDArray[np.float64]


def body_findings(problem: Problem) -> Iterator[Finding]:
    """What certainly has no plan for bodies of this size; nothing of other fleets."""
    fleet, body = problem.fleet, problem.fleet.footprint
    if body is None or not fleet.system.on_arcs:
        return
    overlaps = list(_overlapping(problem, body))
    yield from overlaps
    if not overlaps:
        yield from _stuck(problem, body)


def _overlapping(problem: Problem, body: Footprint) -> Iterator[Finding]:
    """Obstacles that the body overlaps at the start, of the middle member or one at a corner of the ranges."""
    fleet = problem.fleet
    starts = fleet.start_states(np.concatenate([fleet.center[None], fleet.corners]))
    places = starts[[fleet.system.states.index(name) for name in fleet.places]].T
    headings = starts[fleet.system.states.index(fleet.system.heading_state)]
    for avoid in problem.specification.avoid:
        if avoid.footprint is None or avoid.begin > 0:
            continue
        seen = places - avoid.offsets(np.zeros(1))[0]
        depth = avoid.radius - min(float(body.distance(piece, seen, headings).min()) for piece in avoid.pieces)
        if depth > SLACK:
            more = f", grown by the radius {fleet.radius:g} m" if fleet.radius else ""
            what = f"the body ({body}{more}) overlaps obstacle {avoid.name!r} by {depth:.3g} m at the start"
            yield Finding(("fleet", "start", "position"), what, "move the start or the obstacle")


def _stuck(problem: Problem, body: Footprint) -> Iterator[Finding]:
    """Regions to which no way of the planned point leaves room for the largest disc around it in the body."""
    from shapely import Point, box, union_all

    room = body.narrow + problem.fleet.radius - SLACK
    still = [one for one in problem.specification.avoid if one.motion is None and one.footprint is not None]
    still = [one for one in still if one.begin <= 0 and one.end >= problem.duration - 1e-9]
    shapes = [_grown(piece.core, piece.rounding + room) for one in still for piece in one.pieces]
    if not shapes or room <= 0:
        return
    start, blocked = Point(*problem.fleet.start_place), union_all(shapes)
    for leaf, _ in required(problem.task, 0.0, problem.duration):
        region = problem.regions.get(leaf.name)
        if region is None or not region.is_bounded or region.is_empty:
            continue
        goal = _outer(region)
        # everything that is free within a frame wide enough to pass on the outside
        left, down, right, up = union_all([blocked, goal, start]).bounds
        wide = 10 * (room + body.reach)
        free = box(left - wide, down - wide, right + wide, up + wide).difference(blocked)
        pieces = [part for part in getattr(free, "geoms", [free]) if part.distance(start) <= SLACK]
        if not any(part.distance(goal) <= SLACK for part in pieces):
            what = f"no way from the start to {leaf.name!r} is wide enough for the body ({body})"
            hint = f"the planned point needs {room + SLACK:.3g} m to each side: widen a gap, or take a narrower body"
            yield Finding(("fleet", "footprint"), what, hint)
            return


def _outer(region: Polyhedron) -> Geometry:
    """A region as a polygon that holds all of it."""
    from shapely import MultiPoint

    disc = disc_of(region)
    return MultiPoint(region.vertices if disc is None else disc.vertices).convex_hull


def _grown(core: Floats, more: float) -> Geometry:
    """A convex shape grown by some metres, a little less where that has round corners."""
    from shapely import MultiPoint

    return MultiPoint(core).convex_hull.buffer(more)
