"""The problem file, one pydantic model per section. Values are in SI units and radians."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, PrivateAttr, ValidationInfo, model_validator

from ensemble_ctrl.checks import MAX_MEMBERS, MAX_SEED, MAX_STEPS
from ensemble_ctrl.config import fields as f
from ensemble_ctrl.config.clouds import Cloud, read_cloud
from ensemble_ctrl.config.fields import Model, whole
from ensemble_ctrl.config.laws import LawSection, OffsetSection, TurnSection
from ensemble_ctrl.config.motions import MotionSection
from ensemble_ctrl.config.samples import Columns
from ensemble_ctrl.config.shapes import ObstacleShape, RegionShape
from ensemble_ctrl.config.targets import Terminal as TerminalTarget
from ensemble_ctrl.config.wrong import Wrong
from ensemble_ctrl.problem import Guarantee, Method, Objective, ReportOptions, SolveOptions, VerifyOptions
from ensemble_ctrl.risk import Risk
from ensemble_ctrl.systems import SYSTEMS, Bicycle


class Parameters(Model):
    """The parameters that differ between members; those left out are the same for all."""

    traction: LawSection | None = None
    linear_traction: LawSection | None = None
    angular_traction: LawSection | None = None
    start_x: OffsetSection | None = None
    start_y: OffsetSection | None = None
    start_heading: TurnSection | None = None

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        """`traction` is both of the others in one number."""
        for name in ("linear_traction", "angular_traction"):
            if self.traction is not None and getattr(self, name) is not None:
                raise Wrong(f"expected traction or {name}, got both", "traction scales both at once", (name,))
        return self


class Start(Model):
    """Where all members start; the heading counts counter-clockwise from +x, or clockwise from +y."""

    position: f.Point
    heading: f.Angle
    heading_from: Literal["x", "y"] = "x"


class InputBounds(Model):
    """Bounds of the commands: v and omega for a unicycle, v and delta for a bicycle."""

    v: f.SpeedBounds | None = None
    omega: f.TurnRateBounds | None = None
    delta: f.SteeringBounds | None = None


class RateBounds(Model):
    """Largest change of each command per second."""

    v: f.Positive | None = None
    omega: f.Positive | None = None
    delta: f.Positive | None = None


class FleetSection(Model):
    """Who moves."""

    model: f.ModelName
    wheelbase: f.Wheelbase | None = None
    parameters: Parameters = Parameters(traction=LawSection())
    cloud: Cloud | None = None
    start: Start
    input_bounds: InputBounds = InputBounds()
    rate_bounds: RateBounds | None = None
    radius: f.Margin = 0.0
    _robots: Columns = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _read_cloud(self, info: ValidationInfo) -> Self:
        """Read the table of measured robots; what it holds is not given by a law too."""
        if self.cloud is not None:
            self._robots = read_cloud(self.cloud, (info.context or {}).get("folder", Path()))
            laws = {name for name, law in self.parameters if law is not None and "parameters" in self.model_fields_set}
            for name in sorted(laws & set(self._robots)):
                raise Wrong(f"expected {name} in the cloud or among the parameters, got both", path=("cloud",))
        return self

    @property
    def robots(self) -> Columns:
        """Columns of the measured robots."""
        return self._robots

    @model_validator(mode="after")
    def _of_its_model(self) -> Self:
        """Only what the model has."""
        system = SYSTEMS[self.model]
        for name in self.input_bounds.model_fields_set - set(system.controls):
            controls = " and ".join(system.controls)
            raise Wrong(f"expected bounds of {controls}, got {name!r}", path=("input_bounds", name))
        for name in (self.rate_bounds.model_fields_set if self.rate_bounds else set()) - set(system.controls):
            controls = " and ".join(system.controls)
            raise Wrong(f"expected rates of {controls}, got {name!r}", path=("rate_bounds", name))
        if self.wheelbase is not None and self.model != Bicycle.name:
            raise Wrong(f"expected a wheelbase for the bicycle only, got one for the {self.model}", path=("wheelbase",))
        return self


class Horizon(Model):
    """How long, in how many steps (one each 0.1 s by default)."""

    duration: f.FreeDuration
    steps: Annotated[int, BeforeValidator(whole(1, MAX_STEPS))] | None = None

    @property
    def bounds(self) -> tuple[float, float | None]:
        """The duration, or the longest and the shortest."""
        return self.duration if isinstance(self.duration, tuple) else (self.duration, None)


class Moments(Model):
    """How the fleet is represented."""

    basis: Literal["legendre"] = "legendre"
    order: f.Order = None


class Terminal(Model):
    """Where the fleet should end."""

    target: TerminalTarget
    weight: f.Weight = Objective.terminal


class CvarSection(Model):
    """A price on the worst part of the fleet."""

    of: Literal["terminal", "clearance"]
    level: Annotated[float, BeforeValidator(f.level)] = Risk.level
    weight: f.Weight = Risk.weight


class ObjectiveSection(Model):
    """What the plan trades off."""

    robustness: f.Weight = Objective.robustness
    terminal: Terminal | None = None
    effort: f.Effort = 0.1
    smoothness: f.Weight = Objective.smoothness
    cvar: CvarSection | None = None
    earliest: f.Name | None = None


class Solve(Model):
    """How to solve."""

    method: Method = SolveOptions.method
    guarantee: Guarantee = SolveOptions.guarantee
    time_limit: f.Duration = SolveOptions.time_limit
    seed: Annotated[int, BeforeValidator(whole(0, MAX_SEED))] = SolveOptions.seed
    margin: f.Margin = SolveOptions.margin
    routes: f.Routes = SolveOptions.routes
    max_iterations: Annotated[int, BeforeValidator(whole(1, 1_000_000))] = SolveOptions.max_iterations
    cells: Annotated[int, BeforeValidator(whole(1, 64))] = SolveOptions.cells


class Verify(Model):
    """How to check a plan."""

    members: Annotated[int, BeforeValidator(whole(1, MAX_MEMBERS))] = VerifyOptions.members
    substeps: Annotated[int, BeforeValidator(whole(1, 1000))] = VerifyOptions.substeps
    certificate: Annotated[bool, BeforeValidator(f.flag)] = VerifyOptions.certificate


class ReportSection(Model):
    """What figures show."""

    twin: Annotated[bool, BeforeValidator(f.flag)] = ReportOptions.twin


def _listed(value: Any) -> Any:
    """One shape as a list of one."""
    return [value] if isinstance(value, dict) else value


Shapes = Annotated[list[ObstacleShape], BeforeValidator(_listed)]


class ProblemFile(Model):
    """A problem: only the model, the start, the duration and the task are required."""

    version: Annotated[int, BeforeValidator(f.format_version)] = 1
    name: f.FolderName | None = None
    fleet: FleetSection
    horizon: Horizon
    moments: Moments = Moments()
    regions: dict[f.Name, RegionShape] = Field(default_factory=dict)
    obstacles: dict[f.Name, Shapes] = Field(default_factory=dict)
    motions: dict[f.Name, MotionSection] = Field(default_factory=dict)
    task: f.Task
    objective: ObjectiveSection = ObjectiveSection()
    solve: Solve = Solve()
    verify: Verify = Verify()
    report: ReportSection = ReportSection()

    @model_validator(mode="after")
    def _weights_of_its_model(self) -> Self:
        """Weights of the commands that the model has."""
        controls, effort = SYSTEMS[self.fleet.model].controls, self.objective.effort
        for name in sorted((set(effort) if isinstance(effort, dict) else set()) - set(controls)):
            message = f"expected weights of {' and '.join(controls)}, got {name!r}"
            raise Wrong(message, path=("objective", "effort", name))
        return self
