"""A certificate in plain words: what holds, for whom, when, and what does not follow from it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import floor, isfinite, log10

from ensemble_ctrl.certificate import Certificate
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.conflicts import units_of_parts
from ensemble_ctrl.problem.specification import NOTHING_REQUIRED
from ensemble_ctrl.report.text import member_text, percent, range_text

LIMITS = (
    "It is about robots that follow the model exactly. Not covered: sensor noise, model error, rounding in the robot, "
    "and robots that meet each other. It does not say that the plan is the best one."
)
LIMITS_OF_BOUNDS = (
    "It is about robots whose errors stay within the bounds that the problem gives, whatever they do within them. Not "
    "covered: errors beyond these bounds, rounding in the robot, and robots that meet each other. It does not say that "
    "the plan is the best one."
)

UNENCLOSED = (
    "What this page says is about the robots that were replayed, at the times that were looked at, and not about the "
    "others."
)
"""What is left where a system could not be enclosed."""


@dataclass(frozen=True)
class Words:
    """What is claimed, the numbers one by one, and what to keep in mind."""

    lead: str
    bounds: tuple[str, ...]
    note: str


def certificate_words(problem: Problem, certificate: Certificate | None) -> Words:
    """What a certificate proves, in words."""
    if certificate is None:
        lead = "No certificate was asked for: nothing is claimed beyond the robots that were replayed."
        hint = "Set verify.certificate: true in the problem file, or run ensemble-plan verify on the results."
        return Words(lead, (), hint)
    if certificate.empty:
        return Words(f"{NOTHING_REQUIRED[0].upper()}{NOTHING_REQUIRED[1:]}.", (), LIMITS)
    limits = LIMITS_OF_BOUNDS if certificate.uncertainty else LIMITS
    units = units_of_parts(problem)
    bounds = tuple(_bounds(certificate, units))
    ranges, when = _ranges(certificate), f"at every instant of the {problem.duration:g} s"
    when += ", under every disturbance within the bounds" if certificate.uncertainty else ""
    who = f"every robot{ranges}, {when}"
    if certificate.proven == "yes":
        return Words(f"Proven: {_claim(certificate, who, f'{ranges}, {when}')}.", bounds, limits)
    if certificate.counter_example is not None:
        c = certificate.counter_example
        amount = length(c.amount, units.get(c.what, "m"))
        moment = "" if c.time is None else f" at t = {c.time:.2f} s"
        if certificate.ranges and not c.parameters:
            lead = f"Refuted: the fleet breaks {c.what} by {amount}."
            return Words(lead, bounds, "It is about the fleet as a whole, not about one robot.")
        lead = f"Refuted: the robot with {member_text(c.parameters)} breaks {c.what} by {amount}{moment}."
        return Words(lead, bounds, "Replay that robot to see it: plan.replay(parameters=[...]).")
    if certificate.reason:
        return Words(f"Undecided: {certificate.reason}.", bounds, UNENCLOSED)
    lead = f"Undecided: no robot was found that breaks the task, but it could not be proven for {who}."
    return Words(lead, bounds, "A narrower range of the parameters, or more margin (solve.margin), is easier to prove.")


def _claim(certificate: Certificate, who: str, scope: str) -> str:
    """What is proven: of everybody, of a share of the fleet, or of both."""
    shares = [f"at least {percent(part.share, decimals=2)} %" for part in certificate.parts if part.share is not None]
    if not shares:
        return f"{who}, does the whole task"
    some = " and ".join(shares)
    if len(certificate.parts) > len(shares) or certificate.clearances:
        return f"{who}, does the rest of the task, and {some} of them do what is asked of a share"
    return f"{some} of the robots{scope}, do what is asked of a share"


def length(value: float, of: str = "m") -> str:
    """A number with three digits, rounded down; metres in the unit that reads best, others in theirs.

    Examples
    --------
    >>> length(0.0104999), length(1.2399), length(-0.0021), length(0.0425, "m/s")
    ('1.04 cm', '1.23 m', '-2.1 mm', '0.0425 m/s')
    """
    if not isfinite(value) or value == 0:
        return f"{value:g} {of}"
    metres = [(1.0, "m"), (100.0, "cm"), (1000.0, "mm")]
    factor, unit = metres[int(abs(value) < 1) + int(abs(value) < 0.01)] if of == "m" else (1.0, of)
    scale = 10.0 ** (2 - floor(log10(abs(factor * value))))
    return f"{floor(factor * value * scale + 1e-9) / scale:.6g} {unit}"


def _ranges(certificate: Certificate) -> str:
    """For whom."""
    texts = [f"{name} from {range_text(name, low, high, 'to')}" for name, (low, high) in certificate.ranges.items()]
    return " with " + ", ".join(texts) if texts else ""


def _bounds(certificate: Certificate, units: Mapping[str, str]) -> Iterator[str]:
    """The bounds, a sentence each."""
    for b in certificate.clearances:
        if b.sampled == float("inf"):
            continue  # outside the horizon: nothing was asked
        closest = f"closest seen: {length(b.sampled)}, {member_text(b.parameters)}, t = {b.time:.2f} s"
        if b.proven >= 0:
            yield f"{b.obstacle}: clearance at least {length(b.proven)} ({closest})."
        else:
            yield f"{b.obstacle}: not shown to be avoided; proven is clearance at least {length(b.proven)} ({closest})."
    for part in certificate.parts:
        proven = length(part.proven, units.get(part.part, "m"))
        if not part.covered:
            yield f"{part.part}: outside what the proof can bound."
        elif part.share is not None and part.proven >= 0:
            share = f"{percent(part.share, decimals=2)} %"
            yield f"{part.part}: done by {share} of the fleet with at least {proven} to spare."
        elif part.proven >= 0:
            yield f"{part.part}: done with at least {proven} to spare."
        else:
            yield f"{part.part}: not shown to be done; proven is {proven}."
