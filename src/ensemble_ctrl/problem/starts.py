"""Members that move off together from different places: the places, by name, and the problem of each."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl.formula import Always, And, Formula
from ensemble_ctrl.constraints.stl.leaves import Apart
from ensemble_ctrl.constraints.stl.rewrite import conjuncts
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyMapping
from ensemble_ctrl.core.values import numbers, shown

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem
    from ensemble_ctrl.systems import System

MOST = 100
"""Starts of one fleet: each is planned, proven and replayed."""
Offsets = Mapping[str, tuple[float, ...]]
"""Where members start beside the fleet's own start, by the names of the starts, metres."""


def starts_of(system: System, starts: Any) -> ReadOnlyMapping[tuple[float, ...]]:
    """Offsets by name: from a mapping, or from rows, which are called s1, s2, ...; an empty mapping is of one start.

    Raises
    ------
    ProblemError
        For no or too many starts, places of another dimension, numbers that are not finite, and a place given twice.
    """
    if isinstance(starts, Mapping) and not starts:
        return ReadOnlyMapping({})
    wanted = f"at least one place [{', '.join(system.positions)}], by name or in a list"
    if not isinstance(starts, Mapping):
        rows = numbers("fleet.starts", starts, wanted)
        starts = {f"s{k + 1}": row for k, row in enumerate(np.atleast_1d(rows))}
    if not 1 <= len(starts) <= MOST:
        raise ProblemError(f"fleet.starts: expected {wanted}, {MOST} at most, got {len(starts)}")
    found: dict[str, tuple[float, ...]] = {}
    for name, place in starts.items():
        if not isinstance(name, str) or not name:
            raise ProblemError(f"fleet.starts: expected names, got {shown(name)}")
        row = numbers(f"fleet.starts.{name}", place, f"a place [{', '.join(system.positions)}]")
        if row.shape != (len(system.positions),) or not np.isfinite(row).all():
            came = row.tolist()
            raise ProblemError(f"fleet.starts.{name}: expected a place [{', '.join(system.positions)}], got {came}")
        found[name] = tuple(row.tolist())
        first = next(other for other, there in found.items() if there == found[name])
        if first != name:
            raise ProblemError(f"fleet.starts.{name}: expected another place than that of {first}, got {row.tolist()}")
    return ReadOnlyMapping(found)


@dataclass(frozen=True)
class Pair:
    """Members of two starts in the common frame of a program: what one of them is further, and how far they keep apart.

    Attributes
    ----------
    offset : tuple of float
        Where one member would be from the other if both had the same parameters, shape (d,), metres.
    distance : float
        Metres between their centres.
    begin, end : float
        When, seconds.
    """

    offset: tuple[float, ...]
    distance: float
    begin: float
    end: float


def by_start(problem: Problem) -> dict[str, Problem]:
    """The problem of the members at each start, by its name; the problem itself, without a name, where all start alike.

    Notes
    -----
    What holds for each of these problems under some controls holds for the whole fleet, but for what the task says of
    members of different starts (``apart``), which is no part of these problems.
    """
    if not problem.fleet.starts:
        return {"": problem}
    parts = [part for part in conjuncts(problem.task) if not keeps_apart(part)]
    found: dict[str, Problem] = {}
    for name in problem.fleet.starts:
        # checked as a part of the whole problem, with its line in the file
        one = found[name] = copy(problem)
        object.__setattr__(one, "fleet", problem.fleet.at_start(name))
        object.__setattr__(one, "task", parts[0] if len(parts) == 1 else And(tuple(parts)))
    return found


def places(problem: Problem) -> dict[str, NDArray[np.float64]]:
    """The middle of the start positions by the names of the starts, shape (d,) each, metres; one is called start."""
    return {name or "start": one.fleet.start_place for name, one in by_start(problem).items()}


def keeps_apart(part: Formula) -> bool:
    """Whether a conjunct is ``G[a,b] apart(d)``."""
    return isinstance(part, Always) and isinstance(part.child, Apart)


def label(what: str, start: str) -> str:
    """What a bound is of, with the start of the members that it is for."""
    return f"{what} from start {start}" if start else what
