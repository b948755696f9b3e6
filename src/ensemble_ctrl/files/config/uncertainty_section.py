"""The section on errors of the model: what robots may do beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, WithJsonSchema

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config import fields as f
from ensemble_ctrl.files.config.errors import FieldError, only, show, suggestion
from ensemble_ctrl.problem.arguments.units import quantity
from ensemble_ctrl.problem.uncertainty import POSITION, Uncertainty
from ensemble_ctrl.systems import System

Data = dict[str, Any]
HELD = 1.0
"""Time constant in seconds of a loop on the heading of which no more is said than that it is there."""
KINDS = {"m": "length", "rad": "angle", "m/s": "speed", "rad/s": "turn rate"}
"""What a number in a declared unit measures."""
RATES = {"m": "speed", "rad": "turn rate"}
"""The same for the rate of a state with a declared unit."""


def _share(value: Any) -> float:
    """A percentage, or a share from 0 to 1."""
    text = value.strip() if isinstance(value, str) else ""
    number = quantity("number", 0)(text[:-1]) / 100 if text.endswith("%") else quantity("number", 0)(value)
    if number > 1:
        raise FieldError(f"expected a share up to 1, or a percentage, got {show(value)}", "for example  2 %")
    return number


def _hold(value: Any) -> float | None:
    """True for a loop as robots have it, or its time constant."""
    if isinstance(value, bool):
        return HELD if value else None
    try:
        return quantity("time", above=0)(value)
    except FieldError:
        wanted = "expected true, false, or a time above 0 in s, ms, min or h"
        raise FieldError(f"{wanted}, got {show(value)}") from None


Time = Annotated[float, BeforeValidator(quantity("time", 0)), f.numeric("time", minimum=0)]
Hold = Annotated[
    float | None,
    BeforeValidator(_hold),
    WithJsonSchema({"anyOf": [{"type": "boolean"}, f.numeric("time", exclusiveMinimum=0).json_schema]}),
]


class UncertaintySection(f.Model):
    """What robots may do beside the model: bounds, for which every proof holds, whatever happens within them."""

    disturbance: dict[str, Any] = Field(default_factory=dict)
    """Largest error of the rate of each state, such as `heading: 0.3 deg/s`; `position: 5 mm/s` in any direction."""
    actuators: dict[str, Any] = Field(default_factory=dict)
    """Largest error of each command: `1 %` of it, or `0.01 m/s`, or both as `{share: 1 %, absolute: 0.01 m/s}`."""
    quantisation: dict[str, Any] = Field(default_factory=dict)
    """Steps to which each command is rounded, such as `v: 0.01 m/s`."""
    varies: dict[str, Any] = Field(default_factory=dict)
    """How far a parameter strays on the way from the member's own value, such as `traction: 1 %` of it."""
    delay: Time = 0.0
    """Longest delay of the commands; each robot has its own, from zero to this. Robots on arcs only."""
    jitter: Time = 0.0
    """By how much a command may begin earlier or later than at its time. Robots on arcs only."""
    heading_hold: Hold = None
    """Whether robots turn back to the heading of their model by a loop of their own, with a time constant of 1 s, or
    its time constant. Robots on arcs only."""

    def bounds(self, system: System) -> Uncertainty:
        """The bounds for a system's states, commands and parameters.

        Raises
        ------
        FieldError
            For names that the system does not have, and numbers in other units; its path is within the section.
        """
        rates = dict(zip(system.states, (RATES.get(unit, "number") for unit in _units(system)), strict=True))
        commands = {n: KINDS.get(u, "number") for n, u in zip(system.controls, system.control_units, strict=True)}
        actuators = _each("actuators", self.actuators, commands, _actuator)
        try:
            return Uncertainty(
                _each("disturbance", self.disturbance, {POSITION: "speed"} | rates, _bound),
                {name: absolute for name, (absolute, _) in actuators.items() if absolute},
                {name: share for name, (_, share) in actuators.items() if share},
                _each("quantisation", self.quantisation, commands, _bound),
                _each("varies", self.varies, dict.fromkeys(system.parameters, ""), lambda value, _: _share(value)),
                self.delay,
                self.jitter,
                self.heading_hold,
            ).checked(system)
        except ProblemError as error:
            name, _, message = str(error).partition(": ")
            raise FieldError(message, path=tuple(name.split(".")[1:])) from None


def read_bounds(section: UncertaintySection, system: System) -> Uncertainty:
    """The section's bounds, its errors with their place in the fleet's section."""
    try:
        return section.bounds(system)
    except FieldError as error:
        raise FieldError(error.message, error.hint, ("uncertainty", *error.path), on_key=error.on_key) from None


def _units(system: System) -> list[str]:
    """The units of all states, metres for a position without one."""
    units = list(system.state_units) or [""] * len(system.states)
    return [unit or ("m" if name in system.positions else "") for name, unit in zip(system.states, units, strict=True)]


def _each(section: str, given: Data, kinds: Mapping[str, str], read: Callable[[Any, str], Any]) -> Data:
    """Values by names that are known, each read as what it measures."""
    found = {}
    for name, value in given.items():
        if name not in kinds:
            hint = suggestion(name, kinds) or f"known here: {', '.join(kinds) or 'none'}"
            raise FieldError("unknown name", hint, (section, str(name)), on_key=True)
        try:
            found[name] = read(value, kinds[name])
        except FieldError as error:
            raise FieldError(error.message, error.hint, (section, str(name), *error.path)) from None
    return found


def _bound(value: Any, kind: str) -> float:
    """A bound of at least zero."""
    return quantity(kind, 0)(value)


def _actuator(value: Any, kind: str) -> tuple[float, float]:
    """An absolute bound and a share."""
    if isinstance(value, dict):
        only(value, ("absolute", "share"))
        return _bound(value.get("absolute", 0), kind), _share(value.get("share", 0))
    if isinstance(value, str) and value.strip().endswith("%"):
        return 0.0, _share(value)
    return _bound(value, kind), 0.0


def uncertainty_data(bounds: Uncertainty) -> Data:
    """The section as plain data; nothing for robots that follow their model."""
    if not bounds:
        return {}
    found = bounds.data()
    absolute, shares = found.pop("actuators", {}), found.pop("shares", {})
    if absolute or shares:
        names = dict.fromkeys([*absolute, *shares])
        found["actuators"] = {
            name: {"absolute": absolute.get(name, 0.0), "share": shares.get(name, 0.0)} for name in names
        }
    return {"uncertainty": found}
