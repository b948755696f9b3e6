"""Proven clearance: lower bounds of the distance between whole cells of members and convex obstacles, refined.

A *box* is a cell of parameters and a piece of one step.  Boxes whose lower bound is too far below the best sampled
distance are halved, in the parameter or in time, whichever adds more to their size, until the bound is tight.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.enclosure import Flow, Track, growth
from ensemble_ctrl.constraints import Obstacle

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Sample = tuple[float, float, float]
"""A distance seen, with its parameter and time."""

TIGHT = 5e-4
"""Metres within which a proven clearance meets the sampled one before refinement ends."""
ROUNDS = 40
"""Largest number of halvings of one box."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes as columns: index of the centre in the track, half width, step, and the share of the step they cover."""

    centre: Ints
    half: Floats
    step: Ints
    begin: Floats
    end: Floats

    def __len__(self) -> int:
        return len(self.centre)

    def where(self, mask: NDArray[np.bool_]) -> Boxes:
        """Some of the boxes."""
        return Boxes(self.centre[mask], self.half[mask], self.step[mask], self.begin[mask], self.end[mask])

    def joined(self, other: Boxes) -> Boxes:
        """Both lists."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Boxes(*(np.concatenate(pair) for pair in pairs))


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
        Smallest distance seen, metres, so that the truth lies between the two.
    parameter, time : float
        Where it was seen.
    """

    obstacle: str
    proven: float
    sampled: float
    parameter: float
    time: float


@dataclass(eq=False)
class Prover:
    """Bounds for one flow; the track of centres is shared by all obstacles.

    Attributes
    ----------
    boxes : int
        Boxes looked at so far.
    """

    flow: Flow
    lower: float
    upper: float
    cells: int = 16
    limit: int = 200_000
    boxes: int = 0
    centres: Floats = field(init=False)
    track: Track = field(init=False)
    remainder: Floats = field(init=False)
    error: float = field(init=False)

    def __post_init__(self) -> None:
        edges = np.linspace(self.lower, self.upper, self.cells + 1)
        self.centres = (edges[:-1] + edges[1:]) / 2
        self.track = Track.of(self.flow, self.centres)
        self.remainder = self.flow.remainder()
        self.error = self.flow.rounding()

    @property
    def half(self) -> float:
        """Half width of a first cell, rounded up."""
        return (self.upper - self.lower) / self.cells / 2 * (1 + 1e-12) + 1e-15

    def bound(self, name: str, piece: Obstacle, steps: Ints, radius: float) -> Bound:
        """Proven and sampled clearance of every member from `piece` during `steps`."""
        centre, step = (i.ravel() for i in np.meshgrid(np.arange(self.cells), steps, indexing="ij"))
        boxes = Boxes(centre, np.full(len(centre), self.half), step, np.zeros(len(centre)), np.ones(len(centre)))
        best: Sample = (np.inf, np.nan, np.nan)
        proven = np.inf
        for _ in range(ROUNDS):
            if not len(boxes):
                break
            self.boxes += len(boxes)
            low, best, wide, long = self._bounds(boxes, piece, best)
            open_ = low < best[0] - TIGHT
            proven = min(proven, float(low[~open_].min(initial=np.inf)))
            if self.boxes > self.limit:
                proven = min(proven, float(low.min()))
                break
            boxes = self._halved(boxes.where(open_), (wide > long)[open_])
        else:
            proven = min(proven, float(self._bounds(boxes, piece, best)[0].min(initial=np.inf)))
        return Bound(name, proven - radius - self.error, best[0] - radius, best[1], best[2])

    def _bounds(self, boxes: Boxes, piece: Obstacle, best: Sample) -> tuple[Floats, Sample, Floats, Floats]:
        """Lower bounds, the best sample so far, and how much width and length add to each box."""
        c = self.centres[boxes.centre]
        ends = [self._at(boxes, share, c) for share in (boxes.begin, boxes.end)]
        corners = np.stack([p + sign * boxes.half[:, None] * d for p, d in ends for sign in (1.0, -1.0)], axis=1)
        radius = growth(
            self.flow, boxes.step, (boxes.end - boxes.begin) * self.flow.step, c, boxes.half, self.remainder
        )
        distance = piece.distance(ends[0][0])
        k = int(distance.argmin())
        time = (boxes.step[k] + boxes.begin[k]) * self.flow.step
        best = min(best, (float(distance[k]), float(c[k]), float(time)))
        middle = (ends[0][0] + ends[1][0]) / 2
        reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1) + radius
        low = piece.distance(middle) - reach
        near = low < best[0] - TIGHT
        low[near] = np.maximum(low[near], separation(corners[near], piece.vertices) - radius[near])
        wide = boxes.half * np.maximum(*(np.linalg.norm(d, axis=1) for _, d in ends))
        wide += boxes.half**2 / 2 * self.remainder[boxes.step + 1]
        long = np.linalg.norm(ends[1][0] - ends[0][0], axis=1) / 2
        return low, best, wide, long

    def _at(self, boxes: Boxes, share: Floats, c: Floats) -> tuple[Floats, Floats]:
        """Position and slope at a share of each box's step."""
        move, slope = self.flow.moved(boxes.step, share, c)
        at = boxes.centre, boxes.step
        return self.track.position[at] + move, self.track.slope[at] + slope

    def _halved(self, boxes: Boxes, wide: NDArray[np.bool_]) -> Boxes:
        """Each box in two: in the parameter where that is the larger side, else in time."""
        across, along = boxes.where(wide), boxes.where(~wide)
        middle = (along.begin + along.end) / 2
        early = Boxes(along.centre, along.half, along.step, along.begin, middle)
        late = Boxes(along.centre, along.half, along.step, middle, along.end)
        return self._narrowed(across).joined(early).joined(late)

    def _narrowed(self, boxes: Boxes) -> Boxes:
        """Each box split in the parameter; new centres join the track."""
        half = boxes.half / 2
        c = self.centres[boxes.centre]
        wanted = np.concatenate([c - half, c + half])
        new, index = np.unique(wanted, return_inverse=True)
        index = index + len(self.centres)
        self.centres = np.concatenate([self.centres, new])
        if len(new):
            self.track = self.track.joined(Track.of(self.flow, new))
        twice = [np.concatenate([part, part]) for part in (boxes.step, boxes.begin, boxes.end)]
        widths = np.concatenate([half, half]) * (1 + 1e-12)
        return Boxes(index, widths, twice[0], twice[1], twice[2])


def separation(corners: Floats, vertices: Floats) -> Floats:
    """A lower bound of the signed distance between quadrilaterals and a convex polygon, by the best line tried.

    Parameters
    ----------
    corners : ndarray, shape (boxes, 4, 2)
        Metres.
    vertices : ndarray, shape (k, 2)
        Corners of the polygon, counter-clockwise.

    Notes
    -----
    *Guarantee*: never above the true distance, since any line that separates two convex sets bounds it.
    """
    edges = np.roll(vertices, -1, axis=0) - vertices
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    sides = corners[:, [1, 3, 2, 0]] - corners[:, [0, 1, 3, 2]]
    normals = np.stack([sides[..., 1], -sides[..., 0]], axis=-1)
    towards = (corners[:, :, None] - vertices).reshape(len(corners), 4 * len(vertices), 2)
    fixed = np.broadcast_to(outward, (len(corners), *outward.shape))
    tried = np.concatenate([fixed, normals, -normals, towards], axis=1)
    length = np.linalg.norm(tried, axis=2, keepdims=True)
    tried = np.where(length > 1e-12, tried / np.where(length > 1e-12, length, 1.0), [1.0, 0.0])
    gap = (tried @ corners.transpose(0, 2, 1)).min(axis=2) - (tried @ vertices.T).max(axis=2)
    return np.asarray(gap.max(axis=1))
