"""A certificate judged by the oracle: every claim that is false, and whether brute force decides what was left open."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ensemble_ctrl.certificate import Certificate
from ensemble_ctrl.core.errors import ProblemError

from . import distributions, subject
from .model import Case, Floats, Long, Node, ends_of
from .oracle import Duty, Oracle, duties_of, needed, needed_parts, reads_fleet, reads_only_fleet

SPARE = 1e-3
"""Metres with which brute force decides a case that a certificate should decide too."""
DOUBLE = 2.0**-52


@dataclass(frozen=True)
class Fault:
    """A false claim.

    Attributes
    ----------
    kind : str
        ``false yes``, ``bound``, ``false no``, ``counter-example``, ``refusal`` or ``crash``.
    what : str
        The obstacle or the part, and what was said of it.
    excess : float
        Metres by which the claim is wrong.
    """

    kind: str
    what: str
    excess: float


@dataclass(frozen=True)
class Judgement:
    """What was said of a case, and what is true."""

    verdict: str
    truth: float
    missed: float
    faults: tuple[Fault, ...]

    @property
    def decided(self) -> str:
        """What brute force says with a millimetre to spare; nothing if it is closer."""
        return "no" if self.truth <= -SPARE else "yes" if self.truth - self.missed >= SPARE else ""


def judge(case: Case) -> Judgement:
    """The certificate of a case against the oracle."""
    oracle = Oracle(case)
    try:
        certificate = subject.certified(case)
    except ProblemError as error:
        truth, missed = _true_value(oracle)
        wrong = truth - missed >= SPARE
        faults = (Fault("refusal", str(error), truth),) if wrong and not _is_legal(str(error)) else ()
        return Judgement("refused", truth, missed, faults)
    except Exception as error:
        return Judgement("crash", math.nan, 0.0, (Fault("crash", repr(error), math.inf),))
    return _judged(case, oracle, certificate)


def _is_legal(message: str) -> bool:
    """Whether a problem is refused for a reason that has nothing to do with its task."""
    return "inside obstacle" in message


def _true_value(oracle: Oracle) -> tuple[float, float]:
    """The smallest value of all parts, and by how much it may be below the truth."""
    values, missed = [], 0.0
    for part in oracle.case.conjuncts:
        duties = duties_of(oracle.case, part)
        values += [oracle.clearance(duty) for duty in duties]
        if not duties:
            values.append(_share_value(oracle, part) if part[0] == "share" else oracle.worst(part))
            missed = max(missed, oracle.missed(part))
    return min(values), missed


def _share_value(oracle: Oracle, part: Node) -> float:
    """The value that about this share of the fleet reaches."""
    rows, weights = distributions.drawn(oracle.case, 33)
    values = oracle.member_values(part[2], rows)
    order = np.argsort(-values)
    return float(values[order][(np.cumsum(weights[order]) >= part[1] - 1e-12).argmax()])


def _judged(case: Case, oracle: Oracle, certificate: Certificate) -> Judgement:
    """Each bound against what was found."""
    parts = needed_parts(case.conjuncts)
    duties = needed([duty for part in parts for duty in duties_of(case, part)])
    others = [part for part in parts if not duties_of(case, part)]
    faults: list[Fault] = []
    truths: list[float] = []
    missed = 0.0
    if len(duties) != len(certificate.clearances) or len(others) != len(certificate.parts):
        what = f"{len(certificate.clearances)} clearances and {len(certificate.parts)} parts"
        faults.append(Fault("crash", f"{what} for {len(duties)} and {len(others)}", math.inf))
        return Judgement("crash", math.nan, 0.0, tuple(faults))
    for duty, bound in zip(duties, certificate.clearances, strict=True):
        near = _member(case, bound.parameters)
        truth = oracle.clearance(duty, near)
        truths.append(truth)
        faults += _too_high(bound.obstacle, bound.proven, truth + float(oracle.slack))
        if near is not None and math.isfinite(bound.sampled):
            faults += _witness(oracle, duty, bound.sampled, near, bound.time)
    for part, task in zip(others, certificate.parts, strict=True):
        near = _member(case, task.parameters)
        if part[0] == "share" and not reads_fleet(part[2]):
            truths.append(_share_value(oracle, part))
            faults += _share_faults(oracle, part, task.proven, task.share)
            faults += _refuted_share(oracle, part, task.sampled)
            continue
        truth = oracle.worst(part, near)
        truths.append(truth)
        missed = max(missed, oracle.missed(part))
        faults += _too_high(task.part, task.proven, truth + oracle.missed(part) + float(oracle.slack))
        if math.isfinite(task.sampled) and (near is not None or reads_only_fleet(part)):
            seen = truth if near is None else float(oracle.robustness(part, near)[0])
            faults += _too_low(oracle, task.part, task.sampled, seen - float(oracle.knots[1] + oracle.slack))
    truth = min(truths)
    faults += _summary(case, certificate)
    if certificate.proven == "yes" and truth + missed + float(oracle.slack) < 0:
        faults.append(Fault("false yes", "the task", -truth))
    if certificate.proven == "no" and certificate.counter_example is None:
        faults.append(Fault("counter-example", "none with a no", math.inf))
    return Judgement(certificate.proven, truth, missed, tuple(faults))


def _summary(case: Case, certificate: Certificate) -> Iterator[Fault]:
    """What is told of all bounds together: no more than each of them says, of the ranges that were asked for."""
    for what, told, bounds in (
        ("clearance", certificate.clearance, certificate.clearances),
        ("robustness", certificate.robustness, certificate.parts),
    ):
        for bound in bounds:
            yield from _too_high(what, told, bound.proven)
    least = [bound.proven for bound in certificate.clearances] + [part.proven for part in certificate.parts]
    if certificate.proven == "yes" and not all(proven >= 0 for proven in least):
        yield Fault("false yes", f"with bounds {least!r}", math.inf)
    seen = [bound.sampled for bound in certificate.clearances] + [part.sampled for part in certificate.parts]
    if certificate.proven == "no" and not any(sampled < 0 for sampled in seen):
        yield Fault("false no", f"with {seen!r} seen", math.inf)
    if certificate.ranges != {name: ends_of(distribution) for name, distribution in case.distributions.items()}:
        yield Fault("bound", f"ranges {certificate.ranges!r}", math.inf)


def _member(case: Case, parameters: dict[str, float]) -> Floats | None:
    """A member as a row; None where there is none."""
    if not parameters and case.distributions:
        return None
    return np.array([[parameters[name] for name in case.distributions]]).reshape(1, len(case.distributions))


def _too_high(what: str, proven: float, truth: float) -> Iterator[Fault]:
    """A bound above the truth; NaN is above everything."""
    if not proven <= truth:
        yield Fault("bound", f"{what}: proven {proven!r}, found {truth!r}", proven - truth)


def _too_low(oracle: Oracle, what: str, said: float, lowest: float) -> Iterator[Fault]:
    """A violation that is none, or more of one than there is."""
    if said < 0 < lowest:
        yield Fault("false no", f"{what}: said {said!r}, true {lowest!r}", lowest)
    elif said + _rounding(oracle) < lowest:
        yield Fault("counter-example", f"{what}: said {said!r}, true {lowest!r}", lowest - said)


def _witness(oracle: Oracle, duty: Duty, said: float, near: Floats, time: float) -> Iterator[Fault]:
    """A distance seen that isn't there, by a member or at a time that the claim isn't about."""
    low, high = oracle.ends.T
    outside = max(float((low - near).max(initial=0.0)), float((near - high).max(initial=0.0)))
    if outside > 0 and said < 0:
        yield Fault("counter-example", f"{duty.name}: a member {outside!r} outside the ranges", outside)
    early, late = Long(duty.begin), min(Long(duty.end), oracle.motion.grid[-1])
    width = Long(8 * DOUBLE) * oracle.motion.grid[-1]
    if not early - width <= Long(time) <= late + width:
        if said < 0:
            yield Fault("false no", f"{duty.name}: seen at {time!r} s, outside {duty.begin!r}..{duty.end!r}", -said)
        return
    times = np.clip(Long(time) + width * np.array([-1, 0, 1], dtype=Long), early, late)
    yield from _too_low(oracle, duty.name, said, float(oracle.distances(duty, near, times).min() - oracle.slack))


def _rounding(oracle: Oracle) -> float:
    """What double precision may leave a distance by that is only seen, not proven."""
    return 1e5 * float(oracle.slack) + 64 * DOUBLE * oracle.extent


def _share_faults(oracle: Oracle, part: Node, proven: float, share: float | None) -> Iterator[Fault]:
    """A share of the fleet that is less than claimed."""
    if not math.isfinite(proven):
        if proven > 0:
            yield Fault("bound", f"share: proven {proven!r}", math.inf)
        return
    exact = distributions.is_exact(oracle.case)
    for count in (32, 512):
        rows, weights = distributions.drawn(oracle.case, count)
        values = oracle.member_values(part[2], rows)
        slack = float(oracle.slack + oracle.knots[1])
        found = float(weights[values + slack >= proven].sum())
        wanted = max(part[1], share or 0.0)
        if found >= wanted - (1e-9 if exact else _scatter(oracle, count)):
            return
        if exact:
            break
    yield Fault("bound", f"share: {wanted!r} of the fleet at {proven!r}, found {found!r}", wanted - found)


def _refuted_share(oracle: Oracle, part: Node, sampled: float) -> Iterator[Fault]:
    """A share that is refuted and yet reached."""
    if sampled >= 0:
        return
    rows, weights = distributions.drawn(oracle.case, 512)
    values = oracle.member_values(part[2], rows)
    found = float(weights[values > float(oracle.knots[1] + oracle.slack)].sum())
    if found >= part[1] + (-1e-9 if distributions.is_exact(oracle.case) else _scatter(oracle, 512)):
        yield Fault("false no", f"share: said {sampled!r}, {found!r} of the fleet do it", found - part[1])


def _scatter(oracle: Oracle, count: int) -> float:
    """By how much a share of so many drawn members may miss that of the fleet."""
    return 3.0 / math.sqrt(count) / (1 if len(oracle.case.distributions) > 1 else 3)
