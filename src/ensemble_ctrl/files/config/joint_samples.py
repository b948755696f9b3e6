"""Measured robots whose parameters belong together: a table with a column for each."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema

from ensemble_ctrl.files.config.errors import FieldError, show
from ensemble_ctrl.files.config.samples import Columns, columns_of, samples
from ensemble_ctrl.problem.arguments.units import quantity

KNOWN = ("traction", "linear_traction", "angular_traction", "start_heading")
"""Parameters that a table may hold; other columns are left out."""


def _joint_samples(value: Any) -> Any:
    """The name of a file, or columns of numbers of one length."""
    if isinstance(value, str):
        return value
    if not isinstance(value, dict) or not value:
        example = "for example  samples: measured.csv, with a column for each parameter"
        raise FieldError(f"expected the name of a file, or columns of numbers, got {show(value)}", example)
    return {str(name): _column(str(name), column) for name, column in value.items()}


def _column(name: str, value: Any) -> Any:
    """One column of numbers."""
    if name not in KNOWN:
        raise FieldError(f"expected columns among {', '.join(KNOWN)}, got {name!r}", path=(name,))
    try:
        return samples(value, quantity("angle") if name == "start_heading" else quantity("number", above=0.0))
    except FieldError as error:
        raise FieldError(error.message, error.hint, (name, *error.path)) from None


JointSamples = Annotated[
    Any, BeforeValidator(_joint_samples), WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "object"}]})
]


def read_joint_samples(value: Any, folder: Path) -> Columns:
    """The columns of joint samples as they stand in a file.

    Raises
    ------
    FieldError
        If a table can't be read, has none of the parameters, or its columns differ in length.
    """
    try:
        columns = value if isinstance(value, dict) else columns_of(folder, value)
    except FieldError as error:
        raise FieldError(error.message, error.hint, ("samples",)) from None
    found = {name: columns[name] for name in KNOWN if name in columns}
    if not found:
        raise FieldError(
            f"expected columns among {', '.join(KNOWN)}, got {', '.join(columns) or 'none'}", path=("samples",)
        )
    if len({len(column) for column in found.values()}) > 1:
        sizes = ", ".join(f"{name} {len(column)}" for name, column in found.items())
        raise FieldError(f"expected columns of one length, got {sizes}", path=("samples",))
    return found
