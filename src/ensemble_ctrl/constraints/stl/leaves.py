"""The leaves of a formula: linear predicates, and names of regions and obstacles."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import ClassVar

from ensemble_ctrl.constraints.stl._text import number
from ensemble_ctrl.constraints.stl._tokens import RESERVED
from ensemble_ctrl.constraints.stl.formula import Formula
from ensemble_ctrl.core.errors import ProblemError

_STATE = re.compile(r"[^\W\d]\w*")
_PLACE = re.compile(r"[^\W\d][\w.-]*")


@dataclass(frozen=True, slots=True)
class Predicate(Formula):
    """``sum of coefficient * state + offset >= 0``; its robustness is divided by the coefficients' norm.

    Parameters
    ----------
    coefficients : tuple of (state name, float)
        Kept sorted by name, repeated names added up, zeros dropped.
    offset : float
    label : str
        Text for figures; not compared.
    column : int
        1-based place in the text it came from, 0 if none; not compared.
    """

    coefficients: tuple[tuple[str, float], ...]
    offset: float = 0.0
    label: str = field(default="", compare=False)
    column: int = field(default=0, compare=False, repr=False)

    def __post_init__(self) -> None:
        total: dict[str, float] = {}
        for name, value in self.coefficients:
            if not _STATE.fullmatch(name) or name in RESERVED:
                raise ProblemError(f"Predicate.coefficients: expected a state's name, got {name!r}")
            total[name] = total.get(name, 0.0) + float(value)
        kept = tuple((name, value) for name, value in sorted(total.items()) if value != 0)
        if not kept:
            raise ProblemError("Predicate.coefficients: expected at least one state, got a statement on numbers only")
        if not all(map(math.isfinite, [self.offset, *(value for _, value in kept)])):
            raise ProblemError(f"Predicate: expected finite numbers, got {kept} and {self.offset}")
        object.__setattr__(self, "coefficients", kept)
        object.__setattr__(self, "offset", float(self.offset))
        object.__setattr__(self, "depth", 1)

    def negated(self) -> Predicate:
        """The predicate whose robustness is minus this one's."""
        opposite = tuple((name, -value) for name, value in self.coefficients)
        return Predicate(opposite, -self.offset, f"not {self.label}" if self.label else "", self.column)

    def normalised(self) -> tuple[tuple[tuple[str, float], ...], float]:
        """Coefficients and offset divided by the norm of the coefficients."""
        # (c x + offset) / |c|: for positions the signed distance from the line
        norm = math.hypot(*(value for _, value in self.coefficients))
        return tuple((name, value / norm) for name, value in self.coefficients), self.offset / norm

    def __str__(self) -> str:
        terms = [_signed(value, name) for name, value in self.coefficients]
        return f"{' '.join(terms).removeprefix('+ ').replace('- ', '-', 1 if terms[0][0] == '-' else 0)} >= " + number(
            0.0 - self.offset
        )


@dataclass(frozen=True, slots=True)
class Known(Formula):
    """A robustness that is known already; only progression along a measured past makes it.

    Parameters
    ----------
    value : float
        In the unit of the predicates, metres for places; not NaN.
    """

    value: float

    def __post_init__(self) -> None:
        if math.isnan(self.value):
            raise ProblemError("Known: expected a number, got nan")
        object.__setattr__(self, "depth", 1)

    def __str__(self) -> str:
        return f"known({number(self.value)})"


@dataclass(frozen=True, slots=True)
class _Place(Formula):
    """A leaf about a named part of the map."""

    name: str
    column: int = field(default=0, compare=False, repr=False)
    word: ClassVar[str] = ""

    def __post_init__(self) -> None:
        if not _PLACE.fullmatch(self.name):
            raise ProblemError(f"{self.word}(...): expected a name of letters, digits, _ . -, got {self.name!r}")
        object.__setattr__(self, "depth", 1)

    def __str__(self) -> str:
        return f"{self.word}({self.name})"


@dataclass(frozen=True, slots=True)
class Inside(_Place):
    """Inside a region: robustness `Polyhedron.margin`, metres."""

    word: ClassVar[str] = "in"


@dataclass(frozen=True, slots=True)
class Avoid(_Place):
    """Outside an obstacle or region, or all ``obstacles``: `Obstacle.facet_clearance` minus radius."""

    word: ClassVar[str] = "avoid"


def _signed(value: float, name: str) -> str:
    """One term of a sum with its sign."""
    size = "" if abs(value) == 1 else f"{number(abs(value))}*"
    return f"{'-' if value < 0 else '+'} {size}{name}"
