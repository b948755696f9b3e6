"""Which members do a part of the task that a share of the fleet has to do: a box of parameters, found and weighed.

Members on a grid are looked at; the box is the largest found in which all of them do it with some to spare. The proof
is then one for every member of that box, as for a fleet of its own, and the distributions' mass of the box is a lower
bound of the share.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.enclosure import Flow, Range, Track
from ensemble_ctrl.certificate.instants import Mesh
from ensemble_ctrl.certificate.masses import MASS_ERROR
from ensemble_ctrl.certificate.signals import CellSignals
from ensemble_ctrl.certificate.task import scheduled
from ensemble_ctrl.problem.specification import ChanceConstraint

if TYPE_CHECKING:
    from ensemble_ctrl.moments import Distribution
    from ensemble_ctrl.problem import Problem
    from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

MEMBERS = {0: 1, 1: 1024, 2: 64}
"""About as many values of each of so many parameters are looked at; else 16."""
SPARE = (1e-3, 5e-3, 2e-2, 5e-2)
"""Metres that members on the grid have to spare, in turn, until the box is proven."""
SUBSTEPS = 4
"""Samples per step."""


def boxes(
    problem: Problem, controls: Floats, fleet: Fleet, chance: ChanceConstraint
) -> Iterator[tuple[dict[str, Range], float]]:
    """Ranges of the members that seem to do a chance part, with their mass; with more and more to spare.

    Only those with the mass that the part asks for.
    """
    # robustness of members on a grid, less what half the box of starts takes away (predicates are 1-Lipschitz)
    axes = [
        _values(distribution, k in fleet.dynamic, len(fleet.dynamic))
        for k, distribution in enumerate(fleet.parameters.values())
    ]
    shape = tuple(map(len, axes))
    members = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes)) if axes else np.zeros((1, 0))
    value = _value(problem, controls, fleet, chance, members).reshape(shape) - float(np.linalg.norm(fleet.shift))
    seen: set[tuple[tuple[int, int], ...]] = set()
    for spare in SPARE:
        box = _largest(fleet, axes, value >= spare)
        if box is None or box in seen:
            continue
        seen.add(box)
        low, high = _ends(fleet, axes, box)
        mass = _certain(fleet, low, high)
        if mass >= chance.share.p:
            ends = zip(fleet.names, low.tolist(), high.tolist(), strict=True)
            yield {name: Range(a, b) for name, a, b in ends}, mass


def _certain(fleet: Fleet, low: Floats, high: Floats) -> float:
    """The mass of a box, rounded down where it comes from distribution functions."""
    rest = zip(fleet.parameters.items(), low, high, strict=True)
    # exact where members are counted, or where the box holds all of the range
    counted = all(
        distribution.measured is not None or (a <= distribution.lower and b >= distribution.upper)
        for (_, distribution), a, b in rest
    )
    return fleet.mass(low, high) if counted else max(0.0, fleet.mass(low, high) - MASS_ERROR)


def _values(distribution: Distribution, bends: bool, dynamic: int) -> Floats:
    """Values of a parameter, even in its range and its distribution; only the middle for one that shifts the start."""
    if not bends:
        return np.array([distribution.center])
    share = np.linspace(0.0, 1.0, MEMBERS.get(dynamic, 16) // 2 + 1)
    # evenly in the range and evenly in mass: good boxes end near either
    even = distribution.lower + share * (distribution.upper - distribution.lower)
    return np.unique(np.concatenate([even, distribution.quantile(share), [distribution.lower, distribution.upper]]))


def _ends(fleet: Fleet, axes: list[Floats], box: tuple[tuple[int, int], ...]) -> tuple[Floats, Floats]:
    """A box as numbers; all of the range of a parameter that shifts the start."""
    low, high = np.array(fleet.lower), np.array(fleet.upper)
    for k, (axis, (first, last)) in enumerate(zip(axes, box, strict=True)):
        if k in fleet.dynamic:
            low[k], high[k] = axis[first], axis[last]
    return low, high


def _value(problem: Problem, controls: Floats, fleet: Fleet, chance: ChanceConstraint, members: Floats) -> Floats:
    """How well each member does the part, about: at some times of each step."""
    distributions = dict(fleet.parameters)
    # members as cells of no width: positions at SUBSTEPS times per step
    mesh = Mesh.of(problem.duration, len(controls), range(len(controls) * SUBSTEPS + 1), SUBSTEPS)
    flow = Flow.of(problem, controls, distributions, mesh)
    away = np.append(flow.error, flow.error[-1:])
    values = np.full(len(members), np.inf)
    size = max(1, 500_000 // flow.steps)
    blocks = [slice(i, i + size) for i in range(0, len(members), size)]
    for rows in blocks:
        path = Track.of(flow, members[rows]).position
        times = np.linspace(0.0, problem.duration, path.shape[1])
        for avoid in chance.avoid:
            distances = avoid.distances(path, times) - away[avoid.during(times)]
            values[rows] = np.minimum(values[rows], distances.min(axis=1, initial=np.inf))
    for part in chance.rest:
        found = scheduled(problem, controls, distributions, part.formula, SUBSTEPS)
        if found is None:
            continue
        fine, schedule, commands = found
        for rows in blocks:
            signals = CellSignals.of(fine, commands, members[rows], np.zeros_like(members[rows]))
            values[rows] = np.minimum(values[rows], schedule.value(signals))
    return values


def _largest(fleet: Fleet, axes: list[Floats], good: Bools) -> tuple[tuple[int, int], ...] | None:
    """The box of grid members, all of them good, that has the largest mass; the best found with several parameters."""
    if not good.any():
        return None
    wide = [k for k, axis in enumerate(axes) if len(axis) > 1]
    if len(wide) == 1:
        return _longest(fleet, axes, good, wide[0])
    return _peeled(fleet, axes, good)


def _longest(fleet: Fleet, axes: list[Floats], good: Bools, k: int) -> tuple[tuple[int, int], ...]:
    """The run of good members with the largest mass."""
    # begin and end of each run of good members
    padded = np.concatenate([[False], good.ravel(), [False]])
    first, after = np.flatnonzero(np.diff(padded.astype(int)) == 1), np.flatnonzero(np.diff(padded.astype(int)) == -1)
    runs = [
        tuple((int(a), int(b) - 1) if axis == k else (0, 0) for axis in range(len(axes)))
        for a, b in zip(first, after, strict=True)
    ]
    return max(runs, key=lambda box: fleet.mass(*_ends(fleet, axes, box)))


def _peeled(fleet: Fleet, axes: list[Floats], good: Bools) -> tuple[tuple[int, int], ...] | None:
    """All of the grid, less the outermost layer with the largest part of bad members, until none is left."""
    box = [(0, len(axis) - 1) for axis in axes]
    while True:
        inside = good[tuple(slice(first, last + 1) for first, last in box)]
        if inside.all():
            return tuple(box)
        # greedy: of the 2 d outer layers, take the one with the smallest share of good members off
        layers = [
            (float(np.take(inside, 0 if low else -1, axis=k).mean()), k, low)
            for k, (first, last) in enumerate(box)
            if last > first
            for low in (True, False)
        ]
        if not layers:
            return None
        _, k, low = min(layers)
        first, last = box[k]
        box[k] = (first + 1, last) if low else (first, last - 1)


def weighed(problem: Problem, distributions: Mapping[str, Distribution]) -> Fleet:
    """The fleet with the distributions of a certificate; joint samples stand for its own distributions only."""
    fleet = problem.fleet
    same = all(distributions[name] is distribution for name, distribution in fleet.parameters.items())
    return fleet if same else fleet.with_distributions(distributions)
