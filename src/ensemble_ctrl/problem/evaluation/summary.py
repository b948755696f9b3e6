"""What many members did, in a few numbers that can be added in any order with the same result, bit for bit."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from fractions import Fraction
from typing import Any, Self

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import exact
from ensemble_ctrl.problem.evaluation.clearance import Clearance
from ensemble_ctrl.problem.evaluation.histogram import Histogram
from ensemble_ctrl.problem.evaluation.interval import wilson
from ensemble_ctrl.problem.fleet import Member

WORST = 10
"""How many of the worst members a summary keeps."""


@dataclass(frozen=True, order=True)
class WorstMember:
    """One of the members with the smallest robustness.

    Attributes
    ----------
    robustness : float
        Metres, or the unit of the task.
    block, place : int
        The block it was drawn in, and its place there.
    parameters : tuple of float
        In the order of the fleet's names.
    """

    robustness: float
    block: int
    place: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class ShareCount:
    """How many members do a part of the task that a share of the fleet has to do.

    Attributes
    ----------
    part : str
        As it was written.
    required : float
        The required share.
    satisfied : int
        Members drawn at random that do it.
    drawn : int
        Members drawn at random.
    """

    part: str
    required: float
    satisfied: int
    drawn: int

    @property
    def share(self) -> float:
        """Of the members drawn at random; 1 of none."""
        return self.satisfied / self.drawn if self.drawn else 1.0

    @property
    def reached(self) -> bool:
        """Whether at least the required share does it, of the members drawn at random."""
        return self.satisfied >= exact(self.required) * self.drawn

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's interval at 95 % for the whole fleet."""
        return wilson(self.satisfied, self.drawn)

    def merge(self, other: ShareCount) -> ShareCount:
        """Both together."""
        return replace(self, satisfied=self.satisfied + other.satisfied, drawn=self.drawn + other.drawn)


@dataclass(frozen=True, eq=False)
class Summary:
    """What some blocks of members did.

    Attributes
    ----------
    names : tuple of str
        The parameters' names.
    substeps : int
        Samples per step.
    members : int
        How many members there were.
    violating : int
        How many of them fail what every member has to do, or are inside an obstacle at a sampled time.
    drawn, drawn_violating : int
        The same of those drawn at random: the corners of the ranges, which are in the first block, are not.
    finite : int
        Members whose robustness is finite.
    total, squares : Fraction
        Sums of these members' robustness and of its square, exact sums of every block's rounded ones.
    worst : tuple of WorstMember
        Those with the smallest robustness, in order, `WORST` at most.
    histograms : tuple of Histogram
        Of the robustness of all that every member has to do, and of each part of the task.
    clearances : tuple of Clearance
        The closest approach to each obstacle.
    shares : tuple of ShareCount
        One for each part ``share(p, f)`` of the task.

    Notes
    -----
    *Guarantee*: `merge` is associative and commutative, bit for bit: nothing in it rounds.
    """

    names: tuple[str, ...]
    substeps: int
    members: int
    violating: int
    drawn: int
    drawn_violating: int
    finite: int
    total: Fraction
    squares: Fraction
    worst: tuple[WorstMember, ...]
    histograms: tuple[Histogram, ...]
    clearances: tuple[Clearance, ...]
    shares: tuple[ShareCount, ...]

    def merge(self, other: Summary) -> Self:
        """Both together: of all blocks of the one and the other, each of which should be in one of them only.

        Raises
        ------
        ProblemError
            If they are of different fleets, tasks, maps or samples per step.
        """
        for name, mine, given in zip(("names", "substeps", "parts"), self._kind, other._kind, strict=True):
            if mine != given:
                raise ProblemError(f"summary: expected {name} {mine!r:.80}, got {given!r:.80}")
        counted = ("members", "violating", "drawn", "drawn_violating", "finite", "total", "squares")
        return replace(
            self,
            **{name: getattr(self, name) + getattr(other, name) for name in counted},
            worst=tuple(sorted((*self.worst, *other.worst))[:WORST]),
            histograms=tuple(a.merge(b) for a, b in zip(self.histograms, other.histograms, strict=True)),
            clearances=tuple(a.merge(b) for a, b in zip(self.clearances, other.clearances, strict=True)),
            shares=tuple(a.merge(b) for a, b in zip(self.shares, other.shares, strict=True)),
        )

    @property
    def _kind(self) -> tuple[object, ...]:
        """What two summaries need to have in common."""
        parts = [h.part for h in self.histograms], [c.obstacle for c in self.clearances], [s.part for s in self.shares]
        return self.names, self.substeps, parts

    @property
    def mean(self) -> float:
        """Mean robustness of the members whose robustness is finite; not a number without any."""
        return float(self.total / self.finite) if self.finite else math.nan

    @property
    def variance(self) -> float:
        """Variance of their robustness; not a number without any."""
        if not self.finite:
            return math.nan
        # E x^2 - (E x)^2, exact in the sums; never below zero
        return max(0.0, float(self.squares / self.finite - (self.total / self.finite) ** 2))

    @property
    def satisfied(self) -> float:
        """Share of the members that do all that every member has to do, 0 to 1."""
        return 1.0 - self.violating / self.members

    @property
    def good(self) -> bool:
        """Whether no member violates, and every required share is reached among the members drawn at random."""
        return not self.violating and all(s.reached for s in self.shares)

    def share(self, z: float = 1.96) -> tuple[float, float]:
        """Wilson's interval for the share of the whole fleet that does all that every member has to do."""
        return wilson(self.drawn - self.drawn_violating, self.drawn, z)

    def named(self, worst: WorstMember) -> Member:
        """The parameters of one of the worst members by name."""
        return dict(zip(self.names, worst.parameters, strict=True))

    def as_data(self) -> dict[str, Any]:
        """As plain data, for strict JSON; `from_data` gives the same summary back, bit for bit."""
        plain = {f.name: getattr(self, f.name) for f in fields(self)}
        return plain | {
            "names": list(self.names),
            "total": str(self.total),
            "squares": str(self.squares),
            "worst": [[_finite(w.robustness), w.block, w.place, list(w.parameters)] for w in self.worst],
            "histograms": [h.as_data() for h in self.histograms],
            "clearances": [asdict(c) | {"distance": _finite(c.distance)} for c in self.clearances],
            "shares": [asdict(s) for s in self.shares],
        }

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Self:
        """What `as_data` gave, also after JSON."""
        clearances = (Clearance(**{**c, "distance": _number(c["distance"])}) for c in data["clearances"])
        worst = (WorstMember(_number(w[0]), w[1], w[2], tuple(w[3])) for w in data["worst"])
        return cls(
            **{
                **data,
                "names": tuple(data["names"]),
                "total": Fraction(data["total"]),
                "squares": Fraction(data["squares"]),
                "worst": tuple(worst),
                "histograms": tuple(Histogram.from_data(h) for h in data["histograms"]),
                "clearances": tuple(clearances),
                "shares": tuple(ShareCount(**s) for s in data["shares"]),
            }
        )

    def to_json(self) -> str:
        """One line of strict JSON, every number with all its digits."""
        return json.dumps(self.as_data(), allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """What `to_json` gave, bit for bit."""
        return cls.from_data(json.loads(text))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Summary) and self.as_data() == other.as_data()

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        least = self.worst[0].robustness if self.worst else math.inf
        low, high = self.share()
        return (
            f"Summary({self.members} members: {self.violating} violate, robustness >= {least:.4f}, "
            f"share of the fleet {100 * low:.6g} to {100 * high:.6g} %)"
        )


def _finite(value: float) -> float | None:
    """A number of JSON; infinity, which is none, as None."""
    return value if math.isfinite(value) else None


def _number(value: float | None) -> float:
    """What `_finite` was given."""
    return math.inf if value is None else value
