"""The section ``online`` of a problem file: how the loop runs, and the simulated robots that it is tried on."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config import fields as f
from ensemble_ctrl.files.config.errors import FieldError
from ensemble_ctrl.files.config.fields import Model, whole
from ensemble_ctrl.files.config.motions import MotionSection
from ensemble_ctrl.files.config.shapes import ObstacleShape, RegionShape
from ensemble_ctrl.files.config.uncertainty_section import UncertaintySection, read_bounds
from ensemble_ctrl.planning.online.options import MAX_ORDER, OnlineOptions
from ensemble_ctrl.planning.online.propagation import Errors
from ensemble_ctrl.planning.online.settings import OnlineSettings, RobotSettings
from ensemble_ctrl.planning.online.simulated import SMALL_CAR_FLAWS, Drifting, Factors, Fixed, Flaws, Terrain
from ensemble_ctrl.planning.online.simulated_errors import ErrorKind
from ensemble_ctrl.planning.online.simulated_obstacles import ObstacleSettings, Straying
from ensemble_ctrl.problem.arguments.units import quantity
from ensemble_ctrl.problem.checks import MAX_SEED, Finding
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.systems import System

Turn = Annotated[float, BeforeValidator(quantity("angle", 0)), f.numeric("angle", minimum=0)]
Delay = Annotated[float, BeforeValidator(quantity("time", 0)), f.numeric("time", minimum=0)]
Rate = Annotated[float, BeforeValidator(quantity("number", 0)), f.numeric("number", minimum=0)]
Magnitudes = Annotated[tuple[f.Positive, f.Positive], BeforeValidator(f.pair("[of v, of the other command]"))]


def _share(value: Any) -> float:
    """A share of messages."""
    share = quantity("number", 0)(value)
    if share >= 1:
        raise FieldError(f"expected a share from 0 to below 1, got {share:g}")
    return share


Share = Annotated[float, BeforeValidator(_share), f.numeric("number", minimum=0, exclusiveMaximum=1)]


class NoiseSection(Model):
    """Largest errors of a measured pose."""

    position: f.Margin = Errors.position
    """Largest error of x and of y."""
    heading: Turn = Errors.heading
    """Largest error of the heading."""


class LostSection(Model):
    """Shares of lost messages."""

    measurements: Share = 0.0
    """Share of lost measurements."""
    commands: Share = 0.0
    """Share of lost commands."""


class DriftSection(Model):
    """Factors that vary as a sine."""

    middle: f.Positive
    """Mean value of the factors."""
    amplitude: Rate
    """Amplitude."""
    period: f.Duration
    """Period."""


class PatchSection(Model):
    """A patch of ground with its own traction."""

    region: RegionShape
    """The patch, in any form of a region."""
    traction: f.Positive
    """Factor on speed and turn rate inside."""


class RobotSection(Model):
    """The simulated robot; its parameters may lie outside the fleet's ranges."""

    parameters: dict[f.Name, float] = Field(default_factory=dict)
    """True parameters of a system defined by an ODE, by name; drawn from the ranges if not given."""
    preset: Literal["small_car"] | None = None
    """`small_car`: a car at a tenth of its size; steering ends at 0.36 rad, commands are rounded."""
    traction: f.Positive | None = None
    """True factor on speed and turn rate; drawn from the ranges if no factor is given. May be outside them."""
    linear_traction: f.Positive | None = None
    """True factor on the speed alone."""
    angular_traction: f.Positive | None = None
    """True factor on the turn rate alone."""
    drifting: DriftSection | None = None
    """Factors that vary as a sine."""
    terrain: list[PatchSection] = Field(default_factory=list)
    """Patches of its own in place of the problem's `terrain`, each `{region: {box: ...}, traction: ...}`, unknown
    to the loop. The first that holds the robot counts."""
    noise: NoiseSection | None = None
    """Actual measurement errors, uniform; by default as large as assumed."""
    delay: Delay | None = None
    """Latency of the measurements; 0.1 s by default."""
    command_delay: Delay = 0.0
    """Latency of the commands, beside that of `fleet.uncertainty`, of which the loop does not know."""
    errors: ErrorKind = "random"
    """How its errors go within the bounds of `fleet.uncertainty`: uniform in each step; `bang-bang`, at the bounds with
    a change of sign every 3 s or so; `constant`, at the bounds for good; `none`. On arcs only."""
    uncertainty: UncertaintySection | None = None
    """Bounds of its errors in place of the fleet's, larger ones too. On arcs only."""
    saturation: Magnitudes | None = None
    """Saturation: largest absolute value of each command."""
    quantum: Magnitudes | None = None
    """Commands are rounded to multiples of these."""
    lost: LostSection = Field(default_factory=LostSection)
    """Shares of lost messages."""
    seed: Annotated[int, BeforeValidator(whole(0, MAX_SEED))] = 0
    """Seed of the random errors."""

    @model_validator(mode="after")
    def _one_truth(self) -> Self:
        """Factors given in one way."""
        apart = self.linear_traction is not None or self.angular_traction is not None
        if self.drifting is not None and (self.traction is not None or apart or self.terrain):
            raise FieldError("expected drifting alone, got other factors too", path=("drifting",))
        if apart and (self.traction is not None or self.terrain):
            raise FieldError("expected traction, or linear_traction and angular_traction, got both", path=("traction",))
        return self

    def settings(self, errors: Errors, system: System, place: int = 0) -> RobotSettings:
        """As the loop's simulation takes it; among several, seeds that are not given are those of their places."""
        seed = self.seed if "seed" in self.model_fields_set else place
        bounds = None if self.uncertainty is None else self._bounds(self.uncertainty, system)
        return RobotSettings(self._factors(), self._flaws(errors), seed, self.errors, bounds, self.parameters)

    def _bounds(self, given: UncertaintySection, system: System) -> Uncertainty:
        """Those of its errors, which a simulation on arcs has."""
        if not system.on_arcs:
            raise FieldError(f"expected none, since a simulated {system.name} follows its model", path=("uncertainty",))
        return read_bounds(given, system)

    def _factors(self) -> Factors | None:
        """The true factors, if any are given."""
        if self.drifting is not None:
            return Drifting(self.drifting.middle, self.drifting.amplitude, self.drifting.period)
        if self.terrain:
            patches = [(patch.region.area, patch.traction) for patch in self.terrain]
            return Terrain(patches, 1.0 if self.traction is None else self.traction)
        factors = (self.linear_traction, self.angular_traction)
        if self.traction is not None:
            factors = (self.traction, self.traction)
        return None if factors == (None, None) else Fixed(*(1.0 if value is None else value for value in factors))

    def _flaws(self, errors: Errors) -> Flaws:
        """What is wrong with it; measurements are as wrong as is assumed, unless given otherwise."""
        base = SMALL_CAR_FLAWS if self.preset else Flaws(errors.position, errors.heading, 0.1)
        return Flaws(
            position=base.position if self.noise is None else self.noise.position,
            heading=base.heading if self.noise is None else self.noise.heading,
            delay=base.delay if self.delay is None else self.delay,
            command_delay=self.command_delay,
            saturation=base.saturation if self.saturation is None else self.saturation,
            quantum=base.quantum if self.quantum is None else self.quantum,
            lost_measurements=self.lost.measurements,
            lost_commands=self.lost.commands,
        )


class ComingSection(ObstacleShape):
    """An obstacle that comes while the loop runs, in any form of an obstacle; nothing is known of it before."""

    appears: Delay = 0.0
    """When it is seen first, where it is drawn."""
    vanishes: f.Duration | None = None
    """When it is gone; never by default."""
    motion: MotionSection | None = None
    """How it is predicted to move, as in `motions`, with `uncertainty`; times count from its appearance."""
    seen_every: f.Duration | None = None
    """Time after which it is measured, and predicted, anew, as well as at first; never by default."""
    strays: Straying = "towards"
    """How the simulated one leaves the prediction, as fast as its uncertainty grows: `towards` the nearest robot,
    `away`, `random`, or `none`."""
    seed: Annotated[int, BeforeValidator(whole(0, MAX_SEED))] = 0
    """Seed of all that is drawn."""

    @model_validator(mode="after")
    def _in_time(self) -> Self:
        """It goes after it has come, and is predicted when it is seen."""
        if self.vanishes is not None and self.vanishes <= self.appears:
            wanted = f"expected a time after it appears, at {self.appears:g} s, got {self.vanishes:g} s"
            raise FieldError(wanted, path=("vanishes",))
        if self.motion is not None and self.motion.uncertainty.since:
            wanted = f"expected none, since it is predicted when it appears, got {self.motion.uncertainty.since:g} s"
            raise FieldError(wanted, path=("motion", "uncertainty", "since"))
        if self.seen_every is not None and self.motion is None:
            raise FieldError("expected a motion to predict anew, got none", path=("seen_every",))
        return self

    def settings(self, end: float) -> ObstacleSettings:
        """As the simulation takes it, predicted up to the time `end`."""
        motion = None if self.motion is None else self.motion.motion(max(end, 1e-3))
        return ObstacleSettings(
            self.pieces, self.appears, self.vanishes, motion, self.seen_every, self.strays, self.seed
        )


class OnlineSection(Model):
    """Settings of the loop, and the simulated robots."""

    applied_steps: Annotated[int, BeforeValidator(whole(1, 10_000))] = OnlineOptions.applied_steps
    """Control steps of each plan that are applied."""
    deadline: f.Duration = OnlineOptions.deadline
    """Time to replan, proof included; at most the steps applied. It starts this long before the new plan is used."""
    noise: NoiseSection = Field(default_factory=NoiseSection)
    """Assumed bounds of the measurement errors."""
    drift: Rate = 0.0
    """Assumed bound of the change of a factor, per second, without end but for its range."""
    learn: Annotated[bool, BeforeValidator(f.flag)] = OnlineOptions.learn
    """Whether parameters are estimated; otherwise their ranges are kept."""
    horizon: Literal["shrinking", "receding"] = OnlineOptions.horizon
    """`shrinking`: windows are absolute. `receding`: the task starts again at the current time of each plan."""
    run_for: f.Duration | None = None
    """With `receding`: how long the loop runs."""
    order: Annotated[int, BeforeValidator(whole(1, MAX_ORDER))] = OnlineOptions.order
    """Truncation order of the plans."""
    rounds: Annotated[int, BeforeValidator(whole(1, 100))] = OnlineOptions.rounds
    """Largest number of quadratic programs for one plan."""
    states: dict[f.Name, Rate] = Field(default_factory=dict)
    """For a system defined by an ODE, all of whose states are measured: assumed bound of each one's error, in its unit;
    0.01 for states that are not named."""
    silence: f.Duration = OnlineOptions.silence
    """The robot is stopped after this time without a measurement."""
    recovery: f.Duration = OnlineOptions.recovery
    """How long a stopped robot may search for a plan."""
    attempts: Annotated[int, BeforeValidator(whole(0, 100))] = OnlineOptions.attempts
    """How often it may search."""
    robot: RobotSection = Field(default_factory=RobotSection)
    """The simulated robot; its parameters may lie outside the fleet's ranges."""
    robots: dict[f.Name, RobotSection] = Field(default_factory=dict)
    """Several robots that receive the same commands, each as in `robot`; seeds are 0, 1, ... by default."""
    obstacles: dict[f.Name, ComingSection] = Field(default_factory=dict)
    """Obstacles that come, move and go while the loop runs, by names of their own."""

    @model_validator(mode="after")
    def _one_or_several(self) -> Self:
        """Robots given in one way."""
        if self.robots and "robot" in self.model_fields_set:
            raise FieldError("expected robot, or robots by name, got both", path=("robots",))
        return self

    @model_validator(mode="after")
    def _how_long(self) -> Self:
        """A receding horizon never ends by itself."""
        if self.horizon == "receding" and self.run_for is None:
            raise FieldError("expected run_for with `horizon: receding`, which never ends by itself", path=("horizon",))
        if self.horizon == "shrinking" and self.run_for is not None:
            raise FieldError("expected run_for only with `horizon: receding`", path=("run_for",))
        return self

    @model_validator(mode="before")
    @classmethod
    def _moved(cls, given: Any) -> Any:
        """Bounds of actuators are the fleet's today."""
        for name in ("actuators",) if isinstance(given, dict) else ():
            if name in given:
                hint = "by the names of the commands, as in  fleet: {uncertainty: {actuators: {v: 2 cm/s}}}"
                raise FieldError("moved to fleet.uncertainty.actuators", hint, (name,), on_key=True)
        return given

    def settings(self, system: System, duration: float) -> OnlineSettings:
        """As the loop takes it, for a fleet of a system and a task that takes `duration` seconds."""
        errors = Errors(self.noise.position, self.noise.heading, self.drift)
        options = OnlineOptions(
            errors=errors, **self.model_dump(exclude={"noise", "drift", "robot", "robots", "obstacles"})
        )
        robots, found = self.robots or {"robot": self.robot}, {}
        for k, (name, robot) in enumerate(robots.items()):
            try:
                found[name] = robot.settings(errors, system, k)
            except FieldError as error:
                path = ("online", *(("robots", name) if self.robots else ("robot",)), *error.path)
                wrong = ProblemError(f"{'.'.join(map(str, path))}: {error.message}")
                wrong.findings = (Finding(path, error.message, error.hint, on_key=error.on_key),)
                raise wrong from None
        end = duration + (self.run_for or 0.0)
        return OnlineSettings(options, found, {name: each.settings(end) for name, each in self.obstacles.items()})
