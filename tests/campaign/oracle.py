"""The truth about a case, as far as brute force finds it: dense in time, searched in the parameters.

Values are upper bounds of the worst member's: what was found to be that low is that low. By how much they may miss what
is between the sampled times is told with them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from . import distributions, monitor
from .arcs import Motion
from .model import Case, Floats, Long, Longs, Node, Polygon, children, conjuncts, ends_of, instants
from .monitor import Signal
from .shapes import corners_of, facet_clearances, signed_distance

FINE = 1e-7
"""Metres that chords may leave the arcs by, as far as `KNOTS` times are enough."""
KNOTS = 120
GRID = 9
"""Members looked at first in a range, for one parameter."""
EIGHTHS = np.linspace(0, 1, 9).astype(Long)
"""Where a chord is looked at; the lowest point is on one of the two eighths that meet at the lowest of these."""
QUARTERS, FEW_QUARTERS = 30, 6
"""Times that a chord is cut to a quarter, until what is left of it is a rounding, or short."""


@dataclass(frozen=True)
class Duty:
    """What is kept out of all through a window: ``G[a,b] avoid(o)`` or ``G[a,b] not in(r)``."""

    name: str
    pieces: tuple[Polygon, ...]
    radius: float
    begin: float
    end: float


def duties_of(case: Case, part: Node) -> list[Duty]:
    """The duties that a part of the task is made of; none for any other part."""
    if part[0] != "G":
        return []
    kept = conjuncts(part[3])
    if not all(leaf[0] == "avoid" or (leaf[0] == "not" and leaf[1][0] == "in") for leaf in kept):
        return []
    begin, end = (0.0, case.duration) if part[1] is None else (part[1], part[2])
    found = []
    for leaf in kept:
        if leaf[0] == "not":
            (x0, x1), (y0, y1) = case.regions[leaf[1][1]]
            found.append(Duty(leaf[1][1], (((x0, y0), (x1, y0), (x1, y1), (x0, y1)),), 0.0, begin, end))
        else:
            names = list(case.obstacles) if leaf[1] == "obstacles" else [leaf[1]]
            found += [Duty(name, case.obstacles[name], case.radius, begin, end) for name in names]
    return found


def needed(duties: list[Duty]) -> list[Duty]:
    """Those whose windows no other one of the same holds; of equal ones the first."""
    claims = [((duty.name, duty.radius), duty.begin, duty.end) for duty in duties]
    return [duty for k, duty in enumerate(duties) if not _is_implied(k, claims)]


def needed_parts(parts: Sequence[Node]) -> list[Node]:
    """Those that say something which no other says: of ``G f`` the widest windows, of ``F f`` the narrowest."""
    claims: list[tuple[object, float, float]] = []
    for part in parts:
        windowed = part[0] in ("F", "G")
        begin, end = (part[1], part[2]) if windowed and part[1] is not None else (0.0, np.inf)
        sign = -1.0 if part[0] == "F" else 1.0
        claims.append(((part[0], part[3]) if windowed else part, sign * begin, sign * end))
    return [part for k, part in enumerate(parts) if not _is_implied(k, claims)]


def _is_implied(k: int, claims: Sequence[tuple[object, float, float]]) -> bool:
    """Whether another claim of the same has a window around this one's; of equal ones the first counts."""
    what, begin, end = claims[k]
    for other, (same, early, late) in enumerate(claims):
        around = early <= begin and end <= late
        if other != k and same == what and around and (other < k or (early, late) != (begin, end)):
            return True
    return False


class Oracle:
    """What is true of one case."""

    def __init__(self, case: Case) -> None:
        self.case, self.motion = case, Motion(case)
        self.ends = np.array([ends_of(distribution) for distribution in case.distributions.values()]).reshape(-1, 2)
        self.rng = np.random.default_rng(7)

    @cached_property
    def members(self) -> Floats:
        """Those looked at first: the middle, the corners, and a grid or some drawn ones."""
        low, high = self.ends.T
        rows = [(low + high) / 2, *(np.array(row) for row in product(*(sorted(set(e)) for e in self.ends.tolist())))]
        wide = np.flatnonzero(high > low)
        if len(wide) == 1:
            for share in np.linspace(0, 1, GRID)[1:-1]:
                rows.append(low + share * (high - low))
        elif len(wide):
            rows += list(low + self.rng.random((GRID, len(low))) * (high - low))
        if not len(low):
            return np.zeros((1, 0))
        return np.unique(np.clip(np.array(rows).reshape(len(rows), len(low)), low, high), axis=0)

    def around(self, best: Floats, width: float, count: int) -> Floats:
        """Members near one, within a share of the ranges."""
        low, high = self.ends.T
        wide = np.flatnonzero(high > low)
        if len(wide) == 1:
            move = np.zeros((count, len(low)))
            move[:, wide[0]] = np.linspace(-1, 1, count)
        else:
            move = self.rng.uniform(-1, 1, (count, len(low)))
        return np.asarray(np.clip(best + move * width * (high - low), low, high))

    @cached_property
    def extent(self) -> float:
        """Largest coordinate of the map, metres."""
        sizes = [np.abs(np.array(p)).max() for pieces in self.case.obstacles.values() for p in pieces]
        sizes += [np.abs(np.array(box)).max() for box in self.case.regions.values()]
        sizes += [np.abs(np.array(places)).max() for _, places in self.case.motions.values()]
        return float(max([*sizes, *map(abs, self.case.position)]))

    @cached_property
    def slack(self) -> np.longdouble:
        """Rounding of everything here, metres."""
        return self.motion.slack(self.members) + Long(1e-18) * Long(self.extent)

    # -- clearance ---------------------------------------------------------------------------------------------------

    def clearance(self, duty: Duty, near: Floats | None = None) -> float:
        """Smallest distance found from what a duty keeps out of, metres: an upper bound of the truth."""
        begin, end = Long(duty.begin), min(Long(duty.end), self.motion.grid[-1])
        times = self._times(begin, end)
        rows = self.members if near is None else np.concatenate([self.members, near])
        between = self._closest_on_chords(duty, rows, times)
        best, member, time = self._closest(duty, rows, np.unique(np.append(times, between)))
        span, width = (end - begin) / max(len(times) - 1, 1), 1.0 / GRID
        for _ in range(6):
            near_times = np.unique(np.clip(time + span * np.linspace(-1, 1, 9).astype(Long), begin, end))
            rows = np.concatenate([member[None], self.around(member, width, 9)])
            value, row, at = self._closest(duty, rows, near_times)
            if value < best:
                best, member, time = value, row, at
            span, width = span / 3, width / 3
        return best

    def _times(self, begin: np.longdouble, end: np.longdouble) -> Longs:
        """Times of a window: its ends, the grid's, those of motions, and some between."""
        extra = [begin, end, *(Long(t) for times, _ in self.case.motions.values() for t in times)]
        times, _ = self.motion.knots(extra, FINE, KNOTS)
        times = np.unique(np.concatenate([times, begin + (end - begin) * np.linspace(0, 1, 17).astype(Long)]))
        return np.asarray(times[(times >= begin) & (times <= end)])

    def _closest(self, duty: Duty, rows: Floats, times: Longs) -> tuple[float, Floats, np.longdouble]:
        """The smallest distance with its member and time."""
        distance = self.distances(duty, rows, times)
        i, j = np.unravel_index(int(distance.argmin()), distance.shape)
        return float(distance[i, j]), rows[i], times[j]

    def distances(self, duty: Duty, rows: Floats, times: Longs) -> Longs:
        """Distance of members at some times, shape (members, times), metres."""
        seen = self._seen(duty, rows, times)
        pieces = [signed_distance(corners_of(piece), seen) for piece in duty.pieces]
        return np.asarray(np.minimum.reduce(pieces) - Long(duty.radius))

    def lowest_on_chords(self, duty: Duty, rows: Floats, times: Longs) -> tuple[Longs, Longs]:
        """The smallest distance of each member on the chords between its places at some times, and when it is there.

        The distance from a convex polygon is convex along a chord, so that cutting off what is higher finds it.
        """
        seen = self._seen(duty, rows, times)
        least, when = np.full(len(rows), np.inf, Long), np.full(len(rows), times[0])
        for corners in map(corners_of, duty.pieces):
            i, at, low = _lowest(corners, seen, times, np.arange(len(rows)), QUARTERS)
            for n in np.argsort(-low, kind="stable"):
                if low[n] < least[i[n]]:
                    least[i[n]], when[i[n]] = low[n], at[n]
        return least - Long(duty.radius), when

    def _closest_on_chords(self, duty: Duty, rows: Floats, times: Longs) -> np.longdouble:
        """About when the closest member is closest on the chords between its places at some times."""
        seen = self._seen(duty, rows, times)
        found = [_lowest(corners_of(p), seen, times, np.zeros(len(rows), int), FEW_QUARTERS) for p in duty.pieces]
        return Long(min(((low.min(), at[low.argmin()]) for _, at, low in found), key=lambda pair: pair[0])[1])

    def _seen(self, duty: Duty, rows: Floats, times: Longs) -> Longs:
        """Places of members at some times from what a duty keeps out of, shape (members, times, 2)."""
        return np.asarray(self.motion.paths(rows, times) - self._displaced(duty.name, times))

    def _displaced(self, name: str, times: Longs) -> Longs:
        """How far an obstacle has moved."""
        if name not in self.case.motions:
            return np.zeros((len(times), 2), Long)
        when, where = self.case.motions[name]
        knots, offsets = np.array(when, dtype=Long), np.array(where, dtype=Long)
        return np.stack([Signal(knots, offsets[:, k]).at(times) for k in (0, 1)], axis=1)

    # -- robustness --------------------------------------------------------------------------------------------------

    @cached_property
    def knots(self) -> tuple[Longs, np.longdouble]:
        """Times of the signals, and by how much their chords may leave the arcs."""
        times, pieces = self.motion.knots(list(set(instants(self.case.task))), FINE, KNOTS)
        return times, self.motion.sagitta(pieces)

    def missed(self, part: Node) -> float:
        """By how much a value may be below the truth: nothing where only the smallest of sampled values counts."""
        return 0.0 if _only_smallest(part) else float(self.knots[1])

    def robustness(self, part: Node, rows: Floats) -> Floats:
        """Robustness of members at time 0, shape (members,)."""
        paths = self.motion.paths(rows, self.knots[0])
        return np.array([float(self._signal(part, path).at(np.zeros(1, Long))[0]) for path in paths])

    def worst(self, part: Node, near: Floats | None = None) -> float:
        """Smallest robustness found of any member; of the fleet, if the part reads nothing else."""
        if reads_only_fleet(part):
            return float(self.robustness(part, self.members[:1])[0])
        return self._lowest(lambda rows: self.robustness(part, rows), near)

    def _lowest(self, value: Callable[[Floats], Floats], near: Floats | None) -> float:
        """The smallest of a function of members, searched around the lowest of the first ones."""
        rows = self.members if near is None else np.concatenate([self.members, near])
        values = value(rows)
        best, member = float(values.min()), rows[values.argmin()]
        if (self.ends[:, 1] > self.ends[:, 0]).any():
            for width in (1.0 / GRID, 0.25 / GRID):
                rows = self.around(member, width, 6)
                values = value(rows)
                if values.min() < best:
                    best, member = float(values.min()), rows[values.argmin()]
        return best

    def member_values(self, part: Node, rows: Floats) -> Floats:
        """How well members do what a share of the fleet has to: distances for duties, robustness for the rest.

        Both on chords, which may leave the arcs by the second of `knots`.
        """
        values = np.full(len(rows), np.inf)
        for inner in conjuncts(part):
            kept = duties_of(self.case, inner)
            for duty in kept:
                times = self._times(Long(duty.begin), min(Long(duty.end), self.motion.grid[-1]))
                values = np.minimum(values, self.lowest_on_chords(duty, rows, times)[0].astype(float))
            if not kept:
                values = np.minimum(values, self.robustness(inner, rows))
        return values

    def _signal(self, node: Node, path: Longs) -> Signal:
        """A formula's robustness over time for one member's path at the knots."""
        case = self.case
        match node[0]:
            case "pred":
                norm = np.hypot(Long(node[1]), Long(node[2]))
                value = (Long(node[1]) * path[:, 0] + Long(node[2]) * path[:, 1] + Long(node[3])) / norm
                return Signal(self.knots[0], value)
            case "in":
                (x0, x1), (y0, y1) = case.regions[node[1]]
                sides = [path[:, 0] - Long(x0), Long(x1) - path[:, 0], path[:, 1] - Long(y0), Long(y1) - path[:, 1]]
                return monitor.combined([Signal(self.knots[0], side) for side in sides], smallest=True)
            case "avoid":
                return monitor.combined([self._avoided(piece, path) for piece in self._pieces(node[1])], smallest=True)
            case "not":
                return -self._signal(node[1], path)
            case "and" | "or":
                return monitor.combined([self._signal(part, path) for part in node[1:]], node[0] == "and")
            case "mean":
                return self._signal(node[1], self._mean_path)
            case "share":
                rows, weights = distributions.rule(case)
                paths = self.motion.paths(rows, self.knots[0])
                return monitor.ranked([self._signal(node[2], path) for path in paths], weights, node[1])
            case "U":
                left, right = self._signal(node[3], path), self._signal(node[4], path)
                if node[1] is None:
                    return monitor.until_rest(left, right)
                return monitor.until_window(left, right, Long(node[1]), Long(node[2]))
        child = self._signal(node[3], path)
        child = child if node[0] == "F" else -child
        if node[1] is None:
            value = monitor.eventually_rest(child)
        else:
            value = monitor.eventually(child, Long(node[1]), Long(node[2]))
        return value if node[0] == "F" else -value

    def _avoided(self, piece: tuple[Polygon, float], path: Longs) -> Signal:
        """Distance beyond the best of a piece's sides, less the radius."""
        sides = facet_clearances(corners_of(piece[0]), path)
        return monitor.combined([Signal(self.knots[0], side - Long(piece[1])) for side in sides.T], smallest=False)

    def _pieces(self, name: str) -> list[tuple[Polygon, float]]:
        """Pieces with that name, and what they grow by."""
        if name in self.case.regions:
            (x0, x1), (y0, y1) = self.case.regions[name]
            return [(((x0, y0), (x1, y0), (x1, y1), (x0, y1)), self.case.radius)]
        names = list(self.case.obstacles) if name == "obstacles" else [name]
        return [(piece, self.case.radius) for name in names for piece in self.case.obstacles[name]]

    @cached_property
    def _mean_path(self) -> Longs:
        """The mean place of the fleet at the knots."""
        rows, weights = distributions.rule(self.case)
        return np.asarray((weights[:, None, None] * self.motion.paths(rows, self.knots[0])).sum(axis=0))


def _lowest(
    corners: Longs, seen: Longs, times: Longs, group: NDArray[np.int64], quarters: int
) -> tuple[NDArray[np.int64], Longs, Longs]:
    """Members, times and distances from a convex polygon there, the lowest of each group of members among them.

    Chords are given up when nothing on them can be the lowest of their group.
    """
    value = signed_distance(corners, seen)
    least = np.full(int(group.max()) + 1, np.inf, Long)
    np.minimum.at(least, group, value.min(axis=1))
    way = np.hypot(*np.moveaxis(np.diff(seen, axis=1), -1, 0))
    # a chord's ends are further than its middle by half its length at most
    i, j = np.nonzero((value[:, :-1] + value[:, 1:] - way) / 2 < least[group][:, None])
    begin, along, way = seen[i, j], seen[i, j + 1] - seen[i, j], way[i, j]
    low, high = np.zeros(len(i), Long), np.ones(len(i), Long)
    found = [(np.arange(len(seen)), times[value.argmin(axis=1)], value.min(axis=1))]
    for _ in range(quarters if len(i) else 0):
        at = low[:, None] + EIGHTHS * (high - low)[:, None]
        value = signed_distance(corners, begin[:, None] + at[..., None] * along[:, None])
        k, row = value.argmin(axis=1), np.arange(len(i))
        share, lowest = at[row, k], value[row, k]
        np.minimum.at(least, group[i], lowest)
        low, high = at[row, np.maximum(k - 1, 0)], at[row, np.minimum(k + 1, len(EIGHTHS) - 1)]
        kept = lowest - (high - low) * way <= least[group[i]]
        i, j, begin, along, way = i[kept], j[kept], begin[kept], along[kept], way[kept]
        low, high, share, lowest = low[kept], high[kept], share[kept], lowest[kept]
    if len(i):
        found.append((i, times[j] + share * (times[j + 1] - times[j]), lowest))
    member, when, distance = (np.concatenate(part) for part in zip(*found, strict=True))
    return member, when, distance


def reads_fleet(node: Node) -> bool:
    """Whether a formula speaks of the fleet as a whole."""
    return node[0] in ("mean", "share") or any(reads_fleet(part) for part in children(node))


def reads_only_fleet(node: Node) -> bool:
    """Whether a formula has the same value for every member."""
    parts = children(node)
    return node[0] in ("mean", "share") or (bool(parts) and all(map(reads_only_fleet, parts)))


def _only_smallest(node: Node, positive: bool = True) -> bool:
    """Whether a value is the smallest of predicates at sampled times, so that it is never below the truth."""
    match node[0]:
        case "pred" | "in":
            return positive or node[0] == "pred"
        case "not":
            return _only_smallest(node[1], not positive)
        case "and" | "G":
            return positive and all(_only_smallest(part) for part in children(node))
        case "or" | "F":
            return not positive and all(_only_smallest(part, False) for part in children(node))
    return False
