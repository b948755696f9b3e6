"""GeoJSON as named polygons, with what is wrong reported at its place in the file."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple, NoReturn

from ensemble_ctrl.files.config.degrees import check_system
from ensemble_ctrl.files.config.errors import is_number, show
from ensemble_ctrl.files.config.tree import Place, TextError

Ring = list[tuple[float, float]]

KINDS = ("Polygon", "MultiPolygon", "GeometryCollection", "Feature", "FeatureCollection")
WITHOUT_AREA = ("Point", "MultiPoint", "LineString", "MultiLineString")
"""What is left out, and counted."""
NAMES = ("name", "Name", "NAME", "title", "Title", "TITLE")
"""Properties that hold a feature's name; else its ``id``."""
MAX_NESTING = 10


class Shape(NamedTuple):
    """A polygon of a map.

    Attributes
    ----------
    name : str
        Of its feature, empty if it has none.
    rings : list of list of (float, float)
        Its outline, then its holes; the first corner is not repeated.
    where : str
        Where it stands in the file, such as ``features[3].geometry.coordinates``.
    region : bool
        Whether its feature has the property ``role`` with the value ``region``.
    """

    name: str
    rings: list[Ring]
    where: str
    region: bool = False


def shapes_of(text: str) -> tuple[list[Shape], list[str]]:
    """Every polygon of a GeoJSON text, in its own units, and the kinds of the points and lines beside them.

    Raises
    ------
    TextError
        If it is not JSON, not GeoJSON, or its coordinates are degrees.
    """
    try:
        data = json.loads(text, parse_constant=lambda name: _constant(text, name))
    except json.JSONDecodeError as error:
        message = f"not JSON: {error.msg[:1].lower()}{error.msg[1:]}"
        raise TextError(message, Place(error.lineno, error.colno)) from None
    except (RecursionError, ValueError) as error:
        wanted = (
            f"nested at most {MAX_NESTING} deep" if isinstance(error, RecursionError) else "numbers of usual length"
        )
        raise TextError(f"expected JSON {wanted}, got more") from None
    check_system(_system(data))
    left_out: list[str] = []
    return list(_shapes(data, ("", False), "", 0, left_out)), left_out


def _system(data: Any) -> str:
    """The name of the coordinate system that an object names, as the format allowed before 2016."""
    for key in ("crs", "properties", "name"):
        data = data.get(key) if isinstance(data, dict) else None
    return data if isinstance(data, str) else ""


def _constant(text: str, name: str) -> NoReturn:
    """Refuse NaN and the infinities, which JSON does not have."""
    found = re.search(rf"(?<![\w\"]){name}(?![\w\"])", text)
    before = text[: found.start()] if found else ""
    place = Place(before.count("\n") + 1, len(before) - before.rfind("\n")) if found else None
    raise TextError(f"expected finite numbers, got {name}", place)


def _shapes(data: Any, owner: tuple[str, bool], where: str, depth: int, left_out: list[str]) -> Iterator[Shape]:
    """The polygons of one object; `where` is its place. What has no area is named in `left_out`."""
    kind = data.get("type") if isinstance(data, dict) else None
    if kind in WITHOUT_AREA:
        left_out.append(str(kind))
        return
    if kind not in KINDS:
        got = show(kind) if isinstance(data, dict) else show(data)
        raise TextError(f"{_at(where)}expected a GeoJSON object of type {', '.join(KINDS)}, got {got}")
    if depth > MAX_NESTING:
        raise TextError(f"{_at(where)}expected objects nested at most {MAX_NESTING} deep, got more")
    match kind:
        case "FeatureCollection":
            for i, feature in enumerate(_list(data, "features", where)):
                yield from _shapes(feature, owner, _below(where, f"features[{i}]"), depth + 1, left_out)
        case "Feature":
            if data.get("geometry") is not None:
                yield from _shapes(data["geometry"], _owner(data), _below(where, "geometry"), depth + 1, left_out)
        case "GeometryCollection":
            for i, part in enumerate(_list(data, "geometries", where)):
                yield from _shapes(part, owner, _below(where, f"geometries[{i}]"), depth + 1, left_out)
        case "MultiPolygon":
            for i, rings in enumerate(_list(data, "coordinates", where)):
                yield _shape(owner, rings, _below(where, f"coordinates[{i}]"))
        case _:
            yield _shape(owner, _list(data, "coordinates", where), _below(where, "coordinates"))


def _owner(feature: dict[str, Any]) -> tuple[str, bool]:
    """What a feature is called, by one of `NAMES` or its ``id``, and whether its ``role`` is ``region``."""
    properties = feature.get("properties")
    given = properties if isinstance(properties, dict) else {}
    return name_among([*(given.get(key) for key in NAMES), feature.get("id")]), given.get("role") == "region"


def name_among(given: Iterable[Any]) -> str:
    """The first that is a name; empty without one."""
    named = (str(one) for one in given if isinstance(one, str | int) and not isinstance(one, bool) and one != "")
    return next(named, "")


def _shape(owner: tuple[str, bool], data: Any, where: str) -> Shape:
    """One polygon, each ring without its last corner, which repeats the first."""
    if not isinstance(data, list) or not data:
        raise TextError(f"{_at(where)}expected the rings of a polygon, got {show(data)}")
    rings = [_ring(ring, f"{where}[{i}]") for i, ring in enumerate(data)]
    return Shape(owner[0], rings, where, owner[1])


def _ring(data: Any, where: str) -> Ring:
    """One closed ring."""
    if not isinstance(data, list) or len(data) < 4:
        got = f"{len(data)} positions" if isinstance(data, list) else show(data)
        raise TextError(f"{_at(where)}expected a ring of at least 4 positions, got {got}")
    ring = [_position(position, f"{where}[{i}]") for i, position in enumerate(data)]
    if ring[0] != ring[-1]:
        message = f"expected a closed ring, got one from {list(ring[0])} to {list(ring[-1])}"
        raise TextError(f"{_at(where)}{message}", hint="repeat the first position at the end")
    return ring[:-1]


def _position(data: Any, where: str) -> tuple[float, float]:
    """One position; a height is left out."""
    if not isinstance(data, list) or not 2 <= len(data) <= 4 or not all(map(is_number, data)):
        raise TextError(f"{_at(where)}expected [x, y] with finite numbers, got {show(data)}")
    return float(data[0]), float(data[1])


def _list(data: dict[str, Any], key: str, where: str) -> list[Any]:
    """A member that is a list."""
    value = data.get(key)
    if not isinstance(value, list):
        raise TextError(f"{_at(where)}expected a list as {key!r}, got {show(value)}")
    return value


def _below(where: str, key: str) -> str:
    """The place of a member."""
    return f"{where}.{key}" if where else key


def _at(where: str) -> str:
    """A place, to begin a message with."""
    return f"{where}: " if where else ""
