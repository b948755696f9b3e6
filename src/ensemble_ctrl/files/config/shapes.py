"""Areas of the map: boxes, polygons, half-planes, and obstacles from WKT and GeoJSON."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PrivateAttr,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)

from ensemble_ctrl.constraints import Disc, DiscRegion, Obstacle, Polyhedron, Solid
from ensemble_ctrl.constraints.stl import Predicate, parse
from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.files.config import fields as f
from ensemble_ctrl.files.config.errors import FieldError, show, suggestion
from ensemble_ctrl.files.config.maps import Area, MapContent, area_of_polygon, areas_from_wkt, read_map, wrong
from ensemble_ctrl.files.config.occupancy import Unknown
from ensemble_ctrl.files.config.source import checked_path
from ensemble_ctrl.files.config.tree import TextError
from ensemble_ctrl.problem.checks import STATES

Pieces = tuple[Obstacle, ...]
Floats = NDArray[np.float64]
Built = TypeVar("Built")
_EXAMPLE = "for example 'x + 2*y <= 3'"
_FEATURE = ("feature",)


def _side(bounds: tuple[float, float]) -> tuple[float, float]:
    """A side of a box, with a length."""
    if bounds[0] >= bounds[1]:
        raise FieldError(f"expected [low, high] with low below high, got [{bounds[0]:g}, {bounds[1]:g}]")
    return bounds


def _places(info: ValidationInfo) -> tuple[str, ...]:
    """Names of the position's coordinates."""
    return tuple((info.context or {}).get("places", STATES))


def _halfplane(value: Any, info: ValidationInfo) -> Predicate:
    """A linear inequality in the position's coordinates, x and y in the plane."""
    predicate, places = parse(value) if isinstance(value, str) else None, _places(info)
    wanted = f"an inequality in {' and '.join(places)}"
    if not isinstance(predicate, Predicate):
        raise FieldError(f"expected {wanted}, got {show(value)}", _EXAMPLE)
    unknown = [name for name, _ in predicate.coefficients if name not in places]
    if unknown:
        raise FieldError(f"expected {wanted}, got the unknown {unknown[0]!r}", _EXAMPLE)
    return predicate


def _sides(value: Any, info: ValidationInfo) -> Any:
    """One [low, high] for each coordinate."""
    places = _places(info)
    if not isinstance(value, list | tuple) or len(value) != len(places):
        shape = ", ".join(f"[{name} low, {name} high]" for name in places)
        raise FieldError(f"expected [{shape}], got {show(value)}")
    return value


def _some(values: list[Any]) -> list[Any]:
    """A list that is not empty."""
    if not values:
        raise FieldError("expected at least one inequality, got an empty list", _EXAMPLE)
    return values


Side = Annotated[tuple[f.Length, f.Length], BeforeValidator(f.pair("[low, high]")), AfterValidator(_side)]
Box = Annotated[tuple[Side, ...], BeforeValidator(_sides), Field(json_schema_extra={"minItems": 1, "maxItems": 3})]
ObstacleBox = Annotated[
    tuple[Side, ...], BeforeValidator(_sides), Field(json_schema_extra={"minItems": 2, "maxItems": 3})
]
HalfPlane = Annotated[Predicate, BeforeValidator(_halfplane), WithJsonSchema({"type": "string"})]
HalfPlanes = Annotated[list[HalfPlane], AfterValidator(_some)]


class DiscShape(f.Model):
    """All points within a radius of a centre, in the plane."""

    center: f.Point
    """`[x, y]`, metres."""
    radius: f.Size
    """Metres, above 0."""

    @property
    def disc(self) -> Disc:
        """The disc."""
        return Disc(self.center, self.radius)


class RegionShape(f.Model):
    """A convex area, in exactly one of these forms; of a map in a file, one feature."""

    box: Box | None = None
    """`[[x low, x high], [y low, y high]]`, metres."""
    polygon: list[f.Point] | None = None
    """Corners `[[x, y], ...]`, in either direction; convex."""
    disc: DiscShape | None = None
    """`{center: [x, y], radius: 0.5 m}`."""
    halfspaces: HalfPlanes | None = None
    """Inequalities `["x + 2*y <= 3", ...]`; may be unbounded."""
    file: str | None = None
    """A GeoJSON or WKT file with one convex polygon, or `feature` of it, in the problem's folder or below."""
    feature: str | None = None
    """Name of the feature in the file, if it holds several."""
    heading: f.AngleRange | None = None
    """`[80 deg, 100 deg]`: `in(...)` of the task means a heading in this range, too, whole turns aside."""
    _area: Polyhedron = PrivateAttr()

    @model_validator(mode="after")
    def _build(self, info: ValidationInfo) -> Self:
        """Build the area, so that what is wrong with it is reported with everything else."""
        _only_of_files(self, ("feature",))
        places = _places(info)
        forms: dict[str, Callable[[Any], Polyhedron]] = {
            "box": Polyhedron.box,
            "polygon": lambda corners: _convex([area_of_polygon(corners)]),
            "disc": lambda shape: DiscRegion(shape.disc),
            "halfspaces": lambda rows: _intersection(rows, places),
            "file": lambda name: _convex(_chosen(name, _content(name, 0.0, None, info), self.feature)),
        }
        self._area = _built(self, forms)
        return self

    @property
    def area(self) -> Polyhedron:
        """The area."""
        return self._area


class ObstacleShape(f.Model):
    """An obstacle, in exactly one of these forms, convex or not; of a map in a file, all features or one."""

    box: ObstacleBox | None = None
    """`[[x low, x high], [y low, y high]]`, metres."""
    polygon: list[f.Point] | None = None
    """Corners `[[x, y], ...]`, in either direction; any simple polygon."""
    disc: DiscShape | None = None
    """`{center: [x, y], radius: 0.5 m}`."""
    halfspaces: HalfPlanes | None = None
    """Inequalities `["x + 2*y <= 3", ...]`; bounded."""
    wkt: str | None = None
    """`POLYGON ((...))` or `MULTIPOLYGON`."""
    file: str | None = None
    """A map: GeoJSON, WKT or a ROS `map.yaml`, in the problem's folder or below."""
    feature: str | None = None
    """Name of the feature in the file; all of them without it."""
    tolerance: f.Margin | None = None
    """Metres by which an area may grow to have fewer corners; it never shrinks."""
    unknown: Unknown | None = None
    """How unknown cells of an occupancy grid count: `occupied` (default) or `free`."""
    _pieces: Pieces = PrivateAttr()
    _content: MapContent | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _build(self, info: ValidationInfo) -> Self:
        """Build the convex pieces, so that what is wrong with them is reported with everything else."""
        self._pieces = self._made(info)
        return self

    def _made(self, info: ValidationInfo) -> Pieces:
        """The convex pieces of the one form that is given."""
        _only_of_files(self, ("feature", "tolerance", "unknown"))
        places = _places(info)
        kind = Solid if len(places) == 3 else Obstacle
        forms: dict[str, Callable[[Any], Pieces]] = {
            "box": lambda box: (kind.box(box),),
            "polygon": lambda corners: area_of_polygon(corners).pieces,
            "disc": lambda shape: (shape.disc,),
            "halfspaces": lambda rows: (kind(*_rows(rows, places)),),
            "wkt": lambda text: _pieces(areas_from_wkt(text)),
            "file": lambda name: _pieces(self._mapped(name, info)),
        }
        return _built(self, forms)

    def _mapped(self, name: str, info: ValidationInfo) -> list[Area]:
        """The areas of a map, of which the rest is kept."""
        self._content = _content(name, self.tolerance, self.unknown, info)
        return _chosen(name, self._content, self.feature)

    @property
    def content(self) -> MapContent | None:
        """What its map holds beside the areas, if it has one."""
        return self._content

    @property
    def pieces(self) -> Pieces:
        """The convex pieces."""
        return self._pieces


def _built(shape: f.Model, forms: Mapping[str, Callable[[Any], Built]]) -> Built:
    """The one form that is given, built."""
    given = [form for form in forms if getattr(shape, form) is not None]
    if len(given) != 1:
        raise FieldError(f"expected exactly one of {', '.join(forms)}, got {' and '.join(given) or 'none'}")
    try:
        return forms[given[0]](getattr(shape, given[0]))
    except FieldError as error:
        path = error.path if error.path == _FEATURE else (given[0], *error.path)
        raise FieldError(error.message, error.hint, path, error.offset) from None
    except TextError as error:
        raise FieldError(error.message, error.hint, (given[0],)) from None
    except EnsembleError as error:
        raise FieldError(str(error).partition(": ")[2], path=(given[0],)) from None


def _only_of_files(shape: f.Model, names: Iterable[str]) -> None:
    """Refuse fields about reading a file where there is none."""
    for name in names:
        if getattr(shape, name) is not None and getattr(shape, "file", None) is None:
            raise FieldError(f"expected {name} only with file", path=(name,))


def _content(name: str, tolerance: float | None, unknown: Unknown | None, info: ValidationInfo) -> MapContent:
    """What a map holds that lies with the problem file."""
    path = checked_path((info.context or {}).get("folder", Path()), name)
    try:
        return read_map(path, tolerance, unknown)
    except TextError as error:
        raise wrong(name, error) from None


def _chosen(file: str, content: MapContent, feature: str | None) -> list[Area]:
    """The areas of a map that are meant: one by its name, or all obstacles."""
    found = [area for area in content.areas if feature in (None, area.name)]
    if feature is None:
        found = [area for area in content.areas if not area.region]
        if not found:
            raise FieldError(f"expected obstacles in {file}, got only regions", "name one with feature")
    if not found:
        known = [area.name for area in content.areas if area.name]
        hint = suggestion(feature, known) or f"it has {', '.join(known) or 'no names'}"
        raise FieldError(f"{file} has no feature named {show(feature)}", hint, _FEATURE)
    return found


def _pieces(areas: Iterable[Area]) -> Pieces:
    """The convex pieces of some areas."""
    return tuple(piece for area in areas for piece in area.pieces)


def _convex(areas: Iterable[Area]) -> Polyhedron:
    """A convex polygon as a region."""
    pieces = [corners for area in areas for corners in area.corners]
    if len(pieces) > 1:
        hint = f"it splits into {len(pieces)} convex ones: name each and write in(a) or in(b)"
        raise FieldError("expected a convex polygon, got one that is not", hint)
    return Polyhedron.polygon(pieces[0])


def _intersection(halfplanes: list[Predicate], places: tuple[str, ...]) -> Polyhedron:
    """The points that satisfy every inequality."""
    A, lower = _rows(halfplanes, places)
    return Polyhedron(A, lower, np.full(len(lower), np.inf))


def _rows(halfplanes: list[Predicate], places: tuple[str, ...]) -> tuple[Floats, Floats]:
    """Inequalities as ``A x >= b``."""
    coefficients = [dict(halfplane.coefficients) for halfplane in halfplanes]
    A = np.array([[row.get(state, 0.0) for state in places] for row in coefficients])
    return A, np.array([0.0 - halfplane.offset for halfplane in halfplanes])
