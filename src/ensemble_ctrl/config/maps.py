"""Polygons from well-known text and GeoJSON; shapely is imported at the first use."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.config.source import MAX_MAP_BYTES, read_bytes, text_of
from ensemble_ctrl.config.tree import TextError
from ensemble_ctrl.config.wrong import Wrong, show

Corners = NDArray[np.float64]


def polygons_from_wkt(text: str) -> list[Corners]:
    """Corners of the polygons of a POLYGON, a MULTIPOLYGON or a collection of them, in metres."""
    import shapely

    try:
        geometry = shapely.from_wkt(text)
    except shapely.errors.GEOSException:
        raise Wrong(f"expected WKT, got {show(text)}", "for example 'POLYGON ((0 0, 2 0, 1 1, 0 0))'") from None
    return _polygons(geometry)


def polygons_from_file(path: Path) -> list[Corners]:
    """Corners of the polygons in a GeoJSON or WKT file, in metres."""
    import shapely

    try:
        text = text_of(read_bytes(path, MAX_MAP_BYTES), MAX_MAP_BYTES)
    except TextError as error:
        raise Wrong(f"{path}: {error.message}", error.hint) from None
    if not text.lstrip().startswith("{"):
        return polygons_from_wkt(text.strip())
    try:
        return _polygons(shapely.from_geojson(text))
    except shapely.errors.GEOSException as error:
        raise Wrong(f"{path}: expected GeoJSON or WKT, got an error from its reader: {error}") from None


def _polygons(geometry: Any) -> list[Corners]:
    """Corners of every polygon, without the repeated last one."""
    parts = [part for outer in getattr(geometry, "geoms", [geometry]) for part in getattr(outer, "geoms", [outer])]
    found = []
    for part in parts:
        if part.geom_type != "Polygon" or part.is_empty:
            raise Wrong(f"expected polygons, got {'an empty one' if part.is_empty else part.geom_type}")
        if part.interiors:
            raise Wrong("expected polygons without holes, got one with a hole", "split it along the hole")
        found.append(np.asarray(part.exterior.coords)[:-1, :2])
    if not found:
        raise Wrong("expected at least one polygon, got none")
    return found
