"""One problem of the benchmark: its text, and the commands that are known to do it, or why none can."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ensemble_ctrl as ec

Floats = NDArray[np.float64]

HERE = Path(__file__).parent


@dataclass(frozen=True, eq=False)
class Case:
    """A problem with a known plan, or with a reason why there is none.

    Attributes
    ----------
    family : str
        Problems of one kind.
    seed : int
        Its number in the family, and the seed that it is drawn by.
    text : str
        The problem file, as JSON, which is YAML too.
    controls : ndarray of shape (steps, n_u), or None
        Commands that do the task; none for an impossible problem.
    reason : str
        Why an impossible problem has no plan; empty for others.
    refused : bool
        Whether the check of the problem file proves that.
    """

    family: str
    seed: int
    text: str
    controls: Floats | None
    reason: str = ""
    refused: bool = False

    @property
    def name(self) -> str:
        """The family and the seed, as ``mazes-07``."""
        return f"{self.family}-{self.seed:02d}"

    @property
    def digest(self) -> str:
        """What distinguishes this problem from another one of the same name."""
        return hashlib.sha256(self.text.encode()).hexdigest()[:16]

    def problem(self, seconds: float = 60.0) -> ec.Problem:
        """The problem, to be solved within some seconds; raises `ConfigError` where the check refuses it."""
        overrides = [f"solve.time_limit={seconds}"]
        return ec.load_text(self.text, str(HERE / "plants.yaml"), overrides, trust=True)


def text_of(data: Mapping[str, Any]) -> str:
    """A problem file from plain data, in numbers that are the same on every machine."""
    return json.dumps(_plain(data), indent=1)


def _plain(value: Any) -> Any:
    """Numbers to 1e-6, which hides the last digits of a processor's sine; arrays as lists."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return round(float(value), 6)
    return value.item() if isinstance(value, np.generic) else value
