"""What is proven of a clearance, and the worst of an obstacle's pieces, by whichever search."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.instants import Spans

if TYPE_CHECKING:
    from ensemble_ctrl.constraints.motion import Motion
    from ensemble_ctrl.problem.ensemble import Member
    from ensemble_ctrl.problem.specification import AvoidConstraint

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Verdict = Literal["yes", "no", "undecided"]

ALIKE = 1e-9
"""Metres by which members seen have to differ for one to be worse: more than the rounding of another machine."""


@dataclass(frozen=True)
class Bound:
    """The clearance from one obstacle.

    Attributes
    ----------
    obstacle : str
        Its name.
    proven : float
        No member is ever closer than this, metres; negative when that can't be shown.
    sampled : float
        Smallest distance seen, metres, rounded up, so that the truth lies between the two.
    parameters : dict of str to float
        Whose distance that was.
    time : float
        When, seconds.
    """

    obstacle: str
    proven: float
    sampled: float
    parameters: Member
    time: float


@dataclass(frozen=True)
class CounterExample:
    """A member that violates the task, or the fleet where the task reads it as a whole.

    Attributes
    ----------
    what : str
        The obstacle kept out of, or the part of the task.
    parameters : dict of str to float
        Whose parameters these are; replaying this member shows the violation. Empty for the fleet.
    time : float or None
        When, in seconds, where it is an obstacle.
    amount : float
        Metres by which it violates, > 0.
    """

    what: str
    parameters: Member
    time: float | None
    amount: float


class Search(Protocol):
    """What finds the clearance of a fleet from one convex piece."""

    def nearness(self, obstacle: Any, spans: Spans, motion: Motion | None = None) -> float:
        """About the smallest distance, metres."""

    def bound(
        self,
        name: str,
        obstacle: Any,
        spans: Spans,
        radius: float,
        motion: Motion | None = None,
        *,
        enough: float = np.inf,
    ) -> Bound:
        """Proven and sampled clearance; what is proven to be further away than `enough` isn't looked at closely."""


def nearness(search: Search, avoid: AvoidConstraint, spans: Spans) -> float:
    """About the smallest distance from what is avoided, metres."""
    return min(search.nearness(piece, spans, avoid.motion) for piece in avoid.pieces) - avoid.radius


def nearest_piece(search: Search, avoid: AvoidConstraint, spans: Spans, enough: float = np.inf) -> Bound:
    """The worst piece; those that look nearest come first, so that the others need only be far enough."""
    found: list[Bound] = []
    several = len(avoid.pieces) > 1
    for piece in sorted(avoid.pieces, key=lambda one: several and search.nearness(one, spans, avoid.motion)):
        # further pieces need a bound above the distance already seen, no tighter one
        enough = min([enough, *(b.sampled for b in found)])
        own = {} if avoid.footprint is None else {"footprint": avoid.footprint}
        found.append(search.bound(avoid.name, piece, spans, avoid.radius, avoid.motion, enough=enough, **own))
    worst = min(found, key=lambda b: b.sampled)
    return replace(worst, proven=min(b.proven for b in found))


def last_lowest(values: Floats) -> int:
    """The last of the members that are lowest but for rounding, so that each machine names the same one."""
    return len(values) - 1 - int((values <= np.fmin.reduce(values) + ALIKE)[::-1].argmax())
