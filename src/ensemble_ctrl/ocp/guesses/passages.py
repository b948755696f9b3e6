"""Whether any way leads past the obstacles at all, before commands are searched that follow one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.checks.presence import Presence, alternatives
from ensemble_ctrl.problem.checks.walls import Piece, pieces

Floats = NDArray[np.float64]

SPARE = 0.1, 1e-6
"""Room on each side that a passage leaves at least: as a share of `solve.margin`, and of the map's size."""
ARC = 32
"""Segments of a quarter of a circle."""


def closed_off(problem: Problem) -> tuple[str, ...]:
    """Regions that no passage leads to, one for each way of doing the task; none if some way may be open.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    tuple of str
        Names of regions.

    Notes
    -----
    *Guarantee*: none. Obstacles that only touch, or leave less room than `SPARE`, count as closed. A search may end by
    that, but it is no proof that there is no plan, as a wall of `ensemble_ctrl.problem.checks.walls` is.
    """
    if len(problem.fleet.places) != 2:
        return ()
    found: list[str] = []
    for way in alternatives(problem):
        first = next((presence.leaf.name for presence in way if _is_behind(problem, way, presence)), None)
        if first is None:
            return ()
        found.append(first)
    return tuple(dict.fromkeys(found))


def _is_behind(problem: Problem, way: Sequence[Presence], presence: Presence) -> bool:
    """Whether no passage leads from the start to a region until members have to be there."""
    from shapely import MultiPoint

    region = problem.regions.get(presence.leaf.name)
    if region is None or region.is_empty or not region.is_bounded or len(region.vertices) < 3:
        return False
    parts = pieces(problem, way, presence.latest)
    goal = MultiPoint(region.vertices - problem.fleet.start_place).convex_hull
    return bool(parts) and not connected(_blocked(problem, parts), np.zeros(2), goal)


def _blocked(problem: Problem, parts: Sequence[Piece]) -> Any:
    """Where the planned point may not be, or has less room than `SPARE`."""
    from shapely import MultiPoint, union_all

    corners = np.concatenate([part.corners for part in parts])
    spare = SPARE[0] * problem.solve.margin + SPARE[1] * (1.0 + float(np.ptp(corners, axis=0).max()))
    hulls = [MultiPoint(part.corners).convex_hull.buffer(part.radius + spare, quad_segs=ARC) for part in parts]
    return union_all(hulls)


def connected(blocked: Any, start: Floats, goal: Any) -> bool:
    """Whether a way leads from a place to a shape around what is blocked; True where the place itself is blocked.

    Parameters
    ----------
    blocked : shapely geometry
    start : ndarray, shape (2,)
        Metres.
    goal : shapely geometry
    """
    import shapely

    at = shapely.Point(start)
    if blocked.covers(at):
        return True
    # one frame around everything: what is outside is one piece
    left, down, right, up = shapely.union_all([blocked, at, goal]).bounds
    pad = 1.0 + right - left + up - down
    free = shapely.box(left - pad, down - pad, right + pad, up + pad).difference(blocked)
    return any(part.covers(at) and part.intersects(goal) for part in shapely.get_parts(free))


__all__ = ["closed_off", "connected"]
