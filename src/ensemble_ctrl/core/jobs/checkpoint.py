"""Finished units in a file of JSON lines, for a rerun after an end of any process."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Self

from ensemble_ctrl.core.errors import WorkerError
from ensemble_ctrl.core.jobs.unit import Outcome, Unit
from ensemble_ctrl.core.jobs.versions import digest, versions
from ensemble_ctrl.core.storage import Lines


class Checkpoint:
    """The results of finished units; of any number, since only their places are held in memory.

    Parameters
    ----------
    path : Path
        The file, or a new name; it is held until `close`.

    Attributes
    ----------
    stale : int
        Results of other versions of the program or its libraries, which are not used.

    Raises
    ------
    WorkerError
        If another process holds it.

    Notes
    -----
    *Guarantee*: a result is used only for a unit with the same kind, content and index, under the same versions.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._lines = Lines(path)
        except BlockingIOError:
            raise WorkerError(f"{path}: another process is writing its results here") from None
        self.path, self._versions, self.stale = path, digest(versions()), 0
        self._places: dict[str, int] = {}
        for place, line in self._lines.read():
            self._note(place, line)

    def __contains__(self, unit: Unit) -> bool:
        return unit.key in self._places

    def __len__(self) -> int:
        return len(self._places)

    def add(self, outcome: Outcome) -> None:
        """Keep a result; an outcome without one is not kept, so that a rerun tries it again."""
        if outcome.failure:
            return
        line = {"unit": outcome.unit.key, "versions": self._versions, "seconds": outcome.seconds}
        text = json.dumps({**line, "result": outcome.result}, allow_nan=False)
        self._places[outcome.unit.key] = self._lines.add(text.encode())

    def result(self, unit: Unit) -> Any:
        """The result of a unit that is in it."""
        return json.loads(self._lines.at(self._places[unit.key]))["result"]

    def close(self) -> None:
        """Give up the file."""
        self._lines.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _note(self, place: int, line: bytes) -> None:
        """Take note of a line of an earlier run; one that is none is passed over."""
        try:
            read = json.loads(line)
            key, version = str(read["unit"]), read["versions"]
        except (ValueError, KeyError, TypeError):
            return
        if version == self._versions:
            self._places[key] = place
        else:
            self.stale += 1
