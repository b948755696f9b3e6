"""Arguments of a fleet: where it starts, how large its robots are, and bounds of its commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyMapping
from ensemble_ctrl.core.values import numbers, shown
from ensemble_ctrl.problem.arguments.readers import numbers_by_name, quantity_of
from ensemble_ctrl.systems import System

Floats = NDArray[np.float64]


def frozen(values: Any, shape: tuple[int, ...], what: str) -> Floats:
    """A read-only float copy of `values`, checked for shape and finiteness."""
    array = numbers(what, values, f"{shape} numbers")
    if array.shape != shape:
        raise ProblemError(f"{what}: expected {shape} numbers, got shape {array.shape}")
    if not np.isfinite(array).all():
        raise ProblemError(f"{what}: expected finite numbers, got {array.tolist()}")
    array.setflags(write=False)
    return array


def start_of(system: System, start: object, position: Any, heading: Any) -> ReadOnlyMapping[float]:
    """Where all members start, by the names of states."""
    given = {} if start is None else numbers_by_name("fleet.start", start)
    for name, value in given.items():
        if name not in system.states:
            raise ProblemError(f"fleet.start: expected names among {', '.join(system.states)}, got {name!r}")
        if not np.isfinite(value):
            raise ProblemError(f"fleet.start.{name}: expected a finite number, got {value}")
    if position is not None:
        place = frozen(position, (len(system.positions),), "fleet.position")
        _once("position", system.positions, given)
        given |= dict(zip(system.positions, place.tolist(), strict=True))
    if heading is not None:
        if not system.heading_state:
            raise ProblemError(f"fleet.heading: expected none, for a {system.name} has none, got {shown(heading)}")
        _once("heading", (system.heading_state,), given)
        given[system.heading_state] = quantity_of("fleet.heading", heading, "angle")
        if not np.isfinite(given[system.heading_state]):
            raise ProblemError(f"fleet.heading: expected a finite number, got {heading}")
    return ReadOnlyMapping(given)


def _once(field: str, states: Sequence[str], start: Mapping[str, float]) -> None:
    """Refuse a start that two arguments give."""
    if twice := [name for name in states if name in start]:
        came = ", ".join(f"start[{name!r}]" for name in twice)
        raise ProblemError(f"fleet.{field}: expected the start to be given once, got {field} and {came}")


def rest_of_start(system: System, start: Mapping[str, float], changes: Mapping[str, Any]) -> dict[str, float]:
    """A fleet's start less the states that a new position or heading replaces."""
    shorts = (("position", system.positions), ("heading", (system.heading_state,)))
    anew = {name for short, states in shorts if changes.get(short) is not None for name in states}
    return {name: value for name, value in start.items() if name not in anew}


def radius_of(radius: Any) -> float:
    """The radius of a robot."""
    size = quantity_of("fleet.radius", radius, "length")
    if not np.isfinite(size) or size < 0:
        raise ProblemError(f"fleet.radius: expected a radius of at least 0 m, got {size}")
    return size


def rates_of(system: System, bounds: Any) -> Floats | None:
    """Rate bounds above zero."""
    if bounds is None:
        return None
    rates = per_control(system, "rate_bounds", bounds, finite=False)
    if (rates <= 0).any():
        raise ProblemError(f"fleet.rate_bounds: expected numbers above 0, got {rates.tolist()}")
    return rates


def per_control(system: System, name: str, values: Any, finite: bool = True) -> Floats:
    """A read-only number for each command."""
    array = numbers(f"fleet.{name}", values, "one number for each command")
    wanted = f"one number for each of {', '.join(system.controls)}"
    if array.shape != (len(system.controls),) or np.isnan(array).any() or (finite and np.isinf(array).any()):
        raise ProblemError(f"fleet.{name}: expected {wanted}, got {array.tolist()}")
    array.setflags(write=False)
    return array
