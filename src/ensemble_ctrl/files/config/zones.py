"""Zones in a problem file: an area, and what robots do there."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import BeforeValidator, ValidationInfo, model_validator

from ensemble_ctrl.files.config import fields as f
from ensemble_ctrl.files.config.errors import FieldError
from ensemble_ctrl.files.config.shapes import ObstacleShape, Pieces
from ensemble_ctrl.problem.zones import Zone

Data = dict[str, Any]


class ZoneShape(ObstacleShape):
    """An area, in one form of an obstacle or several of them, with exactly one rule."""

    areas: list[ObstacleShape] | None = None
    """Several areas, each in one form of an obstacle."""
    v: f.Speed | None = None
    """Largest speed of a robot while its body touches the area, forwards or backwards."""
    keep_out: Annotated[bool, BeforeValidator(f.flag)] = False
    """Robots keep out of the area at all times."""

    def _made(self, info: ValidationInfo) -> Pieces:
        """The convex pieces of all areas."""
        if self.areas is None:
            return super()._made(info)
        given = [form for form in ("box", "polygon", "disc", "halfspaces", "wkt", "file") if getattr(self, form)]
        if given or not self.areas:
            raise FieldError(f"expected areas alone, one or more, got {' and '.join(given) or 'none'}", path=("areas",))
        return tuple(piece for area in self.areas for piece in area.pieces)

    @model_validator(mode="after")
    def _one_rule(self) -> Self:
        """Exactly one rule is given."""
        if (self.v is None) != self.keep_out:
            came = "neither" if self.v is None else "both"
            raise FieldError(f"expected one of v and keep_out: true, got {came}")
        if self.v is not None and not 0 < self.v < float("inf"):
            raise FieldError(f"expected a limit above 0 m/s, got {self.v:g}", path=("v",))
        return self

    @property
    def zone(self) -> Zone:
        """The zone."""
        return Zone(self.pieces, self.v)


def zone_data(zone: Zone, pieces: list[Data]) -> Data:
    """A zone as it stands in a problem file, from its pieces as they stand there."""
    area = pieces[0] if len(pieces) == 1 else {"areas": pieces}
    return {**area, **({"keep_out": True} if zone.speed is None else {"v": zone.speed})}
