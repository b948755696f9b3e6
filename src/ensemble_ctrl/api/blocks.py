"""The blocks of a replay as units of work: on processes or a Dask cluster, kept and resumed.

As a kind of unit (`ensemble_ctrl.core.jobs`) the content is a plan with the seed and the size of its blocks, and the
index is the block's.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import WorkerError, first_of
from ensemble_ctrl.core.jobs import Checkpoint, Cluster, Content, Outcome, Unit, outcomes
from ensemble_ctrl.core.values import path_of, whole
from ensemble_ctrl.files.config.portable import problem_of, problem_text
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.streaming import SIZE, Blocks, division
from ensemble_ctrl.problem.evaluation.summary import Summary

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Draw:
    """Which members are run.

    Attributes
    ----------
    members : int
        How many, the corners of the ranges included.
    seed, substeps : int, optional
        As for `ensemble_ctrl.problem.evaluation.streaming.Blocks`.
    size : int
        Members of a block; the draw depends on it.
    """

    members: int
    seed: int | None = None
    substeps: int | None = None
    size: int = SIZE


def prepare(text: str) -> tuple[Blocks, int]:
    """The blocks of a content, and the size of each."""
    data = json.loads(text)
    with problem_of(data["problem"]) as problem:
        return Blocks(problem, np.array(data["controls"]), data["seed"], data["substeps"]), data["size"]


def run(prepared: tuple[Blocks, int], index: int) -> dict[str, Any]:
    """The summary of a block, as plain data."""
    blocks, size = prepared
    return blocks.summary(index, size).as_data()


def units(problem: Problem, controls: Floats, draw: Draw) -> Iterator[Unit]:
    """The blocks of a draw: the same for more members, so that they can be added later."""
    blocks = Blocks(problem, controls, draw.seed, draw.substeps)
    text, sent = problem_text(problem), np.asarray(controls, float).tolist()

    def content(size: int) -> Content:
        about = {"problem": text, "controls": sent, "seed": blocks.seed, "substeps": blocks.substeps, "size": size}
        return Content(json.dumps(about))

    full = content(draw.size)
    for index, size in division(draw.members, draw.size):
        first = index * draw.size
        yield Unit(__name__, full if size == draw.size else content(size), index, f"members {first} to {first + size}")


def replay_on(
    problem: Problem,
    controls: Floats,
    draw: Draw,
    cluster: str = "local",
    *,
    checkpoint: str | os.PathLike[str] | None = None,
    watch: Callable[[Summary], bool] | None = None,
    stop: Callable[[], bool] = lambda: False,
    left_out: Callable[[Outcome], None] | None = None,
) -> Summary:
    """Run `controls` on any number of members, block by block on several workers.

    Parameters
    ----------
    problem : Problem
        Fleet, map and task.
    controls : ndarray, shape (steps, n_u)
        The broadcast commands.
    draw : Draw
        Which members.
    cluster : str
        ``local`` for one process on each core, ``local:N`` for N, ``tcp://HOST:PORT`` for a Dask scheduler.
    checkpoint : path, optional
        A file of JSON lines. Blocks that it has are not run again; new ones are added to it.
    watch : callable, optional
        Called with the summary so far after each block; returning True ends the replay with it.
    stop : callable
        Called at least twice a second; once it returns True, the replay ends with what there is, but not before there
        is a block.
    left_out : callable, optional
        Called with each block that could not be run.

    Returns
    -------
    Summary
        Of the blocks that were run: the same, bit for bit, for any number of workers anywhere.

    Raises
    ------
    WorkerError
        If a block could not be run and there is no `left_out` to be told of it; if no block could; and if the
        cluster does not answer, or has other versions.
    """
    whole("members", draw.members, 1)
    place, path = Cluster.parse(cluster), None if checkpoint is None else path_of("checkpoint", checkpoint)
    found = _Found(watch, left_out)
    with nullcontext() if path is None else Checkpoint(path) as kept:
        for outcome in outcomes(units(problem, controls, draw), place, kept, lambda: found.ends(stop)):
            found.take(outcome)
    return found.whole()


@dataclass(eq=False)
class _Found:
    """The blocks that have been run, together."""

    watch: Callable[[Summary], bool] | None
    left_out: Callable[[Outcome], None] | None
    total: Summary | None = None
    ended: bool = False
    lost: tuple[str, ...] = ()

    def take(self, outcome: Outcome) -> None:
        """Add a block."""
        if outcome.failure:
            self.lost = (*self.lost, outcome.failure)
            if self.left_out is not None:
                self.left_out(outcome)
            return
        one = Summary.from_data(outcome.result)
        self.total = one if self.total is None else self.total.merge(one)
        self.ended = self.ended or (self.watch is not None and self.watch(self.total))

    def ends(self, stop: Callable[[], bool]) -> bool:
        """Whether to begin no more blocks."""
        return self.ended or (self.total is not None and stop())

    def whole(self) -> Summary:
        """All of them."""
        if self.total is None or (self.lost and self.left_out is None):
            raise WorkerError("; ".join(first_of(self.lost)))
        return self.total
