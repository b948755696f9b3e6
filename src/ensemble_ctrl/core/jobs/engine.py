"""Units, kept or computed: the one way in which the package does many independent pieces of work."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator

from ensemble_ctrl.core.jobs.checkpoint import Checkpoint
from ensemble_ctrl.core.jobs.cluster import Cluster
from ensemble_ctrl.core.jobs.unit import Outcome, Stop, Unit


def outcomes(
    units: Iterable[Unit], cluster: Cluster, checkpoint: Checkpoint | None = None, stop: Stop = lambda: False
) -> Iterator[Outcome]:
    """What comes of units, each once, as they end.

    Parameters
    ----------
    units : iterable of Unit
        Taken as workers get free, so that there may be any number of them.
    cluster : Cluster
        Where they are computed.
    checkpoint : Checkpoint, optional
        Units in it are not computed again, and finished ones are added to it before they are yielded.
    stop : callable
        Called at least twice a second; once it returns True, units at work are given up and no more are begun.

    Yields
    ------
    Outcome
        Not in the order of the units.

    Raises
    ------
    WorkerError
        If workers can't begin, have other versions, or the scheduler has ended. What is finished is in `checkpoint`.

    Notes
    -----
    *Guarantee*: every unit has one outcome, unless stopped; one that ends its worker three times is among them, with
    `Outcome.killed`.
    """
    kept: deque[Outcome] = deque()

    def fresh() -> Iterator[Unit]:
        for unit in units:
            if checkpoint is not None and unit in checkpoint:
                kept.append(Outcome(unit, checkpoint.result(unit)))
            else:
                yield unit

    for outcome in cluster.backend().outcomes(fresh(), stop):
        while kept:
            yield kept.popleft()
        if checkpoint is not None:
            checkpoint.add(outcome)
        yield outcome
    while kept:
        yield kept.popleft()
