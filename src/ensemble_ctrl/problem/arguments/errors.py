"""What a reader of values raises, and how values are worded."""

from __future__ import annotations

import math
from typing import Any

from ensemble_ctrl.core.errors import shortened


class FieldError(ValueError):
    """A value is not what was wanted; pydantic keeps it with the place at which it was raised.

    Parameters
    ----------
    message : str
        What was wanted and what came.
    hint : str
        What to do.
    path : tuple
        Keys from the place at which it was raised to the value that is wrong.
    offset : int, optional
        0-based place of the mistake within the value's text.
    on_key : bool
        Whether it is about the last key of the path, not about its value.
    """

    def __init__(
        self,
        message: str,
        hint: str = "",
        path: tuple[str | int, ...] = (),
        offset: int | None = None,
        on_key: bool = False,
    ) -> None:
        super().__init__(message)
        self.message, self.hint, self.path, self.offset, self.on_key = message, hint, path, offset, on_key


def is_number(value: Any) -> bool:
    """Whether a value is a finite number, of a size that others can be added to."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= 1e300


def show(value: Any) -> str:
    """A value as it stands in the file, shortened."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a section" if value else "an empty section"
    if isinstance(value, list | tuple):
        scalars = len(value) <= 4 and not any(isinstance(item, dict | list | tuple) for item in value)
        return f"[{', '.join(map(show, value))}]" if scalars else f"a list of {len(value)}"
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else f"{'-' if value < 0 else ''}.inf"
    return shortened(repr(value))
