"""How much is tried: all of it in ``make slow``, a part that is quick in ``make test``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest
from _pytest.mark.structures import ParameterSet
from hypothesis import settings

ALL, FEW = 100, 20
"""Examples of a property that asks for no number, by profile; others are scaled alike."""
LEAST = 10
"""Examples of a property in every profile, if it asks for as many."""


def register() -> None:
    """Give Hypothesis the two profiles, and load the quick one."""
    # No property fails for its time: times belong to the benchmarks.
    settings.register_profile("all", deadline=None, max_examples=ALL)
    settings.register_profile("few", deadline=None, max_examples=FEW)
    settings.load_profile("few")


def examples(number: int, **others: Any) -> settings:
    """Settings of a property that deserves `number` examples; others go to Hypothesis as they are."""
    scaled = number * settings().max_examples // ALL
    return settings(max_examples=max(scaled, min(number, LEAST)), **others)


def quick(values: Iterable[Any], *chosen: Any) -> list[ParameterSet]:
    """Parameters of a test of which ``make test`` runs the chosen ones only; the others are marked `slow`."""
    return [pytest.param(value, marks=() if value in chosen else pytest.mark.slow) for value in values]
