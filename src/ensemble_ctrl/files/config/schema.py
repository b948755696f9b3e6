"""The problem file, one pydantic model per section. Values are in SI units and radians."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema

from ensemble_ctrl.files.config import fields as f
from ensemble_ctrl.files.config.axes import RANGE, Axis, axes
from ensemble_ctrl.files.config.fields import Model, whole
from ensemble_ctrl.files.config.fleets import AnyFleet
from ensemble_ctrl.files.config.motions import MotionSection
from ensemble_ctrl.files.config.online import OnlineSection
from ensemble_ctrl.files.config.shapes import ObstacleShape, RegionShape
from ensemble_ctrl.files.config.targets import Terminal as TerminalTarget
from ensemble_ctrl.files.config.terrain_section import TerrainSection
from ensemble_ctrl.files.config.uncertainty_section import UncertaintySection
from ensemble_ctrl.files.config.zones import ZoneShape
from ensemble_ctrl.problem import (
    Coordinates,
    Grid,
    Guarantee,
    Integrator,
    Method,
    Objective,
    Offered,
    ReportOptions,
    SolveOptions,
    VerifyOptions,
)
from ensemble_ctrl.problem.checks import MAX_MEMBERS, MAX_SEED, MAX_STEPS
from ensemble_ctrl.problem.risk import Risk


class Horizon(Model):
    """Duration and number of control steps."""

    duration: f.FreeDuration
    """Duration of the plan, `T` in the task; or `{at_most: ..., at_least: ...}` for minimum time."""
    steps: Annotated[int, BeforeValidator(whole(1, MAX_STEPS))] | None = None
    """Control steps of equal length; by default one per 0.1 s."""

    @property
    def bounds(self) -> tuple[float, float | None]:
        """The duration, or the longest and the shortest."""
        return self.duration if isinstance(self.duration, tuple) else (self.duration, None)


class Moments(Model):
    """How the fleet is represented."""

    basis: Literal["legendre"] = "legendre"
    """Basis of the moments."""
    order: f.Order = None
    """Truncation order N: moments 0 to N. `auto`: the lowest with an error below 0.1 mm."""
    coordinates: Coordinates = "nodal"
    """Variables of the program: robots at the Gauss nodes (`nodal`), or the moments, as in the paper (`modal`)."""
    integrator: Integrator = "exponential"
    """Step of modal coordinates: exact (`exponential`), or the classical Runge-Kutta rule (`rk4`)."""


class Terminal(Model):
    """Terminal cost."""

    target: TerminalTarget
    """Where the fleet should end: `[x, y]`, a formation, moments, mean and covariance, or a pose to be reached."""
    weight: f.Weight = Objective.terminal
    """Weight of the squared terminal moment error, per m²."""


class CvarSection(Model):
    """A penalty on the worst part of the fleet."""

    of: Literal["terminal", "clearance"]
    """What is penalised: the distance from the target at the end, or the clearance on the way."""
    level: Annotated[float, BeforeValidator(f.level)] = Risk.level
    """Level of the CVaR: the share of the fleet left out of the mean, 0 to below 1."""
    weight: f.Weight = Risk.weight
    """Weight per metre."""


class ObjectiveSection(Model):
    """Weights of the objective."""

    robustness: f.Weight = Objective.robustness
    """Reward for each metre of the task's robustness."""
    terminal: Terminal | None = None
    """Where the fleet should end; without it no terminal term."""
    effort: f.Effort = 0.1
    """Weight of the integral of the squared commands; or one for each, `{v: 0.1, omega: 0.02}`."""
    smoothness: f.Weight = Objective.smoothness
    """Weight of the integral of the squared rates of the commands."""
    cvar: CvarSection | None = None
    """A penalty on the worst part of the fleet."""
    earliest: f.Name | None = None
    """A region that every member has to reach in minimum time; the other terms come second."""
    tolerance: UncertaintySection | None = None
    """Errors of the model, as in `fleet.uncertainty`: the plan tolerates as large a multiple of them as can be."""


class Solve(Model):
    """Solver settings."""

    method: Method = SolveOptions.method
    """`nlp`: nonlinear program. `minlp`: Bonmin chooses the facets of the obstacles."""
    guarantee: Guarantee = SolveOptions.guarantee
    """What the constraints bound: every member (`hull`), the Gauss nodes (`nodes`), or the moments (`moment`)."""
    time_limit: f.Duration = SolveOptions.time_limit
    """After this time the best plan so far is returned."""
    seed: Annotated[int, BeforeValidator(whole(0, MAX_SEED))] = SolveOptions.seed
    """Seed of the replayed members."""
    margin: f.Margin = SolveOptions.margin
    """Margin of the program to obstacles and in the robustness."""
    routes: f.Routes = SolveOptions.routes
    """Routes tried on a coarse grid before the best is refined. `all`: every one around the obstacles without loops."""
    max_iterations: Annotated[int, BeforeValidator(whole(1, 1_000_000))] = SolveOptions.max_iterations
    """Iterations of one solve."""
    cells: Annotated[int, BeforeValidator(whole(1, 64))] = SolveOptions.cells
    """Number of parts of the first parameter's range, each with its own separating hyperplanes; for wide ranges."""
    solver: str = SolveOptions.solver
    """Solver of the nonlinear programs: `ipopt`, `sqp`, or a registered one."""
    grid: Grid = SolveOptions.grid
    """With `minlp`, the grid on which facets are chosen: about 32 steps (`coarse`), or the problem's own (`full`)."""
    facets: Offered = SolveOptions.facets
    """With `minlp`, facets to choose from: `near` the plan's own, `all`, or those of a `linear` model (HiGHS)."""
    polish: Annotated[bool, BeforeValidator(f.flag)] = SolveOptions.polish
    """With `minlp`, improve a choice of facets with hyperplanes and margin; if not, it is kept as it is returned."""
    bonmin_limit: f.Duration = SolveOptions.bonmin_limit
    """What one run of Bonmin may take."""


class Verify(Model):
    """Replay and certificate."""

    members: Annotated[int, BeforeValidator(whole(1, MAX_MEMBERS))] = VerifyOptions.members
    """Number of simulated members."""
    substeps: Annotated[int, BeforeValidator(whole(1, 1000))] = VerifyOptions.substeps
    """Samples per step of the replay."""
    certificate: Annotated[bool, BeforeValidator(f.flag)] = VerifyOptions.certificate
    """Prove the plan for all parameters and times, and tighten until that succeeds."""


class ReportSection(Model):
    """Contents of figures and summary."""

    baseline: Annotated[bool, BeforeValidator(f.flag)] = ReportOptions.baseline
    """Also plan without obstacles and bounding regions, drawn dashed."""
    suggest: Annotated[bool, BeforeValidator(f.flag)] = ReportOptions.suggest
    """If no plan is found, search up to 30 s for a change of the problem that helps."""


def _listed(value: Any) -> Any:
    """One shape as a list of one."""
    return [value] if isinstance(value, dict) else value


Shapes = Annotated[list[ObstacleShape], BeforeValidator(_listed)]


AXIS = {
    "anyOf": [
        {"type": "array", "minItems": 1},
        {"type": "object", "required": ["from", "to"], "properties": dict.fromkeys(RANGE, True)},
        {"type": "object", "required": ["seeds"], "properties": {"seeds": {"type": "integer"}, "first": True}},
        {"type": "object", "required": ["files"], "properties": {"files": {"type": "string"}}},
    ]
}
"""The JSON Schema of one axis."""
Sweep = Annotated[
    tuple[Axis, ...], BeforeValidator(axes), WithJsonSchema({"type": "object", "additionalProperties": AXIS})
]


class ProblemFile(Model):
    """A problem: only the model, the start, the duration and the task are required."""

    version: Annotated[int, BeforeValidator(f.format_version)] = 1
    """Version of the file's format."""
    name: f.FolderName | None = None
    """Name of the results folder; by default the file's name."""
    fleet: AnyFleet
    """Model, parameters and start of the members."""
    horizon: Horizon
    """Duration and number of control steps."""
    moments: Moments = Field(default_factory=Moments)
    """How the fleet is represented."""
    regions: dict[f.Name, RegionShape] = Field(default_factory=dict)
    """Named convex areas that the task uses."""
    obstacles: dict[f.Name, Shapes] = Field(default_factory=dict)
    """Named areas for `avoid(...)` in the task, each one shape or a list of shapes."""
    motions: dict[f.Name, MotionSection] = Field(default_factory=dict)
    """Motions of obstacles from where they are drawn; the others are static."""
    zones: dict[f.Name, ZoneShape] = Field(default_factory=dict)
    """Named areas that robots keep out of (`keep_out: true`) or drive slowly in (`v: 0.3 m/s`)."""
    terrain: dict[f.Name, TerrainSection] = Field(default_factory=dict)
    """Named patches of ground, such as mud, in which parameters of the robots may differ from their own values."""
    ignore: list[f.Name] = Field(default_factory=list)
    """Obstacles that the task need not avoid at all times: suppresses the warning."""
    task: f.Task
    """The task of every member, a formula such as `F[14, 16] in(goal) and G avoid(obstacles)`."""
    objective: ObjectiveSection = Field(default_factory=ObjectiveSection)
    """Weights of the objective."""
    solve: Solve = Field(default_factory=Solve)
    """Solver settings."""
    verify: Verify = Field(default_factory=Verify)
    """Replay and certificate."""
    report: ReportSection = Field(default_factory=ReportSection)
    """Contents of figures and summary."""
    online: OnlineSection | None = None
    """Settings of `ensemble-plan online` and its simulated robots."""
    sweep: Sweep = ()
    """Fields by their dotted keys with the values that they take in turn, for `ensemble-plan sweep`."""
