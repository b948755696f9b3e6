"""The shape of a robot in a problem file."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from pydantic import PrivateAttr, model_validator

from ensemble_ctrl.constraints.footprint import Footprint
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config import fields as f
from ensemble_ctrl.files.config.errors import FieldError

Data = dict[str, Any]


class FootprintSection(f.Model):
    """A rectangle by length and width, or a convex polygon; in the robot's frame, x forwards and y to the left."""

    length: f.Size | None = None
    """Length of a rectangle, with `width`."""
    width: f.Size | None = None
    """Width of a rectangle."""
    rear_overhang: f.Margin | None = None
    """How far the rectangle reaches behind the planned position; half its length by default."""
    polygon: list[f.Point] | None = None
    """Corners `[[x, y], ...]` from the planned position, in either direction; convex, at most 16."""
    _body: Footprint = PrivateAttr()

    @model_validator(mode="after")
    def _build(self) -> Self:
        """Build the shape, so that what is wrong with it is reported with everything else."""
        rectangle = {name for name in ("length", "width", "rear_overhang") if getattr(self, name) is not None}
        if self.polygon is not None:
            if rectangle:
                raise FieldError(f"expected a polygon, or length and width, got polygon and {min(rectangle)}")
            self._body = _made(lambda: Footprint(np.array(self.polygon)), "polygon")
            return self
        if self.length is None or self.width is None:
            missing = "length" if self.length is None else "width"
            raise FieldError(f"expected length and width, or a polygon, got no {missing}")
        length, width = self.length, self.width
        self._body = _made(lambda: Footprint.rectangle(length, width, self.rear_overhang), "rear_overhang")
        return self

    @property
    def body(self) -> Footprint:
        """The shape."""
        return self._body


def footprint_data(body: Footprint | None) -> Data:
    """The section of a fleet on the shape of its robots, by corners; nothing without one."""
    return {} if body is None else {"footprint": {"polygon": body.corners.tolist()}}


def _made(make: Any, field: str) -> Footprint:
    """A footprint, its errors placed at a field."""
    try:
        found: Footprint = make()
    except ProblemError as error:
        raise FieldError(str(error).partition(": ")[2], path=(field,)) from None
    return found
