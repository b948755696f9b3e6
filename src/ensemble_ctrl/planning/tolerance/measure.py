"""How much error of the model a plan tolerates: the largest bound of each kind with which it stays proven.

*Guarantee*: with every bound named, alone, the certificate says *yes*. That it does not with a larger one says nothing
of whether an error breaks the plan: what an attack needs to do that, where one is asked for, is above it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate import Certificate, certify
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.ensemble import Member
from ensemble_ctrl.problem.evaluation.adversary import attack
from ensemble_ctrl.problem.signals import rates_read
from ensemble_ctrl.problem.uncertainty import POSITION, Uncertainty

Floats = NDArray[np.float64]
Tell = Callable[[str], None]

CLOSE = 0.02
"""Share of a bound within which it is proven and a larger one is not."""
FIRST = 1e-3
"""The first bound that is tried: 1 mm/s, 1 mrad/s, 0.1 %, 1 ms."""
TRIES = 40
"""Certificates for one kind at most."""
MOST = 1e3
"""Bounds beyond which nothing is looked for."""


@dataclass(frozen=True)
class Tolerated:
    """What a plan tolerates of one kind of error.

    Attributes
    ----------
    kind : str
        In words.
    unit : str
        Of the bounds; empty for shares, which are from 0 to 1, and for multiples of a mix.
    bound : float
        The largest bound that was proven; zero if none was.
    beyond : float or None
        The smallest bound that was not; None where the plan stays proven as far as bounds make sense.
    ends : str
        What can't be proven beyond it: an obstacle, or a part of the task.
    time : float or None
        When, in seconds, where it is an obstacle.
    parameters : dict of str to float
        Of the member that is closest to failing.
    broken : float or None
        The bound with which a disturbance was found that breaks the plan; None if none was looked for, or found.
    """

    kind: str
    unit: str
    bound: float
    beyond: float | None
    ends: str
    time: float | None
    parameters: Member
    broken: float | None = None

    def amount(self, value: float) -> str:
        """A bound in the unit that reads best: mm/s, mrad/s, ms, a percentage, or as it is."""
        if self.unit in ("m/s", "rad/s", "s"):
            return f"{1000 * value:.3g} m{self.unit}"
        if self.unit:
            return f"{value:.3g} {self.unit}"
        return f"{value:.3g}" if "times" in self.kind else f"{100 * value:.3g} %"

    def __str__(self) -> str:
        return f"{self.kind:<44}{self.amount(self.bound):>12}  {self._end()}"

    def _end(self) -> str:
        """What ends it."""
        if self.beyond is None:
            return "and more than that makes no sense"
        when = "" if self.time is None else f" at t = {self.time:.2f} s"
        who = ", ".join(f"{name} {value:.4g}" for name, value in self.parameters.items())
        broken = "" if self.broken is None else f"; broken by an attack with {self.amount(self.broken)}"
        return f"then {self.ends}{when}{f' ({who})' if who else ''}{broken}"


@dataclass(frozen=True)
class Tolerance:
    """What a plan tolerates.

    Attributes
    ----------
    kinds : tuple of Tolerated
        Each kind alone.
    mix : Tolerated
        All errors that the fleet has, scaled together; for a fleet without any, all kinds at once, each at the same
        share of what is tolerated of it alone.
    """

    kinds: tuple[Tolerated, ...]
    mix: Tolerated

    def __str__(self) -> str:
        """A line for each kind, and the mix."""
        return "\n".join(["proven with errors of the model up to", *(f"  {one}" for one in (*self.kinds, self.mix))])


@dataclass(frozen=True)
class _Kind:
    """One kind of error, by its bound."""

    name: str
    unit: str
    most: float
    of: Callable[[float], Uncertainty]


def measure(problem: Problem, controls: Floats, *, attacked: bool = False, tell: Tell | None = None) -> Tolerance:
    """Measure what a plan tolerates.

    Parameters
    ----------
    problem : Problem
    controls : ndarray, shape (steps, n_u)
    attacked : bool
        Whether to look for a disturbance that breaks the plan, beyond what is tolerated.
    tell : callable, optional
        Called with the name of each kind before it is looked at.
    """
    kinds = _kinds(problem)
    found = []
    for kind in kinds:
        if tell is not None:
            tell(kind.name)
        found.append(_tolerated(problem, controls, kind, attacked))
    if tell is not None:
        tell("all together")
    return Tolerance(tuple(found), _tolerated(problem, controls, _mixed(problem, kinds, found), attacked))


def _kinds(problem: Problem) -> list[_Kind]:
    """What a fleet's robots may be off by."""
    fleet, system = problem.fleet, problem.fleet.system
    held = fleet.uncertainty.heading_hold
    found = [_Kind("drift of the position", "m/s", MOST, lambda b: Uncertainty({POSITION: b}))]
    if system.on_arcs:
        name = "error of the turn rate" + ("" if held is None else f", held within {held:g} s")
        found.append(_Kind(name, "rad/s", MOST, lambda b: Uncertainty({"heading": b}, heading_hold=held)))
    else:
        given = [name for name in fleet.uncertainty.disturbance if name != POSITION]
        found += [_state_kind(name, fleet.state_units.get(name, "")) for name in given]
    found += [_command_kind(name, held) for name in system.controls]
    found += [_varying_kind(name, held) for name in system.parameters if name in fleet.parameters]
    if system.on_arcs and not rates_read(problem):
        found.append(_Kind("delay", "s", problem.duration, lambda b: Uncertainty(delay=b)))
        most = problem.step / 2
        found.append(_Kind("jitter", "s", most, lambda b: Uncertainty(jitter=min(b, most), heading_hold=held)))
    return found


def _state_kind(name: str, unit: str) -> _Kind:
    """A disturbance of one state's rate."""
    return _Kind(f"disturbance of {name}", f"{unit}/s" if unit else "", MOST, lambda b: Uncertainty({name: b}))


def _command_kind(name: str, held: float | None) -> _Kind:
    """A share of one command."""
    return _Kind(f"error of {name}", "", 1.0, lambda b: Uncertainty(shares={name: b}, heading_hold=held))


def _varying_kind(name: str, held: float | None) -> _Kind:
    """A parameter that strays."""
    return _Kind(f"{name} that varies", "", 1.0, lambda b: Uncertainty(varies={name: b}, heading_hold=held))


def _mixed(problem: Problem, kinds: list[_Kind], found: list[Tolerated]) -> _Kind:
    """The fleet's own errors scaled, or every kind at the same share of what is tolerated of it alone."""
    own = problem.fleet.uncertainty
    if own:
        largest = max([1e-9, *own.shares.values(), *own.varies.values()])
        most = min(1 / largest, problem.step / 2 / max(own.jitter, 1e-9), problem.duration / max(own.delay, 1e-9))
        return _Kind("the errors of the problem, times", "", most, own.scaled)
    pairs = list(zip(kinds, found, strict=True))
    return _Kind(
        "all kinds, each at this share of its bound",
        "",
        1.0,
        lambda b: _together([kind.of(b * one.bound) for kind, one in pairs]),
    )


def _together(bounds: list[Uncertainty]) -> Uncertainty:
    """The bounds of several kinds at once."""
    names = ("disturbance", "shares", "varies")
    each = {name: {k: v for one in bounds for k, v in getattr(one, name).items()} for name in names}
    held = next((one.heading_hold for one in bounds if one.heading_hold is not None), None)
    delay, jitter = (max(getattr(one, name) for one in bounds) for name in ("delay", "jitter"))
    return Uncertainty(**each, delay=delay, jitter=jitter, heading_hold=held)


def _with(problem: Problem, bounds: Uncertainty) -> Problem:
    """The problem with other errors."""
    return problem.with_(fleet=problem.fleet.with_(uncertainty=bounds))


def _tolerated(problem: Problem, controls: Floats, kind: _Kind, attacked: bool) -> Tolerated:
    """The largest bound of a kind, by secants and bisection."""

    def proof(bound: float) -> Certificate:
        return certify(_with(problem, kind.of(bound)), controls)

    low, high, worst = 0.0, np.inf, proof(0.0)
    if worst.proven != "yes":
        return _result(kind, 0.0, 0.0, worst)
    spare, bound = _least(worst), min(FIRST, kind.most)
    for k in range(TRIES):
        found = proof(bound)
        if found.proven == "yes":
            low = bound
            if bound >= kind.most:
                return _result(kind, bound, None, found)
        else:
            high, worst = bound, found
        if np.isfinite(high) and high - low <= CLOSE * high:
            break
        bound = min(_next(low, high, bound, spare, spare - _least(found), k), kind.most)
    result = _result(kind, low, high, worst)
    return replace(result, broken=_broken(problem, controls, kind, low)) if attacked else result


def _next(low: float, high: float, bound: float, spare: float, lost: float, k: int) -> float:
    """The bound to try next: what is lost grows about in proportion to it; every third time the middle."""
    guess = bound * spare / lost if np.isfinite(lost) and lost > 0 else 8 * bound
    if np.isinf(high):
        return float(np.clip(guess * (1 + CLOSE / 3), 1.5 * bound, 8 * bound))
    if k % 3 == 2 or not low < guess < high:
        return float(np.sqrt(low * high)) if low > 0 else high / 8
    # a little to the side of the guess that the bracket lacks
    guess *= 1 + CLOSE / 3 * (1 if bound == low else -1)
    return guess if low < guess < high else (low + high) / 2


def _least(certificate: Certificate) -> float:
    """The smallest bound of a certificate."""
    return -np.inf if certificate.reason else min(certificate.clearance, certificate.robustness)


def _result(kind: _Kind, low: float, high: float | None, worst: Certificate) -> Tolerated:
    """A bound, with what ends it."""
    ends, time, who = worst.reason, None, {}
    least = np.inf
    for bound in worst.clearances:
        if bound.proven < least:
            least, ends, time, who = bound.proven, bound.obstacle, bound.time, bound.parameters
    for part in worst.parts:
        if part.proven < least:
            least, ends, time, who = part.proven, part.part, None, part.parameters
    return Tolerated(kind.name, kind.unit, low, high, ends, time, dict(who))


def _broken(problem: Problem, controls: Floats, kind: _Kind, bound: float) -> float | None:
    """About the smallest bound with which an attack succeeds: that of a few, in proportion to what they take."""
    model = attack(_with(problem, Uncertainty()), controls).clearance
    tried = max(bound, FIRST * CLOSE)
    for _ in range(4):
        if tried > kind.most:
            return None
        found = attack(_with(problem, kind.of(tried)), controls).clearance
        if found < 0:
            return tried
        taken = model - found
        tried = min(tried * max(1.03, 1.02 * model / taken), 4 * tried) if taken > 0 else 2 * tried
    return None
