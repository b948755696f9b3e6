"""How far sampled members of different starts are from each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem.evaluation.clearance import Clearance
from ensemble_ctrl.problem.problem import Problem
from ensemble_ctrl.problem.specification import ApartConstraint

Floats = NDArray[np.float64]

MOST = 20_000_000
"""Distances that are looked at, in all pairs of starts together."""
MEMBERS = 200
"""Members of each start that are compared at most."""


def compared(problem: Problem, times: int) -> int:
    """How many members of each start are compared with those of the others; none where the task does not ask for it."""
    starts = len(problem.fleet.starts)
    pairs = starts * (starts - 1) // 2 * len(problem.specification.apart)
    return 0 if not pairs else int(np.clip((MOST / (pairs * times)) ** 0.5, 3, MEMBERS))


def closest_pairs(
    problem: Problem, paths: Mapping[str, Floats], members: Mapping[str, Floats]
) -> Iterator[tuple[str, str, Clearance, Floats]]:
    """The closest that members of each two starts come, and by how much each pair of members is further than wanted.

    Parameters
    ----------
    problem : Problem
    paths : mapping of str to ndarray, shape (members, times, d)
        Positions of members of each start at evenly spaced times of the whole plan, metres.
    members : mapping of str to ndarray, shape (members, parameters)

    Yields
    ------
    one, other : str
        The starts.
    clearance : Clearance
        Of the closest pair, less what is wanted.
    least : ndarray, shape (members of one, members of other)
        The same of every pair, metres.
    """
    for wanted in problem.specification.apart:
        for one, other in combinations(paths, 2):
            yield one, other, *_closest(problem, wanted, (one, other), paths, members)


def _closest(
    problem: Problem,
    wanted: ApartConstraint,
    pair: tuple[str, str],
    paths: Mapping[str, Floats],
    members: Mapping[str, Floats],
) -> tuple[Clearance, Floats]:
    """The closest pair of members of two starts within the window."""
    here, there = (paths[name] for name in pair)
    times = np.linspace(0.0, problem.duration, here.shape[1])
    during = np.flatnonzero((times >= wanted.begin - 1e-9) & (times <= wanted.end + 1e-9))
    least, when = np.full((len(here), len(there)), np.inf), np.zeros((len(here), len(there)))
    for n in during.tolist():
        away = np.linalg.norm(here[:, n][:, None] - there[:, n], axis=-1) - wanted.distance
        when[away < least] = times[n]
        np.minimum(least, away, out=least)
    i, j = np.unravel_index(int(least.argmin()), least.shape)
    rows = zip(pair, (members[pair[0]][i], members[pair[1]][j]), strict=True)
    who = {f"{what} of {name}": v for name, row in rows for what, v in problem.fleet.named(row).items()}
    inside = int((least < 0).any(axis=1).sum())
    return Clearance(f"{wanted} of {pair[0]} and {pair[1]}", float(least[i, j]), float(when[i, j]), who, inside), least
