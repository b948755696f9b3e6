"""The routes that a search tried, and what became of each."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.rounds import Attempt

Floats = NDArray[np.float64]
Outcome = Literal["kept", "refined", "coarse", "failed"]


@dataclass(frozen=True, eq=False)
class Tried:
    """One route.

    Attributes
    ----------
    name : str
        On which side of it each obstacle that it passes lies; ``given`` for a guess.
    corners : ndarray, shape (corners, 2)
        Metres; empty for a guess.
    length : float
        Metres.
    cost : float
        After the coarse solve.
    clearance : float
        Smallest distance between the fleet's hull and an obstacle after the coarse solve, metres.
    feasible : bool
        Whether the coarse solution keeps the constraints.
    seconds : float
        Of the coarse solve.
    outcome : {"kept", "refined", "coarse", "failed"}
        ``kept``: the plan comes from it. ``refined``: solved on the problem's own grid, but another was better.
        ``coarse``: solved on the coarse grid only. ``failed``: there is no coarse solution.
    fine_cost : float or None
        After the fine solve, where there was one.
    kind : str
        What it was made from.
    short : float
        By how much the coarse solution falls short of the task or enters an obstacle, metres or the unit of the task.
    """

    name: str
    corners: Floats
    length: float
    cost: float
    clearance: float
    feasible: bool
    seconds: float
    outcome: Outcome
    fine_cost: float | None = None
    kind: str = "route"
    short: float = 0.0


class Start(Protocol):
    """What is told of where a search began."""

    @property
    def name(self) -> str:
        """On which side of it each obstacle that it passes lies."""

    @property
    def kind(self) -> str:
        """What it was made from."""

    @property
    def corners(self) -> Floats:
        """Metres, shape (corners, d)."""

    @property
    def length(self) -> float:
        """Metres."""


def tried(guess: Start, coarse: Attempt, fine: Attempt | None, kept: bool) -> Tried:
    """What became of a guess."""
    outcome: Outcome = "kept" if kept else "refined" if fine else "coarse" if coarse.iterations else "failed"
    return Tried(
        guess.name,
        guess.corners,
        guess.length,
        coarse.value.cost,
        coarse.value.gap,
        coarse.value.keeps(0.0),
        coarse.build_seconds + coarse.solve_seconds,
        outcome,
        fine.value.cost if fine else None,
        guess.kind,
        max(0.0, -coarse.value.gap, -coarse.value.robustness),
    )


def part_log(log: Path | None, candidate: int) -> Path | None:
    """Where one candidate's solves are logged while they run."""
    return log and log.with_name(f"{log.name}.{candidate + 1}")


def join_logs(log: Path | None, parts: Sequence[Path | None]) -> None:
    """Append the candidates' logs to `log` in order, as far as the disk holds them, and remove them."""
    for part in parts:
        if log and part and part.exists():
            with suppress(OSError), log.open("ab") as whole:
                whole.write(part.read_bytes())
            part.unlink()
