"""Replay of as many members as one likes, block by block in bounded memory.

`block_summary` is the piece that work is divided into: a pure function of the plan, the seed, and the block's index and
size. It may run anywhere, in any order and more than once; `Summary.merge` of all blocks is the same, bit for bit, for
any number of workers of one kind of machine. `Summary.to_json` keeps every bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import UnsupportedError
from ensemble_ctrl.core.values import expect, whole
from ensemble_ctrl.problem.evaluation.disturbed import channels
from ensemble_ctrl.problem.evaluation.histogram import Histogram
from ensemble_ctrl.problem.evaluation.judge import Judge, Judged
from ensemble_ctrl.problem.evaluation.summary import WORST, ShareCount, Summary, WorstMember
from ensemble_ctrl.problem.problem import Problem

Floats = NDArray[np.float64]

SIZE = 100_000
"""Members of a block, if not given."""
PILOTS = 201
"""About as many members, spread evenly over the ranges, say where the bins of histograms lie."""
EVERYTHING = "everything that each member has to do"
"""What the first histogram is of."""


class PlanLike(Protocol):
    """What a block needs of a plan."""

    @property
    def problem(self) -> Problem:
        """Fleet, map and task."""

    @property
    def controls(self) -> Floats:
        """Broadcast commands, shape (steps, n_u)."""


class Blocks:
    """The blocks of one plan and seed; making it costs as much as a few hundred members.

    Parameters
    ----------
    problem : Problem
        Fleet, map and task.
    controls : ndarray, shape (steps, n_u)
        The broadcast commands.
    seed : int, optional
        Of the draw; default `problem.solve.seed`.
    substeps : int, optional
        Samples per step; default `problem.verify.substeps`.

    Raises
    ------
    ProblemError
        For controls or numbers that are none.
    UnsupportedError
        For a task that reads the fleet as a whole, which no block can be judged by.
    """

    def __init__(
        self, problem: Problem, controls: Floats, seed: int | None = None, substeps: int | None = None
    ) -> None:
        expect("problem", problem, Problem)
        self.problem = problem
        self.seed = whole("seed", problem.solve.seed if seed is None else seed, 0)
        self.substeps = whole("substeps", problem.verify.substeps if substeps is None else substeps, 1)
        dice = self.seed if channels(problem) else None
        self.judge = Judge(problem, problem.fleet.checked_controls(controls), self.substeps, dice=dice)
        if self.judge.together:
            wanted = "a task that is read for each member, to replay it block by block"
            raise UnsupportedError(f"task: expected {wanted}, got {problem.task}")
        self._empty = self._histograms()

    def _histograms(self) -> tuple[Histogram, ...]:
        """Empty histograms, with bins around what a few members do."""
        fleet = self.problem.fleet
        pilot = self.judge.judge(np.concatenate([fleet.corners, fleet.grid(PILOTS)]))
        names = [EVERYTHING, *(str(part) for part in self.problem.specification.parts)]
        rows = [pilot.robustness, *pilot.parts]
        return tuple(Histogram.over(name, row) for name, row in zip(names, rows, strict=True))

    def members(self, index: int, size: int) -> Floats:
        """The members of a block, shape (size, parameters): the first block begins with the corners of the ranges."""
        corners = self.problem.fleet.corners[: size if index == 0 else 0]
        return np.concatenate([corners, self.problem.fleet.sample(size - len(corners), (self.seed, index))])

    def summary(self, index: int, size: int) -> Summary:
        """What the members of one block do; see `block_summary`."""
        index, size = whole("index", index, 0), whole("size", size, 1)
        members = self.members(index, size)
        judged = self.judge.judge(members)
        corners = min(size, len(self.problem.fleet.corners)) if index == 0 else 0
        violating = judged.robustness < 0
        finite = judged.robustness[np.isfinite(judged.robustness)]
        rows = [judged.robustness, *judged.parts]
        return Summary(
            names=self.problem.fleet.names,
            substeps=self.substeps,
            members=size,
            violating=int(violating.sum()),
            drawn=size - corners,
            drawn_violating=int(violating[corners:].sum()),
            finite=len(finite),
            total=Fraction(float(finite.sum())),
            squares=Fraction(float((finite**2).sum())),
            worst=_worst(judged.robustness, members, index),
            histograms=tuple(empty.counted(row) for empty, row in zip(self._empty, rows, strict=True)),
            clearances=tuple(
                one.clearance(avoid.name, self.judge.times, members, self.problem.fleet.named)
                for avoid, one in zip(self.problem.specification.avoid, judged.closest, strict=True)
            ),
            shares=tuple(self._shares(judged, corners)),
        )

    def _shares(self, judged: Judged, corners: int) -> Iterator[ShareCount]:
        """How many of the members drawn at random do what a share of the fleet has to do."""
        for chance in self.problem.specification.chance:
            row = judged.parts[self.problem.specification.parts.index(chance.part)][corners:]
            yield ShareCount(str(chance.share), chance.share.p, int((row >= 0).sum()), len(row))


def block_summary(plan: PlanLike, seed: int, index: int, size: int, substeps: int | None = None) -> Summary:
    """What the members of one block do under a plan: a pure function of its arguments.

    Parameters
    ----------
    plan : Plan
        Or anything with a `problem` and `controls`.
    seed, index : int
        These two alone determine the draw, with the size. Block 0 begins with the corners of the parameters' ranges.
    size : int
        Members of the block; bounded memory means a bounded size, `SIZE` being a good one.
    substeps : int, optional
        Samples per step; default `problem.verify.substeps`.

    Returns
    -------
    Summary
        To be added by `Summary.merge` to those of other blocks, in any order.

    Notes
    -----
    *Guarantee*: exact for the members and times sampled, as `ensemble_ctrl.problem.evaluation.sampled.replay`, and for
    no others. Use `Blocks(problem, controls, seed).summary(index, size)` to prepare a plan once for many blocks.
    """
    return Blocks(plan.problem, plan.controls, seed, substeps).summary(index, size)


def division(members: int, size: int = SIZE) -> Iterator[tuple[int, int]]:
    """Index and size of every block of so many members: all of one size but the last.

    Examples
    --------
    >>> list(division(250, 100))
    [(0, 100), (1, 100), (2, 50)]
    """
    members, size = whole("members", members, 1), whole("size", size, 1)
    return ((i, min(size, members - i * size)) for i in range(-(-members // size)))


def replay_blocks(
    problem: Problem,
    controls: Floats,
    members: int,
    *,
    seed: int | None = None,
    substeps: int | None = None,
    size: int = SIZE,
    watch: Callable[[Summary], bool] | None = None,
) -> Summary:
    """Run `controls` on as many members as one likes, in bounded memory.

    Parameters
    ----------
    problem, controls, seed, substeps
        As for `Blocks`.
    members : int
        How many to draw, the corners of the ranges included.
    size : int
        Members of a block; the draw depends on it.
    watch : callable, optional
        Called with the summary so far after each block; returning True ends the replay with it.

    Returns
    -------
    Summary
        Of the blocks that were run.
    """
    blocks = Blocks(problem, controls, seed, substeps)
    total: Summary | None = None
    for index, count in division(members, size):
        one = blocks.summary(index, count)
        total = one if total is None else total.merge(one)
        if watch is not None and watch(total):
            break
    assert total is not None
    return total


def _worst(robustness: Floats, members: Floats, block: int) -> tuple[WorstMember, ...]:
    """The members with the smallest robustness, those drawn first before their equals."""
    count = min(WORST, len(robustness))
    limit = np.partition(robustness, count - 1)[count - 1]
    some = np.flatnonzero(robustness <= limit)
    order = some[np.argsort(robustness[some], kind="stable")][:count]
    return tuple(WorstMember(float(robustness[k]), block, int(k), tuple(members[k].tolist())) for k in order)
