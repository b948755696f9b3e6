"""Run a sweep: problems are made as workers get free, planned there, and kept in a file as they end."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import field
from pathlib import Path
from typing import Any

from ensemble_ctrl.api.planned import no_row, unit_of
from ensemble_ctrl.api.sweep.rows import Sweep
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ConfigError, ProblemError
from ensemble_ctrl.core.jobs import Checkpoint, Cluster, Outcome, Unit, outcomes
from ensemble_ctrl.core.values import path_of, shown
from ensemble_ctrl.files.config import Variants
from ensemble_ctrl.files.config.overrides import Given

Progress = Callable[[dict[str, Any], int, int], bool]
"""Called with each row, how many there are by now, and how many there will be; returning True stops the sweep."""
FILE = "file"
"""The axis of many files."""


def sweep(
    sources: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    overrides: Iterable[Given] = (),
    axes: Iterable[str] = (),
    cluster: str = "local",
    checkpoint: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
    trust: bool = False,
) -> Sweep:
    """Plan every problem of a sweep.

    Parameters
    ----------
    sources : path or sequence of paths
        Problem files; ``-`` is stdin. Their sections ``sweep`` have axes.
    overrides : iterable of str
        ``KEY=VALUE``, applied to every problem before the values of the axes.
    axes : iterable of str
        Further axes, ``KEY=VALUES``, as ``solve.seed=[1, 2, 3]``.
    cluster : str
        ``local`` for one process on each core, ``local:N`` for N, ``tcp://HOST:PORT`` for a Dask scheduler.
    checkpoint : path, optional
        A file of JSON lines: rows that it has are not planned again, new ones are added to it.
    progress : callable, optional
        ``progress(row, done, total) -> bool``; returning True stops with the rows so far.
    trust : bool
        As of `ensemble_ctrl.load`.

    Returns
    -------
    Sweep

    Raises
    ------
    ConfigError
        If a file or an axis can't be used. Values that only together can't are a row with status ``refused``.
    WorkerError
        If the cluster does not answer, or has other versions. Finished rows are in `checkpoint`.

    Notes
    -----
    *Guarantee*: rows do not depend on the number of workers, but for their times and for plans that a time limit ended.
    """
    place = Cluster.parse(cluster)
    path = None if checkpoint is None else path_of("checkpoint", checkpoint)
    files = {name: Variants(name, overrides, axes, trust=trust) for name in _names(sources)}
    return run(files, place, path, progress)


def _names(sources: object) -> list[str]:
    """The names of one file or several."""
    if isinstance(sources, str | os.PathLike):
        return [str(path_of("sources", sources))]
    if not isinstance(sources, list | tuple):
        raise ProblemError(f"sources: expected the path of a problem file, or a list of paths, got {shown(sources)}")
    return [str(path_of(f"sources[{i}]", name)) for i, name in enumerate(sources)]


def run(files: dict[str, Variants], cluster: Cluster, checkpoint: Path | None, progress: Progress | None) -> Sweep:
    """Plan every problem of some files, by their names; see `sweep`."""
    if not files:
        raise ProblemError("sources: expected one problem file or more, got none")
    found = _Running(files)
    with nullcontext() if checkpoint is None else Checkpoint(checkpoint) as kept:
        found.run(cluster, kept, progress)
    return found.sweep()


@dataclass(eq=False)
class _Running:
    """A sweep that runs: its problems, and the rows so far by their place."""

    files: dict[str, Variants]
    rows: dict[int, dict[str, Any]] = field(default_factory=dict)
    places: dict[Unit, int] = field(default_factory=dict)
    stopped: bool = False

    @property
    def total(self) -> int:
        """Rows of the whole sweep."""
        return sum(map(len, self.files.values()))

    @property
    def axes(self) -> tuple[str, ...]:
        """Keys that vary."""
        keys = dict.fromkeys(axis.key for file in self.files.values() for axis in file.axes)
        return (*([FILE] if len(self.files) > 1 or not keys else []), *keys)

    def run(self, cluster: Cluster, kept: Checkpoint | None, progress: Progress | None) -> None:
        """Plan what is not kept."""
        for outcome in outcomes(self._units(progress), cluster, kept, lambda: self.stopped):
            self._put(self.places.pop(outcome.unit), _facts(outcome), progress)

    def sweep(self) -> Sweep:
        """What came of it."""
        rows = tuple(self.rows[place] for place in sorted(self.rows))
        return Sweep(next(iter(self.files.values())).base.problem.name, self.axes, rows, self.total)

    def _units(self, progress: Progress | None) -> Iterator[Unit]:
        """The problems that can be planned; the others get their row at once."""
        numbered = ((variants, n) for variants in self.files.values() for n in range(len(variants)))
        for place, (variants, number) in enumerate(numbered):
            try:
                unit = unit_of(variants.problem(number).problem, f"row {place + 1}")
            except ConfigError as error:
                self._put(place, no_row("refused", _first(error)), progress)
                continue
            self.places[unit] = place
            yield unit

    def _put(self, place: int, facts: dict[str, Any], progress: Progress | None) -> None:
        """Take a row."""
        self.rows[place] = {**dict.fromkeys(self.axes), **self._values(place), **facts}
        if progress is not None and progress(self.rows[place], len(self.rows), self.total):
            self.stopped = True

    def _values(self, place: int) -> dict[str, Any]:
        """Where a row is along the axes."""
        for name, file in self.files.items():
            if place < len(file):
                own = {FILE: name} if FILE in self.axes else {}
                return own | {key: _plain(value) for key, value in file.values(place).items()}
            place -= len(file)
        raise IndexError(place)


def _facts(outcome: Outcome) -> dict[str, Any]:
    """The row of a unit."""
    if outcome.failure:
        return no_row("killed" if outcome.killed else "error", outcome.failure)
    facts: dict[str, Any] = outcome.result["row"]
    return facts


def _plain(value: Any) -> Any:
    """A value as it stands in a row: of a file its name."""
    return value[FILE] if isinstance(value, dict) and set(value) == {FILE} else value


def _first(error: ConfigError) -> str:
    """What is wrong first, without its place in the file."""
    first = next(iter(error.diagnostics), None)
    return str(error) if first is None else f"{first.path}: {first.message}"
