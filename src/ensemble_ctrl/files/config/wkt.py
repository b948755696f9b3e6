"""Well-known text as polygons: one geometry, one a line, or a column of a table; with or without ``SRID=...;``."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ensemble_ctrl.files.config.degrees import check_system
from ensemble_ctrl.files.config.errors import show
from ensemble_ctrl.files.config.geojson import NAMES, Shape, name_among
from ensemble_ctrl.files.config.tree import Place, TextError

MAX_NESTING = 20
COLUMNS = ("wkt", "wkt_geom", "geom", "geometry", "the_geom")
"""What a column of geometries is called in tables, in small letters."""
LONGEST_HEADER = 10_000
_EXAMPLE = "for example 'POLYGON ((0 0, 2 0, 1 1, 0 0))'"
_SRID = re.compile(r"\s*SRID\s*=\s*(\d+)\s*;", re.IGNORECASE)
_START = re.compile(r"\s*(SRID|POINT|LINE|POLYGON|MULTI|GEOMETRY|TRIANGLE|TIN|CIRCULAR|COMPOUND|CURVE|SURFACE)", re.I)


def shapes_of_wkt(text: str) -> tuple[list[Shape], list[str]]:
    """Every polygon of a text, and the kinds of the points and lines beside them.

    Raises
    ------
    TextError
        If some part is not WKT, with its line where there are several; or if its coordinates are degrees.
    """
    shapes: list[Shape] = []
    left_out: list[str] = []
    for line, name, part in _parts(text):
        for geometry in _simple(_geometry(part, line)):
            if geometry.geom_type == "Polygon" and not geometry.is_empty:
                rings = [np.asarray(ring.coords)[:-1, :2] for ring in (geometry.exterior, *geometry.interiors)]
                where = "" if line is None else f"line {line}"
                shapes.append(Shape(name, [[(float(x), float(y)) for x, y in ring] for ring in rings], where))
            else:
                left_out.append("empty one" if geometry.is_empty else geometry.geom_type)
    return shapes, left_out


def _parts(text: str) -> Iterator[tuple[int | None, str, str]]:
    """Each geometry's text with its line, where there are several, and its name."""
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
    if lines and not _START.match(lines[0][1]):
        first = lines[0][1][:LONGEST_HEADER]
        header = [cell.strip().lower() for cell in next(csv.reader([first], delimiter=_separator(first)))]
        if any(cell in COLUMNS for cell in header):
            yield from _rows(text)
            return
    geometries = list(_balanced(lines))
    if len(geometries) > 1 and all(_START.match(part) for _, part in geometries):
        yield from ((i, "", part) for i, part in geometries)
    else:
        yield None, "", text


def _balanced(lines: Sequence[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    """Lines, joined where a bracket is still open, with the number of the first."""
    first, joined = 0, ""
    for i, line in lines:
        first, joined = (first, f"{joined}\n{line}") if joined else (i, line)
        if joined.count("(") <= joined.count(")"):
            yield first, joined
            joined = ""
    if joined:
        yield first, joined


def _separator(header: str) -> str:
    """What separates the cells of a table."""
    return max(",;\t", key=header.count)


def _rows(text: str) -> Iterator[tuple[int | None, str, str]]:
    """The geometries of a table, as QGIS writes them."""
    reader = csv.DictReader(text.splitlines(), delimiter=_separator(text.lstrip().splitlines()[0]))
    before = csv.field_size_limit(len(text) + 1)  # a polygon of many corners is one cell
    try:
        rows = [(reader.line_num, row) for row in reader]
    except csv.Error as error:
        raise TextError(f"expected a table, got one that can't be read ({error})", Place(reader.line_num, 1)) from None
    finally:
        csv.field_size_limit(before)
    for line, row in rows:
        column = next(key for key in row if key and key.strip().lower() in COLUMNS)
        yield line, name_among([*(row.get(key) for key in NAMES), row.get("id")]), row[column] or ""


def _geometry(text: str, line: int | None) -> Any:
    """One shapely geometry."""
    import shapely

    place = None if line is None else Place(line, 1)
    srid = _SRID.match(text)
    if srid is not None:
        check_system(f"SRID={srid[1]}")
        text = text[srid.end() :]
    if _nesting(text) > MAX_NESTING:
        raise TextError(f"expected WKT nested at most {MAX_NESTING} deep, got more", place)
    try:
        with np.errstate(invalid="ignore"):  # NaN is reported below
            return shapely.from_wkt(text.strip())
    except shapely.errors.GEOSException:
        raise TextError(f"expected WKT, got {show(text)}", place, _EXAMPLE) from None


def _simple(geometry: Any) -> Iterator[Any]:
    """The parts of a shapely geometry that have no parts."""
    if not hasattr(geometry, "geoms"):
        yield geometry
        return
    for part in geometry.geoms:
        yield from _simple(part)


def _nesting(text: str) -> int:
    """How deep the brackets of a text are nested at most."""
    depth = deepest = 0
    for bracket in re.findall(r"[()]", text):
        depth += 1 if bracket == "(" else -1
        deepest = max(deepest, depth)
    return deepest
