"""Maps from other tools as named areas: GeoJSON, well-known text and occupancy grids; shapely is loaded when needed."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.config.geojson import Shape, shapes_of
from ensemble_ctrl.config.occupancy import read_occupancy
from ensemble_ctrl.config.source import MAX_MAP_BYTES, read_bytes, text_of
from ensemble_ctrl.config.tree import TextError
from ensemble_ctrl.config.wrong import Wrong, show
from ensemble_ctrl.constraints import Obstacle, convex_cover, convex_pieces
from ensemble_ctrl.constraints.polygon import LARGEST
from ensemble_ctrl.errors import ProblemError

Floats = NDArray[np.float64]

MAX_PIECES = 1_000
MAX_CORNERS = 10_000
"""Convex pieces and corners that one map may have, before and after they are cut: a problem file has to hold them."""
MAX_NESTING = 20
CELLS = 2.0
"""Cells by which an occupancy grid may grow unless a tolerance is given."""
_EXAMPLE = "for example 'POLYGON ((0 0, 2 0, 1 1, 0 0))'"
_SIMPLER = "give a tolerance (in metres), or cut out what you need"


@dataclass(frozen=True, eq=False)
class Area:
    """A named area of a map.

    Attributes
    ----------
    name : str
        Empty where the map gives none.
    corners : tuple of ndarray, shape (corners, 2)
        Of its convex pieces, counter-clockwise, metres.
    region : bool
        Whether it is meant as a region, not as an obstacle.
    """

    name: str
    corners: tuple[Floats, ...]
    region: bool = False

    @property
    def pieces(self) -> tuple[Obstacle, ...]:
        """Its convex pieces."""
        return tuple(Obstacle.box(box_of(c)) if is_box(c) else Obstacle.polygon(c) for c in self.corners)


def is_box(corners: Floats) -> bool:
    """Whether a convex polygon is a rectangle along the axes."""
    ends = np.array([corners.min(axis=0), corners.max(axis=0)])
    return len(corners) == 4 and bool((corners[:, None] == ends).any(axis=1).all())


def box_of(corners: Floats) -> Floats:
    """The smallest box along the axes round some points, ``[[x low, x high], [y low, y high]]``."""
    return np.column_stack([corners.min(axis=0), corners.max(axis=0)])


def area_of_polygon(corners: Sequence[tuple[float, float]]) -> Area:
    """A polygon that stands in a problem file, by the same rule as one of a map.

    Raises
    ------
    TextError
        If it is not simple, or too large.
    """
    (area,) = _areas([Shape("", [list(corners)], "")], 0.0)
    return area


def areas_from_wkt(text: str, tolerance: float = 0.0) -> list[Area]:
    """The polygons of a POLYGON, a MULTIPOLYGON or a collection of them, in metres, as one area.

    Raises
    ------
    TextError
        If it is not WKT, or holds something else.
    """
    import shapely

    if _nesting(text) > MAX_NESTING:
        raise TextError(f"expected WKT nested at most {MAX_NESTING} deep, got more")
    try:
        with np.errstate(invalid="ignore"):  # NaN is told of below
            geometry = shapely.from_wkt(text)
    except shapely.errors.GEOSException:
        raise TextError(f"expected WKT, got {show(text)}", hint=_EXAMPLE) from None
    return _areas(list(_shapes(geometry)), tolerance)


def areas_from_file(path: Path, tolerance: float | None = None) -> list[Area]:
    """The areas of a map: features of a GeoJSON file by their names, a WKT file as one, an occupancy grid as one.

    Parameters
    ----------
    path : Path
        GeoJSON, WKT, or the ``.yaml`` that goes with an image of an occupancy grid.
    tolerance : float, optional
        Metres by which areas may grow, so that they need fewer pieces: 0, or `CELLS` of a grid's cells, if not given.

    Raises
    ------
    TextError
        If it can't be read, with the place where that is known; if it holds something else than polygons; if it is too
        large.

    Notes
    -----
    *Guarantee*: the pieces cover the areas, and nothing further than the tolerance from them.
    """
    if path.suffix.lower() in (".pgm", ".png"):
        raise TextError(
            "expected a map, got an image alone", hint="name the .yaml that tells its resolution and origin"
        )
    text = text_of(read_bytes(path, MAX_MAP_BYTES), MAX_MAP_BYTES)
    if path.suffix.lower() in (".yaml", ".yml"):
        return [_grid(path, text, tolerance)]
    if text.lstrip().startswith(("{", "[")):
        return _areas(shapes_of(text), tolerance or 0.0)
    return areas_from_wkt(text.strip(), tolerance or 0.0)


def _grid(path: Path, text: str, tolerance: float | None) -> Area:
    """The occupied cells of a grid."""
    cells = read_occupancy(path, text)
    try:
        corners = cells.pieces(CELLS * cells.size if tolerance is None else tolerance)
    except ProblemError as error:
        raise TextError(str(error).partition(": ")[2], hint="give a larger tolerance (in metres)") from None
    return Area("walls", _no_more_than_fit(corners))


def _areas(shapes: list[Shape], tolerance: float) -> list[Area]:
    """Polygons by the names of their features."""
    if not shapes:
        raise TextError("expected at least one polygon, got none")
    if len(shapes) > MAX_PIECES:
        raise TextError(f"expected at most {MAX_PIECES} polygons, got {len(shapes)}", hint="cut out what you need")
    count = sum(len(ring) for shape in shapes for ring in shape.rings)
    if count > MAX_CORNERS:
        raise TextError(f"expected at most {MAX_CORNERS} corners, got {count}", hint="simplify the polygons first")
    for shape in shapes:
        _check_size(shape)
    named: dict[tuple[str, bool], list[Floats]] = {}
    for shape in shapes:
        named.setdefault((shape.name, shape.region), []).extend(_cut(shape, 0.0 if shape.region else tolerance))
    _no_more_than_fit([piece for pieces in named.values() for piece in pieces])
    return [Area(name, tuple(pieces), region) for (name, region), pieces in named.items()]


def _check_size(shape: Shape) -> None:
    """Refuse coordinates that no robot will ever see."""
    for x, y in (corner for ring in shape.rings for corner in ring):
        if not max(abs(x), abs(y)) <= LARGEST:
            where = f"{shape.where}: " if shape.where else ""
            raise TextError(f"{where}expected coordinates of at most {LARGEST:g} m, got [{x:g}, {y:g}]")


def _cut(shape: Shape, tolerance: float) -> list[Floats]:
    """The convex pieces of one polygon."""
    outline, *holes = shape.rings
    try:
        if tolerance == 0:
            return convex_pieces(outline, holes)
        return convex_cover(outline, holes, tolerance)
    except ProblemError as error:
        where = f"{shape.where}: " if shape.where else ""
        name = f"{shape.name!r}: " if shape.name else ""
        raise TextError(f"{where}{name}{str(error).partition(': ')[2]}") from None


def _no_more_than_fit(pieces: Sequence[Floats]) -> tuple[Floats, ...]:
    """The pieces, if a problem file can hold them."""
    count = sum(map(len, pieces))
    if len(pieces) > MAX_PIECES or count > MAX_CORNERS:
        wanted = f"at most {MAX_PIECES} convex pieces with {MAX_CORNERS} corners"
        raise TextError(f"expected {wanted}, got {len(pieces)} with {count}", hint=_SIMPLER)
    return tuple(pieces)


def _shapes(geometry: Any) -> Iterable[Shape]:
    """The polygons of a shapely geometry."""
    if hasattr(geometry, "geoms"):
        for part in geometry.geoms:
            yield from _shapes(part)
        return
    if geometry.geom_type != "Polygon" or geometry.is_empty:
        raise TextError(f"expected polygons, got {'an empty one' if geometry.is_empty else geometry.geom_type}")
    rings = [np.asarray(ring.coords)[:-1, :2] for ring in (geometry.exterior, *geometry.interiors)]
    yield Shape("", [[(float(x), float(y)) for x, y in ring] for ring in rings], "")


def _nesting(text: str) -> int:
    """How deep the brackets of a text are nested at most."""
    depth = deepest = 0
    for bracket in re.findall(r"[()]", text):
        depth += 1 if bracket == "(" else -1
        deepest = max(deepest, depth)
    return deepest


def wrong(path: Path, error: TextError) -> Wrong:
    """What is wrong with a map, told where a problem file names it."""
    place = f":{error.place.line}:{error.place.column}" if error.place else ""
    return Wrong(f"{path}{place}: {error.message}", error.hint)
