"""The terminal target in a problem file: a place, a place for each member, moments, or mean and covariance."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, ValidationInfo, WithJsonSchema

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config.errors import FieldError, only, show
from ensemble_ctrl.problem.arguments.units import quantity
from ensemble_ctrl.problem.checks import STATES
from ensemble_ctrl.problem.target import Formation, MomentTarget, Pose, SpreadTarget, Target

Floats = NDArray[np.float64]
Names = tuple[str, ...]
Data = dict[str, Any]
Place = tuple[str | int, ...]
Made = TypeVar("Made")

FORMS = (
    "{0}, {{PARAMETER: [[value, {0}], ...]}}, {{moments: ...}}, {{mean: ..., covariance: ...}}, "
    "or {{position: {0}, heading: ..., tolerances: ...}}"
)
MATRICES = {1: "[[a]]", 2: "[[a, b], [b, c]]", 3: "[[a, b, c], [b, d, e], [c, e, f]]"}
"""Covariances in words, by their size."""
_LENGTH, _NUMBER, _ANGLE = quantity("length"), quantity("number"), quantity("angle")


def target(value: Any, info: ValidationInfo) -> tuple[float, ...] | Target | Pose:
    """A target in any of its forms."""
    names = tuple((info.context or {}).get("places", STATES))
    forms = FORMS.format(_written(names))
    if not isinstance(value, dict):
        return _place(value, (), names, forms)
    keys = set(value)
    if "moments" in keys:
        only(keys, {"moments", "weights"})
        weights = value.get("weights")
        rows = np.array(_rows(value["moments"], ("moments",), names))
        given = None if weights is None else np.array(_numbers(weights, ("weights",)))
        return _built(lambda: MomentTarget(rows, given), ("moments",))
    if keys & {"position", "heading", "tolerances"}:
        return _pose(value, keys, names)
    if keys & {"mean", "covariance"}:
        only(keys, {"mean", "covariance"})
        for name in ("mean", "covariance"):
            if name not in keys:
                raise FieldError(f"expected mean and covariance, but {name} is missing")
        mean, square = np.array(_place(value["mean"], ("mean",), names)), _matrix(value["covariance"], len(names))
        return _built(lambda: SpreadTarget(mean, square), ("covariance",))
    if len(keys) != 1:
        raise FieldError(f"expected {forms}, got {show(value)}")
    (name,) = keys
    return _formation(str(name), value[name], names)


def _pose(value: Data, keys: set[str], names: Names) -> Pose:
    """A position and a heading with a tolerance of each."""
    only(keys, {"position", "heading", "tolerances"})
    for name in ("position", "heading", "tolerances"):
        if name not in keys:
            raise FieldError(f"expected position, heading and tolerances, but {name} is missing")
    given = value["tolerances"]
    if not isinstance(given, dict) or set(given) != {"position", "heading"}:
        raise FieldError(f"expected {{position: 5 cm, heading: 5 deg}}, got {show(given)}", path=("tolerances",))
    position = _place(value["position"], ("position",), names)
    within = _one(given["position"], ("tolerances", "position"), _LENGTH)
    turn = _one(given["heading"], ("tolerances", "heading"), _ANGLE)
    heading = _one(value["heading"], ("heading",), _ANGLE)
    return _built(lambda: Pose(np.array(position), heading, within, turn), ("tolerances",))


def target_data(given: Any) -> Any:
    """A target as it stands in a problem file."""
    match given:
        case Formation():
            return {
                given.parameter: [[v, p] for v, p in zip(given.values.tolist(), given.places.tolist(), strict=True)]
            }
        case MomentTarget():
            weights = [] if given.weights is None else given.weights.tolist()
            return {"moments": given.moments.tolist(), "weights": weights}
        case SpreadTarget():
            return {"mean": given.mean.tolist(), "covariance": given.covariance.tolist()}
    return given.tolist()


Terminal = Annotated[
    Any,
    BeforeValidator(target),
    WithJsonSchema({"anyOf": [{"type": "array", "minItems": 1, "maxItems": 3}, {"type": "object"}]}),
]


def _formation(name: str, rows: Any, names: Names) -> Formation:
    """A table of a parameter's values and their places."""
    wanted = f"[value, {_written(names)}]"
    if not isinstance(rows, list) or not rows:
        raise FieldError(f"expected [{wanted}, ...], got {show(rows)}", path=(name,))
    values, places = [], []
    for i, row in enumerate(rows):
        if not isinstance(row, list | tuple) or len(row) != 2:
            raise FieldError(f"expected {wanted}, got {show(row)}", path=(name, i))
        convert = _LENGTH if name in [f"start_{place}" for place in names] else _NUMBER
        values.append(_one(row[0], (name, i, 0), convert))
        places.append(_place(row[1], (name, i, 1), names))
    return _built(lambda: Formation(name, np.array(values), np.array(places)), (name,))


def _built(make: Callable[[], Made], path: Place) -> Made:
    """The target, or what is wrong with it at its place."""
    try:
        return make()
    except ProblemError as error:
        raise FieldError(str(error).partition(": ")[2], path=path) from None


def _matrix(value: Any, size: int) -> Floats:
    """As many rows as numbers in each."""
    if not isinstance(value, list) or [len(row) if isinstance(row, list) else 0 for row in value] != [size] * size:
        wanted = MATRICES[size]
        raise FieldError(f"expected {wanted}, got {show(value)}", path=("covariance",))
    return np.array([_numbers(row, ("covariance", i)) for i, row in enumerate(value)])


def _rows(value: Any, path: Place, names: Names) -> list[tuple[float, ...]]:
    """A list of places."""
    if not isinstance(value, list) or not value:
        raise FieldError(f"expected a list of {_written(names)}, got {show(value)}", path=path)
    return [_place(row, (*path, i), names) for i, row in enumerate(value)]


def _numbers(value: Any, path: Place) -> list[float]:
    """A list of numbers."""
    if not isinstance(value, list):
        raise FieldError(f"expected a list of numbers, got {show(value)}", path=path)
    return [_one(item, (*path, i), _NUMBER) for i, item in enumerate(value)]


def _place(value: Any, path: Place, names: Names, wanted: str = "") -> tuple[float, ...]:
    """A length for each coordinate of the position."""
    if not isinstance(value, list | tuple) or len(value) != len(names):
        raise FieldError(f"expected {wanted or _written(names)}, got {show(value)}", path=path)
    return tuple(_one(one, (*path, i), _LENGTH) for i, one in enumerate(value))


def _written(names: Names) -> str:
    """A place in words, ``[x, y]``."""
    return f"[{', '.join(names)}]"


def _one(value: Any, path: Place, convert: Callable[[Any], float]) -> float:
    """One number."""
    try:
        return convert(value)
    except FieldError as error:
        raise FieldError(error.message, error.hint, path) from None
