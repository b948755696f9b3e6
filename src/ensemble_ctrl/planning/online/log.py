"""The record of a run: one JSON object a line, each written out at once, so that it is whole up to any fault."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.plain import to_json
from ensemble_ctrl.core.storage import open_new
from ensemble_ctrl.core.version import __version__
from ensemble_ctrl.planning.online.driver import Loop, Outcome
from ensemble_ctrl.planning.online.step import Step

Floats = NDArray[np.float64]


class RunLog:
    """A file of lines with ``kind``: ``start``, then a ``step`` for each plan, then ``end``.

    Parameters
    ----------
    path : Path
        The file; what is there is replaced.
    """

    def __init__(self, path: Path) -> None:
        self._file = open_new(path)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def start(self, loop: Loop) -> None:
        """What runs, and how."""
        fleet = loop.problem.fleet
        self._write(
            "start",
            ensemble_ctrl=__version__,
            name=loop.problem.name,
            task=str(loop.problem.task),
            steps=loop.steps,
            step_seconds=loop.problem.step,
            controls=list(fleet.system.controls),
            ranges={n: [distribution.lower, distribution.upper] for n, distribution in fleet.parameters.items()},
            uncertainty=fleet.uncertainty.data(),
            options=asdict(loop.options),
        )

    def step(self, loop: Loop, step: Step, controls: Floats) -> None:
        """One step, the measurement that it saw last, and its commands."""
        last = {name: None if each.last is None else asdict(each.last) for name, each in loop.trackers.items()}
        seen = {"measurement": next(iter(last.values()))} if len(last) == 1 else {"measurements": last}
        self._write("step", time=step.begin * loop.problem.step, **asdict(step), **seen, commands=controls.tolist())

    def end(self, outcome: Outcome) -> None:
        """How it ended."""
        self._write("end", ending=outcome.ending, reason=outcome.reason, robustness=outcome.robustness)

    def fault(self, error: BaseException) -> None:
        """What broke it off."""
        self._write("end", ending="fault", reason=f"{type(error).__name__}: {error}")

    def _write(self, kind: str, **facts: Any) -> None:
        """One line."""
        self._file.write(to_json({"kind": kind, **facts}) + "\n")
        self._file.flush()
