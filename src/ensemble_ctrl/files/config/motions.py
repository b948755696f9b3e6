"""Moving obstacles in a problem file."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config import fields as f
from ensemble_ctrl.files.config.errors import FieldError, show
from ensemble_ctrl.problem.arguments.units import quantity

Entry = tuple[float, tuple[float, ...]]
Growth = Annotated[float, BeforeValidator(quantity("speed", 0)), f.numeric("speed", minimum=0)]
Time = Annotated[float, BeforeValidator(quantity("time")), f.numeric("time")]
Velocity = Annotated[tuple[f.Speed, ...], BeforeValidator(f.few("[vx, vy]", 2, 3))]


def _path(value: Any) -> list[Entry]:
    """A list of times and displacements."""
    if not isinstance(value, list) or len(value) < 2:
        raise FieldError(f"expected two or more [time, [x, y]], got {show(value)}")
    return [_entry(i, row) for i, row in enumerate(value)]


def _entry(i: int, row: Any) -> Entry:
    """One time and its displacement."""
    pair = row[1] if isinstance(row, list) and len(row) == 2 else None
    if not isinstance(pair, list) or len(pair) not in (2, 3):
        raise FieldError(f"expected [time, [x, y]], got {show(row)}", path=(i,))
    time, length = quantity("time"), quantity("length")
    try:
        return time(row[0]), tuple(length(each) for each in pair)
    except FieldError as error:
        raise FieldError(error.message, error.hint, (i,)) from None


Course = Annotated[list[Entry] | None, BeforeValidator(_path), WithJsonSchema({"type": "array"})]


class LooseSection(f.Model):
    """How far an obstacle may be from where its motion says, in any direction: more and more with time."""

    position: f.Margin = 0.0
    """Distance up to the time `since`."""
    speed: Growth = 0.0
    """Metres that are added per second from then on."""
    since: Time = 0.0
    """Time at which the motion was predicted."""


class MotionSection(f.Model):
    """How an obstacle moves from where it is drawn: with a velocity, or along a path in time."""

    velocity: Velocity | None = None
    """Constant velocity `[vx, vy]`, in space `[vx, vy, vz]`, in m/s."""
    path: Course = None
    """Displacement over time, `[[time, [x, y]], ...]`, linear in between; in space `[x, y, z]`."""
    uncertainty: LooseSection = Field(default_factory=LooseSection)
    """How far from that it may be, `{position: 5 cm, speed: 2 cm/s}`; counted as if it were everywhere there."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        """Exactly one of the two, and times that increase."""
        if (self.velocity is None) == (self.path is None):
            raise FieldError(f"expected exactly one of velocity, path, got {'both' if self.path else 'none'}")
        if self.path is not None:
            try:
                self.motion(1.0)
            except ProblemError as error:
                raise FieldError(str(error).partition(": ")[2], path=("path",)) from None
        return self

    def motion(self, duration: float) -> Motion:
        """The motion over a horizon."""
        loose = self.uncertainty
        if self.path is None:
            known = Motion.steady(self.velocity or (0.0, 0.0), duration)
        else:
            times, offsets = zip(*self.path, strict=True)
            known = Motion(np.array(times), np.array(offsets))
        return replace(known, uncertainty=loose.position, growth=loose.speed, since=loose.since)
