"""Parts of a fleet: the members whose parameter is in some interval."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.moments import Distribution, Interval, Samples
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]


def places(fleet: Fleet, name: str, ticks: int) -> Floats:
    """Values of a parameter between which a fleet may be cut: those of measured robots, or evenly spaced ones.

    Returns
    -------
    ndarray, shape (places,)
        Increasing, with both ends of the range.
    """
    distribution = fleet.parameters[name]
    if distribution.measured is not None:
        return np.unique(distribution.measured)
    return np.linspace(
        distribution.lower, distribution.upper, ticks + 1 if distribution.upper > distribution.lower else 1
    )


def part(fleet: Fleet, name: str, lower: float, upper: float) -> Fleet:
    """The members of a fleet whose parameter is in a closed interval, which holds at least one.

    Measured robots keep their values, and those measured together stay together; any other distribution becomes the
    uniform one on the interval.
    """
    distribution = fleet.parameters[name]
    if fleet.samples is not None and name in fleet.samples:
        inside = (fleet.samples[name] >= lower) & (fleet.samples[name] <= upper)
        rows = {column: values[inside] for column, values in fleet.samples.items()}
        distributions: dict[str, Distribution] = {column: Samples(values) for column, values in rows.items()}
        return replace(fleet, parameters={**fleet.parameters, **distributions}, samples=rows)
    if distribution.measured is not None:
        own: Distribution = Samples(
            distribution.measured[(distribution.measured >= lower) & (distribution.measured <= upper)]
        )
    else:
        own = Interval(lower, upper)
    return replace(fleet, parameters={**fleet.parameters, name: own})


def robots(fleet: Fleet) -> int | None:
    """How many robots were measured; None for a fleet that is a range."""
    counts = [] if fleet.samples is None else [len(next(iter(fleet.samples.values())))]
    counts += [
        len(distribution.measured)
        for distribution in fleet.parameters.values()
        if distribution.measured is not None and not counts
    ]
    return counts[0] if counts else None
