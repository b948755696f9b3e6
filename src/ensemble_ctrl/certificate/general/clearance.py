"""Proven clearance of any system: lower bounds of the distance between polynomial tubes and convex obstacles, refined.

A *box* is a part of a piece of time and of a cell of parameters.  For a direction `n` of length one, the distance from
a convex obstacle is at least ``n x - max n v`` over its corners `v`; on a box, ``n x`` is one polynomial, bounded by
its coefficients.  Boxes whose bound is too far below the best distance seen are halved, in time or in the parameter
that moves them most, until the bound is tight.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.bound import ALIKE, Bound, last_lowest
from ensemble_ctrl.certificate.clearance import TIGHT
from ensemble_ctrl.certificate.general.basis import UNIT, UP
from ensemble_ctrl.certificate.general.boxes import Boxes, outwards
from ensemble_ctrl.certificate.general.enclosure import Enclosure
from ensemble_ctrl.certificate.instants import Spans

if TYPE_CHECKING:
    from ensemble_ctrl.constraints import Obstacle
    from ensemble_ctrl.constraints.motion import Motion


Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NUMBERS = 20_000_000
"""Coefficients of all boxes looked at for one obstacle before the search for a better bound ends."""
ROUNDS = 60
"""Largest number of halvings of one box."""
DESCENTS = 3
"""Rounds of the search for the closest place of a box."""
BLOCK = 4_000_000
"""Numbers held at a time for the nearest edges."""
SMALLEST = 1e-9
"""Metres; boxes that move their members by less are not halved."""


@dataclass(eq=False)
class Prover:
    """Bounds for one enclosure.

    Parameters
    ----------
    enclosure : Enclosure
    rows : ndarray, shape (d, states)
        The position in the states.
    names : sequence of str
        The parameters.
    lower, upper : ndarray, shape (parameters,)
        Their ranges.
    duration : float
        Seconds.
    steps : int
        Steps of the controls.

    Attributes
    ----------
    boxes : int
        Boxes looked at so far.
    """

    enclosure: Enclosure
    rows: Floats
    names: Sequence[str]
    lower: Floats
    upper: Floats
    duration: float
    steps: int
    boxes: int = field(default=0)
    goal: float = field(default=np.inf)

    def bound(
        self,
        name: str,
        obstacle: Obstacle,
        spans: Spans,
        radius: float,
        motion: Motion | None = None,
        *,
        enough: float = np.inf,
    ) -> Bound:
        """Proven and sampled clearance of every member from an obstacle, which may move, during some time.

        Parameters
        ----------
        spans : Spans
            Parts of steps.
        radius : float
            Metres by which robots grow.
        enough : float
            Metres; what is proven to be further away isn't looked at more closely.

        Notes
        -----
        *Guarantee*: `Bound.proven` is never above the distance of any member at any instant of the spans. What is
        seen is of members that follow the model; boxes are halved until their bound meets that less its errors.
        """
        self.goal = np.inf
        boxes = self._first(spans)
        enough += radius
        proven, best, spent = np.inf, Bound(name, -np.inf, np.inf, {}, np.nan), 0
        for _ in range(ROUNDS):
            self.boxes += len(boxes)
            spent += boxes.c.size
            # branch and bound: boxes whose bound is below the smallest distance seen are halved
            low, best = self._bounds(boxes, obstacle, motion, best)
            sizes = boxes.sizes()
            open_ = (low < min(self.goal - TIGHT, enough)) & (sizes.max(axis=1) > SMALLEST)
            proven = min(proven, float(low[~open_].min(initial=np.inf)))
            if spent > NUMBERS or not open_.any():
                proven = min(proven, float(low.min()))
                break
            boxes = boxes.where(open_).halved(sizes[open_].argmax(axis=1))
        else:
            proven = min(proven, float(self._bounds(boxes, obstacle, motion, best)[0].min()))
        if np.isnan(proven):
            proven = -np.inf
        return Bound(name, proven - radius, best.sampled - radius, best.parameters, best.time)

    def nearness(self, obstacle: Obstacle, spans: Spans, motion: Motion | None = None) -> float:
        """Smallest distance of the boxes' middles from an obstacle, metres: is it near?"""
        boxes = self._first(spans)
        return float(obstacle.distance(boxes.middle() - self._moved(boxes, motion)[0]).min())

    def _first(self, spans: Spans) -> Boxes:
        """All cells during some time."""
        parts = self.enclosure.parts
        piece = (spans.step[:, None] * parts + np.arange(parts)).ravel()
        # shares of a step in the coordinates -1 to 1 of each of its pieces
        low, high = (
            (2 * (share[:, None] * parts - np.arange(parts)) - 1).ravel() for share in (spans.begin, spans.end)
        )
        meets = (low <= 1.0) & (high >= -1.0)
        return Boxes.of(self.enclosure, self.rows, piece[meets], *outwards(low[meets], high[meets]))

    def _bounds(self, boxes: Boxes, obstacle: Obstacle, motion: Motion | None, best: Bound) -> tuple[Floats, Bound]:
        """Lower bounds of the boxes' distances, and the smallest distance seen so far."""
        place, drift, bend = self._moved(boxes, motion)
        # x~ relative to the obstacle, whose chord is linear in tau: place and half its way are two coefficients
        c = boxes.c.copy()
        c[:, :, 0, 0] -= place
        c[:, :, 1, 0] -= drift
        # all that is not in the polynomial: radius, the obstacle's bend, 64 u of all numbers
        size = np.abs(c).sum(axis=(2, 3))
        extent = float(np.abs(obstacle.vertices).max())
        rounding = 64 * UNIT * (size.sum(axis=1) + np.abs(place).sum(axis=1) + extent)
        pad = (boxes.pad + bend[:, None]) * UP + rounding[:, None]
        # first bound: d_O is 1-Lipschitz, so d_O(c_00) - |sum' |c| + pad|
        middle = c[:, :, 0, 0]
        away = np.linalg.norm(size - np.abs(middle) + pad, axis=1) * UP
        low = obstacle.distance(middle) - away - rounding
        closest = self._closest(boxes, c, obstacle)
        for normal in self._directions(obstacle, middle, closest, c, boxes):
            # second bound: n x >= c_00 - sum' |c| - |n| pad for n x~ as one polynomial, less max_v n v
            along = np.einsum("bd,bdtp->btp", normal, c)
            first = along[:, 0, 0].copy()
            along[:, 0, 0] = 0.0
            spread = (np.abs(along).sum(axis=(1, 2)) + (np.abs(normal) * pad).sum(axis=1)) * UP
            gap = first - spread - (normal @ obstacle.core.T).max(axis=1) - obstacle.rounding - 4 * rounding
            low = np.maximum(low, gap - 8 * UNIT * np.abs(gap))
        # members in the middle and at the closest place: distances with the model's radius in their favour
        away = np.linalg.norm(np.maximum(pad - boxes.off, 0.0), axis=1) + 2 * rounding
        for ends in (np.zeros_like(closest), closest):
            best = self._seen(boxes, obstacle, motion, ends, away, best)
        return np.where(np.isnan(low), -np.inf, low), best

    def _linear(self, boxes: Boxes, c: Floats) -> Floats:
        """The linear terms in time and in each parameter, shape (boxes, d, 1 + parameters)."""
        lines = [c[:, :, 0, boxes.basis.line(k)] for k in range(len(boxes.wide))]
        return np.stack([c[:, :, 1, 0], *lines], axis=2)

    def _closest(self, boxes: Boxes, c: Floats, obstacle: Obstacle) -> Floats:
        """About where in each box members are closest to an obstacle, -1 to 1 in time and each parameter.

        By descent along one coordinate after the other of the linear part; any answer gives a true bound.
        """
        arms = self._linear(boxes, c)
        square = np.maximum((arms**2).sum(axis=1), 1e-300)
        found = np.zeros((len(boxes), arms.shape[2]))
        place = c[:, :, 0, 0].copy()
        for _ in range(DESCENTS):
            # along each arm in turn, the share of it that leads nearest to the obstacle, clipped to [-1, 1]
            target = _nearest(obstacle.edges, place)
            for k in range(arms.shape[2]):
                step = ((place - target) * arms[:, :, k]).sum(axis=1) / square[:, k]
                new = np.clip(found[:, k] - step, -1.0, 1.0)
                place += arms[:, :, k] * (new - found[:, k])[:, None]
                found[:, k] = new
        return found

    def _seen(
        self, boxes: Boxes, obstacle: Obstacle, motion: Motion | None, ends: Floats, away: Floats, best: Bound
    ) -> Bound:
        """The smallest distance of one member of each box, with the whole radius in its favour, if below the best."""
        begin, end = self._times(boxes)[1:]
        times = (begin + end) / 2 + ends[:, 0] * (end - begin) / 2
        moved = 0.0 if motion is None else motion.at(times)
        places = boxes.at(ends[:, 0], ends[:, 1:]) - moved
        seen = obstacle.distance(places) + away
        if boxes.off.any():
            # |n| off, along the direction n from the nearest place
            apart = np.abs(places - _nearest(obstacle.edges, places))
            lost = (apart * boxes.off).sum(axis=1) / np.maximum(np.linalg.norm(apart, axis=1), 1e-300)
            self.goal = min(self.goal, float((seen - lost).min()))
        else:
            self.goal = min(self.goal, float(seen.min()))
        k = last_lowest(seen)
        if not seen[k] < best.sampled - ALIKE:
            return best
        member = np.clip(boxes.where(np.array([k])).members(ends[[k], 1:])[0], self.lower, self.upper).tolist()
        return Bound(
            best.obstacle, best.proven, float(seen[k]), dict(zip(self.names, member, strict=True)), float(times[k])
        )

    def _directions(
        self, obstacle: Obstacle, middle: Floats, closest: Floats, c: Floats, boxes: Boxes
    ) -> Iterator[Floats]:
        """Directions of length one away from an obstacle: its best facets', and those from its nearest places."""
        # the facet with the largest n x - h, and the direction from the nearest place of the edges
        G, h = obstacle.unit_rows()
        for points in (middle, middle + np.einsum("bdk,bk->bd", self._linear(boxes, c), closest)):
            facet = G[(points @ G.T - h).argmax(axis=1)]
            apart = points - _nearest(obstacle.edges, points)
            length = np.linalg.norm(apart, axis=1, keepdims=True)
            outside = ((points @ G.T - h).max(axis=1, keepdims=True) > 0) & (length > 1e-9)
            yield facet
            yield np.where(outside, apart / np.where(outside, length, 1.0), facet)

    def _times(self, boxes: Boxes) -> tuple[Floats, Floats, Floats]:
        """The middle, the beginning and the end of each box in seconds."""
        step = self.duration / (self.steps * self.enclosure.parts)
        begin, end = (boxes.piece + (1 + share) / 2 for share in (boxes.begin, boxes.end))
        return (begin + end) / 2 * step, begin * step, end * step

    def _moved(self, boxes: Boxes, motion: Motion | None) -> tuple[Floats, Floats, Floats]:
        """An obstacle's place in the middle of each box, half its way, and how far it leaves a straight line."""
        still = np.zeros((len(boxes), self.rows.shape[0]))
        if motion is None:
            return still, still, still[:, 0]
        _, begin, end = self._times(boxes)
        here, there = motion.at(begin), motion.at(end)
        # chord of the motion on the box, and what the motion leaves it by
        return (here + there) / 2, (there - here) / 2, motion.bend(begin, end)


def _nearest(edges: Floats, points: Floats) -> Floats:
    """The nearest place on any edge to each point; `edges` has shape (edges, 2, d)."""
    found = np.empty_like(points)
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    square = np.maximum((along**2).sum(axis=1), 1e-300)
    size = max(1, BLOCK // edges.size)
    for rows in (slice(i, i + size) for i in range(0, len(points), size)):
        # projection on each edge, its share clipped to [0, 1]
        apart = points[rows, None] - start
        share = np.clip((apart * along).sum(axis=2) / square, 0.0, 1.0)
        places = start + share[..., None] * along
        nearest = np.linalg.norm(points[rows, None] - places, axis=2).argmin(axis=1)
        found[rows] = places[np.arange(len(nearest)), nearest]
    return found
