"""The problem file, one pydantic model per section. Values are in SI units and radians."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from ensemble_ctrl.files.config import fields as f
from ensemble_ctrl.files.config.fields import Model, whole
from ensemble_ctrl.files.config.fleets import AnyFleet
from ensemble_ctrl.files.config.motions import MotionSection
from ensemble_ctrl.files.config.online import OnlineSection
from ensemble_ctrl.files.config.shapes import ObstacleShape, RegionShape
from ensemble_ctrl.files.config.targets import Terminal as TerminalTarget
from ensemble_ctrl.problem import (
    Coordinates,
    Guarantee,
    Integrator,
    Method,
    Objective,
    ReportOptions,
    SolveOptions,
    VerifyOptions,
)
from ensemble_ctrl.problem.checks import MAX_MEMBERS, MAX_SEED, MAX_STEPS
from ensemble_ctrl.problem.risk import Risk


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
    coordinates: Coordinates = "nodal"
    """Variables of the program: robots at the Gauss nodes (`nodal`), or the moments, as in the paper (`modal`)."""
    integrator: Integrator = "exponential"
    """Step of modal coordinates: exact (`exponential`), or the classical Runge-Kutta rule (`rk4`)."""


class Terminal(Model):
    """Where the fleet should end."""

    target: TerminalTarget
    """Where the fleet should end: `[x, y]`, or a formation, moments, or mean and covariance."""
    weight: f.Weight = Objective.terminal
    """Weight of the squared terminal moment error, per m²."""


class CvarSection(Model):
    """A penalty on the worst part of the fleet."""

    of: Literal["terminal", "clearance"]
    """What is penalised: the distance from the target at the end, or the clearance on the way."""
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
    """A penalty on the worst part of the fleet."""
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
    solver: str = SolveOptions.solver
    """Which solver each nonlinear program is given to: `ipopt`, `sqp`, or one that you registered."""


class Verify(Model):
    """How to check a plan."""

    members: Annotated[int, BeforeValidator(whole(1, MAX_MEMBERS))] = VerifyOptions.members
    """Members replayed."""
    substeps: Annotated[int, BeforeValidator(whole(1, 1000))] = VerifyOptions.substeps
    """Samples per step of the replay."""
    certificate: Annotated[bool, BeforeValidator(f.flag)] = VerifyOptions.certificate
    """Prove the plan for all parameters and times, and tighten until that succeeds."""


class ReportSection(Model):
    """What figures and summary show."""

    baseline: Annotated[bool, BeforeValidator(f.flag)] = ReportOptions.baseline
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
    fleet: AnyFleet
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
