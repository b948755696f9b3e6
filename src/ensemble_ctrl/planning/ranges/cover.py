"""As few parts as possible that cover a fleet, each with a certified plan.

Along one parameter the parts are chosen greedily from one end, each as long as a plan is found for it. No cover by
intervals has fewer, if a plan is found wherever there is one: the k-th cut of any cover is at most the k-th of this.
With several parameters the fleet is cut along the one that spreads it most; where no part along that one has a plan, it
is halved along the next one, and each half covered by itself. At the end neighbours are joined that have a plan
together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import RunawayError
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.ranges.oracle import Found, Oracle, Routes
from ensemble_ctrl.planning.ranges.parts import part, places
from ensemble_ctrl.planning.ranges.search import largest
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]

FIRST = 8
"""The first part tried along a single parameter is the range divided by this."""
HALVINGS = 4
"""How often a fleet is halved along further parameters."""


@dataclass(eq=False)
class Cover:
    """One search.

    Parameters
    ----------
    oracle : Oracle
    ticks : int
        Even steps of each range between which it may be cut; measured fleets are cut between robots.
    most : int
        Parts after which the search ends without a cover.
    downwards : bool
        Whether parts are chosen from the high end.

    Attributes
    ----------
    parts : list of Found
        In the order of the parameters.
    missed : Fleet or None
        What no plan was found for.
    limited : bool
        Whether that is because there are as many parts as allowed.
    """

    oracle: Oracle
    ticks: int
    most: int
    downwards: bool = False
    parts: list[Found] = field(default_factory=list)
    missed: Fleet | None = None
    limited: bool = False

    @property
    def complete(self) -> bool:
        """Whether the parts cover the whole fleet."""
        return self.missed is None

    def run(self) -> Cover:
        """Cover the whole fleet."""
        fleet = self.oracle.problem.fleet
        middle = self.oracle.certified(_point(fleet)) if len(_wide(fleet)) > 1 else None
        controls = None if middle is None else middle.solution.controls
        self._cover(fleet, self._axes(fleet, controls), controls, HALVINGS)
        if len(_wide(fleet)) > 1 and self.complete:
            self._join()
        return self

    def _axes(self, fleet: Fleet, controls: Floats | None) -> list[str]:
        """The parameters that differ between members, first the one that spreads the fleet most under `controls`."""
        names = _wide(fleet)
        if controls is None or len(names) < 2:
            return names
        step = self.oracle.problem.step

        def spread(name: str) -> float:
            ends = np.tile(fleet.center, (2, 1))
            ends[:, fleet.names.index(name)] = fleet.parameters[name].lower, fleet.parameters[name].upper
            low, high = fleet.trajectories(controls, ends, step)[..., fleet.place_columns]
            return float(np.linalg.norm(high - low, axis=-1).max())

        try:
            return sorted(names, key=spread, reverse=True)
        except RunawayError:
            return names

    def _cover(self, fleet: Fleet, axes: list[str], guess: Floats | None, halvings: int) -> None:
        """Cover a part of the fleet greedily along the first axis."""
        if not axes:
            self._single(fleet, guess)
            return
        rest: Fleet | None = fleet
        while rest is not None and self.complete:
            if len(self.parts) >= self.most or self.oracle.stopped:
                self.missed, self.limited = rest, not self.oracle.stopped
                return
            found = self._longest(rest, axes[0], guess)
            if found is None:
                self._halved(rest, axes, guess, halvings)
                return
            self.parts.append(found)
            guess = found.solution.controls
            rest = self._rest(rest, axes[0], found.solution.problem.fleet)

    def _rest(self, fleet: Fleet, axis: str, done: Fleet) -> Fleet | None:
        """What is left of a fleet beyond a part at the end of an axis; None if nothing is."""
        (lower, upper), (begin, end), measured = _ends(fleet, axis), _ends(done, axis), fleet.parameters[axis].measured
        if self.downwards:
            end = begin if measured is None else float(measured[measured < begin].max(initial=-np.inf))
            return part(fleet, axis, lower, end) if end > lower or (measured is not None and end == lower) else None
        begin = end if measured is None else float(measured[measured > end].min(initial=np.inf))
        return part(fleet, axis, begin, upper) if begin < upper or (measured is not None and begin == upper) else None

    def _single(self, fleet: Fleet, guess: Floats | None) -> None:
        """A fleet whose members are all alike."""
        found = self.oracle.certified(fleet, [] if guess is None else [guess])
        if found is None:
            self.missed = fleet
        else:
            self.parts.append(found)

    def _longest(self, fleet: Fleet, axis: str, guess: Floats | None) -> Found | None:
        """The longest certified part from the end of an axis."""
        cuts, best = places(fleet, axis, self._ticks(fleet, axis)), list[Found]()
        cuts = cuts[::-1] if self.downwards else cuts
        guesses = [] if guess is None else [guess]
        even = fleet.parameters[axis].measured is None

        def works(count: float) -> bool:
            # `count` steps of a range, or robots, from the end
            last = int(count) if even else int(count) - 1
            group = part(fleet, axis, *sorted((cuts[0], cuts[last])))
            routes: Routes
            near, routes = ([best[-1].solution.controls], "screen") if best else (guesses, "search")
            found = self.oracle.certified(group, near, routes)
            best.extend([] if found is None else [found])
            return found is not None

        limit = len(cuts) - 1 if even else len(cuts)
        several = len(_wide(fleet)) > 1
        largest(works, limit if several else max(1, limit // FIRST), limit, 1, whole=True)
        return best[-1] if best else None

    def _ticks(self, fleet: Fleet, axis: str) -> int:
        """Steps of what is left of an axis, each as long as at the beginning."""
        whole, left = self.oracle.problem.fleet.parameters[axis], fleet.parameters[axis]
        return max(1, round(self.ticks * left.half_width / whole.half_width)) if whole.half_width else 1

    def _halved(self, fleet: Fleet, axes: list[str], guess: Floats | None, halvings: int) -> None:
        """Cover the halves of a fleet along its next axis; nothing is found where there is none."""
        others = [*axes[1:], axes[0]] if len(axes) > 1 else []
        if not others or not halvings:
            self.missed = fleet
            return
        for half in _halves(fleet, others[0], self._ticks(fleet, others[0])):
            if self.complete:
                self._cover(half, [name for name in others if name in _wide(half)], guess, halvings - 1)

    def _join(self) -> None:
        """Join neighbours that have a plan together."""
        while pair := next(self._joined(), None):
            first, second, found = pair
            self.parts = [found if one is first else one for one in self.parts if one is not second]

    def _joined(self) -> Iterator[tuple[Found, Found, Found]]:
        """Pairs of parts whose union is a box with a plan."""
        for i, one in enumerate(self.parts):
            for other in self.parts[i + 1 :]:
                union = _union(self.oracle.problem.fleet, one.solution.problem.fleet, other.solution.problem.fleet)
                if union is not None:
                    guesses = [one.solution.controls, other.solution.controls]
                    found = self.oracle.certified(union, guesses, "never")
                    if found is not None:
                        yield one, other, found


def _wide(fleet: Fleet) -> list[str]:
    """The parameters that differ between members."""
    return [name for name, distribution in fleet.parameters.items() if distribution.upper > distribution.lower]


def _point(fleet: Fleet) -> Fleet:
    """The middle member alone."""
    return fleet.with_distributions(
        {name: Interval(distribution.center, distribution.center) for name, distribution in fleet.parameters.items()}
    )


def _halves(fleet: Fleet, axis: str, ticks: int) -> list[Fleet]:
    """Two parts of a fleet along an axis, of as many steps or robots."""
    cuts = places(fleet, axis, max(2, ticks))
    distribution, middle = fleet.parameters[axis], len(cuts) // 2
    low = middle - 1 if distribution.measured is not None else middle
    return [part(fleet, axis, distribution.lower, cuts[low]), part(fleet, axis, cuts[middle], distribution.upper)]


def _union(whole: Fleet, one: Fleet, other: Fleet) -> Fleet | None:
    """Two parts of a fleet together, if they differ along one axis and nothing of the fleet is between them."""
    differ = [n for n in _wide(whole) if _ends(one, n) != _ends(other, n)]
    if len(differ) != 1 or whole.samples is not None:
        return None
    axis = differ[0]
    low, high = sorted((one, other), key=lambda fleet: fleet.parameters[axis].lower)
    measured, (_, end), (begin, upper) = whole.parameters[axis].measured, _ends(low, axis), _ends(high, axis)
    gap = begin > end if measured is None else bool(((measured > end) & (measured < begin)).any())
    if gap:
        return None
    joined = part(whole, axis, low.parameters[axis].lower, upper)
    for name in set(_wide(whole)) - {axis}:
        joined = part(joined, name, *_ends(low, name))
    return joined


def _ends(fleet: Fleet, name: str) -> tuple[float, float]:
    """The range of a parameter."""
    return fleet.parameters[name].lower, fleet.parameters[name].upper
