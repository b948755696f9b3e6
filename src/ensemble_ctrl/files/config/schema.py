"""The problem file, one pydantic model per section. Values are in SI units and radians."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, PrivateAttr, ValidationInfo, model_validator

from ensemble_ctrl.files.config import fields as f
from ensemble_ctrl.files.config.clouds import Cloud, read_cloud
from ensemble_ctrl.files.config.fields import Model, whole
from ensemble_ctrl.files.config.laws import LawSection, OffsetSection, TurnSection
from ensemble_ctrl.files.config.motions import MotionSection
from ensemble_ctrl.files.config.online import OnlineSection
from ensemble_ctrl.files.config.samples import Columns
from ensemble_ctrl.files.config.shapes import ObstacleShape, RegionShape
from ensemble_ctrl.files.config.targets import Terminal as TerminalTarget
from ensemble_ctrl.files.config.wrong import Wrong
from ensemble_ctrl.problem import Guarantee, Method, Objective, ReportOptions, SolveOptions, VerifyOptions
from ensemble_ctrl.problem.checks import MAX_MEMBERS, MAX_SEED, MAX_STEPS
from ensemble_ctrl.problem.risk import Risk
from ensemble_ctrl.systems import SYSTEMS, Bicycle


class Parameters(Model):
    """The parameters that differ between members; those left out are the same for all."""

    traction: LawSection | None = None
    """Factor on speed and turn rate at once; above 0."""
    linear_traction: LawSection | None = None
    """Factor on the speed alone; above 0."""
    angular_traction: LawSection | None = None
    """Factor on the turn rate alone; above 0."""
    start_x: OffsetSection | None = None
    """Offset of the start from `start.position`, in metres."""
    start_y: OffsetSection | None = None
    """Offset of the start from `start.position`, in metres."""
    start_heading: TurnSection | None = None
    """Offset of the heading from `start.heading`, counter-clockwise, in radians."""

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
    """Who moves."""

    model: f.ModelName
    """The dynamics all members share; `ensemble-plan models` lists them."""
    wheelbase: f.Wheelbase | None = None
    """Bicycle only: distance between the axles; 0.3 m if not given."""
    parameters: Parameters = Field(default_factory=lambda: Parameters(traction=LawSection()))
    """What differs between members; without the section, `traction` from 0.9 to 1.1."""
    cloud: Cloud | None = None
    """Measured robots whose parameters belong together: a CSV file with a column for each, or columns."""
    start: Start
    """Where all members start."""
    input_bounds: InputBounds = Field(default_factory=InputBounds)
    """Bounds of the commands."""
    rate_bounds: RateBounds | None = None
    """Largest change of each command per second, from each step to the next."""
    radius: f.Margin = 0.0
    """Radius of a robot; what `avoid(...)` names grows by it."""
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
    """Length of the plan, `T` in the task; or `{at_most: ..., at_least: ...}`, and the plan is as short as can be."""
    steps: Annotated[int, BeforeValidator(whole(1, MAX_STEPS))] | None = None
    """Control steps of equal length; by default one each 0.1 s."""

    @property
    def bounds(self) -> tuple[float, float | None]:
        """The duration, or the longest and the shortest."""
        return self.duration if isinstance(self.duration, tuple) else (self.duration, None)


class Moments(Model):
    """How the fleet is represented."""

    basis: Literal["legendre"] = "legendre"
    """Polynomials of the moments."""
    order: f.Order = None
    """Truncation order N: moments 0 to N. `auto` takes the lowest one that errs by less than 0.1 mm."""


class Terminal(Model):
    """Where the fleet should end."""

    target: TerminalTarget
    """Where the fleet should end: `[x, y]`, or a formation, moments, or mean and covariance."""
    weight: f.Weight = Objective.terminal
    """Weight of the squared terminal moment error, per m²."""


class CvarSection(Model):
    """A price on the worst part of the fleet."""

    of: Literal["terminal", "clearance"]
    """What the price is on: the distance from the target at the end, or the clearance on the way."""
    level: Annotated[float, BeforeValidator(f.level)] = Risk.level
    """Share of the fleet that is left out of the mean, 0 to below 1."""
    weight: f.Weight = Risk.weight
    """Weight per metre."""


class ObjectiveSection(Model):
    """What the plan trades off."""

    robustness: f.Weight = Objective.robustness
    """Reward for each metre of the task's robustness."""
    terminal: Terminal | None = None
    """Where the fleet should end; without it no terminal term."""
    effort: f.Effort = 0.1
    """Weight of the integral of the squared commands; or one for each, `{v: 0.1, omega: 0.02}`."""
    smoothness: f.Weight = Objective.smoothness
    """Weight of the integral of the squared rates of the commands."""
    cvar: CvarSection | None = None
    """A price on the worst part of the fleet."""
    earliest: f.Name | None = None
    """A region that every member is to pass as soon as can be, before all else."""


class Solve(Model):
    """How to solve."""

    method: Method = SolveOptions.method
    """`nlp`: nonlinear program, IPOPT. `minlp`: facets of the obstacles chosen anew with Bonmin."""
    guarantee: Guarantee = SolveOptions.guarantee
    """For whom the program's constraints hold: every member (`hull`), the Gauss nodes, or the moments."""
    time_limit: f.Duration = SolveOptions.time_limit
    """The best plan so far is returned after this time."""
    seed: Annotated[int, BeforeValidator(whole(0, MAX_SEED))] = SolveOptions.seed
    """Seed of the replayed members."""
    margin: f.Margin = SolveOptions.margin
    """What the program keeps to spare, from obstacles and in the robustness."""
    routes: f.Routes = SolveOptions.routes
    """Routes tried on a coarse grid before the best is refined. `all`: every one around the obstacles without loops."""
    max_iterations: Annotated[int, BeforeValidator(whole(1, 1_000_000))] = SolveOptions.max_iterations
    """Iterations of one solve."""
    cells: Annotated[int, BeforeValidator(whole(1, 64))] = SolveOptions.cells
    """Parts of the first parameter's range with separating hyperplanes of their own; for wide fleets."""


class Verify(Model):
    """How to check a plan."""

    members: Annotated[int, BeforeValidator(whole(1, MAX_MEMBERS))] = VerifyOptions.members
    """Members replayed."""
    substeps: Annotated[int, BeforeValidator(whole(1, 1000))] = VerifyOptions.substeps
    """Looks at the obstacles in each step of the replay."""
    certificate: Annotated[bool, BeforeValidator(f.flag)] = VerifyOptions.certificate
    """Prove the plan for all parameters and times, and tighten until that succeeds."""


class ReportSection(Model):
    """What figures and summary show."""

    twin: Annotated[bool, BeforeValidator(f.flag)] = ReportOptions.twin
    """Plan the same problem without obstacles and bounding regions too, and draw it dashed."""
    suggest: Annotated[bool, BeforeValidator(f.flag)] = ReportOptions.suggest
    """Where no plan is found, look up to 30 s for a change of the problem that would help."""


def _listed(value: Any) -> Any:
    """One shape as a list of one."""
    return [value] if isinstance(value, dict) else value


Shapes = Annotated[list[ObstacleShape], BeforeValidator(_listed)]


class ProblemFile(Model):
    """A problem: only the model, the start, the duration and the task are required."""

    version: Annotated[int, BeforeValidator(f.format_version)] = 1
    """Version of the file's format."""
    name: f.FolderName | None = None
    """Names the results folder; by default the file's name."""
    fleet: FleetSection
    """Who moves: the model, what differs between its members, where they start."""
    horizon: Horizon
    """How long, in how many steps."""
    moments: Moments = Field(default_factory=Moments)
    """How the fleet is represented."""
    regions: dict[f.Name, RegionShape] = Field(default_factory=dict)
    """Named convex areas that the task speaks of."""
    obstacles: dict[f.Name, Shapes] = Field(default_factory=dict)
    """Named areas that the task can say `avoid(...)` of, each one shape or a list of shapes."""
    motions: dict[f.Name, MotionSection] = Field(default_factory=dict)
    """How obstacles move from where they are drawn; those not named here stand still."""
    ignore: list[f.Name] = Field(default_factory=list)
    """Obstacles that need not be avoided throughout: no warning of it."""
    task: f.Task
    """What every member has to do, a formula such as `F[14, 16] in(goal) and G avoid(obstacles)`."""
    objective: ObjectiveSection = Field(default_factory=ObjectiveSection)
    """What the plan trades off."""
    solve: Solve = Field(default_factory=Solve)
    """How to solve."""
    verify: Verify = Field(default_factory=Verify)
    """How to check a plan."""
    report: ReportSection = Field(default_factory=ReportSection)
    """What figures and summary show."""
    online: OnlineSection | None = None
    """How a loop runs, and the robot that it is tried on, for `ensemble-plan online`."""
