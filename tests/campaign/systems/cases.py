"""Cases: a system, ranges, commands, members and what a task could ask of them, all from two numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl import OdeSystem

from .kinds import KINDS, SHARES, Rng

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Case:
    """One system with ranges, commands and members.

    Attributes
    ----------
    family : str
    system : OdeSystem
    names : tuple of str
        Parameters, and ``start_`` with a state for an offset of its start.
    lower, upper : ndarray, shape (parameters,)
    origin : ndarray, shape (states,)
        The start without offsets.
    controls : ndarray, shape (steps, n_u)
    duration : float
    members : ndarray, shape (members, parameters)
    shares : ndarray, shape (shares,)
        Parts of each step at which members are looked at, rising to 1.
    """

    family: str
    system: OdeSystem
    names: tuple[str, ...]
    lower: Floats
    upper: Floats
    origin: Floats
    controls: Floats
    duration: float
    members: Floats
    shares: Floats


def make(seed: int, index: int, members: int) -> Case:
    """The case of a number."""
    rng = np.random.default_rng([seed, index])
    weights = np.array([SHARES.get(name, 2) for name in KINDS], dtype=float)
    family = str(rng.choice(list(KINDS), p=weights / weights.sum()))
    return of_family(family, rng, members)


def of_family(family: str, rng: Rng, members: int) -> Case:
    """A case of a family."""
    kind = KINDS[family](rng)
    names, lower, upper = _ranges(rng, kind.system, kind.ranges)
    steps = int(rng.choice([1, 2, 5, 10, 20]))
    duration = float(kind.duration * rng.uniform(0.1, 1.0) * min(1.0, steps / 4))
    size = kind.size * rng.choice([0.0, 0.3, 1.0])
    controls = np.array(kind.rest) + size * rng.uniform(-1, 1, (steps, len(kind.rest)))
    inner = np.sort(rng.uniform(0, 1, 2)) if steps < 10 else rng.uniform(0, 1, 1)
    shares = np.concatenate([inner, [1.0]])
    some = _members(rng, lower, upper, members)
    return Case(family, kind.system, names, lower, upper, np.array(kind.start), controls, duration, some, shares)


def _ranges(
    rng: Rng, system: OdeSystem, allowed: dict[str, tuple[float, float]]
) -> tuple[tuple[str, ...], Floats, Floats]:
    """Parts of the ranges of some parameters, and of offsets of some starts; some have no width, all may be missing."""
    bounds = dict(allowed)
    for name in rng.permutation(system.states).tolist()[: int(rng.choice([0, 0, 1, 2, 3]))]:
        bounds[f"start_{name}"] = (-0.05, 0.05)
    names = [name for name in bounds if rng.random() < 0.8][:5]
    rng.shuffle(names)
    lower, upper = np.empty(len(names)), np.empty(len(names))
    for k, name in enumerate(names):
        low, high = bounds[name]
        width = (high - low) * float(rng.choice([0.0, 1e-6, 0.03, 0.2, 0.5], p=[0.1, 0.1, 0.2, 0.4, 0.2]))
        lower[k] = rng.uniform(low, high - width)
        upper[k] = lower[k] + width
    return tuple(names), lower, upper


def _members(rng: Rng, lower: Floats, upper: Floats, count: int) -> Floats:
    """Corners, the middle, members with some parameters at an end, and any."""
    share = rng.uniform(0, 1, (count, len(lower)))
    share[: count // 2] = rng.choice([0.0, 0.25, 0.5, 1.0], (count // 2, len(lower)), p=[0.35, 0.15, 0.15, 0.35])
    return np.clip(lower + share * (upper - lower), lower, upper)
