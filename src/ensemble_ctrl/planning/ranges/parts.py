"""Parts of a fleet: the members whose parameter is in some interval."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.moments import Distribution, Interval, Samples
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]

NARROWEST = 0.05
"""Smallest value of a parameter of the system considered, as a share of the nominal one."""
FURTHEST = 3.0
"""Largest offset of a start considered, metres or radians."""


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


def widened(fleet: Fleet, halves: Mapping[str, float]) -> Fleet:
    """The same fleet with uniform distributions of some parameters, of these half widths around their middles."""
    middles = {name: fleet.parameters[name].center for name in halves}
    own = {name: Interval(middles[name] - half, middles[name] + half) for name, half in halves.items()}
    return fleet.with_distributions({**fleet.parameters, **own})


def furthest(fleet: Fleet, name: str) -> float:
    """The largest half width of a parameter that is considered, in its own unit."""
    return fleet.parameters[name].center * (1 - NARROWEST) if name in fleet.system.parameters else FURTHEST
