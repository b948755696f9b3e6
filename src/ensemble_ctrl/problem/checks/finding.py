"""One thing that is wrong, or odd, in a problem."""

from __future__ import annotations

from typing import Literal

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import shortened

Severity = Literal["error", "warning"]
Path = tuple[str | int, ...]


SLACK = 1e-9
"""Seconds, metres and shares by which a problem may be off before that is a finding: rounding of what people write."""


@dataclass(frozen=True)
class Finding:
    """Something wrong, or odd, in a problem.

    Parameters
    ----------
    path : tuple of str or int
        Keys that lead to it in a problem file.
    message : str
        What was wanted and what came.
    hint : str
        What to do.
    severity : {"error", "warning"}
        Whether the problem can be solved as it is.
    offset : int, optional
        0-based place within the text at `path`.
    on_key : bool
        Whether it is about the key at `path`, not about its value.
    """

    path: Path
    message: str
    hint: str = ""
    severity: Severity = "error"
    offset: int | None = None
    on_key: bool = False

    def __str__(self) -> str:
        text = f"{path_text(self.path)}: {self.message}"
        return f"{text}; {self.hint}" if self.hint else text


def path_text(path: Path) -> str:
    """A path as a person writes it.

    Examples
    --------
    >>> path_text(("regions", "goal", "box", 0))
    'regions.goal.box[0]'
    """
    return "".join(f"[{key}]" if isinstance(key, int) else f".{shortened(key)}" for key in path).removeprefix(".")
