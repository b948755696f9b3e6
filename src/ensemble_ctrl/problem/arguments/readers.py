"""Readers of arguments: each returns the value as the package keeps it, or raises ProblemError with its name."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Disc, DiscRegion, Obstacle, Polyhedron, Solid
from ensemble_ctrl.constraints.disc import obstacle_of
from ensemble_ctrl.constraints.stl import Formula, parse
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import expect, numbers, shown
from ensemble_ctrl.moments import Distribution
from ensemble_ctrl.problem.arguments.errors import FieldError
from ensemble_ctrl.problem.arguments.units import quantity

Floats = NDArray[np.float64]
T = TypeVar("T")


def quantity_of(name: str, value: Any, kind: str) -> float:
    """A number in SI units, or a text with a number and a unit of `kind`; its range is checked elsewhere.

    Examples
    --------
    >>> quantity_of("duration", "2 min", "time")
    120.0
    """
    if isinstance(value, np.number | np.ndarray) and np.ndim(value) == 0:
        value = value.item()
    try:
        return float(value) if isinstance(value, float) else quantity(kind)(value)
    except (FieldError, OverflowError) as error:
        raise ProblemError(f"{name}: {error}") from None


def mapping_of(name: str, value: Any, kind: type[T], wanted: str) -> dict[str, T]:
    """Values of a type by their names; `wanted` describes one."""
    if not isinstance(value, Mapping):
        raise ProblemError(f"{name}: expected a mapping of names, each to {wanted}, got {shown(value)}")
    return {_name(name, key): expect(f"{name}[{key!r}]", each, kind, wanted) for key, each in value.items()}


def distributions_of(name: str, value: Any) -> dict[str, Distribution]:
    """The distributions of parameters by their names."""
    return mapping_of(name, value, Distribution, "a distribution such as Interval(0.9, 1.1)")  # type: ignore[type-abstract]


def numbers_by_name(name: str, value: Any) -> dict[str, float]:
    """Numbers by their names."""
    given = mapping_of(name, value, object, "a number")
    return {key: quantity_of(f"{name}.{key}", each, "number") for key, each in given.items()}


def names_of(name: str, value: Any) -> tuple[str, ...]:
    """Names, or one."""
    if isinstance(value, str):
        return (value,)
    if not isinstance(value, Collection) or not all(isinstance(each, str) for each in value):
        raise ProblemError(f"{name}: expected names, got {shown(value)}")
    return tuple(value)


def task_of(name: str, value: Any) -> Formula:
    """A formula, or its text."""
    if isinstance(value, str):
        return parse(value)
    return expect(name, value, Formula, "a formula, or its text")


def regions_of(name: str, value: Any) -> dict[str, Polyhedron]:
    """Regions by name, each a Polyhedron or a box ``[[x low, x high], ...]``."""
    if not isinstance(value, Mapping):
        raise ProblemError(f"{name}: expected a mapping of names to regions, got {shown(value)}")
    return {_name(name, key): _region(f"{name}[{key!r}]", each) for key, each in value.items()}


def _region(name: str, value: Any) -> Polyhedron:
    """One region."""
    if isinstance(value, Polyhedron):
        return value
    if isinstance(value, Disc):
        return DiscRegion(value)
    wanted = "a Polyhedron, a Disc, or a box [[x low, x high], ...]"
    return Polyhedron.box(_sides(name, value, wanted))


def obstacles_of(name: str, value: Any) -> dict[str, tuple[Obstacle, ...]]:
    """Obstacles by name, each one shape or several; without names, one or several that are called o1, o2, ..."""
    if isinstance(value, Mapping):
        return {_name(name, key): pieces_of(f"{name}[{key!r}]", each) for key, each in value.items()}
    return {f"o{k + 1}": (piece,) for k, piece in enumerate(pieces_of(name, value))}


WANTED_OBSTACLE = "an Obstacle, a Disc, a bounded Polyhedron, or a box [[x low, x high], ...]"


def pieces_of(name: str, value: Any) -> tuple[Obstacle, ...]:
    """The convex pieces of one area: one shape, or a sequence of them."""
    if isinstance(value, Obstacle | Polyhedron) or _is_box(value):
        return (_piece(name, value),)
    if not isinstance(value, Sequence) or isinstance(value, str | bytes):
        raise ProblemError(f"{name}: expected {WANTED_OBSTACLE}, or several of them, got {shown(value)}")
    return tuple(_piece(f"{name}[{k}]", each) for k, each in enumerate(value))


def _piece(name: str, value: Any) -> Obstacle:
    """One convex shape."""
    if isinstance(value, Obstacle):
        return value
    if isinstance(value, Polyhedron):
        if not value.is_bounded or value.A.shape[1] not in (2, 3):
            raise ProblemError(f"{name}: expected {WANTED_OBSTACLE}, got one that is unbounded or of other dimensions")
        return obstacle_of(value)
    sides = _sides(name, value, WANTED_OBSTACLE)
    return (Solid if len(sides) == 3 else Obstacle).box(sides)


def _is_box(value: Any) -> bool:
    """Whether a value is nested numbers of the shape of a box."""
    try:
        return np.array(value, dtype=float).shape in ((2, 2), (3, 2))
    except (TypeError, ValueError):
        return False


def _sides(name: str, value: Any, wanted: str) -> Floats:
    """The sides of a box, shape (d, 2)."""
    array = numbers(name, value, wanted)
    if array.ndim != 2 or array.shape[1] != 2 or not 1 <= len(array) <= 3:
        raise ProblemError(f"{name}: expected {wanted}, got {shown(value)}")
    return array


def _name(where: str, key: object) -> str:
    """A name."""
    return expect(f"{where}: a name", key, str, "text")
