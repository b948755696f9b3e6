"""Members that start at different places, planned as if they started at one: each start has a map of its own.

Where rates do not depend on the position, a member that starts `d` further moves along the same curve, `d` further.  So
it does its task if a member at the common start does that task on a map moved by ``-d``.  The program of the fleet with
several starts is that of one fleet, in the middle of the starts, with as many copies of the map and of the task.

Nothing here is part of a proof, which is about each start as it is (`ensemble_ctrl.certificate.starts`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Disc, DiscRegion, Obstacle, Polyhedron, Solid
from ensemble_ctrl.constraints.disc import disc_of
from ensemble_ctrl.constraints.stl import Always, And, Avoid, Formula, Inside, Predicate, conjuncts
from ensemble_ctrl.constraints.stl.rewrite import map_leaves, rebuilt
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.specification import avoided
from ensemble_ctrl.problem.starts import Pair, keeps_apart

Floats = NDArray[np.float64]


ALL = "all"
"""What follows the name of the region that is left of the copies for all starts."""


def in_one_frame(problem: Problem) -> Problem:
    """The problem of one fleet in the middle of the starts; its plans are those of the fleet with all of them."""
    fleet = problem.fleet
    places = np.array(list(fleet.starts.values()))
    middle = places.mean(axis=0)
    base = fleet.of_one_start
    moves = [middle - place for place in places]
    common = {name: _common([_moved_region(region, m) for m in moves]) for name, region in problem.regions.items()}
    shared = {name: region for name, region in common.items() if region is not None and not region.is_empty}
    kept = [part for part in conjuncts(problem.task) if not keeps_apart(part)]
    tasks = tuple(part for one in kept for part in _of_all(problem, one, moves, shared))
    return problem.with_(
        fleet=base.with_(position=base.position + middle),
        task=tasks[0] if len(tasks) == 1 else And(tasks),
        regions={_name(n, k): _moved_region(r, m) for k, m in enumerate(moves) for n, r in problem.regions.items()}
        | {f"{name}.{ALL}": region for name, region in shared.items()},
        obstacles={
            _name(n, k): tuple(_moved_piece(piece, m) for piece in pieces)
            for k, m in enumerate(moves)
            for n, pieces in problem.obstacles.items()
        },
        zones={
            _name(n, k): replace(zone, pieces=tuple(_moved_piece(piece, m) for piece in zone.pieces))
            for k, m in enumerate(moves)
            for n, zone in problem.zones.items()
        },
        terrain={
            _name(n, k): replace(patch, pieces=tuple(_moved_piece(piece, m) for piece in patch.pieces))
            for k, m in enumerate(moves)
            for n, patch in problem.terrain.items()
        },
        motions={_name(n, k): motion for k in range(len(moves)) for n, motion in problem.motions.items()},
        ignore=tuple(_name(n, k) for k in range(len(moves)) for n in problem.ignore),
        report=replace(problem.report, suggest=False),
        verify=replace(problem.verify, certificate=problem.verify.certificate and not problem.specification.apart),
        pairs=tuple(_pairs(problem)),
    )


def _pairs(problem: Problem) -> Iterator[Pair]:
    """Members that keep apart: one pair for all starts that differ alike."""
    for wanted in problem.specification.apart:
        differ = {tuple(np.subtract(a, b).tolist()) for a, b in combinations(problem.fleet.starts.values(), 2)}
        # a pair and the same the other way round are one
        for offset in sorted({max(one, tuple(-x for x in one)) for one in differ}):
            yield Pair(offset, wanted.distance, wanted.begin, wanted.end)


def _name(name: str, k: int) -> str:
    """The copy of a place for one start."""
    return f"{name}.{k + 1}"


def _of_all(
    problem: Problem, task: Formula, moves: Sequence[Floats], shared: Mapping[str, Polyhedron]
) -> tuple[Formula, ...]:
    """A conjunct of the task for every start: one formula where all have to do the same at the same time."""
    each = tuple(_moved_task(problem, task, k, move) for k, move in enumerate(moves))
    if not _at_all_times(task, shared):
        return each
    # G in(r_1) and G in(r_2) = G in(r_1 and r_2): one place to go to instead of several
    kept = [leaf for leaf in conjuncts(task.parts[0]) if isinstance(leaf, Inside)]
    inside = tuple(Inside(f"{leaf.name}.{ALL}") for leaf in kept)
    rest = tuple(part for one in each for part in conjuncts(one.parts[0]) if not isinstance(part, Inside))
    parts = (*inside, *rest)
    return (rebuilt(task, [parts[0] if len(parts) == 1 else And(parts)]),)


def _at_all_times(task: Formula, shared: Mapping[str, Polyhedron]) -> bool:
    """Whether a conjunct is ``G (in(a) and in(b) and ...)`` about regions that all starts have a part of."""
    if not isinstance(task, Always):
        return False
    parts = conjuncts(task.child)
    inside = [part for part in parts if isinstance(part, Inside)]
    return bool(inside) and all(not part.parts for part in parts) and all(part.name in shared for part in inside)


def _moved_task(problem: Problem, task: Formula, k: int, move: Floats) -> Formula:
    """A conjunct for the members of one start, about their copies of the places."""

    def change(leaf: Formula) -> Formula:
        if isinstance(leaf, Avoid):
            names = tuple(Avoid(_name(name, k)) for name in avoided(problem, leaf))
            return names[0] if len(names) == 1 else And(names) if names else leaf
        if isinstance(leaf, Inside):
            return Inside(_name(leaf.name, k))
        if isinstance(leaf, Predicate):
            # c . (x - move) + d >= 0 for the member that starts `move` away
            by_name = dict(zip(problem.fleet.places, move.tolist(), strict=True))
            shift = sum(factor * by_name.get(name, 0.0) for name, factor in leaf.coefficients)
            return replace(leaf, offset=leaf.offset - shift)
        return leaf

    return map_leaves(task, change)


def _common(regions: Sequence[Polyhedron]) -> Polyhedron | None:
    """What several copies of a region have in common, if any bounds are left."""
    lower = np.max([region.lower for region in regions], axis=0)
    upper = np.min([region.upper for region in regions], axis=0)
    return None if (lower > upper).any() else Polyhedron(regions[0].A, lower, upper)


def _moved_region(region: Polyhedron, move: Floats) -> Polyhedron:
    """A region, moved."""
    if (disc := disc_of(region)) is not None:
        return DiscRegion(Disc(disc.center + move, disc.radius))
    along = region.A @ move
    return Polyhedron(region.A, region.lower + along, region.upper + along)


def _moved_piece(piece: Obstacle, move: Floats) -> Obstacle:
    """A convex piece of an obstacle, moved."""
    if (disc := disc_of(piece)) is not None:
        return Disc(disc.center + move, disc.radius)
    make = Solid.hull if piece.A.shape[1] == 3 else Obstacle.polygon
    return make(piece.vertices + move)
