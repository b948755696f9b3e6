"""The certified tube of a fleet: areas that hold every member of a slice of the parameter's range at every instant."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from ensemble_ctrl.certificate.enclosure import Flow
from ensemble_ctrl.certificate.errors import Unenclosed
from ensemble_ctrl.certificate.tube import enclosed, general
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.starts import by_start
from ensemble_ctrl.report.map_content import VIEWS, View

Floats = NDArray[np.float64]

SLICES = 12
"""Slices of the first parameter's range, for robots on arcs."""
SLICE_STEPS = 200_000
"""Steps of all slices together: fewer slices for very long horizons."""
GENERAL_SLICES = 16
"""The same for other systems, whose cells are halved: a power of two."""
CELLS = {1: 1, 2: 4, 3: 3}
"""Cells of each of the other parameters, for so many parameters in all; else 2."""
PIECES = 100
"""About as many pieces of time; the steps in one piece share a convex hull."""
SMOOTH = 4e-4
"""Shares of the map's size by which outlines may be made simpler; they grow by as much."""


@dataclass(frozen=True, eq=False)
class Ribbon:
    """Where the members of one slice may be, at any time.

    Attributes
    ----------
    share : float
        Middle of the slice in the first parameter's range, 0 to 1.
    outlines : tuple of ndarray, shape (corners, 2)
        Rings of the area in metres, to be filled by the even-odd rule.
    """

    share: float
    outlines: tuple[Floats, ...]


def tubes(problem: Problem, controls: Floats) -> dict[View | None, tuple[Ribbon, ...]]:
    """Areas that hold the centres of all members at all times, a slice of the first parameter each, for each view.

    Parameters
    ----------
    problem : Problem
        Fleet and horizon.
    controls : ndarray, shape (steps, n_u)
        Broadcast commands.

    Returns
    -------
    dict of (int, int) or None to tuple of Ribbon
        By the views of `ensemble_ctrl.report.map_content.VIEWS`; empty for systems of which there is no enclosure.

    Notes
    -----
    *Guarantee*: every member, under every disturbance within the fleet's bounds, is inside its slice's area at every
    instant. A piece of time of a slice
    is the convex hull of the certificate's enclosures, so the areas are larger than what the fleet needs; how much
    closer the certificate comes by splitting is not shown. The robots' radius is not in it.
    """
    if problem.fleet.starts:
        found: dict[View | None, tuple[Ribbon, ...]] = {}
        for one in by_start(problem).values():
            found = {view: (*found.get(view, ()), *ribbons) for view, ribbons in tubes(one, controls).items()}
        return found
    if problem.fleet.enclosure == "arcs":
        return {VIEWS[2][0]: _ribbons(*_of_arcs(problem, controls))}
    views = VIEWS.get(len(problem.fleet.places), (None,))
    slices = GENERAL_SLICES if problem.fleet.names and problem.fleet.upper[0] > problem.fleet.lower[0] else 1
    timed = problem.step if views == (None,) else 0.0
    try:
        hulls = general(problem, controls, problem.fleet.parameters, slices, timed)
    except Unenclosed:
        return {}
    shown = {view: hulls.points if view is None else hulls.points[..., list(view)] for view in views}
    return {view: _ribbons(points, hulls.radius, slices) for view, points in shown.items()}


def _of_arcs(problem: Problem, controls: Floats) -> tuple[Floats, Floats, int]:
    """The tube of robots on arcs as points, radii and slices."""
    flow = Flow.of(problem, controls)
    count = len(flow.lower)
    most = min(SLICES, max(2, SLICE_STEPS // problem.steps))
    # `most` cells along the first parameter times CELLS along each other one
    each = np.array([most, *[CELLS.get(count, 2)] * (count - 1)][:count], dtype=int)
    slices = most if count and flow.upper[0] > flow.lower[0] else 1
    found = enclosed(flow, each)
    return found.points, found.radius + flow.rounding(), slices


def _ribbons(points: Floats, radius: Floats, slices: int) -> tuple[Ribbon, ...]:
    """Areas from points (steps, cells, corners, 2) and radii (steps, cells), cells in the order of slices."""
    # per slice and piece of time: the convex hull of all corners, grown by the largest radius
    pieces = _pieces(len(points))
    points = points[pieces].swapaxes(1, 2)  # pieces, cells, steps in one, corners, 2
    points = points.reshape(len(pieces), slices, -1, 2).swapaxes(0, 1)
    radius = radius[pieces].max(axis=1).reshape(len(pieces), slices, -1).max(axis=2).T
    hulls = shapely.convex_hull(shapely.multipoints(points))
    grown = shapely.buffer(hulls, radius, join_style="mitre", cap_style="square")
    tolerance = SMOOTH * max(float(np.ptp(points.reshape(-1, 2), axis=0).max()), 1e-6)
    return tuple(
        Ribbon((k + 0.5) / slices if slices > 1 else 0.3, _rings(shapely.union_all(parts), tolerance))
        for k, parts in enumerate(grown)
    )


def _pieces(steps: int) -> NDArray[np.int64]:
    """Steps that go together, shape (pieces, steps in one); the last piece repeats the last step."""
    # ceil(steps / PIECES) steps to a piece
    together = -(-steps // PIECES)
    return np.minimum(np.arange(-(-steps // together) * together), steps - 1).reshape(-1, together)


def _rings(area: shapely.Geometry, tolerance: float) -> tuple[Floats, ...]:
    """The rings of an area that holds `area` and has fewer corners."""
    # simplifying moves the border by at most the tolerance: grown by as much, the area still holds the tube
    larger = shapely.buffer(shapely.simplify(area, tolerance), tolerance, join_style="mitre")
    polygons = shapely.get_parts(larger)
    rings = [shapely.get_rings(polygon) for polygon in polygons]
    return tuple(shapely.get_coordinates(ring) for found in rings for ring in found)
