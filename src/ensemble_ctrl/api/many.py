"""Many problems at once: plans as they come, from processes of this machine or from a Dask cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import nullcontext

from ensemble_ctrl.api.planned import unit_of
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.api.portable import plan_of
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.jobs import Checkpoint, Cluster, Outcome, Unit, outcomes
from ensemble_ctrl.core.values import called, path_of
from ensemble_ctrl.files.config import load
from ensemble_ctrl.problem import Problem


@dataclass(frozen=True, eq=False)
class Planned:
    """What came of one of many problems.

    Attributes
    ----------
    index : int
        Its place among the problems that were given, from 0.
    problem : Problem
        What was to be planned.
    plan : Plan or None
        The plan, replayed and certified; None if it could not be planned.
    error : str
        Why there is no plan; empty if there is one.
    """

    index: int
    problem: Problem
    plan: Plan | None
    error: str = ""


def plan_many(
    problems: Iterable[Problem | str | os.PathLike[str]],
    *,
    cluster: str = "local",
    checkpoint: str | os.PathLike[str] | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> Iterator[Planned]:
    """Plan many problems side by side, each in a process of its own.

    Parameters
    ----------
    problems : iterable of Problem or path
        Taken as workers get free, so that there may be any number of them.
    cluster : str
        ``local`` for one process on each core, ``local:N`` for N, ``tcp://HOST:PORT`` for a Dask scheduler.
    checkpoint : path, optional
        A file of JSON lines. Plans that it has are not made again; new ones are added to it.
    stop : callable
        Called at least twice a second; once it returns True, the plans at work are given up.

    Yields
    ------
    Planned
        As they end, not in order. A plan that falls short is given as it is: see its `status` and `verified`.

    Raises
    ------
    ProblemError
        For what is no problem, or another `cluster`.
    UnsupportedError
        For Dask, if it is not installed.
    WorkerError
        If the cluster does not answer, or has other versions of this package or of its libraries.

    Notes
    -----
    *Guarantee*: a plan does not depend on the number of workers or on where they are, unless its time limit ends it.

    Examples
    --------
    >>> import ensemble_ctrl as ec
    >>> problem = ec.example("box")
    >>> wider = [problem.with_(steps=steps) for steps in (10, 20)]
    >>> {one.index: one.plan.verified for one in ec.plan_many(wider, cluster="local:1")}  # doctest: +SKIP
    {0: True, 1: True}
    """
    place, called_stop = Cluster.parse(cluster), called("stop", stop)
    if isinstance(problems, Problem | str | bytes | os.PathLike):
        raise ProblemError("problems: expected several problems or paths, as [problem], got one")
    path = None if checkpoint is None else path_of("checkpoint", checkpoint)
    return _planned(problems, place, path, called_stop)


def _planned(
    problems: Iterable[object], cluster: Cluster, path: os.PathLike[str] | None, stop: Callable[[], bool]
) -> Iterator[Planned]:
    """The plans as they end."""
    waiting: dict[Unit, tuple[int, Problem]] = {}

    def units() -> Iterator[Unit]:
        for index, given in enumerate(problems):
            problem = given if isinstance(given, Problem) else load(path_of(f"problems[{index}]", given, "a Problem"))
            unit = unit_of(problem, f"problems[{index}] ({problem.name})", whole=True)
            waiting[unit] = index, problem
            yield unit

    with nullcontext() if path is None else Checkpoint(path_of("checkpoint", path)) as kept:
        for outcome in outcomes(units(), cluster, kept, stop):
            yield _result(outcome, *waiting.pop(outcome.unit))


def _result(outcome: Outcome, index: int, problem: Problem) -> Planned:
    """What came of one problem."""
    if outcome.failure:
        return Planned(index, problem, None, outcome.failure)
    if outcome.result["plan"] is None:
        return Planned(index, problem, None, outcome.result["row"]["message"])
    return Planned(index, problem, plan_of(outcome.result["plan"], problem))
