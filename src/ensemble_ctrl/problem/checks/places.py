"""The map: regions without a point, goals under obstacles, a start inside one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.disc import corners_around
from ensemble_ctrl.constraints.stl import Share, conjuncts
from ensemble_ctrl.problem.checks.finding import SLACK, Finding, Severity
from ensemble_ctrl.problem.checks.presence import alternatives
from ensemble_ctrl.problem.checks.task import mentioned

if TYPE_CHECKING:
    from shapely import Polygon

    from ensemble_ctrl.problem.problem import Problem

Floats = NDArray[np.float64]


def area_findings(problem: Problem) -> Iterator[Finding]:
    """Regions without a point or without an end, and goals that obstacles cover."""
    inside, _ = mentioned(problem)
    needed = set.intersection(*({presence.leaf.name for presence in way} for way in alternatives(problem)))
    for name, region in problem.regions.items():
        path = ("regions", name)
        if region.is_empty:
            yield Finding(path, "this region is empty: no point satisfies all of its inequalities", on_key=True)
        elif not region.is_bounded:
            yield Finding(path, "this region is unbounded", "close it if that is not meant", "warning", on_key=True)
        elif name in inside and len(problem.fleet.places) == 2 and _is_covered(region, problem):
            names = ", ".join(_near(region, problem))
            message = f"obstacles cover the whole region: {names}{_grown(problem)}"
            severity: Severity = "error" if name in needed else "warning"
            yield Finding(path, message, "move the region or the obstacles", severity, on_key=True)


def _near(region: Polyhedron, problem: Problem) -> list[str]:
    """Names of the obstacles that touch a region's bounding box, grown by the radius."""
    low, high = region.vertices.min(axis=0), region.vertices.max(axis=0)
    touching: dict[str, None] = {}
    for name, piece in problem.pieces:
        below = piece.vertices.min(axis=0) - problem.fleet.radius
        beyond = piece.vertices.max(axis=0) + problem.fleet.radius
        if (below <= high).all() and (beyond >= low).all():
            touching[name] = None
    return list(touching)


def _is_covered(region: Polyhedron, problem: Problem) -> bool:
    """Whether no point of a region is clear of the obstacles, grown by the radius."""
    body = problem.fleet.footprint
    if len(region.vertices) < 3 or not (body is None or body.holds_point):
        return False
    still = [name for name in _near(region, problem) if name not in problem.motions]
    near = [piece for name in still for piece in problem.obstacles[name]]
    if not near or any(_is_clear(point, near, problem.fleet.radius) for point in _probes(region)):
        return False
    from shapely import Polygon, union_all

    # covered: the region, or the polygon around a disc, less the obstacles, grown by the radius, has no area
    grown = union_all([_shape(piece, problem.fleet.radius) for piece in near])
    area = Polygon(corners_around(region))
    return bool(area.difference(grown).area <= SLACK * area.area)


def _probes(region: Polyhedron) -> Iterator[Floats]:
    """A region's middle and its corners, moved in a little."""
    middle = region.vertices.mean(axis=0)
    yield middle
    for corner in region.vertices:
        yield 0.99 * corner + 0.01 * middle


def _is_clear(point: Floats, pieces: Iterable[Obstacle], radius: float) -> bool:
    """Whether a point is further than a radius from every piece."""
    return all(float(piece.distance(point)) > radius for piece in pieces)


def start_findings(problem: Problem) -> Iterator[Finding]:
    """The start is in an obstacle, or closer to it than the radius; or some of the starts are, where they differ."""
    fleet, path = problem.fleet, ("fleet", "start", "position")
    if fleet.footprint is not None:
        return  # of bodies: `ensemble_ctrl.problem.checks.bodies`
    enough = any(isinstance(part, Share) for part in conjuncts(problem.task))
    for name, pieces in problem.obstacles.items():
        moved = problem.motions[name].at(0.0) if name in problem.motions else np.zeros(len(fleet.places))
        starts = fleet.start_place[None] if enough or fleet.shift.any() else _starts(problem)
        depths = fleet.radius - np.min([piece.distance(starts - moved) for piece in pieces], axis=0)
        if depths.max() > SLACK:
            worst = 0 if depths[0] > SLACK else int(depths.argmax())
            place = ", ".join(f"{x:g}" for x in starts[worst])
            message = f"the start ({place}) is {depths[worst]:.3g} m deep inside obstacle {name!r}{_grown(problem)}"
            yield Finding(path, message, "move the start or the obstacle")
        elif not enough and fleet.shift.any() and _some_start(problem, name, moved):
            message = f"some members start inside obstacle {name!r}{_grown(problem)}: start_x and start_y reach it"
            yield Finding(path, message, "narrow their ranges, or move the start or the obstacle")


def _starts(problem: Problem) -> Floats:
    """Where the middle member starts, and those at the corners of the ranges, shape (starts, d)."""
    fleet = problem.fleet
    members = np.concatenate([fleet.center[None], fleet.corners])
    columns = [fleet.system.states.index(place) for place in fleet.places]
    return np.asarray(fleet.start_states(members)[columns].T)


def _some_start(problem: Problem, name: str, moved: Floats) -> bool:
    """Whether the box of start positions meets an obstacle, which has `moved` from where it is drawn."""
    from shapely import box

    start, fleet = problem.fleet.start_place - moved, problem.fleet
    # box of start positions against the obstacle grown by the radius
    area = box(*(start - fleet.shift), *(start + fleet.shift))
    shapes = [_shape(piece, fleet.radius - SLACK) for piece in problem.obstacles[name]]
    return any(shape.intersects(area) for shape in shapes)


def _shape(piece: Obstacle, more: float) -> Polygon:
    """An obstacle grown by some metres, for shapely; a little less where that has round corners."""
    from shapely import MultiPoint

    return MultiPoint(piece.core).convex_hull.buffer(piece.rounding + more)


def _grown(problem: Problem) -> str:
    """A remark that obstacles are larger than they are drawn."""
    return f", grown by the radius {problem.fleet.radius:g} m" if problem.fleet.radius else ""
