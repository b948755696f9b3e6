"""What a certificate is about, in one number: another question has another."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.disc import disc_of
from ensemble_ctrl.constraints.stl.rewrite import reads_fleet

if TYPE_CHECKING:
    from ensemble_ctrl.moments import Distribution
    from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]


def fingerprint(problem: Problem, controls: Floats, distributions: Mapping[str, Distribution]) -> str:
    """SHA-256 of the controls and of everything that the claim depends on."""
    fleet = problem.fleet
    digest = hashlib.sha256()
    numbers: Sequence[object] = [
        *fleet.identity,
        fleet.radius,
        problem.duration,
        [(name, distribution.lower, distribution.upper) for name, distribution in distributions.items()],
        _spread(problem, distributions) if reads_fleet(problem.task) else [],
        str(problem.task),
        [
            (name, region.A.tolist(), region.lower.tolist(), region.upper.tolist())
            for name, region in problem.regions.items()
        ],
        [(name, piece.A.tolist(), piece.b.tolist()) for name, piece in problem.pieces],
        [(name, m.times.tolist(), m.offsets.tolist(), *m.doubt) for name, m in problem.motions.items()],
    ]
    # the rows of a disc are those of a polygon around it
    zones = problem.zones.items()
    shapes = [*problem.regions.items(), *problem.pieces, *((name, p) for name, zone in zones for p in zone.pieces)]
    discs = [
        (name, disc.center.tolist(), disc.radius) for name, shape in shapes if (disc := disc_of(shape)) is not None
    ]
    if discs:
        numbers = [*numbers, discs]
    if problem.zones:
        pieces = [(name, zone.speed, [(p.A.tolist(), p.b.tolist()) for p in zone.pieces]) for name, zone in zones]
        numbers = [*numbers, ["zones", *pieces]]
    if fleet.footprint is not None:
        numbers = [*numbers, fleet.footprint.corners.tolist()]
    if fleet.uncertainty:
        numbers = [*numbers, fleet.uncertainty.data()]
    if problem.terrain:
        numbers = [*numbers, "terrain", [(name, patch.data()) for name, patch in sorted(problem.terrain.items())]]
    digest.update(repr(numbers).encode())
    digest.update(np.ascontiguousarray(controls, dtype="<f8").tobytes())
    return digest.hexdigest()


def _spread(problem: Problem, distributions: Mapping[str, Distribution]) -> list[object]:
    """How the fleet is spread, for claims about a share or the mean of it."""
    quantiles = [[*d.quantile(np.linspace(0.0, 1.0, 65)).tolist(), *_finer(d)] for d in distributions.values()]
    return [quantiles, [(name, column.tolist()) for name, column in (problem.fleet.samples or {}).items()]]


def _finer(distribution: Distribution) -> list[object]:
    """What quantiles do not tell: every measured value, and every part of a mixture."""
    parts, values = getattr(distribution, "parts", ()), getattr(distribution, "values", np.zeros(0))
    return [*((weight, repr(part), _finer(part)) for part, weight in parts), *values.tolist()]
