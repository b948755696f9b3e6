"""The certificate of members that move off together from several places: one proof for each start, put together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

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
        inputs=fingerprint(problem, controls, distributions),
        reason=next((label(one.reason, name) for name, one in found.items() if one.reason), ""),
    )
