"""Patches of terrain in a problem file: an area, and the ranges that parameters have in it."""

from __future__ import annotations

from typing import Self

from pydantic import ConfigDict, ValidationInfo, model_validator

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.files.config import fields as f
from ensemble_ctrl.files.config.errors import FieldError
from ensemble_ctrl.files.config.shapes import ObstacleShape
from ensemble_ctrl.problem.terrain import Patch


class TerrainSection(ObstacleShape):
    """An area in one of these forms, and the range of each parameter that may differ in it: `traction: [0.6, 0.8]`."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, f.Range]

    areas: list[ObstacleShape] | None = None
    """Several shapes that are one patch, in place of one of these forms."""

    def _made(self, info: ValidationInfo) -> tuple[Obstacle, ...]:
        """The convex pieces of one shape, or of several."""
        if self.areas is None:
            return super()._made(info)
        if given := [name for name in ObstacleShape.model_fields if getattr(self, name) is not None]:
            raise FieldError(f"expected either areas or one shape, got areas and {given[0]}", path=(given[0],))
        if not self.areas:
            raise FieldError("expected at least one shape, got an empty list", path=("areas",))
        return tuple(piece for shape in self.areas for piece in shape.pieces)

    @model_validator(mode="after")
    def _some(self) -> Self:
        """At least one parameter."""
        if not self.__pydantic_extra__:
            raise FieldError("expected the range of a parameter in it, got none", "for example  traction: [0.6, 0.8]")
        return self

    def patch(self) -> Patch:
        """The patch; its parameters are still to be compared with the system's."""
        return Patch(self.pieces, dict(self.__pydantic_extra__))
