"""The fleet's certified tube as GeoJSON: for each step an area that holds every member during it.

Of robots in space it is the area seen from above, with the lowest and the highest place; of robots on a line, a line.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.errors import Unenclosed
from ensemble_ctrl.certificate.tube import tube
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import UnsupportedError
from ensemble_ctrl.files.config.footprint_section import footprint_data
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.starts import by_start, label

Floats = NDArray[np.float64]

QUARTER = 4
"""Corners of a quarter circle."""
GRID = 1e-6
"""Metres to which corners are rounded; areas are grown by more than that before."""


@dataclass(frozen=True, eq=False)
class Area:
    """Where the fleet is during some time.

    Attributes
    ----------
    outline : shapely.Geometry
        In the first two coordinates, metres.
    heights : tuple of float
        The lowest and the highest value of the third one; empty where there is none.
    """

    outline: Any
    heights: tuple[float, ...] = ()


def areas(problem: Problem, controls: Floats) -> list[Area]:
    """The area of each step, of members that start at one place.

    Raises
    ------
    UnsupportedError
        For a system that is defined by an ODE, if the certificate has no enclosure of it.

    Notes
    -----
    *Guarantee*: every member with any parameters in the fleet's ranges, under every disturbance within its bounds, has
    its middle in the area of a step, between its heights, at every instant of it; rounding included.
    """
    import shapely

    try:
        found = tube(problem, controls)
    except Unenclosed as error:
        raise UnsupportedError(f"geojson: nothing is proven of where the fleet is: {error}") from None
    # least and largest coordinates of each step over cells and corners, with the radius and two roundings to GRID
    low, high = ((found.points + way * found.radius[..., None, None]) for way in (-1, 1))
    low, high = low.min(axis=(1, 2)) - 2 * GRID, high.max(axis=(1, 2)) + 2 * GRID
    if low.shape[1] == 1:
        lines = (shapely.LineString([(a, 0.0), (b, 0.0)]) for a, b in zip(low[:, 0], high[:, 0], strict=True))
        return [Area(shapely.set_precision(line, GRID)) for line in lines]
    # each cell: the convex hull of its points, grown by its radius; each step: the union of its cells
    hulls = shapely.convex_hull(shapely.multipoints(found.points[..., :2]))
    # a polygon of 4 QUARTER sides holds a disk if its corners are 1 / cos(pi / (4 QUARTER)) times as far out
    grown = shapely.buffer(hulls, (found.radius + 2 * GRID) / cos(pi / (4 * QUARTER)), quad_segs=QUARTER)
    shapes = [shapely.set_precision(shapely.union_all(cells), GRID) for cells in np.atleast_2d(grown)]
    ends = np.stack([low, high], axis=1)[..., 2:].reshape(len(low), -1).tolist()
    return [Area(shape, tuple(heights)) for shape, heights in zip(shapes, ends, strict=True)]


def to_geojson(problem: Problem, controls: Floats) -> dict[str, Any]:
    """Features: the area that the fleet covers altogether, then that of each step with its times, for each start."""
    import shapely

    found, places = {start: areas(one, controls) for start, one in by_start(problem).items()}, problem.fleet.places
    every = [area for steps in found.values() for area in steps]
    union = shapely.union_all([area.outline for area in every])
    # the union over all steps, in the plane grown by more than the rounding to GRID
    grown = shapely.line_merge(union) if len(places) == 1 else union.buffer(2 * GRID, quad_segs=1)
    whole = shapely.set_precision(grown, GRID)
    heights = np.array([area.heights for area in every])
    all_ = Area(whole, (float(heights[:, 0].min()), float(heights[:, 1].max())) if len(places) == 3 else ())
    where = "area" if len(places) < 3 else f"area, {places[2]} between its ends,"
    follows = "is disturbed within the bounds" if problem.uncertain else "follows the model"
    starts = problem.fleet.starts
    facts: dict[str, Any] = {
        "parameters": {
            name: [distribution.lower, distribution.upper] for name, distribution in problem.fleet.parameters.items()
        },
        "radius": problem.fleet.radius,
        **footprint_data(problem.fleet.footprint),
        **({"starts": {name: list(place) for name, place in starts.items()}} if starts else {}),
        "axes": list(places[:2]),
        "meaning": f"the middle of every robot that {follows} is in this {where} from t_begin to t_end; metres",
    }
    ends = problem.times.tolist()
    features = [_feature("fleet", all_, places, {"t_begin": 0.0, "t_end": problem.duration, **facts})]
    for start, steps in found.items():
        own = {"start": start} if start else {}
        for k, area in enumerate(steps):
            facts = {"t_begin": ends[k], "t_end": ends[k + 1], **own}
            features.append(_feature(label(f"step {k}", start), area, places, facts))
    return {"type": "FeatureCollection", "name": problem.name, "features": features}


def _feature(name: str, area: Area, places: Sequence[str], facts: dict[str, Any]) -> dict[str, Any]:
    """One feature; outlines counter-clockwise."""
    import shapely

    heights = dict(zip([f"{places[-1]}_min", f"{places[-1]}_max"], area.heights, strict=False))
    return {
        "type": "Feature",
        "properties": {"name": name, **facts, **heights},
        "geometry": shapely.geometry.mapping(shapely.orient_polygons(area.outline)),
    }
