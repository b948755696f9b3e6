"""The shared controls run on sampled members, in blocks of bounded memory.

Robots on arcs move exactly, others by a rule of stated accuracy (`ensemble_ctrl.problem.integrated`).

Nothing here knows how the controls were found.
"""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from itertools import chain
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.constraints.stl import Share
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.values import expect, whole
from ensemble_ctrl.problem.evaluation.apart import closest_pairs, compared
from ensemble_ctrl.problem.evaluation.clearance import Clearance
from ensemble_ctrl.problem.evaluation.disturbed import channels
from ensemble_ctrl.problem.evaluation.interval import wilson
from ensemble_ctrl.problem.evaluation.judge import Judge, Judged
from ensemble_ctrl.problem.fleet import Member
from ensemble_ctrl.problem.problem import Problem
from ensemble_ctrl.problem.specification import NOTHING_AVOIDED, NOTHING_REQUIRED
from ensemble_ctrl.problem.starts import by_start, label

Floats = NDArray[np.float64]
T = TypeVar("T")

BLOCK = 20_000
"""Members in one block, at 160 samples: after each one the replay may end."""
MOST_STATES = 5_000_000
"""States that are evaluated for a chart, or to find what fails."""


@dataclass(frozen=True)
class ShareSeen:
    """How many members do a part of the task that a share of the fleet has to do.

    Attributes
    ----------
    part : str
        As it was written.
    required : float
        The required share.
    satisfied : float
        The share of the members drawn at random that do it, 0 to 1; of all members if none was drawn.
    low, high : float
        Wilson's interval at 95 % for the share of the whole fleet.
    """

    part: str
    required: float
    satisfied: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Replay:
    """What happened to the sampled members.

    Attributes
    ----------
    parameters : ndarray, shape (members, parameters)
        Parameters in sampling order, in the columns of ``names``; the corners of the ranges come first.
    names : tuple of str
        The parameters' names.
    robustness : ndarray, shape (members,)
        Exact robustness in metres of the whole task, one number a member, of its states at `substeps` times a step.
    clearances : tuple of Clearance
        One for each obstacle, at `substeps` times a step.
    violating : ndarray of bool, shape (members,)
        Members with a negative robustness: those that fail the task, or are inside an obstacle at a sampled time.
    substeps : int
        Samples per step.
    seconds : float
        What it took.
    corners : int
        How many of the first members are corners of the ranges, or were given; the others were drawn at random.
    shares : tuple of ShareSeen
        One for each part ``share(p, f)`` of the task.
    disturbed : bool
        Whether each member was disturbed within the fleet's bounds, by samples of what may disturb it.
    starts : tuple of str
        The name of each member's start, where they start at different places.
    """

    parameters: Floats
    names: tuple[str, ...]
    robustness: Floats
    clearances: tuple[Clearance, ...]
    violating: NDArray[np.bool_]
    substeps: int
    seconds: float
    corners: int = 0
    shares: tuple[ShareSeen, ...] = ()
    disturbed: bool = False
    starts: tuple[str, ...] = ()

    @property
    def members(self) -> int:
        """How many members were replayed."""
        return len(self.parameters)

    @property
    def satisfied(self) -> float:
        """Share of the members that do the task and enter no obstacle, 0 to 1."""
        return float(1.0 - self.violating.mean())

    def share(self, z: float = 1.96) -> tuple[float, float]:
        """Bounds of the whole fleet's share that does the task, from the members drawn at random.

        Parameters
        ----------
        z : float
            Standard deviations of the normal distribution: 1.96 for a confidence of 95 %.

        Returns
        -------
        low, high : float
            Wilson's interval, 0 to 1; (0, 1) if no member was drawn.

        Notes
        -----
        Members at the corners of the ranges were not drawn and don't count. E. B. Wilson, Probable inference, the
        distribution of succession, and statistical inference, 1927.
        """
        drawn = self.violating[self.corners :]
        return wilson(int((~drawn).sum()), len(drawn), z)

    @property
    def worst_start(self) -> str:
        """The name of the start of the member with the smallest robustness; empty where all start alike."""
        return self.starts[int(self.robustness.argmin())] if self.starts else ""

    @property
    def worst(self) -> tuple[float, Member]:
        """Smallest robustness in metres and whose parameters they are."""
        i = int(self.robustness.argmin())
        return float(self.robustness[i]), dict(zip(self.names, self.parameters[i].tolist(), strict=True))

    def __repr__(self) -> str:
        closest = min((c.distance for c in self.clearances), default=float("inf"))
        clearance = f"clearance >= {closest:.4f} m" if np.isfinite(closest) else NOTHING_AVOIDED
        worst = self.worst[0]
        found = NOTHING_REQUIRED if worst == np.inf else f"robustness >= {worst:.4f} m, {clearance}"
        return f"Replay({self.members} members: {100 * self.satisfied:.4g} % satisfy, {found}, {self.seconds:.2f} s)"


def replay(
    problem: Problem,
    controls: Floats,
    *,
    members: int | None = None,
    parameters: ArrayLike | Sequence[Mapping[str, float]] | None = None,
    substeps: int | None = None,
    seed: int | None = None,
    watch: Callable[[int], bool] | None = None,
) -> Replay:
    """Run `controls` on sampled members.

    Parameters
    ----------
    problem : Problem
        Fleet, map and task.
    controls : ndarray, shape (steps, n_u)
        The broadcast commands, one row a step of equal length.
    members : int, optional
        How many to draw from the parameters' distributions, the corners of their ranges included; default
        `problem.verify.members`. Of several starts each has its equal part of them.
    parameters : array_like or sequence of mappings, optional
        Members to run instead of drawing any, as `Fleet.members` takes them; of several starts at each of them.
    substeps : int, optional
        Samples per step, for obstacles and for every part of the task; default `problem.verify.substeps`.
    seed : int, optional
        Seed of the draw; default `problem.solve.seed`.
    watch : callable, optional
        Called after each block with the number of members run so far; returning True ends the replay with these.

    Returns
    -------
    Replay

    Raises
    ------
    ProblemError
        For `controls` or `parameters` that are empty, of another shape or not finite, or a count below 1.

    Notes
    -----
    *Guarantee*: exact for the members and times sampled, and for no others. Members that are drawn are disturbed as
    `ensemble_ctrl.problem.evaluation.disturbed` draws it, each once: that finds few of the worst disturbances. Members
    that are given follow their model. Memory is bounded, except for a task
    that reads the fleet as a whole (``mean``, ``share``), for which all members are held at once.
    """
    began = time.perf_counter()
    expect("problem", problem, Problem)
    substeps = problem.verify.substeps if substeps is None else substeps
    substeps = whole("substeps", substeps, 1)
    controls = problem.fleet.checked_controls(controls)
    if problem.fleet.starts:
        count = problem.verify.members if members is None else whole("members", members, 1)
        share = -(-count // len(problem.fleet.starts))
        return _together(
            problem,
            controls,
            {
                name: replay(
                    one, controls, members=share, parameters=parameters, substeps=substeps, seed=seed, watch=watch
                )
                for name, one in by_start(problem).items()
            },
        )
    drawn = _draw(problem, members, seed) if parameters is None else problem.fleet.members(parameters)
    off = parameters is None and bool(channels(problem))
    dice = (problem.solve.seed if seed is None else seed) if off else None
    judge = Judge(problem, controls, substeps, drawn, dice)
    # blocks of bounded memory, but all members at once where mean(f) or share(p, f) is inside of the task
    size = len(drawn) if judge.together else max(1, BLOCK * 160 // (len(controls) * substeps))
    blocks = (drawn[i : i + size] for i in range(0, len(drawn), size))
    results = _watched(blocks, judge.judge, watch)
    drawn = drawn[: size * len(results)]
    robustness = np.concatenate([one.robustness for one in results])
    clearances = tuple(
        _closest(problem, judge.times, drawn, results, size, o) for o in range(len(judge.approach.avoid))
    )
    corners = min(len(problem.fleet.corners), len(drawn)) if parameters is None else len(drawn)
    shares = []
    for chance in problem.specification.chance:
        row = problem.specification.parts.index(chance.part)
        each = np.concatenate([one.parts[row] for one in results])
        random = each[corners:] if corners < len(each) else each
        # robustness of share(p, f): the value that a share p of the members reaches, an order statistic
        fleet = np.sort(random)[len(random) - chance.share.rank(len(random))]
        np.minimum(robustness, fleet, out=robustness)
        shares.append(_seen(chance.share, random, corners < len(each)))
    seconds, names = time.perf_counter() - began, problem.fleet.names
    violating, shown = robustness < 0, tuple(shares)
    return Replay(drawn, names, robustness, clearances, violating, substeps, seconds, corners, shown, off)


def _together(problem: Problem, controls: Floats, runs: Mapping[str, Replay]) -> Replay:
    """One replay of the members of all starts, those at corners of the ranges first; some are compared in pairs."""
    pairs = _in_pairs(problem, controls, runs)
    each = list(runs.values())
    starts = [name for name, one in runs.items() for _ in range(one.members)]
    corner = np.concatenate([np.arange(one.members) < one.corners for one in each])
    order = np.argsort(~corner, kind="stable")
    return Replay(
        np.concatenate([one.parameters for one in each])[order],
        each[0].names,
        np.concatenate([one.robustness for one in each])[order],
        (*(replace(c, obstacle=label(c.obstacle, name)) for name, one in runs.items() for c in one.clearances), *pairs),
        np.concatenate([one.violating for one in each])[order],
        each[0].substeps,
        sum(one.seconds for one in each),
        sum(one.corners for one in each),
        disturbed=each[0].disturbed,
        starts=tuple(starts[k] for k in order),
    )


def _in_pairs(problem: Problem, controls: Floats, runs: Mapping[str, Replay]) -> list[Clearance]:
    """How near the first members of the starts come to each other; their robustness falls to that where it is less."""
    substeps = next(iter(runs.values())).substeps
    some = compared(problem, len(controls) * substeps + 1)
    if not some:
        return []
    members = {name: one.parameters[:some] for name, one in runs.items()}
    paths = {name: trajectories(one, controls, members[name], substeps) for name, one in by_start(problem).items()}
    found = []
    for one, other, clearance, least in closest_pairs(problem, paths, members):
        for name, axis in ((one, 1), (other, 0)):
            seen = runs[name].robustness[:some]
            np.minimum(seen, least.min(axis=axis), out=seen)
            runs[name].violating[:some] |= least.min(axis=axis) < 0
        found.append(clearance)
    return found


def _seen(part: Share, robustness: Floats, drawn: bool) -> ShareSeen:
    """The share of some members with a robustness of zero or more, with the fleet's interval if they were drawn."""
    kept: NDArray[np.bool_] = robustness >= 0
    # binomial confidence interval (Wilson 1927), for members that were drawn at random only
    low, high = wilson(int(kept.sum()), len(kept)) if drawn else (0.0, 1.0)
    return ShareSeen(str(part), part.p, float(kept.mean()), low, high)


def trajectories(
    problem: Problem, controls: Floats, parameters: ArrayLike | Sequence[Mapping[str, float]], substeps: int = 1
) -> Floats:
    """Positions of members, given as `Fleet.members` takes them, shape (members, steps * substeps + 1, d), metres."""
    return states(problem, controls, parameters, substeps)[..., problem.fleet.place_columns]


def all_paths(problem: Problem, controls: Floats, members: Floats, substeps: int = 1) -> tuple[Floats, Floats]:
    """Positions of the same members at every start, as `trajectories` gives them, and the members, one a path."""
    found, whose = all_states(problem, controls, members, substeps)
    return found[..., problem.fleet.place_columns], whose


def all_states(problem: Problem, controls: Floats, members: Floats, substeps: int = 1) -> tuple[Floats, Floats]:
    """The same with every state, as `states` gives them."""
    each = [states(one, controls, members, substeps) for one in by_start(problem).values()]
    return np.concatenate(each), np.tile(members, (len(each), 1))


def states(
    problem: Problem, controls: Floats, parameters: ArrayLike | Sequence[Mapping[str, float]], substeps: int = 1
) -> Floats:
    """States of members, in the columns of `Fleet.states`, shape (members, steps * substeps + 1, n_x)."""
    fleet = problem.fleet
    fine = np.repeat(np.asarray(controls, float), substeps, axis=0)
    return fleet.trajectories(fine, fleet.members(parameters), problem.duration / len(fine))


def headings(
    problem: Problem, controls: Floats, parameters: ArrayLike | Sequence[Mapping[str, float]], substeps: int = 1
) -> Floats | None:
    """Headings of bodies from +x at the times of `states`, shape (members, times), radians; None without bodies."""
    fleet = problem.fleet.of_one_start
    if fleet.footprint is None:
        return None
    fine = np.repeat(np.asarray(controls, float), substeps, axis=0)
    return fleet.arcs.headings(fine, fleet.coefficients(fleet.members(parameters)), problem.duration / len(fine))


def affordable(members: int, steps: int, substeps: int = 1) -> int:
    """The number of members to evaluate, lower for very long horizons: `MOST_STATES` states together, three at least.

    Examples
    --------
    >>> affordable(201, 200, 4), affordable(201, 100_000, 4)
    (201, 12)
    """
    return max(3, min(members, MOST_STATES // (steps * substeps)))


def _draw(problem: Problem, members: int | None, seed: int | None) -> Floats:
    """Sampled members, the corners of the ranges first."""
    members = problem.verify.members if members is None else members
    members = whole("members", members, 1)
    corners = problem.fleet.corners[:members]
    rest = problem.fleet.sample(members - len(corners), problem.solve.seed if seed is None else seed)
    return np.concatenate([corners, rest])


def _watched(blocks: Iterable[Floats], run: Callable[[Floats], T], watch: Callable[[int], bool] | None) -> list[T]:
    """The results of the blocks in order, of all or of the first ones: until `watch` returns true.

    Only a few blocks wait at any time: there may be millions of them.
    """
    results: list[T] = []
    from concurrent.futures import Future, ThreadPoolExecutor

    done, begun = 0, deque[tuple[int, Future[T]]]()
    threads = min(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 2, 4)
    with ThreadPoolExecutor(threads) as pool:
        try:
            # two blocks wait for each thread; the None at the end empty the queue
            for block in chain(blocks, [None] * (2 * threads)):
                if block is not None:
                    begun.append((len(block), pool.submit(run, block)))
                if begun and (block is None or len(begun) > 2 * threads):
                    size, ended = begun.popleft()
                    results.append(ended.result())
                    done += size
                    if watch is not None and watch(done):
                        break
        finally:
            pool.shutdown(cancel_futures=True)  # an exception, as of Ctrl-C, does not wait for the blocks to come
    return results


def _closest(problem: Problem, times: Floats, drawn: Floats, results: Sequence[Judged], size: int, o: int) -> Clearance:
    """The closest of all blocks."""
    named = problem.fleet.named
    each = (
        one.closest[o].clearance(problem.specification.avoid[o].name, times, drawn[k * size :], named)
        for k, one in enumerate(results)
    )
    return reduce(Clearance.merge, each)
