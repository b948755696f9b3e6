"""The types of a problem file's fields, with the validators that read them."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, WithJsonSchema

from ensemble_ctrl.constraints.stl import Formula, parse
from ensemble_ctrl.constraints.stl._tokens import RESERVED
from ensemble_ctrl.files.config.errors import FieldError, only, show, suggestion
from ensemble_ctrl.moments import MAX_ORDER
from ensemble_ctrl.problem.arguments.units import pattern, quantity
from ensemble_ctrl.problem.checks import ALL_OBSTACLES
from ensemble_ctrl.systems import SYSTEMS
from ensemble_ctrl.systems.bicycle import STEEPEST

_NAME = re.compile(r"[^\W\d][\w.-]*")
_FOLDER = re.compile(r"(?!\.{1,2}$)[^/\\:*?\"<>|\x00-\x1f\x7f]{1,100}")


class Model(BaseModel):
    """A section: no unknown fields, immutable; its validator is built with the whole file's, not for itself."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True, defer_build=True)


def numeric(kind: str, **limits: float) -> WithJsonSchema:
    """The JSON Schema of a number that may carry a unit of `kind`; `limits` are for numbers without one."""
    return WithJsonSchema({"anyOf": [{"type": "number", **limits}, {"type": "string", "pattern": pattern(kind)}]})


def either(number: WithJsonSchema, section: dict[str, Any]) -> WithJsonSchema:
    """The JSON Schema of a number or of a section."""
    return WithJsonSchema({"anyOf": [number.json_schema, {"type": "object", **section}]})


def integer(least: int, most: int, word: str) -> WithJsonSchema:
    """The JSON Schema of a whole number in a range, or a word."""
    return WithJsonSchema({"anyOf": [{"type": "integer", "minimum": least, "maximum": most}, {"const": word}]})


def whole(least: int, most: int, also: str = "") -> Callable[[Any], int]:
    """A validator for a whole number in a range."""

    def convert(value: Any) -> int:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or value % 1 != 0 or not least <= value <= most:
            raise FieldError(f"expected a whole number from {least} to {most}{also}, got {show(value)}")
        return int(value)

    return convert


def flag(value: Any) -> bool:
    """Only ``true`` or ``false``."""
    if not isinstance(value, bool):
        raise FieldError(f"expected true or false, got {show(value)}")
    return value


def pair(shape: str) -> Callable[[Any], Any]:
    """A validator for a list of two."""
    return few(shape, 2, 2)


def few(shape: str, least: int, most: int) -> Callable[[Any], Any]:
    """A validator for a short list."""

    def check(value: Any) -> Any:
        if not isinstance(value, list | tuple) or not least <= len(value) <= most:
            raise FieldError(f"expected {shape}, got {show(value)}")
        return value

    return check


def ordered(bounds: tuple[float, float]) -> tuple[float, float]:
    """Bounds whose low end is not above the high one."""
    if bounds[0] > bounds[1]:
        raise FieldError(f"expected [low, high], got [{bounds[0]:g}, {bounds[1]:g}], where low is above high")
    return bounds


def level(value: Any) -> float:
    """A share of the fleet that is left out."""
    number = quantity("number", 0)(value)
    if number >= 1:
        raise FieldError(f"expected a share from 0 to below 1, got {show(value)}", "0.9 looks at the worst tenth")
    return number


def effort(value: Any) -> float | dict[str, float]:
    """One weight, or one for each command by its name."""
    weight = quantity("number", 0)
    if not isinstance(value, dict):
        return weight(value)
    weights = {}
    for name, given in value.items():
        try:
            weights[name] = weight(given)
        except FieldError as error:
            raise FieldError(error.message, error.hint, (name,)) from None
    return weights


def free_duration(value: Any) -> float | tuple[float, float]:
    """A duration, or the longest and the shortest that it may have."""
    seconds, least = quantity("time", above=0), quantity("time", 0)
    if not isinstance(value, dict):
        return seconds(value)
    only(value, ("at_most", "at_least"))
    if "at_most" not in value:
        raise FieldError("expected at_most, the longest that the plan may take, but it is missing")
    bounds = []
    for key in ("at_most", "at_least"):
        try:
            bounds.append((seconds if key == "at_most" else least)(value.get(key, 0.0)))
        except FieldError as error:
            raise FieldError(error.message, error.hint, (key,)) from None
    if bounds[1] > bounds[0]:
        raise FieldError(
            f"expected at_least up to at_most, got {bounds[1]:g} s and {bounds[0]:g} s", path=("at_least",)
        )
    return bounds[0], bounds[1]


def model_name(value: str) -> str:
    """The name of a system."""
    if value not in SYSTEMS:
        raise FieldError(f"{show(value)} is not one of {', '.join(SYSTEMS)}", suggestion(value, SYSTEMS))
    return value


def order_or_auto(value: Any) -> int | None:
    """A truncation order, None for auto."""
    return None if value == "auto" else whole(1, MAX_ORDER, " (or auto)")(value)


def routes_or_all(value: Any) -> int | str:
    """A number of routes, or the word ``all``."""
    return "all" if value == "all" else whole(1, 1000, " (or all)")(value)


def formula(value: Any) -> Formula:
    """A formula from its text."""
    if not isinstance(value, str):
        raise FieldError(f"expected a formula, got {show(value)}", 'for example "F[0, T] in(goal)"')
    return parse(value)


def format_version(value: Any) -> int:
    """The version of the file's format."""
    if value != 1 or isinstance(value, bool):
        raise FieldError(f"expected 1, got {show(value)}", "this release reads version 1")
    return 1


def place_name(value: str) -> str:
    """A name that a task can use."""
    if value in RESERVED or value == ALL_OBSTACLES:
        raise FieldError(f"{value!r} is a word of the task language", "choose another name")
    if not _NAME.fullmatch(value):
        raise FieldError(f"expected a name that starts with a letter, then letters, digits, _ . -, got {show(value)}")
    return value


def folder_name(value: str) -> str:
    """A name that results can be stored under."""
    if not _FOLDER.fullmatch(value):
        raise FieldError(f"expected a name that a folder can have, got {show(value)}", 'leave out / \\ : * ? " < > |')
    return value


def positive_range(bounds: tuple[float, float]) -> tuple[float, float]:
    """A parameter's range."""
    if bounds[0] <= 0:
        raise FieldError(f"expected a range above 0, got [{bounds[0]:g}, {bounds[1]:g}]")
    return bounds


def steering(bounds: tuple[float, float]) -> tuple[float, float]:
    """Bounds of a steering angle, short of the pole at a right angle."""
    if max(map(abs, bounds)) > STEEPEST:
        raise FieldError(f"expected angles from {-STEEPEST:g} to {STEEPEST:g} rad, got [{bounds[0]:g}, {bounds[1]:g}]")
    return bounds


Number = Annotated[float, BeforeValidator(quantity("number")), numeric("number")]
Positive = Annotated[float, BeforeValidator(quantity("number", above=0)), numeric("number", exclusiveMinimum=0)]
Weight = Annotated[float, BeforeValidator(quantity("number", 0)), numeric("number", minimum=0)]
Length = Annotated[float, BeforeValidator(quantity("length")), numeric("length")]
Margin = Annotated[float, BeforeValidator(quantity("length", 0)), numeric("length", minimum=0)]
Size = Annotated[float, BeforeValidator(quantity("length", above=0)), numeric("length", exclusiveMinimum=0)]
Duration = Annotated[float, BeforeValidator(quantity("time", above=0)), numeric("time", exclusiveMinimum=0)]
FreeDuration = Annotated[
    float | tuple[float, float],
    BeforeValidator(free_duration),
    either(
        numeric("time", exclusiveMinimum=0),
        {
            "properties": {
                "at_most": numeric("time", exclusiveMinimum=0).json_schema,
                "at_least": numeric("time", minimum=0).json_schema,
            },
            "required": ["at_most"],
            "additionalProperties": False,
        },
    ),
]
Effort = Annotated[
    float | dict[str, float],
    BeforeValidator(effort),
    either(numeric("number", minimum=0), {"additionalProperties": numeric("number", minimum=0).json_schema}),
]
Angle = Annotated[float, BeforeValidator(quantity("angle")), numeric("angle")]
Speed = Annotated[float, BeforeValidator(quantity("speed")), numeric("speed")]
TurnRate = Annotated[float, BeforeValidator(quantity("turn rate")), numeric("turn rate")]
LOW_HIGH = (BeforeValidator(pair("[low, high]")), AfterValidator(ordered))
Point = Annotated[tuple[Length, Length], BeforeValidator(pair("[x, y]"))]
Name = Annotated[str, AfterValidator(place_name)]
Range = Annotated[tuple[Number, Number], *LOW_HIGH, AfterValidator(positive_range)]
AnyRange = Annotated[tuple[Number, Number], *LOW_HIGH]
Offsets = Annotated[tuple[Length, Length], *LOW_HIGH]
AngleRange = Annotated[tuple[Angle, Angle], *LOW_HIGH]
SteeringBounds = Annotated[tuple[Angle, Angle], *LOW_HIGH, AfterValidator(steering)]
Wheelbase = Annotated[float, BeforeValidator(quantity("length", above=0)), numeric("length", exclusiveMinimum=0)]
SpeedBounds = Annotated[tuple[Speed, Speed], *LOW_HIGH]
TurnRateBounds = Annotated[tuple[TurnRate, TurnRate], *LOW_HIGH]
ModelName = Annotated[str, AfterValidator(model_name), WithJsonSchema({"enum": list(SYSTEMS)})]
Order = Annotated[int | None, BeforeValidator(order_or_auto), integer(1, MAX_ORDER, "auto")]
Routes = Annotated[int | Literal["all"], BeforeValidator(routes_or_all), integer(1, 1000, "all")]
Task = Annotated[Formula, BeforeValidator(formula), WithJsonSchema({"type": "string"})]
FolderName = Annotated[str, AfterValidator(folder_name)]
