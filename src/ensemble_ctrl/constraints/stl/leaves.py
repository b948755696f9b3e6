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
    slack : float
        What an upper bound adds: by how much, in metres, the side of a polygon may be violated where the round shape
        that it stands for, on the safe side, is not.
    """

    coefficients: tuple[tuple[str, float], ...]
    offset: float = 0.0
    label: str = field(default="", compare=False)
    column: int = field(default=0, compare=False, repr=False)
    slack: float = field(default=0.0, repr=False)

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
        return Predicate(opposite, -self.offset, f"not {self.label}" if self.label else "", self.column, self.slack)

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


MOST_TURNS = 100
"""Whole turns either way that an angle may make where a task reads it by `Within`."""


@dataclass(frozen=True, slots=True)
class Within(Formula):
    """An angle within `half` of `centre`, whole turns aside; robustness is `half` less the distance, radians.

    Parameters
    ----------
    state : str
        Name of the angle, such as ``heading``.
    half : float
        Radians, above 0 and below pi.
    centre : float
        Radians, from -2 pi to 2 pi.
    column : int
        1-based place in the text it came from, 0 if none; not compared.
    """

    state: str
    half: float
    centre: float
    column: int = field(default=0, compare=False, repr=False)

    def __post_init__(self) -> None:
        if not _STATE.fullmatch(self.state) or self.state in RESERVED:
            raise ProblemError(f"Within.state: expected a state's name, got {self.state!r}")
        if not 0 < self.half < math.pi:
            raise ProblemError(f"Within.half: expected an angle above 0 and below 180 deg, got {_degrees(self.half)}")
        if not abs(self.centre) <= 2 * math.pi:
            wanted = "an angle from -360 deg to 360 deg"
            raise ProblemError(f"Within.centre: expected {wanted}, got {_degrees(self.centre)}")
        object.__setattr__(self, "half", float(self.half))
        object.__setattr__(self, "centre", float(self.centre))
        object.__setattr__(self, "depth", 1)

    def apart(self, other: Within) -> bool:
        """Whether no angle is within both, by more than rounding."""
        distance = abs(math.remainder(self.centre - other.centre, 2 * math.pi))
        return distance > self.half + other.half + 1e-9

    def turns(self, low: float, high: float) -> list[tuple[Predicate, Predicate]]:
        """Pairs of bounds, one for each whole turn, of which one pair holds for an angle from low to high (radians).

        Raises
        ------
        ProblemError
            For a range of more than `MOST_TURNS` either way.
        """
        first, last = ((end - self.centre) / (2 * math.pi) for end in (low, high))
        if not -MOST_TURNS <= first <= last <= MOST_TURNS:
            wanted = f"an angle that turns at most {MOST_TURNS} times within the input bounds"
            raise ProblemError(f"{self}: expected {wanted}, got one from {_degrees(low)} to {_degrees(high)}")
        pairs = []
        for k in range(math.floor(first), math.ceil(last) + 1):
            # half - |angle - centre - 2 pi k| is the smaller of these two
            middle = self.centre + 2 * math.pi * k
            up = Predicate(((self.state, 1.0),), self.half - middle, str(self), self.column)
            down = Predicate(((self.state, -1.0),), self.half + middle, str(self), self.column)
            pairs.append((up, down))
        return pairs

    def __str__(self) -> str:
        return f"{self.state} within {_angle(self.half)} of {_angle(self.centre)}"


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


@dataclass(frozen=True, slots=True)
class Apart(Formula):
    """Members of different starts are at least so far from each other, centre to centre.

    Parameters
    ----------
    distance : float
        Metres, above 0.
    column : int
        1-based place in the text it came from, 0 if none; not compared.
    """

    distance: float
    column: int = field(default=0, compare=False, repr=False)

    def __post_init__(self) -> None:
        if not 0 < self.distance < math.inf:
            raise ProblemError(f"apart(...): expected a distance above 0 m, got {number(self.distance)} m")
        object.__setattr__(self, "depth", 1)

    def __str__(self) -> str:
        return f"apart({number(self.distance)} m)"


def _signed(value: float, name: str) -> str:
    """One term of a sum with its sign."""
    size = "" if abs(value) == 1 else f"{number(abs(value))}*"
    return f"{'-' if value < 0 else '+'} {size}{name}"


def _degrees(angle: float) -> str:
    """An angle for a person."""
    return f"{math.degrees(angle):g} deg"


def _angle(value: float) -> str:
    """The shortest text that reads back as the same angle: in degrees, if that is shorter."""
    degrees = number(float(f"{math.degrees(value):.10g}"))
    in_degrees = float(degrees) * (math.pi / 180) == value
    return f"{degrees} deg" if in_degrees and value else number(value)
