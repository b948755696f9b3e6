"""The section ``online`` of a problem file: how the loop runs, and the simulated robot that it is tried on."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from ensemble_ctrl.checks import MAX_SEED
from ensemble_ctrl.config import fields as f
from ensemble_ctrl.config.fields import Model, whole
from ensemble_ctrl.config.shapes import RegionShape
from ensemble_ctrl.config.units import quantity
from ensemble_ctrl.config.wrong import Wrong
from ensemble_ctrl.receding.membership import Errors
from ensemble_ctrl.receding.options import MAX_ORDER, OnlineOptions
from ensemble_ctrl.receding.settings import OnlineSettings, RobotSettings
from ensemble_ctrl.receding.simulated import SMALL_CAR_FLAWS, Drifting, Factors, Fixed, Flaws, Terrain

Turn = Annotated[float, BeforeValidator(quantity("angle", 0)), f.NUMERIC]
SpeedError = Annotated[float, BeforeValidator(quantity("speed", 0)), f.NUMERIC]
TurnRateError = Annotated[float, BeforeValidator(quantity("turn rate", 0)), f.NUMERIC]
Delay = Annotated[float, BeforeValidator(quantity("time", 0)), f.NUMERIC]
Rate = Annotated[float, BeforeValidator(quantity("number", 0)), f.NUMERIC]
Magnitudes = Annotated[tuple[f.Positive, f.Positive], BeforeValidator(f.pair("[of v, of the other command]"))]


def _share(value: Any) -> float:
    """A share of messages."""
    share = quantity("number", 0)(value)
    if share >= 1:
        raise Wrong(f"expected a share from 0 to below 1, got {share:g}")
    return share


Share = Annotated[float, BeforeValidator(_share), f.NUMERIC]


class NoiseSection(Model):
    """Largest errors of a measured pose."""

    position: f.Margin = Errors.position
    heading: Turn = Errors.heading


class ActuatorSection(Model):
    """Largest errors of the actuators."""

    speed: SpeedError = 0.0
    turn_rate: TurnRateError = 0.0


class LostSection(Model):
    """Shares of messages that are lost."""

    measurements: Share = 0.0
    commands: Share = 0.0


class DriftSection(Model):
    """Factors that swing about a middle."""

    middle: f.Positive
    amplitude: Rate
    period: f.Duration


class PatchSection(Model):
    """Ground with a traction of its own."""

    region: RegionShape
    traction: f.Positive


class RobotSection(Model):
    """The simulated robot; it need not be like the fleet."""

    preset: Literal["small_car"] | None = None
    traction: f.Positive | None = None
    linear_traction: f.Positive | None = None
    angular_traction: f.Positive | None = None
    drifting: DriftSection | None = None
    terrain: list[PatchSection] = Field(default_factory=list)
    noise: NoiseSection | None = None
    delay: Delay | None = None
    command_delay: Delay = 0.0
    actuators: ActuatorSection = ActuatorSection()
    saturation: Magnitudes | None = None
    quantum: Magnitudes | None = None
    lost: LostSection = LostSection()
    seed: Annotated[int, BeforeValidator(whole(0, MAX_SEED))] = 0

    @model_validator(mode="after")
    def _one_truth(self) -> Self:
        """Factors told in one way."""
        apart = self.linear_traction is not None or self.angular_traction is not None
        if self.drifting is not None and (self.traction is not None or apart or self.terrain):
            raise Wrong("expected drifting alone, got other factors too", path=("drifting",))
        if apart and (self.traction is not None or self.terrain):
            raise Wrong("expected traction, or linear_traction and angular_traction, got both", path=("traction",))
        return self

    def settings(self, errors: Errors) -> RobotSettings:
        """As the loop's simulation takes it."""
        return RobotSettings(self._factors(), self._flaws(errors), self.seed)

    def _factors(self) -> Factors | None:
        """The true factors, if any are told."""
        if self.drifting is not None:
            return Drifting(self.drifting.middle, self.drifting.amplitude, self.drifting.period)
        if self.terrain:
            patches = [(patch.region.area, patch.traction) for patch in self.terrain]
            return Terrain(patches, 1.0 if self.traction is None else self.traction)
        told = (self.linear_traction, self.angular_traction)
        if self.traction is not None:
            told = (self.traction, self.traction)
        return None if told == (None, None) else Fixed(*(1.0 if value is None else value for value in told))

    def _flaws(self, errors: Errors) -> Flaws:
        """What is wrong with it; measurements are as wrong as is assumed, unless told otherwise."""
        base = SMALL_CAR_FLAWS if self.preset else Flaws(errors.position, errors.heading, 0.1)
        return Flaws(
            position=base.position if self.noise is None else self.noise.position,
            heading=base.heading if self.noise is None else self.noise.heading,
            delay=base.delay if self.delay is None else self.delay,
            command_delay=self.command_delay,
            speed=self.actuators.speed,
            turn_rate=self.actuators.turn_rate,
            saturation=base.saturation if self.saturation is None else self.saturation,
            quantum=base.quantum if self.quantum is None else self.quantum,
            lost_measurements=self.lost.measurements,
            lost_commands=self.lost.commands,
        )


class OnlineSection(Model):
    """How the loop runs, and the robot that it is tried on."""

    applied_steps: Annotated[int, BeforeValidator(whole(1, 10_000))] = OnlineOptions.applied_steps
    deadline: f.Duration = OnlineOptions.deadline
    noise: NoiseSection = NoiseSection()
    drift: Rate = 0.0
    actuators: ActuatorSection = ActuatorSection()
    learn: Annotated[bool, BeforeValidator(f.flag)] = OnlineOptions.learn
    horizon: Literal["shrinking", "receding"] = OnlineOptions.horizon
    run_for: f.Duration | None = None
    order: Annotated[int, BeforeValidator(whole(1, MAX_ORDER))] = OnlineOptions.order
    rounds: Annotated[int, BeforeValidator(whole(1, 100))] = OnlineOptions.rounds
    silence: f.Duration = OnlineOptions.silence
    recovery: f.Duration = OnlineOptions.recovery
    attempts: Annotated[int, BeforeValidator(whole(0, 100))] = OnlineOptions.attempts
    robot: RobotSection = RobotSection()

    @model_validator(mode="after")
    def _how_long(self) -> Self:
        """A receding horizon never ends by itself."""
        if self.horizon == "receding" and self.run_for is None:
            raise Wrong("expected run_for with `horizon: receding`, which never ends by itself", path=("horizon",))
        if self.horizon == "shrinking" and self.run_for is not None:
            raise Wrong("expected run_for only with `horizon: receding`", path=("run_for",))
        return self

    def settings(self) -> OnlineSettings:
        """As the loop takes it."""
        noise, actuators = self.noise, self.actuators
        errors = Errors(noise.position, noise.heading, self.drift, actuators.speed, actuators.turn_rate)
        options = OnlineOptions(
            errors=errors,
            **self.model_dump(exclude={"noise", "drift", "actuators", "robot"}),
        )
        return OnlineSettings(options, self.robot.settings(errors))
