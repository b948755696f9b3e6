"""How close groups of members come to what they avoid, evaluated only where it can matter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem.evaluation.clearance import Clearance
from ensemble_ctrl.problem.evaluation.groups import Group, PosedGroup
from ensemble_ctrl.problem.fleet import Member
from ensemble_ctrl.problem.specification import AvoidConstraint

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TOGETHER = 8
"""Times evaluated at once, the nearest first."""


@dataclass()
class Closest:
    """The closest that any member came so far to one obstacle.

    Attributes
    ----------
    distance : float
        Metres; infinite before any was seen.
    time, member : int
        Indices of when, and of whom.
    inside : int
        Members that were inside at some time.
    """

    distance: float = np.inf
    time: int = 0
    member: int = 0
    inside: int = 0

    def clearance(self, name: str, times: Floats, members: Floats, named: Callable[[Floats], Member]) -> Clearance:
        """The same with the obstacle's name, in seconds, and with the member's parameters."""
        return Clearance(name, self.distance, float(times[self.time]), named(members[self.member]), self.inside)


class Approach:
    """What some constraints keep members away from, as arrays over their convex pieces.

    Parameters
    ----------
    avoid : sequence of AvoidConstraint
    times : ndarray, shape (times,)
        Seconds.
    """

    def __init__(self, avoid: Sequence[AvoidConstraint], times: Floats) -> None:
        self.avoid = avoid
        self.pieces = [(o, piece) for o, one in enumerate(avoid) for piece in one.pieces]
        self.owner = np.array([o for o, _ in self.pieces], dtype=int)
        self.radius = np.array([avoid[o].radius for o, _ in self.pieces])
        # no part of a robot is farther from its planned point than this
        bodies = [avoid[o].footprint for o, _ in self.pieces]
        self.own = self.radius + [0.0 if body is None else body.reach for body in bodies]
        self.moved = [None if one.motion is None else one.offsets(times) for one in avoid]
        self.out = ~np.array([avoid[o].during(times) for o, _ in self.pieces], dtype=bool).reshape(-1, len(times))
        # bounding boxes, shape (pieces, 1, d), or (pieces, times, d) where something moves
        low = np.array([piece.vertices.min(axis=0) for _, piece in self.pieces])[:, None]
        high = np.array([piece.vertices.max(axis=0) for _, piece in self.pieces])[:, None]
        if any(moved is not None for moved in self.moved):
            offsets = np.array([avoid[o].offsets(times) for o, _ in self.pieces])
            low, high = low + offsets, high + offsets
        self.low, self.high = low, high

    def judge(self, group: Group, members: Ints, robustness: Floats, closest: Sequence[Closest] | None) -> None:
        """Lower the robustness of a group to its distances, and keep the closest of every obstacle.

        Parameters
        ----------
        group : Group
        members : ndarray, shape (members,)
            Their indices, for `closest`.
        robustness : ndarray, shape (members,)
            Metres, lowered in place to each member's smallest distance.
        closest : sequence of Closest, optional
            One for each constraint, updated.

        Notes
        -----
        *Guarantee*: as if every distance had been computed. A piece is left out, at some times or at all, only where no
        member can be inside of it, closer than the closest so far, or closer than its own robustness so far.
        """
        if not self.pieces:
            return
        bound = self._bounds(group)
        least = bound.min(axis=1)
        inside = np.zeros((len(self.avoid), len(members)), dtype=bool)
        top = max(float(robustness.max()), 0.0)
        known = np.zeros(len(self.avoid)) if closest is None else np.array([one.distance for one in closest])
        near = np.flatnonzero(least < np.maximum(top, known[self.owner]))
        for k in near[np.argsort(least[near], kind="stable")]:
            o = int(self.owner[k])
            one = None if closest is None else closest[o]
            if least[k] < max(top, 0.0 if one is None else one.distance):
                self._visit(k, group, bound[k], members, robustness, one, inside[o])
                top = max(float(robustness.max()), 0.0)
        if closest is not None:
            for one, count in zip(closest, inside.sum(axis=1).tolist(), strict=True):
                one.inside += count

    def _bounds(self, group: Group) -> Floats:
        """No member is closer to each piece's bounding box than this at each time, shape (pieces, times), metres."""
        # gap along each axis between the box and the group's middle; no member is further than its reach from that
        square = np.zeros(self.out.shape)
        for axis in range(group.middle.shape[1]):
            at = group.middle[:, axis]
            gap = np.maximum(self.low[:, :, axis] - at, at - self.high[:, :, axis])
            np.maximum(gap, 0.0, out=gap)
            square += gap * gap
        bound = np.sqrt(square, out=square)
        bound -= group.reach
        bound -= self.own[:, None]
        bound[self.out] = np.inf
        return np.asarray(bound)

    def _visit(
        self,
        k: int,
        group: Group,
        bound: Floats,
        members: Ints,
        robustness: Floats,
        one: Closest | None,
        inside: NDArray[np.bool_],
    ) -> None:
        """Distances from one piece at the times when it may be near, the nearest first."""
        (o, piece), radius = self.pieces[k], self.radius[k]
        when = np.flatnonzero(bound < max(float(robustness.max()), 0.0, -np.inf if one is None else one.distance))
        moved = self.moved[o]
        middle = group.middle[when] if moved is None else group.middle[when] - moved[when]
        # distance is 1-Lipschitz: no member is closer than the middle less the reach
        low = piece.distance(middle) - self.own[k] - group.reach[when]
        order = np.argsort(low, kind="stable")
        when, low = when[order], low[order]
        least = np.full(len(members), np.inf)
        for i in range(0, len(when), TOGETHER):
            top = max(float(np.minimum(robustness, least).max()), 0.0)
            if low[i] >= max(top, -np.inf if one is None else one.distance):
                break
            some = when[i : i + TOGETHER]
            places = group.places(some)
            if moved is not None:
                places -= moved[some].T[:, None]
            seen = self._distances(o, piece, group, places, some) - radius
            np.minimum(least, seen.min(axis=1), out=least)
            if one is not None and (nearest := float(least.min())) < one.distance:
                who = int(least.argmin())
                one.distance, one.member = nearest, int(members[who])
                one.time = int(some[seen[who].argmin()])
        inside |= least < 0
        np.minimum(robustness, least, out=robustness)

    def _distances(self, o: int, piece: Obstacle, group: Group, places: Floats, when: Ints) -> Floats:
        """Distances from one piece of members at `places`, shape (2, members, times), or of their bodies there."""
        body = self.avoid[o].footprint
        if body is None:
            return piece.distance_along(places)
        return body.distance(piece, np.moveaxis(places, 0, -1), cast(PosedGroup, group).headings(when))
