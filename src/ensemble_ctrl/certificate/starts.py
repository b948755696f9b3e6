"""The certificate of members that move off together from several places: one proof for each start, put together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from ensemble_ctrl.problem.starts import by_start, label

if TYPE_CHECKING:
    from ensemble_ctrl.certificate.certify import Certificate
    from ensemble_ctrl.problem import Problem


def of_each_start(problem: Problem, prove: Callable[[Problem], Certificate], inputs: str) -> Certificate:
    """The certificate of a fleet with several starts.

    Parameters
    ----------
    problem : Problem
        With `Fleet.starts`.
    prove : callable
        The certificate of a problem with one start, for the controls and ranges that all have in common.
    inputs : str
        The fingerprint of the whole problem, ranges and controls.

    Notes
    -----
    *Guarantee*: ``yes`` only where every start's own proof says so; each of these is of the fleet that starts there,
    with the whole of the parameters' ranges.
    """
    found = {name: prove(one) for name, one in by_start(problem).items()}
    each = list(found.values())
    verdicts = {one.proven for one in each}
    seen = [
        replace(c.counter_example, what=label(c.counter_example.what, name))
        for name, c in found.items()
        if c.counter_example
    ]
    return replace(
        each[0],
        proven="no" if "no" in verdicts else "yes" if verdicts == {"yes"} else "undecided",
        clearances=tuple(
            replace(b, obstacle=label(b.obstacle, name)) for name, c in found.items() for b in c.clearances
        ),
        parts=tuple(replace(b, part=label(b.part, name)) for name, c in found.items() for b in c.parts),
        counter_example=max(seen, key=lambda one: one.amount, default=None),
        boxes=sum(one.boxes for one in each),
        seconds=sum(one.seconds for one in each),
        inputs=inputs,
        reason=next((label(one.reason, name) for name, one in found.items() if one.reason), ""),
    )
