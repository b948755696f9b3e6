"""The terminal target in a problem file: a place, a place for each member, moments, or mean and covariance."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, ValidationInfo, WithJsonSchema

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config.errors import Wrong, only, show
from ensemble_ctrl.problem.arguments.units import quantity
from ensemble_ctrl.problem.checks import STATES
from ensemble_ctrl.problem.target import Formation, MomentTarget, SpreadTarget, Target

Floats = NDArray[np.float64]
Pair = tuple[float, float]
Data = dict[str, Any]
Place = tuple[str | int, ...]
Made = TypeVar("Made")

FORMS = "[x, y], {PARAMETER: [[value, [x, y]], ...]}, {moments: ...}, or {mean: ..., covariance: ...}"
_LENGTH, _NUMBER = quantity("length"), quantity("number")


def target(value: Any, info: ValidationInfo) -> tuple[float, ...] | Target:
    """A target in any of its forms."""
    places = (info.context or {}).get("places", STATES)
    if not isinstance(value, dict):
        if tuple(places) == STATES:
            return _pair(value, (), FORMS)
        if not isinstance(value, list) or len(value) != len(places):
            raise Wrong(f"expected [{', '.join(places)}], got {show(value)}")
        return tuple(_one(one, (i,), _LENGTH) for i, one in enumerate(value))
    keys = set(value)
    if "moments" in keys:
        only(keys, {"moments", "weights"})
        weights = value.get("weights")
        rows = np.array(_rows(value["moments"], ("moments",), "[x, y]"))
        given = None if weights is None else np.array(_numbers(weights, ("weights",)))
        return _built(lambda: MomentTarget(rows, given), ("moments",))
    if keys & {"mean", "covariance"}:
        only(keys, {"mean", "covariance"})
        for name in ("mean", "covariance"):
            if name not in keys:
                raise Wrong(f"expected mean and covariance, but {name} is missing")
        mean, square = np.array(_pair(value["mean"], ("mean",), "[x, y]")), _matrix(value["covariance"])
        return _built(lambda: SpreadTarget(mean, square), ("covariance",))
    if len(keys) != 1:
        raise Wrong(f"expected {FORMS}, got {show(value)}")
    (name,) = keys
    return _formation(str(name), value[name])


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


def _formation(name: str, rows: Any) -> Formation:
    """A table of a parameter's values and their places."""
    wanted = "[[value, [x, y]], ...]"
    if not isinstance(rows, list) or not rows:
        raise Wrong(f"expected {wanted}, got {show(rows)}", path=(name,))
    values, places = [], []
    for i, row in enumerate(rows):
        if not isinstance(row, list | tuple) or len(row) != 2:
            raise Wrong(f"expected [value, [x, y]], got {show(row)}", path=(name, i))
        convert = _LENGTH if name in ("start_x", "start_y") else _NUMBER
        values.append(_one(row[0], (name, i, 0), convert))
        places.append(_pair(row[1], (name, i, 1), "[x, y]"))
    return _built(lambda: Formation(name, np.array(values), np.array(places)), (name,))


def _built(make: Callable[[], Made], path: Place) -> Made:
    """The target, or what is wrong with it at its place."""
    try:
        return make()
    except ProblemError as error:
        raise Wrong(str(error).partition(": ")[2], path=path) from None


def _matrix(value: Any) -> Floats:
    """Two rows of two numbers."""
    if not isinstance(value, list) or [len(row) if isinstance(row, list) else 0 for row in value] != [2, 2]:
        raise Wrong(f"expected [[a, b], [b, c]], got {show(value)}", path=("covariance",))
    return np.array([_numbers(row, ("covariance", i)) for i, row in enumerate(value)])


def _rows(value: Any, path: Place, wanted: str) -> list[Pair]:
    """A list of pairs."""
    if not isinstance(value, list) or not value:
        raise Wrong(f"expected a list of {wanted}, got {show(value)}", path=path)
    return [_pair(row, (*path, i), wanted) for i, row in enumerate(value)]


def _numbers(value: Any, path: Place) -> list[float]:
    """A list of numbers."""
    if not isinstance(value, list):
        raise Wrong(f"expected a list of numbers, got {show(value)}", path=path)
    return [_one(item, (*path, i), _NUMBER) for i, item in enumerate(value)]


def _pair(value: Any, path: Place, wanted: str) -> Pair:
    """Two lengths."""
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise Wrong(f"expected {wanted}, got {show(value)}", path=path)
    return _one(value[0], (*path, 0), _LENGTH), _one(value[1], (*path, 1), _LENGTH)


def _one(value: Any, path: Place, convert: Callable[[Any], float]) -> float:
    """One number."""
    try:
        return convert(value)
    except Wrong as error:
        raise Wrong(error.message, error.hint, path) from None
