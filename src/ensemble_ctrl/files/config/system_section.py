"""The fleet section of a model that is defined by an ODE, and what is written back of such a fleet."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, Field, PrivateAttr, ValidationInfo, WithJsonSchema, model_validator

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config import fields as f
from ensemble_ctrl.files.config.distributions import PlainSection, distribution_data, distribution_of
from ensemble_ctrl.files.config.errors import FieldError, show, suggestion
from ensemble_ctrl.files.config.footprint_section import FootprintSection, footprint_data
from ensemble_ctrl.files.config.starts_section import Starts, check_dimensions, starts_data
from ensemble_ctrl.files.config.uncertainty_section import UncertaintySection, read_bounds, uncertainty_data
from ensemble_ctrl.files.config.user_system import BY_ODE, system_class
from ensemble_ctrl.problem.arguments.units import quantity
from ensemble_ctrl.problem.checks import Finding
from ensemble_ctrl.problem.fleet import START_PREFIX, Fleet
from ensemble_ctrl.problem.uncertainty import NONE, Uncertainty
from ensemble_ctrl.systems import SYSTEMS, System

Data = dict[str, Any]
POSITION = "position"
"""The key under ``start`` that gives all coordinates of the position at once."""
_NUMBER, _LENGTH = quantity("number"), quantity("length")


def _model(value: Any, info: ValidationInfo) -> type[System]:
    """The class of the model's name, or of the file."""
    return system_class(value, info.context)


def _start(value: Any) -> dict[str, Any]:
    """States by name; the position as a list of lengths."""
    if not isinstance(value, dict):
        raise FieldError(f"expected states with numbers, got {show(value)}", "for example  {position: [0, 0], vx: 1}")
    read: dict[str, Any] = {}
    for name, one in value.items():
        try:
            read[name] = [_LENGTH(x) for x in one] if isinstance(one, list) else _NUMBER(one)
        except FieldError as error:
            raise FieldError(error.message, error.hint, (str(name),)) from None
    return read


Bounds = Annotated[tuple[f.Number, f.Number], *f.LOW_HIGH]
SystemModel = Annotated[Any, BeforeValidator(_model), WithJsonSchema({"anyOf": [{"enum": BY_ODE}, {"type": "object"}]})]
StartStates = Annotated[dict[str, Any], BeforeValidator(_start), WithJsonSchema({"type": "object"})]


class SystemFleetSection(f.Model):
    """Who moves: robots that are defined by an ODE."""

    model: SystemModel
    """The dynamics all members share: a model's name, or {python: FILE.py:CLASS} for a system of one's own."""
    settings: dict[str, Any] = Field(default_factory=dict)
    """Numbers of the model that all members share, in SI units, such as a quadrotor's `mass`."""
    parameters: dict[str, PlainSection] = Field(default_factory=dict)
    """What differs between members: parameters of the model, and `start_` with a state's name for its start."""
    start: StartStates = Field(default_factory=dict)
    """Where all members start: `position`, and other states by name; those left out start at rest."""
    input_bounds: dict[str, Bounds] = Field(default_factory=dict)
    """Bounds of the commands by name; the model's own if not given."""
    rate_bounds: dict[str, f.Positive] = Field(default_factory=dict)
    """Largest change of each command per second, from each step to the next."""
    radius: f.Margin = 0.0
    """Radius of a robot; what `avoid(...)` names grows by it."""
    starts: Starts | None = None
    """Members that start at several places: offsets from `start.position`, by name, as a list, or as a grid."""
    footprint: FootprintSection | None = None
    """Shape of a robot; for robots on arcs."""
    uncertainty: UncertaintySection = Field(default_factory=UncertaintySection)
    """What robots may do beside the model; without it, they follow it exactly."""
    _system: System = PrivateAttr()
    _bounds: Uncertainty = PrivateAttr(default=NONE)

    @model_validator(mode="after")
    def _of_its_model(self) -> Self:
        """The system, and only what it has."""
        self._system = _system(self.model, self.settings)
        system = self._system
        _known("parameters", self.parameters, [*system.parameters, *(START_PREFIX + name for name in system.states)])
        _known("start", self.start, [*system.states, POSITION])
        _known("input_bounds", self.input_bounds, system.controls)
        _known("rate_bounds", self.rate_bounds, system.controls)
        given = self.start.get(POSITION) if POSITION not in system.states else None
        if given is not None and (not isinstance(given, list) or len(given) != len(system.positions)):
            wanted = f"[{', '.join(system.positions)}]"
            raise FieldError(f"expected {wanted}, got {show(given)}", path=("start", POSITION))
        for name, value in self.start.items():
            if isinstance(value, list) and name != POSITION:
                raise FieldError(f"expected a number, got {show(value)}", path=("start", name))
        check_dimensions(self.starts or {}, system.positions)
        self._bounds = read_bounds(self.uncertainty, system)
        return self

    def fleet(self) -> Fleet:
        """The fleet.

        Raises
        ------
        ProblemError
            If its parts don't fit together; with a finding.
        """
        system = self._system
        bounds = np.array(
            [self.input_bounds.get(name, own) for name, own in zip(system.controls, system.input_bounds, strict=True)]
        )
        rates = [self.rate_bounds.get(name, np.inf) for name in system.controls]
        distributions = {name: distribution_of(section, name) for name, section in self.parameters.items()}
        try:
            return Fleet(
                system,
                distributions,
                input_lower=bounds[:, 0],
                input_upper=bounds[:, 1],
                radius=self.radius,
                footprint=None if self.footprint is None else self.footprint.body,
                rate_bounds=np.array(rates) if self.rate_bounds else None,
                start=self._start_states(),
                uncertainty=self._bounds,
                starts=self.starts,
            )
        except ProblemError as error:
            raise _placed(error, self.parameters) from None

    def _start_states(self) -> dict[str, float]:
        """States by name."""
        given = dict(self.start)
        if POSITION not in self._system.states and POSITION in given:
            given |= dict(zip(self._system.positions, given.pop(POSITION), strict=True))
        return given


def _system(kind: type[System], settings: Data) -> System:
    """The system with its settings, complete."""
    takes = [name for name in inspect.signature(kind).parameters if name not in ("args", "kwargs")]
    _known("settings", settings, takes)
    try:
        system = kind(**settings)
        system.require_complete()
    except ProblemError as error:
        name, _, message = str(error).partition(": ")
        raise (
            FieldError(message, path=("settings", name) if name in settings else ("model",))
            if name in takes
            else FieldError(str(error), path=("model",))
        ) from None
    except (TypeError, ValueError, AttributeError) as error:
        raise FieldError(
            f"{kind.__name__} can't be made: {error}", path=("settings",) if settings else ("model",)
        ) from None
    return system


def _known(section: str, given: Iterable[str], names: Iterable[str]) -> None:
    """No names that the system does not have."""
    known = list(names)
    for name in given:
        if name not in known:
            shown = [n for n in known if not n.startswith(START_PREFIX)]
            shown += [f"{START_PREFIX}<state>"] * (len(shown) < len(known))
            hint = suggestion(name, known) or f"known here: {', '.join(shown) or 'none'}"
            raise FieldError("unknown name", hint, (section, name))


def _placed(error: ProblemError, parameters: Iterable[str]) -> ProblemError:
    """An error of the fleet with its place in the file."""
    name, _, message = str(error).partition(": ")
    keys = name.split(".")
    path: tuple[str, ...] = ("fleet", "model")
    if name in parameters:
        path = ("fleet", "parameters", name)
    elif keys[0] == "fleet":
        path = tuple(keys)
    else:
        message = str(error)
    refusal = ProblemError(str(error))
    refusal.findings = (Finding(path, message),)
    return refusal


def system_fleet_data(fleet: Fleet) -> Data:
    """The section of a fleet that follows a differential equation, as plain data."""
    system = fleet.system
    bounds = np.column_stack([np.asarray(fleet.input_lower), np.asarray(fleet.input_upper)]).tolist()
    rates = [] if fleet.rate_bounds is None else np.asarray(fleet.rate_bounds).tolist()
    finite = {n: rate for n, rate in zip(system.controls, rates, strict=False) if np.isfinite(rate)}
    return {
        "model": _model_data(system),
        **({"settings": dict(system.settings())} if system.settings() else {}),
        "parameters": {name: distribution_data(distribution) for name, distribution in fleet.parameters.items()},
        "start": {name: float(value) for name, value in fleet.start.items()},
        "input_bounds": dict(zip(system.controls, bounds, strict=True)),
        **({"rate_bounds": finite} if finite else {}),
        "radius": float(fleet.radius),
        **starts_data(fleet.starts),
        **footprint_data(fleet.footprint),
        **uncertainty_data(fleet.uncertainty),
    }


def _model_data(system: System) -> Any:
    """A model's name, or the file and the class of a user's own."""
    if SYSTEMS.get(system.name) is type(system):
        return system.name
    source = source_file(system)
    if source is None:
        message = f"expected a system in a Python file, so that it can be loaded again, got {type(system).__name__}"
        raise ProblemError(f"fleet.system: {message}, which was typed in")
    return {"python": f"{source.name}:{type(system).__qualname__}"}


def source_file(system: System) -> Path | None:
    """The Python file that a user's own system is in, if there is one."""
    if SYSTEMS.get(system.name) is type(system):
        return None
    try:
        path = Path(inspect.getfile(type(system)))
    except (TypeError, OSError):
        return None
    return path if path.suffix == ".py" and path.is_file() else None
