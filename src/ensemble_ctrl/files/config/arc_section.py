"""The fleet section of a model on arcs, and what is written back of such a fleet."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from ensemble_ctrl.files.config import fields as f
from ensemble_ctrl.files.config.distributions import (
    DistributionSection,
    OffsetSection,
    TurnSection,
    distribution_data,
    distribution_of,
)
from ensemble_ctrl.files.config.errors import FieldError
from ensemble_ctrl.files.config.fields import Model
from ensemble_ctrl.files.config.footprint_section import FootprintSection, footprint_data
from ensemble_ctrl.files.config.joint_samples import JointSamples, read_joint_samples
from ensemble_ctrl.files.config.samples import Columns
from ensemble_ctrl.files.config.starts_section import Starts, check_dimensions, starts_data
from ensemble_ctrl.files.config.uncertainty_section import UncertaintySection, read_bounds, uncertainty_data
from ensemble_ctrl.moments import Distribution, Samples
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.uncertainty import NONE, Uncertainty
from ensemble_ctrl.systems import ArcSystem, Bicycle, Unicycle

Data = dict[str, Any]
ON_ARCS: dict[str, type[ArcSystem]] = {Unicycle.name: Unicycle, Bicycle.name: Bicycle}
"""The models whose fleet section this is."""


class Parameters(Model):
    """Parameters that differ between members; the others are equal for all."""

    traction: DistributionSection | None = None
    """Factor on speed and turn rate at once; above 0."""
    linear_traction: DistributionSection | None = None
    """Factor on the speed alone; above 0."""
    angular_traction: DistributionSection | None = None
    """Factor on the turn rate alone; above 0."""
    start_x: OffsetSection | None = None
    """Offset of the start from `start.position`, in metres."""
    start_y: OffsetSection | None = None
    """Offset of the start from `start.position`, in metres."""
    start_heading: TurnSection | None = None
    """Offset of the heading from `start.heading`, counter-clockwise, in radians."""

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        """`traction` stands for both of the others."""
        for name in ("linear_traction", "angular_traction"):
            if self.traction is not None and getattr(self, name) is not None:
                raise FieldError(f"expected traction or {name}, got both", "traction scales both at once", (name,))
        return self


class Start(Model):
    """Where all members start; the heading counts counter-clockwise from +x, or clockwise from +y."""

    position: f.Point
    """Start of all members, `[x, y]`, but for the offsets `start_x` and `start_y`."""
    heading: f.Angle
    """Start heading of all members, but for the offset `start_heading`."""
    heading_from: Literal["x", "y"] = "x"
    """`x`: from +x, counter-clockwise. `y`: from +y, clockwise (the paper's)."""


class InputBounds(Model):
    """Bounds of the commands: v and omega for a unicycle, v and delta for a bicycle."""

    v: f.SpeedBounds | None = None
    """Bounds of the commanded speed, `[low, high]`."""
    omega: f.TurnRateBounds | None = None
    """Unicycle: bounds of the commanded turn rate, `[low, high]`."""
    delta: f.SteeringBounds | None = None
    """Bicycle: bounds of the steering angle, `[low, high]`, within ±1.5 rad."""


class RateBounds(Model):
    """Largest change of each command per second."""

    v: f.Positive | None = None
    """Largest change of the speed per second, m/s²."""
    omega: f.Positive | None = None
    """Unicycle: largest change of the turn rate per second, rad/s²."""
    delta: f.Positive | None = None
    """Bicycle: largest change of the steering angle per second, rad/s."""


class FleetSection(Model):
    """The fleet."""

    model: f.ModelName
    """Dynamics of all members; `ensemble-plan models` lists them."""
    wheelbase: f.Wheelbase | None = None
    """Bicycle only: distance between the axles; 0.3 m by default."""
    parameters: Parameters = Field(default_factory=lambda: Parameters(traction=DistributionSection()))
    """Parameters that differ between members; by default `traction` from 0.9 to 1.1."""
    samples: JointSamples | None = None
    """Joint samples: measured parameters of whole robots, as a CSV file with a column for each, or as columns."""
    start: Start
    """Where all members start."""
    input_bounds: InputBounds = Field(default_factory=InputBounds)
    """Bounds of the commands."""
    rate_bounds: RateBounds | None = None
    """Largest change of each command per second, from each step to the next."""
    radius: f.Margin = 0.0
    """Radius of a robot; what `avoid(...)` names grows by it. With a footprint, a margin around it."""
    footprint: FootprintSection | None = None
    """Shape of a robot, which `avoid(...)` keeps out of obstacles; a disk of the radius without one."""
    starts: Starts | None = None
    """Members that start at several places: offsets from `start.position`, by name, as a list, or as a grid."""
    uncertainty: UncertaintySection = Field(default_factory=UncertaintySection)
    """What robots may do beside the model; without it, they follow it exactly."""
    _robots: Columns = PrivateAttr(default_factory=dict)
    _bounds: Uncertainty = PrivateAttr(default=NONE)

    @model_validator(mode="after")
    def _read_joint_samples(self, info: ValidationInfo) -> Self:
        """Read the table of measured robots; what it holds is not given by a distribution too."""
        if self.samples is not None:
            self._robots = read_joint_samples(self.samples, (info.context or {}).get("folder", Path()))
            distributions = {
                name
                for name, distribution in self.parameters
                if distribution is not None and "parameters" in self.model_fields_set
            }
            for name in sorted(distributions & set(self._robots)):
                raise FieldError(
                    f"expected {name} in the joint samples or among the parameters, got both", path=("samples",)
                )
        return self

    @staticmethod
    def models() -> tuple[str, ...]:
        """The names of the models that this is the section of."""
        return tuple(ON_ARCS)

    @property
    def robots(self) -> Columns:
        """Columns of the measured robots."""
        return self._robots

    @model_validator(mode="after")
    def _of_its_model(self) -> Self:
        """Only what the model has."""
        system = ON_ARCS[self.model]
        for name in self.input_bounds.model_fields_set - set(system.controls):
            controls = " and ".join(system.controls)
            raise FieldError(f"expected bounds of {controls}, got {name!r}", path=("input_bounds", name))
        for name in (self.rate_bounds.model_fields_set if self.rate_bounds else set()) - set(system.controls):
            controls = " and ".join(system.controls)
            raise FieldError(f"expected rates of {controls}, got {name!r}", path=("rate_bounds", name))
        if self.wheelbase is not None and self.model != Bicycle.name:
            raise FieldError(
                f"expected a wheelbase for the bicycle only, got one for the {self.model}", path=("wheelbase",)
            )
        check_dimensions(self.starts or {}, system.positions)
        self._bounds = read_bounds(self.uncertainty, system())
        return self

    def fleet(self) -> Fleet:
        """The fleet."""
        start, system = self.start, _system(self)
        bounds = np.array(
            [
                default if (given := getattr(self.input_bounds, name)) is None else given
                for name, default in zip(system.controls, system.input_bounds, strict=True)
            ]
        )
        return Fleet(
            system=system,
            parameters=_distributions(self),
            rate_bounds=_rates(self, system),
            samples={name: np.array(column) for name, column in self.robots.items()} or None,
            position=np.array(start.position),
            heading=start.heading if start.heading_from == "x" else math.pi / 2 - start.heading,
            input_lower=bounds[:, 0],
            input_upper=bounds[:, 1],
            radius=self.radius,
            footprint=None if self.footprint is None else self.footprint.body,
            uncertainty=self._bounds,
            starts=self.starts,
        )


def _rates(section: FleetSection, system: ArcSystem) -> NDArray[np.float64] | None:
    """The rate bounds in the order of the commands."""
    if section.rate_bounds is None:
        return None
    given = [getattr(section.rate_bounds, name) for name in system.controls]
    return np.array([math.inf if rate is None else rate for rate in given])


def _distributions(section: FleetSection) -> dict[str, Distribution]:
    """The distribution of each parameter; the default one only where no other is given."""
    given = section.parameters if section.samples is None or "parameters" in section.model_fields_set else ()
    distributions = {
        name: distribution_of(distribution, name) for name, distribution in given if distribution is not None
    }
    return distributions | {name: Samples(column) for name, column in section.robots.items()}


def _system(section: FleetSection) -> ArcSystem:
    """The dynamics."""
    if section.model == Bicycle.name:
        longer = {} if section.wheelbase is None else {"wheelbase": section.wheelbase}
        return Bicycle(heading_from=section.start.heading_from, **longer)
    return ON_ARCS[section.model](heading_from=section.start.heading_from)


def arc_fleet_data(fleet: Fleet) -> Data:
    """The section on the fleet."""
    bounds = np.column_stack([fleet.input_lower, fleet.input_upper]).tolist()
    system, samples = fleet.arcs, fleet.samples or {}
    return {
        "model": system.name,
        **{name: float(value) for name, value in system.settings().items()},
        "parameters": {
            name: distribution_data(distribution)
            for name, distribution in fleet.parameters.items()
            if name not in samples
        },
        **({"samples": {name: column.tolist() for name, column in samples.items()}} if samples else {}),
        "start": {
            "position": fleet.of_one_start.position.tolist(),
            "heading": float(fleet.own_heading),
            "heading_from": system.heading_from,
        },
        "input_bounds": dict(zip(system.controls, bounds, strict=True)),
        **({} if fleet.rate_bounds is None else {"rate_bounds": _rate_data(fleet)}),
        "radius": float(fleet.radius),
        **starts_data(fleet.starts),
        **footprint_data(fleet.footprint),
        **uncertainty_data(fleet.uncertainty),
    }


def _rate_data(fleet: Fleet) -> Data:
    """The rate bounds that are finite."""
    pairs = zip(fleet.system.controls, np.asarray(fleet.rate_bounds).tolist(), strict=True)
    return {name: rate for name, rate in pairs if np.isfinite(rate)}
