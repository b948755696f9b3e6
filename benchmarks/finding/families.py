"""All families, with the number of problems in each that the benchmark runs; any seed draws another problem."""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from . import driving, gates, impossible, swings, tours
from .case import Case

FAMILIES: dict[str, tuple[int, Callable[[int, Generator], Case]]] = {
    "parking": (10, driving.parking),
    "doors": (10, driving.doors),
    "mazes": (30, driving.mazes),
    "poles": (5, driving.poles),
    "stlpy": (21, tours.stlpy),
    "stlplanning": (6, tours.stlplanning),
    "visits": (6, tours.visits),
    "moving": (6, driving.moving),
    "plants": (8, swings.plants),
    "gates": (4, gates.gates),
    "impossible": (6, impossible.impossible),
}
"""By name: how many, and what draws one from a seed."""


def drawn(family: str, seed: int) -> Case:
    """One problem: the same for the same seed.

    Examples
    --------
    >>> drawn("mazes", 3).name
    'mazes-03'
    """
    return FAMILIES[family][1](seed, np.random.default_rng([zlib.crc32(family.encode()), seed]))
