"""What a task may say of headings, speeds and turn rates, and angles that exclude each other."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING

from ensemble_ctrl.constraints.stl import (
    Always,
    Eventually,
    Formula,
    Mean,
    Predicate,
    Within,
    conjuncts,
    leaves,
    negation_normal_form,
)
from ensemble_ctrl.constraints.stl.formula import Not
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.problem.checks.finding import SLACK, Finding
from ensemble_ctrl.problem.checks.task import are_known
from ensemble_ctrl.problem.signals import angle_range, names_in

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem

RATES = "v, omega and commands"


def signal_findings(problem: Problem) -> Iterator[Finding]:
    """Angles that are none, signals where they are not read, and windows of angles that exclude each other."""
    known = (*problem.fleet.states, *problem.fleet.system.signals)
    named = {name for leaf in leaves(problem.task) for name in names_in(leaf)}
    if not (named <= {*known} and are_known(problem)):
        return  # an unknown name is a finding of its own, of a place as well
    wrong = [*_angles(problem), *_together(problem), *_elsewhere(problem), *_untimely(problem)]
    yield from wrong or _excluded(problem)


def _at(leaf: Formula, message: str, hint: str = "") -> Finding:
    """A finding at a leaf of the task."""
    column = getattr(leaf, "column", 0)
    return Finding(("task",), message, hint, offset=column - 1 if column else None)


def _angles(problem: Problem) -> Iterator[Finding]:
    """``within`` is of an angle, of which is known how often it can turn where that matters."""
    units = problem.fleet.state_units | dict(problem.fleet.system.signals)
    for leaf in leaves(problem.task):
        if not isinstance(leaf, Within):
            continue
        unit = units.get(leaf.state, "rad")
        if unit != "rad":
            hint = f"write  abs({leaf.state} - a) <= b"
            yield _at(leaf, f"expected the name of an angle before 'within', got {leaf.state}, in {unit}", hint)
            continue
        try:
            leaf.turns(*angle_range(problem, leaf.state))
        except (ProblemError, ValueError, OverflowError) as error:
            yield _at(leaf, f"{error}", "narrow fleet.input_bounds, or write bounds of the angle: heading <= 10 deg")
    if problem.fleet.system.on_arcs:
        return
    for inner in _negated(negation_normal_form(problem.task)):
        message = f"expected no negation of {inner}: how often {inner.state} turns is not known"
        yield _at(inner, message, "say which angles are wanted")


def _negated(formula: Formula) -> Iterator[Within]:
    """Angles that a formula in negation normal form wants elsewhere."""
    if isinstance(formula, Not) and isinstance(formula.child, Within):
        yield formula.child
    for part in formula.parts:
        yield from _negated(part)


def _together(problem: Problem) -> Iterator[Finding]:
    """One inequality of robots on arcs is about positions, or about headings and rates."""
    signals = problem.fleet.system.signals
    for leaf in leaves(problem.task):
        names = names_in(leaf)
        places, others = ([n for n in names if (n in signals) == kind] for kind in (False, True))
        if places and others:
            message = f"expected an inequality of {' and '.join(places)} or of {' and '.join(others)}, got both: {leaf}"
            yield _at(leaf, message, "write one inequality for each")


def _elsewhere(problem: Problem) -> Iterator[Finding]:
    """Readings and programs that know positions alone."""
    names = problem.fleet.system.signals.keys()
    first = next((leaf for leaf in leaves(problem.task) if set(names_in(leaf)) & names), None)
    if first is None:
        return
    what = f"{first} is about {', '.join(n for n in names_in(first))}, which"
    if problem.solve.guarantee == "moment":
        yield Finding(("solve", "guarantee"), f"{what} the moment form does not have", "use hull")
    if problem.coordinates == "modal":
        yield Finding(("moments", "coordinates"), f"{what} the program in moments does not have", "use nodal")
    for mean in _means(problem.task):
        for leaf in leaves(mean):
            if set(names_in(leaf)) & names:
                message = f"mean(f) is about the mean position, and {leaf} is about {', '.join(names_in(leaf))}"
                yield _at(leaf, message, "ask it of every member")


def _means(formula: Formula) -> Iterator[Formula]:
    """Everything that is read for the mean member."""
    if isinstance(formula, Mean):
        yield formula.child
        return
    for part in formula.parts:
        yield from _means(part)


def _untimely(problem: Problem) -> Iterator[Finding]:
    """Rates of robots that are early or late, of which nothing is proven."""
    bounds, signals = problem.fleet.uncertainty, problem.fleet.system.signals
    for leaf in leaves(problem.task):
        rates = [name for name in names_in(leaf) if name in signals and name != "heading"]
        if rates and (bounds.delay or bounds.jitter):
            message = f"{leaf}: {', '.join(rates)} can't be promised of robots whose commands may be late or early"
            yield _at(leaf, message, "without delay and jitter in fleet.uncertainty, or use input_bounds")
        elif "omega" in rates and bounds.heading_hold is not None:
            message = f"{leaf}: omega can't be promised of robots with a loop of their own on the heading"
            yield _at(leaf, message, "without heading_hold in fleet.uncertainty")


@dataclass(frozen=True)
class _Wanted:
    """What a part of the task wants of one number, throughout a window or at some time of it."""

    leaf: Formula
    begin: float
    end: float
    throughout: bool


def _wanted(problem: Problem) -> Iterator[_Wanted]:
    """The leaves about one state or signal that every plan has to do; none where windows make no sense."""
    try:
        parts = problem.specification.parts
    except ProblemError:
        return
    for part in parts:
        formula = part.resolved
        if not isinstance(formula, Always | Eventually):
            continue
        for leaf in conjuncts(formula.child):
            if isinstance(leaf, Within | Predicate) and len(names_in(leaf)) == 1:
                yield _Wanted(leaf, part.begin, part.end, isinstance(formula, Always))


def _excluded(problem: Problem) -> Iterator[Finding]:
    """Two leaves that are wanted at the same time, and that no value satisfies both of."""
    for one, other in combinations(_wanted(problem), 2):
        if names_in(one.leaf) != names_in(other.leaf) or not _at_once(one, other):
            continue
        if _exclude(one.leaf, other.leaf):
            begin, end = max(one.begin, other.begin), min(one.end, other.end)
            when = f"from {begin:g} to {end:g} s" if end > begin else f"at {begin:g} s"
            message = f"expected what {one.leaf} leaves possible, got {other.leaf}: nothing does both {when}"
            yield _at(other.leaf, message, "change one of the two, or their windows")


def _at_once(one: _Wanted, other: _Wanted) -> bool:
    """Whether there is a time at which both are wanted for certain."""
    if one.throughout and other.throughout:
        return max(one.begin, other.begin) <= min(one.end, other.end) + SLACK
    if one.throughout != other.throughout:
        long, some = (one, other) if one.throughout else (other, one)
        return long.begin <= some.begin + SLACK and some.end <= long.end + SLACK
    return False


def _exclude(one: Formula, other: Formula) -> bool:
    """Whether no value of the state that both are about satisfies both."""
    if isinstance(one, Within) and isinstance(other, Within):
        return one.apart(other)
    if isinstance(one, Predicate) and isinstance(other, Predicate):
        (low, high), (low2, high2) = _range(one), _range(other)
        return max(low, low2) > min(high, high2) + SLACK
    return False


def _range(leaf: Predicate) -> tuple[float, float]:
    """The values of its state that satisfy a predicate."""
    ((_, value),) = leaf.coefficients
    bound = -leaf.offset / value
    return (bound, math.inf) if value > 0 else (-math.inf, bound)
