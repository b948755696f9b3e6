"""The fleet's certified tube as GeoJSON: for each step an area that holds every member during it."""

from __future__ import annotations

from math import cos, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.tube import tube
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

QUARTER = 4
"""Corners of a quarter circle."""
GRID = 1e-6
"""Metres to which corners are rounded; areas are grown by more than that before."""


def areas(problem: Problem, controls: Floats) -> list[Any]:
    """A shapely area for each step.

    Notes
    -----
    *Guarantee*: every member of the exact model, with any parameters in the fleet's ranges, has its middle in the area
    of a step at every instant of it; rounding included.
    """
    import shapely

    found = tube(problem, controls)
    hulls = shapely.convex_hull(shapely.multipoints(found.points))
    grown = shapely.buffer(hulls, (found.radius + 2 * GRID) / cos(pi / (4 * QUARTER)), quad_segs=QUARTER)
    steps = [shapely.union_all(cells) for cells in np.atleast_2d(grown)]
    return [shapely.set_precision(area, GRID) for area in steps]


def to_geojson(problem: Problem, controls: Floats) -> dict[str, Any]:
    """Features: the area that the fleet covers altogether, then that of each step with its times."""
    import shapely

    steps = areas(problem, controls)
    whole = shapely.set_precision(shapely.union_all(steps).buffer(2 * GRID, quad_segs=1), GRID)
    facts = {
        "parameters": {name: [law.lower, law.upper] for name, law in problem.fleet.parameters.items()},
        "radius": problem.fleet.radius,
        "meaning": "the middle of every robot that follows the model is in this area from t_begin to t_end; metres",
    }
    ends = problem.times.tolist()
    features = [_feature("fleet", whole, {"t_begin": 0.0, "t_end": problem.duration, **facts})]
    for k, area in enumerate(steps):
        features.append(_feature(f"step {k}", area, {"t_begin": ends[k], "t_end": ends[k + 1]}))
    return {"type": "FeatureCollection", "name": problem.name, "features": features}


def _feature(name: str, area: Any, facts: dict[str, Any]) -> dict[str, Any]:
    """One feature; outlines counter-clockwise."""
    import shapely

    return {
        "type": "Feature",
        "properties": {"name": name, **facts},
        "geometry": shapely.geometry.mapping(shapely.orient_polygons(area)),
    }
