"""Maps from other tools as named areas: GeoJSON, well-known text and occupancy grids; shapely is loaded when needed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle, convex_cover, convex_pieces
from ensemble_ctrl.constraints.polygon import LARGEST
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config.degrees import check_places
from ensemble_ctrl.files.config.errors import FieldError
from ensemble_ctrl.files.config.geojson import Shape, shapes_of
from ensemble_ctrl.files.config.occupancy import Unknown, read_occupancy
from ensemble_ctrl.files.config.source import MAX_MAP_BYTES, read_bytes, text_of
from ensemble_ctrl.files.config.tree import TextError
from ensemble_ctrl.files.config.wkt import shapes_of_wkt

Floats = NDArray[np.float64]

MAX_PIECES = 1_000
MAX_CORNERS = 10_000
"""Convex pieces and corners that one map may have, before and after they are cut: a problem file has to hold them."""
CELLS = 2.0
"""Cells by which an occupancy grid may grow unless a tolerance is given."""
WIDER = "what is to be kept clear of needs a polygon with a width"
REPAIR = "repair the polygon first, as with shapely.make_valid, or in QGIS by Fix geometries"
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


@dataclass(frozen=True, eq=False)
class MapContent:
    """What a map holds.

    Attributes
    ----------
    areas : list of Area
    notes : tuple of str
        What its reader should know of how it was read.
    edge : ndarray, shape (4, 2), optional
        Corners of a grid, metres; beyond it nothing is known. None for maps of shapes.
    """

    areas: list[Area]
    notes: tuple[str, ...] = ()
    edge: Floats | None = None


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
    shapes, left_out = shapes_of_wkt(text)
    if left_out:
        raise TextError(f"expected polygons, got {counted(left_out)}", hint=WIDER)
    return _areas(shapes, tolerance)


def read_map(path: Path, tolerance: float | None = None, unknown: Unknown | None = None) -> MapContent:
    """The areas of a map: features of a GeoJSON file by their names, a WKT file as one, an occupancy grid as one.

    Parameters
    ----------
    path : Path
        GeoJSON, WKT (also a CSV table with a column of it), or the ``.yaml`` that goes with an occupancy grid's image.
    tolerance : float, optional
        Metres by which areas may grow, so that they need fewer pieces: 0, or `CELLS` of a grid's cells, if not given.
    unknown : {"occupied", "free"}, optional
        What the cells of a grid are that no scan has seen; see `read_occupancy`.

    Raises
    ------
    TextError
        If it can't be read, with the place where that is known; if it has no polygons; if it is too large.

    Notes
    -----
    *Guarantee*: the pieces cover the areas, and nothing further than the tolerance from them.
    """
    if path.suffix.lower() in (".pgm", ".png"):
        raise TextError(
            "expected a map, got an image alone", hint="give the .yaml beside it, with its resolution and origin"
        )
    text = text_of(read_bytes(path, MAX_MAP_BYTES), MAX_MAP_BYTES)
    if path.suffix.lower() in (".yaml", ".yml"):
        return _grid(path, text, tolerance, unknown)
    if unknown is not None:
        raise TextError("expected an occupancy grid where unknown is given, got shapes")
    shapes, left_out = shapes_of(text) if text.lstrip().startswith(("{", "[")) else shapes_of_wkt(text)
    if left_out and not shapes:
        raise TextError(f"expected at least one polygon, got only {counted(left_out)}", hint=WIDER)
    check_places([corner for shape in shapes for ring in shape.rings for corner in ring])
    notes = (f"left out {counted(left_out)}, without an area; {WIDER}",) if left_out else ()
    return MapContent(_areas(shapes, tolerance or 0.0), notes)


def counted(kinds: Sequence[str]) -> str:
    """How many there are of each kind, as ``2 Point and 1 LineString``."""
    return " and ".join(f"{count} {kind}" for kind, count in Counter(kinds).items())


def _grid(path: Path, text: str, tolerance: float | None, unknown: Unknown | None) -> MapContent:
    """The occupied cells of a grid."""
    cells, notes = read_occupancy(path, text, unknown)
    try:
        corners = cells.pieces(CELLS * cells.size if tolerance is None else tolerance)
    except ProblemError as error:
        raise TextError(str(error).partition(": ")[2], hint="give a larger tolerance (in metres)") from None
    return MapContent([Area("walls", _no_more_than_fit(corners))], notes, cells.outline)


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
        message = str(error).partition(": ")[2]
        broken = "cross itself" in message or "holes" in message
        raise TextError(f"{where}{name}{message}", hint=REPAIR if broken else "") from None


def _no_more_than_fit(pieces: Sequence[Floats]) -> tuple[Floats, ...]:
    """The pieces, if a problem file can hold them."""
    count = sum(map(len, pieces))
    if len(pieces) > MAX_PIECES or count > MAX_CORNERS:
        wanted = f"at most {MAX_PIECES} convex pieces with {MAX_CORNERS} corners"
        raise TextError(f"expected {wanted}, got {len(pieces)} with {count}", hint=_SIMPLER)
    return tuple(pieces)


def wrong(name: str, error: TextError) -> FieldError:
    """What is wrong with a map, reported where a problem file names it."""
    place = f":{error.place.line}:{error.place.column}" if error.place else ""
    return FieldError(f"{name}{place}: {error.message}", error.hint)
