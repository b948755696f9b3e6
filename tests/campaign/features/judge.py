"""A certificate judged by what robots at their bounds do: every claim that is false."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from ensemble_ctrl.certificate import Bound, Certificate
from ensemble_ctrl.core.errors import ProblemError

from ..model import Node, conjuncts
from . import oracle, subject
from .paths import Floats, Paths, Rng, Will, driven, members_of, obedient, willful
from .world import Featured, duties_of, is_apart, leaves

ROBOTS = 48
FEW = 16
"""Robots of which the robustness of a formula is looked at."""
SPARE = 1e-3
"""Metres, or the unit of a part, with which robots decide a case that a certificate should decide too."""
PIECES = 480
"""Pieces of time, about."""


@dataclass(frozen=True)
class Judged:
    """What was said of a case, the least value seen, what is false, and what robots decide with `SPARE`."""

    verdict: str
    seen: float
    reason: str
    faults: tuple[str, ...]
    decided: str


def judge(case: Featured, rng: Rng) -> Judged:
    """The certificate of a case against robots."""
    try:
        certificate = subject.certified(case)
    except ProblemError as error:
        return Judged("refused", math.nan, str(error), (), "")
    found = [_robots(one, rng, certificate) for one in _alone(case)]
    told = list(_of_pairs(case, [paths[0] for paths in found], certificate.clearances))
    for name, one, paths in zip(case.starts or [""], _alone(case), found, strict=True):
        told += _of_one(one, paths, [_from(bounds, name) for bounds in (certificate.clearances, certificate.parts)])
    least = min((value for _, value in told), default=math.inf)
    faults = (*(what for what, _ in told if what), *_of_all(certificate, least))
    certain = not (case.errors or case.terrain) and abs(least) > SPARE
    return Judged(
        certificate.proven, least, certificate.reason, faults, ("yes" if least > 0 else "no") if certain else ""
    )


def _alone(case: Featured) -> list[Featured]:
    """The members of each start alone."""
    return [case.at(name) for name in case.starts] or [case]


def _from(bounds: Sequence[Any], start: str) -> list[Any]:
    """The bounds of one start."""
    names = [getattr(bound, "obstacle", None) or bound.part for bound in bounds]
    return [
        bound for bound, name in zip(bounds, names, strict=True) if not start or name.endswith(f" from start {start}")
    ]


def _of_all(certificate: Certificate, least: float) -> Iterator[str]:
    """What is said of all bounds together."""
    bounds: list[Any] = [*certificate.clearances, *certificate.parts]
    if certificate.proven == "yes":
        if not all(bound.proven >= 0 for bound in bounds) or certificate.reason:
            yield f"false yes: with {bounds!r}"
        if least < 0:
            yield f"false yes: a robot has {least!r}"
    if certificate.proven == "no" and certificate.counter_example is None:
        yield "counter-example: none with a no"
    if certificate.proven == "no" and not any(bound.sampled < 0 for bound in bounds):
        yield f"false no: with {bounds!r}"


def _robots(case: Featured, rng: Rng, certificate: Certificate) -> list[Paths]:
    """Robots that follow their model, the counter-examples first, and some that are at their bounds.

    Those that come closest to something, or are the worst that the certificate has seen, then aim at it.
    """
    steps = len(case.base.controls)
    each = max(8, PIECES // steps)
    members = members_of(case, rng, ROBOTS)
    names = list(case.base.distributions)
    bounds: list[Any] = [*certificate.clearances, *certificate.parts]
    given = [bound.parameters for bound in bounds if bound.parameters.keys() == set(names)]
    for k, one in enumerate(given[:FEW]):
        members[k] = [one[name] for name in names]
    calm, will = obedient(FEW, steps, each), willful(case, rng, ROBOTS - FEW, each, _aims(case, rng))
    both = zip(vars(calm).values(), vars(will).values(), strict=True)
    found = [driven(case, members, Will(*(np.concatenate(pair) for pair in both)), each)]
    if case.errors or case.terrain:
        for part in case.parts:
            for name in duties_of(part)[:1]:
                found.append(_aimed(case, rng, each, found[0], name, _window(case, part)))
        found = found[:3]
    return found


def _aims(case: Featured, rng: Rng) -> Floats:
    """Angles at which robots are pushed: towards the lines of the task, and some others."""
    lines = [leaf for part in case.parts for leaf in leaves(part) if leaf[0] == "pred"]
    across = [np.arctan2(leaf[2], leaf[1]) + turn for leaf in lines for turn in (0.0, np.pi)]
    return np.append(across, rng.uniform(-np.pi, np.pi, 4))


def _window(case: Featured, part: Node) -> tuple[float, float]:
    """When a part is about."""
    return (0.0, case.base.duration) if part[1] is None else (part[1], part[2])


def _aimed(case: Featured, rng: Rng, each: int, paths: Paths, name: str, window: tuple[float, float]) -> Paths:
    """The robots that come closest to something, and are pushed towards it."""
    value = oracle.clearance(case, paths, name, window)[:FEW]
    nearest = np.argsort(value)[:3]
    members = paths.members[np.append(np.repeat(nearest[0], ROBOTS // 2), rng.choice(nearest, ROBOTS // 2))]
    aims = np.arange(-4, 4) * np.pi / 4 + rng.uniform(0, np.pi / 4)
    # the angle at which the whole path is shifted closest to it
    size = 1e-3 + abs(float(value[nearest[0]])) / 2
    shifted = [
        replace(
            paths,
            place=paths.place[nearest[:1]] + size * np.array([np.cos(a), np.sin(a)]),
            heading=paths.heading[nearest[:1]],
        )
        for a in aims
    ]
    order = np.argsort([float(oracle.clearance(case, one, name, window)[0]) for one in shifted])
    best = aims[order[0]]
    return driven(case, members, willful(case, rng, ROBOTS, each, best + np.array([-0.3, 0.0, 0.0, 0.3])), each)


def _of_one(case: Featured, found: Sequence[Paths], bounds: Sequence[list[Any]]) -> Iterator[tuple[str, float]]:
    """Bounds above what a robot has, and the least value of each part."""
    clearances, tasks = bounds
    size = 1e-9 + 1e-12 * float(np.abs(found[0].place).max())
    kept = [part for part in case.parts if not is_apart(part)]
    for part, name in [(one, name) for one in kept for name in duties_of(one)]:
        least = min(float(oracle.clearance(case, p, name, _window(case, part)).min()) + p.bulge for p in found) + size
        # where one obstacle has several windows, the least bound is claimed of all of them
        high = min((b.proven for b in clearances if b.obstacle.partition(" from ")[0] == name), default=-math.inf)
        yield (f"bound: clearance {name}: proven {high!r}, a robot has {least!r}" if high > least else ""), least
    others = [part for part in kept if not duties_of(part)]
    if len(others) != len(tasks):
        return
    for part, task in zip(others, tasks, strict=True):
        some = [(found[0], k) for k in (*range(6), *range(FEW, FEW + 10))] + [
            (p, k) for p in found[1:] for k in range(0, ROBOTS, 6)
        ]
        least = min(oracle.robustness(case, p, part, k) + oracle.missed(p, part) for p, k in some)
        yield (
            (f"bound: {task.part}: proven {task.proven!r}, a robot has {least!r}" if task.proven > least else ""),
            least,
        )


def _of_pairs(case: Featured, paths: Sequence[Paths], bounds: Sequence[Bound]) -> Iterator[tuple[str, float]]:
    """Bounds above the distance of two robots of different starts."""
    wanted = [part for part in conjuncts(case.base.task) if is_apart(part)]
    pairs = [(part, one, other) for part in wanted for one, other in combinations(paths, 2)]
    own = [bound for bound in bounds if bound.obstacle.startswith("apart(")]
    for (part, one, other), bound in zip(pairs, own, strict=True) if own else ():
        size = 1e-9 + 1e-12 * float(np.abs(one.place).max())
        seen = oracle.apart(one, other, _window(case, part)) - part[3][1] + size
        yield (
            (f"bound: {bound.obstacle}: proven {bound.proven!r}, robots have {seen!r}" if bound.proven > seen else ""),
            seen,
        )
