"""Whether members are inside of their enclosure, and whether a certificate's claims hold for them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import ensemble_ctrl as ec
from ensemble_ctrl.certificate.bound import CounterExample
from ensemble_ctrl.certificate.certify import Certificate
from ensemble_ctrl.certificate.errors import Unenclosed
from ensemble_ctrl.certificate.general.enclosure import Enclosure, enclose
from ensemble_ctrl.certificate.general.start import Start
from ensemble_ctrl.constraints import Obstacle, Solid

from .cases import Case, Floats
from .kinds import Rng
from .oracle import Long, along

SURE = 1e-15
"""Error of the oracle allowed for, relative to the larger of 1 and the state; times `GROWTH` for what it grows by."""
GROWTH = 8.0
NEAR = 1e-9
"""Metres by which a claim may be wrong for the distance's own rounding."""
ASKED = 0.5
"""Share of the cases that get a task, too."""
LOOKS = 400
"""Times at which a counter-example is looked at."""


@dataclass(frozen=True)
class Judged:
    """What was found of one case.

    Attributes
    ----------
    verdict : str
        Of the certificate; ``undecided`` where there is no enclosure, ``no task`` where there was none.
    triples : int
        Members held against the enclosure.
    faults : tuple of str
        What is false.
    radius : float
        Largest radius, relative to the larger of 1 and the state.
    reason : str
        Why there is no enclosure.
    """

    verdict: str
    triples: int
    faults: tuple[str, ...]
    radius: float = 0.0
    reason: str = ""


def judge(case: Case, rng: Rng) -> Judged:
    """Hold all members against the enclosure, and the claims of a certificate against them."""
    try:
        found = enclose(case.system, _start(case), case.controls, case.duration)
    except Unenclosed as error:
        return Judged("undecided", 0, (), reason=str(error))
    psi, first = _member_values(case, case.members)
    step = np.longdouble(case.duration) / len(case.controls)
    states, wrong = along(case.system, first, psi, case.controls, step, case.shares.astype(np.longdouble))
    if not np.isfinite(states).all():
        return Judged("yes", len(case.members), ("a member runs away from its enclosure",))
    away = outside(found, case, first, states)
    faults = [f"a member is outside by {away:.2g} of its size"] if away > SURE * GROWTH + 100 * wrong else []
    verdict = "no task"
    if rng.random() < ASKED:
        asked = Asked.of(case, states, rng)
        certificate = ec.certify(asked.problem, case.controls)
        faults += list(_false(case, asked, certificate, states))
        verdict = certificate.proven
    scale = np.maximum(1.0, np.abs(found.c).sum(axis=(3, 4)).max(axis=(0, 2)))
    radius = float((found.radius.max(axis=(0, 2)) / scale).max())
    return Judged(verdict, len(case.members), tuple(faults), radius)


def _start(case: Case) -> Start:
    """The box for the enclosure."""
    shifts = [_shift(case, name) for name in case.names]
    return Start(case.names, case.lower, case.upper, case.origin, np.array(shifts, dtype=np.int64))


def _shift(case: Case, name: str) -> int:
    """The state that a parameter offsets, or -1."""
    return case.system.states.index(name.removeprefix("start_")) if name.startswith("start_") else -1


def _member_values(case: Case, members: Floats) -> tuple[dict[str, Long], Long]:
    """Parameters of the system by name, and starts of shape (states, members), of members."""
    psi = {name: np.full(len(members), value, dtype=np.longdouble) for name, value in case.system.parameters.items()}
    first = np.tile(case.origin.astype(np.longdouble)[:, None], (1, len(members)))
    for name, column in zip(case.names, members.astype(np.longdouble).T, strict=True):
        if (state := _shift(case, name)) >= 0:
            first[state] += column
        else:
            psi[name] = column
    return psi, first


def outside(found: Enclosure, case: Case, first: Long, states: Long) -> float:
    """By how much a member leaves all cells that hold it, relative to its size; negative if none does."""
    members = case.members.astype(np.longdouble)
    worst = -np.inf
    held = np.zeros(len(members), dtype=bool)
    for cell in range(len(found.centre)):
        middle, half = (part[cell].astype(np.longdouble) for part in (found.centre, found.half))
        inside = (np.abs(members - middle) <= half).all(axis=1)
        held |= inside
        if not inside.any():
            continue
        s = ((members[inside] - middle)[:, found.wide] / half[found.wide]).clip(-1, 1)
        terms = np.cos(np.arccos(s)[:, None, :] * found.basis.exponents).prod(axis=2)
        for piece, tau, x in _places(found, case, first, states):
            times = np.cos(np.arccos(tau) * np.arange(found.basis.times))
            near = np.einsum("stp,t->sp", found.c[piece, :, cell].astype(np.longdouble), times) @ terms.T
            gap = np.abs(x[:, inside] - near) - found.radius[piece, :, cell, None]
            worst = max(worst, float((gap / np.maximum(1, np.abs(near))).max()))
    assert held.all()
    return worst


def _places(found: Enclosure, case: Case, first: Long, states: Long) -> Iterator[tuple[int, Any, Long]]:
    """Pieces, scaled times and states; the ends of pieces belong to both."""
    yield 0, np.longdouble(-1), first
    for k, step in enumerate(states):
        for share, x in zip(case.shares.astype(np.longdouble), step, strict=True):
            part = min(int(share * found.parts), found.parts - 1)
            yield k * found.parts + part, 2 * (share * found.parts - part) - 1, x
        if k + 1 < len(states):
            yield (k + 1) * found.parts, np.longdouble(-1), step[-1]


@dataclass(frozen=True, eq=False)
class Asked:
    """A task near the members' ways: an obstacle beside them, and a limit of a state.

    Attributes
    ----------
    problem : Problem
    state : int
        The state that is at most `limit` from `begin` to `end`.
    """

    problem: ec.Problem
    state: int
    limit: float
    begin: float
    end: float

    @classmethod
    def of(cls, case: Case, states: Long, rng: Rng) -> Asked:
        """At random; without the obstacle if members start in it."""
        system = case.system
        distributions = {n: ec.Interval(a, b) for n, a, b in zip(case.names, case.lower, case.upper, strict=True)}
        fleet = ec.Fleet(system, distributions, start=dict(zip(system.states, case.origin.tolist(), strict=True)))
        state = int(rng.integers(len(system.states)))
        begin, end = np.sort(rng.uniform(0, case.duration, 2)).tolist()
        limit = float(states[:, :, state].max() + rng.choice([-0.01, 0.0, 1e-4, 0.02]))
        task = f"G[{begin!r}, {end!r}] {system.states[state]} <= {limit!r}"
        beside = {"it": (_beside(case, states, rng),)} if len(system.positions) > 1 else {}

        def problem(task: str, obstacles: Any) -> ec.Problem:
            return ec.Problem("case", fleet, case.duration, len(case.controls), ec.parse(task), {}, obstacles)

        try:
            return cls(problem(f"{task} and G avoid(it)" if beside else task, beside), state, limit, begin, end)
        except ec.ProblemError:
            return cls(problem(task, {}), state, limit, begin, end)

    def distance(self, case: Case, states: Long) -> Floats:
        """Distances from the obstacle of states of shape (states, ...), shape (...)."""
        columns = [case.system.states.index(name) for name in case.system.positions]
        places = np.moveaxis(states[columns].astype(float), 0, -1)
        return np.asarray(np.min([piece.distance(places) for piece in self.problem.obstacles["it"]], axis=0))


def _beside(case: Case, states: Long, rng: Rng) -> Obstacle | Solid:
    """A triangle or a solid near the way of a member."""
    columns = [case.system.states.index(name) for name in case.system.positions]
    places = states[:, :, columns].astype(float)
    middle = places[rng.integers(len(places)), rng.integers(places.shape[1]), :, rng.integers(places.shape[3])]
    away = rng.normal(size=len(columns))
    corners = middle + away / np.linalg.norm(away) * rng.uniform(0.05, 0.5)
    corners = corners + rng.uniform(-0.15, 0.15, (6, len(columns)))
    return Solid.hull(corners) if len(columns) == 3 else Obstacle.polygon(corners[:3])


def _false(case: Case, asked: Asked, certificate: Certificate, states: Long) -> Iterator[str]:
    """Claims that members refute, and counter-examples that violate nothing."""
    near = NEAR * (1 + float(np.abs(states).max()))
    times = (np.arange(len(states))[:, None] + case.shares) * (case.duration / len(case.controls))
    for bound in certificate.clearances:
        seen = float(asked.distance(case, np.moveaxis(states, 2, 0)).min())
        if bound.proven > seen + near:
            yield f"clearance {bound.proven:.6g} is claimed, a member has {seen:.6g}"
    during = (times >= asked.begin) & (times <= asked.end)
    for part in certificate.parts if during.any() else ():
        seen = asked.limit - float(states[during][:, asked.state].max())
        if part.proven > seen + near:
            yield f"robustness {part.proven:.6g} is claimed, a member has {seen:.6g}"
    if certificate.counter_example is not None:
        yield from _unreal(case, asked, certificate.counter_example, near)


def _unreal(case: Case, asked: Asked, example: CounterExample, near: float) -> Iterator[str]:
    """A counter-example that is no member, or does not violate by what it says."""
    member = np.array([[example.parameters[name] for name in case.names]]).reshape(1, -1)
    if not ((case.lower <= member) & (member <= case.upper)).all():
        yield "a counter-example is not in the ranges"
    looks = max(4, LOOKS // len(case.controls))
    psi, first = _member_values(case, member)
    step = np.longdouble(case.duration) / len(case.controls)
    shares = np.arange(1, looks + 1, dtype=np.longdouble) / looks
    path, _ = along(case.system, first, psi, case.controls, step, shares)
    path = np.concatenate([first[None], path.reshape(-1, *first.shape)])[:, :, 0].T
    times = np.linspace(0.0, case.duration, path.shape[1])
    apart = case.duration / path.shape[1] * 1.5
    if example.time is not None:
        value, during = asked.distance(case, path), np.abs(times - example.time) <= apart
    else:
        value = asked.limit - path[asked.state].astype(float)
        during = (times >= asked.begin - apart) & (times <= asked.end + apart)
    between = float(np.abs(np.diff(value)).max(initial=0.0))
    least = float(value[during].min(initial=np.inf))
    if least > -example.amount + 2 * between + near:
        yield f"a counter-example violates by {example.amount:.3g}, its member has {least:.3g}"
