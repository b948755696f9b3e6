"""Proven clearance: lower bounds of the distance between whole cells of members and convex obstacles, refined.

Parameters that only shift the start need no cells: the smallest distance over a box of shifts is the distance to the
obstacle grown by that box.  For the others, a *box* is a cell of parameters and a piece of one step.  Boxes whose lower
bound is too far below the best sampled distance are halved, in a parameter or in time, whichever adds most to their
size, until the bound is tight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.bodies import Body
from ensemble_ctrl.certificate.bound import Bound
from ensemble_ctrl.certificate.boxes import Boxes
from ensemble_ctrl.certificate.disturbance import UNIT
from ensemble_ctrl.certificate.enclosure import CELLS, START, Flow, Track, first_cells, lowered, signs_of
from ensemble_ctrl.certificate.instants import Spans

if TYPE_CHECKING:
    from ensemble_ctrl.constraints.footprint import Footprint
    from ensemble_ctrl.constraints.motion import Motion
    from ensemble_ctrl.constraints.obstacle import Obstacle
    from ensemble_ctrl.problem.ensemble import Member

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Sample = tuple[float, int, int, float]
"""A distance seen, with the centre's index, the step, and the share of it."""
NOWHERE: Sample = (np.inf, 0, 0, 0.0)

TIGHT = 5e-4
"""Metres within which a proven clearance meets the sampled one before refinement ends."""
SHIFTS = 41
"""Starts tried along each side of their box for the closest one."""
ROUNDS = 40
"""Largest number of halvings of one box."""


@dataclass(eq=False)
class Prover:
    """Bounds for one flow; the track of centres is shared by all obstacles.

    Parameters
    ----------
    whole : Flow
        The flow, start positions included.
    names : sequence of str
        Its parameters.
    limit : int
        Boxes looked at for one obstacle before the search for a better bound ends.
    cells : int
        Cells of each parameter to begin with; 0 for `CELLS`.
    early : bool
        Whether spans begin as long before the time meant as robots may be late, so that a delay moves nobody away from
        places that robots were at in the span.

    Attributes
    ----------
    boxes : int
        Boxes looked at so far.
    """

    whole: Flow
    names: Sequence[str]
    limit: int = 200_000
    cells: int = 0
    early: bool = False
    boxes: int = 0
    flow: Flow = field(init=False)
    shift: Floats = field(init=False)
    centres: Floats = field(init=False)
    half: Floats = field(init=False)
    track: Track = field(init=False)
    error: float = field(init=False)
    body: Body = field(init=False)
    signs: Floats = field(init=False)
    growth: Floats = field(init=False)
    _known: dict[bytes, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.flow, self.shift = self.whole.bent(), self.whole.shift()
        count = len(self.flow.lower)
        self.centres, self.half = first_cells(self.flow.lower, self.flow.upper, self.cells or CELLS.get(count, 2))
        self.track = Track.of(self.flow, self.centres)
        self.error = self.whole.rounding()
        self.body = Body(self.flow)
        self.signs = signs_of(count)
        self.growth = self._grown(None)

    def _grown(self, motion: Motion | None, more: Floats | None = None) -> Floats:
        """Metres by which robots of each first cell may be away from their motion, beside an obstacle that may move.

        Shape (cells, steps).
        """
        flow, same = self.flow, not self.cells or self.cells == self.flow.grid
        late = 0.0 if self.early and motion is None else flow.lag
        away = flow.error if flow.errors is None or not same else flow.errors
        return np.broadcast_to(away + late + (0.0 if more is None else more), (len(self.half), flow.steps))

    def nearness(self, obstacle: Obstacle, spans: Spans, motion: Motion | None = None) -> float:
        """Smallest distance of the first cells' middles at the beginnings of steps, metres: is the obstacle near?"""
        return float(self._middles(obstacle, spans.step, motion).min(initial=np.inf))

    def _middles(self, obstacle: Obstacle, steps: Ints, motion: Motion | None) -> Floats:
        """Distance of the first cells' middles from an obstacle at the beginnings of `steps`, shape (cells, steps)."""
        moved = _moved(motion, self.flow.begin[steps])
        return obstacle.distance(self.track.position[: len(self.half), steps] - moved)

    @cached_property
    def _reach(self) -> Floats:
        """How far members of a first cell get from its middle at the beginning of each step, shape (cells, steps)."""
        n, count = np.arange(self.flow.steps), len(self.half)
        place = self.track.position[:count]
        # linear part: sum_k half_k |dp/dq_k| at the grid times
        arms = np.abs(self.half)[:, None, :] * np.linalg.norm(self.track.slope[:count], axis=-1)
        width = arms.sum(axis=-1)
        half = np.broadcast_to(self.half[:, None], (count, self.flow.steps, self.half.shape[1]))
        coeffs = np.broadcast_to(self.flow.coefficients(self.centres[:count])[:, None], (count, self.flow.steps, 5))
        span = np.broadcast_to(self.flow.step, (count, self.flow.steps))
        # what the linear picture misses: the remainder, and the curve's distance from its chord
        radius = self.flow.remainder_at(half, n + 1) + self.flow.growth(n, span, coeffs, half)
        # a step stays within the larger of its two ends' reaches, plus that
        moved = np.linalg.norm(np.diff(place, axis=1), axis=2) + width[:, 1:]
        return np.asarray(np.maximum(width[:, :-1], moved) + radius)

    def bound(
        self,
        name: str,
        obstacle: Obstacle,
        spans: Spans,
        radius: float,
        motion: Motion | None = None,
        growth: Floats | None = None,
        enough: float = np.inf,
        footprint: Footprint | None = None,
    ) -> Bound:
        """Proven and sampled clearance of every member from `obstacle`, which may move, during `spans`.

        Parameters
        ----------
        growth : ndarray, shape (steps of the flow,), optional
            Metres by which every member grows during each step, beyond `radius` and the errors of the flow.
        enough : float
            Metres; what is proven to be further away isn't looked at more closely.
        footprint : Footprint, optional
            The bodies of the members; points without one.

        Notes
        -----
        *Guarantee*: nothing is claimed where numbers overflow: then `proven` is minus infinity. What is seen is of
        robots that grow by `growth`, but follow the flow without errors.
        """
        self.growth, self.body = self._grown(motion, growth), Body(self.flow, footprint)
        self.error = self.whole.rounding() + self.body.rounding()
        if not (np.isfinite(self.error) and np.isfinite(self.growth).all()):
            return Bound(name, -np.inf, np.inf, {}, np.nan)
        enough += radius + self.error
        piece = obstacle.widened(self.shift) if self.shift.any() else obstacle
        boxes, proven, best = self._near(piece, spans, motion, enough)
        spent = self.boxes
        for left in reversed(range(ROUNDS + 1)):
            if not len(boxes):
                break
            self.boxes += len(boxes)
            low, best, sides = self._bounds(boxes, piece, motion, best)
            # branch and bound: split only boxes whose lower bound is below the best distance seen
            open_ = low < min(best[0] - TIGHT, enough)
            last = not left or self.boxes - spent > self.limit
            proven = min(proven, float(low[~open_ | last].min(initial=np.inf)))
            if last:
                break
            boxes = self._halved(boxes.where(open_), sides[open_].argmax(axis=1))
        sampled, member = self._closest(obstacle, motion, best)
        sampled += 0.0 if growth is None else -growth[best[2]]
        proven, sampled = proven - radius - self.error, sampled - radius + self.error
        known = np.isfinite([best[0], sampled]).all()
        return Bound(name, proven if known else -np.inf, sampled if known else np.inf, member, self._time(best))

    def _near(self, piece: Obstacle, spans: Spans, motion: Motion | None, enough: float) -> tuple[Boxes, float, Sample]:
        """The boxes to begin with, but for those that are clearly far; a bound for these; the best sample."""
        cells, steps = len(self.half), spans.step
        centre = np.repeat(np.arange(cells), len(steps))
        begin, end = np.tile(spans.begin, cells), np.tile(spans.end, cells)
        boxes = Boxes(centre, centre, self.half[centre], np.tile(steps, cells), begin, end)
        distance, reach = self._middles(piece, steps, motion), self._reach[:, steps]
        # no corner is farther from the planned point than the body's reach
        distance, reach = distance - self.growth[:, steps], reach + self.body.reach
        if motion is not None:
            # a moving obstacle covers at most its way in the step and its bend off that chord
            first, last = self.flow.begin[steps], self.flow.begin[steps] + self.flow.step[steps]
            reach = reach + np.linalg.norm(motion.at(last) - motion.at(first), axis=-1) + motion.bend(first, last)
        # distance is 1-Lipschitz: no member of a cell is closer than its middle less its reach
        low = lowered((distance - reach).ravel())
        best = self._best(boxes, self._seen(boxes, piece, motion, distance.ravel()), NOWHERE)
        far = low >= min(best[0] - TIGHT, enough)
        return boxes.where(~far), float(low[far].min(initial=np.inf)), best

    def _seen(self, boxes: Boxes, piece: Obstacle, motion: Motion | None, distance: Floats) -> Floats:
        """Distances of the boxes' middles where they begin, given those where their steps begin."""
        late, seen = (boxes.begin > 0) | (self.body.footprint is not None), distance.copy()
        some = boxes.where(late)
        if len(some):
            coeffs = self.flow.coefficients(self.centres[some.centre])
            here = self._at(some, some.begin, coeffs)[0] - _moved(motion, self._times(some, some.begin))
            seen[late] = (
                self.body.distance(piece, here, some.step, some.begin, coeffs) - self.growth[some.cell, some.step]
            )
        return seen

    def _best(self, boxes: Boxes, distance: Floats, best: Sample) -> Sample:
        """The closest of the boxes' middles where they begin, if it is closer than the best so far."""
        k = int(distance.argmin())
        seen = float(distance[k]), int(boxes.centre[k]), int(boxes.step[k]), float(boxes.begin[k])
        return min(best, seen, key=lambda sample: sample[0])

    def _times(self, boxes: Boxes, share: Floats) -> Floats:
        """The instants at a share of each box's step, seconds."""
        return np.asarray(self.flow.begin[boxes.step] + share * self.flow.step[boxes.step])

    def _time(self, sample: Sample) -> float:
        """When a distance was seen, seconds."""
        _, _, n, share = sample
        return float(self.flow.begin[n] + share * self.flow.step[n])

    def _closest(self, obstacle: Obstacle, motion: Motion | None, best: Sample) -> tuple[float, Member]:
        """The distance of a real member near the best sample, and its parameters: shifts are tried on a grid."""
        flow, (_, centre, n, share) = self.whole, best
        bends: NDArray[np.bool_] = np.asarray(flow.directions[:, :3].any(axis=1))
        axes = [np.linspace(*ends, SHIFTS) for ends in zip(flow.lower[~bends], flow.upper[~bends], strict=True)]
        # starts on a grid of their box: a member that exists, for the sampled distance
        shifts = (
            np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes)) if axes else np.zeros((1, 0))
        )
        members = np.empty((len(shifts), len(bends)))
        members[:, bends], members[:, ~bends] = self.centres[centre], shifts
        move, _ = self.flow.moved(np.array([n]), np.array([share]), self.flow.coefficients(self.centres[[centre]]))
        middle = self.track.position[centre, n] + move[0]
        coeffs = flow.coefficients(members)
        place = middle + (coeffs[:, START] - self.flow.origin[START]) - _moved(motion, np.array(self._time(best)))
        distance = self.body.distance(obstacle, place, np.full(len(members), n), np.array(share), coeffs)
        k = int(distance.argmin())
        return float(distance[k]), dict(zip(self.names, members[k].tolist(), strict=True))

    def _bounds(
        self, boxes: Boxes, piece: Obstacle, motion: Motion | None, best: Sample
    ) -> tuple[Floats, Sample, Floats]:
        """Lower bounds, the best sample so far, and what time and each parameter add to every box's size."""
        coeffs = self.flow.coefficients(self.centres[boxes.centre])
        (here, slope), (there, slope_there) = (self._at(boxes, share, coeffs) for share in (boxes.begin, boxes.end))
        begin, end = (self._times(boxes, share) for share in (boxes.begin, boxes.end))
        here, there = here - _moved(motion, begin), there - _moved(motion, end)
        distance = self.body.distance(piece, here, boxes.step, boxes.begin, coeffs)
        grown = self.growth[boxes.cell, boxes.step]
        best = self._best(boxes, distance - grown, best)
        # all that is not in the hull: growth, remainder, the chords of the curve and of the obstacle's way
        curvature = self._curvature(boxes, boxes.half)
        span = (boxes.end - boxes.begin) * self.flow.step[boxes.step]
        growth = self.flow.growth(boxes.step, span, coeffs, boxes.half)
        growth = growth + self.body.growth(boxes.step, span, coeffs, boxes.half)
        radius = grown + curvature + growth + (0.0 if motion is None else motion.bend(begin, end))
        # corners of the parallelograms p + sum_k +-half_k dp/dq_k at both ends of the box, p every corner of a body
        bodies = [self.body.corners(boxes.step, share, coeffs) for share in (boxes.begin, boxes.end)]
        places = [p[:, None] + at for p, (at, _) in zip((here, there), bodies, strict=True)]
        pairs = zip((slope, slope_there), bodies, strict=True)
        arms = [boxes.half[:, None, :, None] * (s[:, None] + own) for s, (_, own) in pairs]
        count = places[0].shape[1]
        points = [p[:, :, None] + self.signs @ a for p, a in zip(places, arms, strict=True)]
        corners = np.concatenate([p.reshape(len(p), count * len(self.signs), 2) for p in points], axis=1)
        # first bound: the distance of the middle less the farthest corner; where it is too weak, a separating line
        middle = (here + there) / 2
        low = piece.distance(middle) - np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1) - radius
        near = low < best[0] - TIGHT
        half = corners.shape[1] // 2
        flat = [a[near].reshape(int(near.sum()), count * boxes.half.shape[1], 2) for a in arms]
        own = self.body.sides(bodies[0][0][near])
        sides = np.concatenate([*flat, corners[near, half:] - corners[near, :half], own], axis=1)
        ends = None if self.body.footprint is None else (places[0][near] + places[1][near]) / 2
        apart = separation(corners[near], sides, piece.core, ends) - piece.rounding
        low[near] = np.maximum(low[near], apart - radius[near])
        # sizes that decide which side is split: half of the way in time, and each parameter's width
        speed = np.abs(coeffs[:, 0] * self.flow.v[boxes.step])  # an arc of a full circle has no chord
        way = (speed + self.body.reach * np.abs(coeffs[:, 1] * self.flow.omega[boxes.step])) * span
        long = np.maximum(way, np.linalg.norm(there - here, axis=1)) / 2
        return lowered(low), best, np.column_stack([long, self._widths(boxes, arms, curvature)])

    def _widths(self, boxes: Boxes, arms: Sequence[Floats], curvature: Floats) -> Floats:
        """What each parameter's width adds to a box, shape (boxes, parameters); `curvature` is the nonlinear part."""
        # linear width of each parameter, of the farthest corner, and what the remainder loses without it
        widths = np.maximum(*(np.linalg.norm(a, axis=3).max(axis=1) for a in arms))
        for k in range(widths.shape[1]):
            without = boxes.half.copy()
            without[:, k] = 0.0
            widths[:, k] += curvature - self._curvature(boxes, without)
        return np.asarray(widths)

    def _curvature(self, boxes: Boxes, half: Floats) -> Floats:
        """How far members, and the corners of their bodies, leave the linear picture in cells of these half widths."""
        return np.asarray(self.flow.remainder_at(half, boxes.step + 1) + self.body.remainder(half, boxes.step))

    def _at(self, boxes: Boxes, share: Floats, coeffs: Floats) -> tuple[Floats, Floats]:
        """Position and slope at a share of each box's step."""
        move, slope = self.flow.moved(boxes.step, share, coeffs)
        at = boxes.centre, boxes.step
        return self.track.position[at] + move, self.track.slope[at] + slope

    def _halved(self, boxes: Boxes, side: Ints) -> Boxes:
        """Each box in two: side 0 is time, side k + 1 the parameter k."""
        along = boxes.where(side == 0)
        middle = (along.begin + along.end) / 2
        early, late = replace(along, end=middle), replace(along, begin=middle)
        halves = early.joined(late)
        across = side > 0
        return halves.joined(self._narrowed(boxes.where(across), side[across] - 1)) if across.any() else halves

    def _narrowed(self, boxes: Boxes, k: Ints) -> Boxes:
        """Each box split in the parameter k; new centres join the track."""
        rows = np.arange(len(boxes))
        half, move = boxes.half.copy(), np.zeros_like(boxes.half)
        half[rows, k] /= 2
        move[rows, k] = half[rows, k]
        c = self.centres[boxes.centre]
        # rounded up, so that both halves cover the box
        half[rows, k] = half[rows, k] * (1 + 1e-12) + UNIT * np.abs(c[rows, k])
        new, index = np.unique(np.concatenate([c - move, c + move]), axis=0, return_inverse=True)
        index = self._tracked(new)[index.ravel()]
        columns = boxes.cell, half, boxes.step, boxes.begin, boxes.end
        twice = [np.concatenate([part, part]) for part in columns]
        return Boxes(index, *twice)

    def _tracked(self, centres: Floats) -> Ints:
        """Indices of centres in the track; those that no obstacle has needed before join it."""
        keys = [centre.tobytes() for centre in centres]
        fresh = [k for k, key in enumerate(keys) if key not in self._known]
        if fresh:
            self._known.update((keys[k], len(self.centres) + i) for i, k in enumerate(fresh))
            self.centres = np.concatenate([self.centres, centres[fresh]])
            self.track = self.track.joined(Track.of(self.flow, centres[fresh]))
        return np.array([self._known[key] for key in keys], dtype=np.int64)


def _moved(motion: Motion | None, times: Floats) -> Floats:
    """Displacement of an obstacle at some times, shape (..., 2): members are looked at from where it is."""
    return np.zeros((*times.shape, 2)) if motion is None else motion.at(times)


def separation(corners: Floats, sides: Floats, vertices: Floats, ends: Floats | None = None) -> Floats:
    """A lower bound of the signed distance between hulls of points and a convex polygon, by the best line tried.

    Parameters
    ----------
    corners : ndarray, shape (boxes, points, 2)
        Metres.
    sides : ndarray, shape (boxes, sides, 2)
        Directions along which the hulls may have sides.
    vertices : ndarray, shape (k, 2)
        Corners of the polygon, counter-clockwise.
    ends : ndarray, shape (boxes, points, 2), optional
        Points to which directions from the vertices are tried: the corners if they are few, or their middle.

    Notes
    -----
    *Guarantee*: never above the true distance, since any line that separates two convex sets bounds it.
    """
    edges = np.roll(vertices, -1, axis=0) - vertices
    # candidate lines: the polygon's faces, the hull's sides, and directions from vertices to corners
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    normals = np.stack([sides[..., 1], -sides[..., 0]], axis=-1)
    if ends is None:
        ends = corners if corners.shape[1] <= 8 else corners.mean(axis=1, keepdims=True)
    towards = (ends[:, :, None] - vertices).reshape(len(corners), ends.shape[1] * len(vertices), 2)
    fixed = np.broadcast_to(outward, (len(corners), *outward.shape))
    tried = np.concatenate([fixed, normals, -normals, towards], axis=1)
    length = np.linalg.norm(tried, axis=2, keepdims=True)
    tried = np.where(length > 1e-12, tried / np.where(length > 1e-12, length, 1.0), [1.0, 0.0])
    gap = (tried @ corners.transpose(0, 2, 1)).min(axis=2) - (tried @ vertices.T).max(axis=2)
    return np.asarray(gap.max(axis=1))
