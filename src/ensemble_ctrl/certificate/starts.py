"""The certificate of members that move off together from several places: one proof for each start, put together."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.apart import apart_bounds
from ensemble_ctrl.certificate.bound import Bound, CounterExample, Verdict
from ensemble_ctrl.certificate.errors import Unenclosed
from ensemble_ctrl.certificate.fingerprint import fingerprint
from ensemble_ctrl.problem.starts import by_start, label

if TYPE_CHECKING:
    from ensemble_ctrl.certificate.certify import Certificate
    from ensemble_ctrl.moments import Distribution
    from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]


def of_each_start(
    problem: Problem,
    controls: Floats,
    distributions: Mapping[str, Distribution],
    prove: Callable[[Problem], Certificate],
) -> Certificate:
    """The certificate of a fleet with several starts.

    Parameters
    ----------
    problem : Problem
        With `Fleet.starts`.
    controls : ndarray, shape (steps, n_u)
        Broadcast commands.
    distributions : mapping of str to Distribution
        The ranges that the claim is about.
    prove : callable
        The certificate of a problem with one start, for these controls and ranges.

    Notes
    -----
    *Guarantee*: ``yes`` only where every start's own proof says so; each of these is of the fleet that starts there,
    with the whole of the parameters' ranges.
    """
    problems = by_start(problem)
    found = {name: prove(one) for name, one in problems.items()}
    each = list(found.values())
    clearances = [replace(b, obstacle=label(b.obstacle, name)) for name, c in found.items() for b in c.clearances]
    reason = next((label(one.reason, name) for name, one in found.items() if one.reason), "")
    began = time.perf_counter()
    try:
        pairs = list(apart_bounds(problems, problem.specification.apart, controls, distributions))
    except Unenclosed as error:
        pairs, reason = [], reason or str(error)
    verdicts = {one.proven for one in each} | {_verdict(bound) for bound in pairs}
    if reason and "no" not in verdicts:
        verdicts.add("undecided")
    return replace(
        each[0],
        proven="no" if "no" in verdicts else "yes" if verdicts == {"yes"} else "undecided",
        clearances=(*clearances, *pairs),
        parts=tuple(replace(b, part=label(b.part, name)) for name, c in found.items() for b in c.parts),
        counter_example=max(_violations(found, pairs), key=lambda one: one.amount, default=None),
        boxes=sum(one.boxes for one in each),
        seconds=sum(one.seconds for one in each) + time.perf_counter() - began,
        inputs=fingerprint(problem, controls, distributions),
        reason=reason,
    )


def _verdict(bound: Bound) -> Verdict:
    """What is known of one pair of starts."""
    return "no" if bound.sampled < 0 else "yes" if bound.proven >= 0 else "undecided"


def _violations(found: Mapping[str, Certificate], pairs: Sequence[Bound]) -> Iterator[CounterExample]:
    """Members of a start that violate the task, and pairs that come too close."""
    for name, one in found.items():
        if one.counter_example is not None:
            yield replace(one.counter_example, what=label(one.counter_example.what, name))
    for bound in pairs:
        if bound.sampled < 0:
            yield CounterExample(bound.obstacle, bound.parameters, bound.time, -bound.sampled)
