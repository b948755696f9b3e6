"""Where a fleet of any system is during each step: hulls of polynomials' linear parts, grown by all that bends them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.enclosure import Ints, signs_of
from ensemble_ctrl.certificate.general.basis import UNIT, UP
from ensemble_ctrl.certificate.general.boxes import Boxes
from ensemble_ctrl.certificate.general.enclosure import Enclosure

Floats = NDArray[np.float64]

TIGHT = 2e-3
"""Metres of radius below which parts are not made smaller."""
MOST_CELLS = 128
"""Parts of each step at most, in time and in the parameters, beyond the slices that are wanted."""
ARMS = 5
"""Linear terms of a hull; the others grow it."""


def hulls(enclosure: Enclosure, rows: Floats, steps: int, slices: int = 1, timed: float = 0.0) -> tuple[Floats, Floats]:
    """Points and radii for each step and part of it, shapes (steps, parts, points, d) and (steps, parts).

    Parameters
    ----------
    enclosure : Enclosure
        Of all members.
    rows : ndarray, shape (d, states)
        The position in the states.
    steps : int
        Steps of the controls.
    slices : int
        Parts of the first parameter's range at least, if it has a width: the parts of a step are in its order.
    timed : float
        Seconds of a step; if not zero, time is the first coordinate of the points, one more than `d`.

    Notes
    -----
    *Guarantee*: every member is, at every instant of a step, in the hull of one of the parts' points, grown by its
    radius; rounding included.
    """
    pieces = np.arange(steps * enclosure.parts)
    whole = np.ones(len(pieces))
    # all cells on whole pieces, cut into slices of the first parameter, then where they bend most
    boxes = Boxes.of(enclosure, rows, pieces, -whole, whole)
    if 0 in enclosure.wide:
        while len(np.unique(boxes.centre[:, 0])) < slices:
            boxes = _all_halved(boxes, 1 + int(np.flatnonzero(enclosure.wide == 0)[0]))
    most = max(len(boxes), MOST_CELLS * steps)
    while 2 * len(boxes) <= most and _radius(boxes)[1].max() > TIGHT:
        boxes = _all_halved(boxes, int(_bends(boxes).argmax()))
    # parts of a step in the order of the first parameter, the piece of time and its part
    step = boxes.piece // enclosure.parts
    first = boxes.centre[:, 0] if boxes.centre.shape[1] else np.zeros(len(boxes))
    boxes = boxes.where(np.lexsort((boxes.begin, boxes.piece, first, step)))
    arms, radius = _radius(boxes)
    middle = boxes.c[:, :, 0, 0]
    # time as a coordinate: its middle, and half its length as one more arm
    if timed:
        piece = timed / enclosure.parts
        begin, end = (piece * (boxes.piece + (1 + share) / 2) for share in (boxes.begin, boxes.end))
        middle = np.column_stack([(begin + end) / 2, middle])
        moves = np.zeros((len(boxes), 1, arms.shape[2]))
        moves[:, 0, 0] = (end - begin) / 2
        arms = np.concatenate([moves, arms], axis=1)
    # corners of the linear part: c_00 +- every arm
    points = middle[:, None] + signs_of(arms.shape[2]) @ arms.transpose(0, 2, 1)
    return points.reshape(steps, -1, *points.shape[1:]), radius.reshape(steps, -1)


def _all_halved(boxes: Boxes, side: int) -> Boxes:
    """All boxes in two along the same side."""
    return boxes.halved(np.full(len(boxes), side))


def _linear(boxes: Boxes) -> tuple[Floats, Floats]:
    """The linear terms in time and in the parameters, shape (boxes, d, 1 + parameters), and sizes of the bent ones."""
    lines: Ints = np.array([boxes.basis.line(k) for k in range(len(boxes.wide))], dtype=np.int64)
    # |c| of all terms but the constant and the linear ones
    bent = np.abs(boxes.c)
    bent[:, :, 0, 0] = bent[:, :, 1, 0] = 0.0
    bent[:, :, 0, lines] = 0.0
    return np.concatenate([boxes.c[:, :, 1, :1], boxes.c[:, :, 0, lines]], axis=2), bent


def _radius(boxes: Boxes) -> tuple[Floats, Floats]:
    """The arms of the hulls, shape (boxes, d, arms), that of time first, and what grows them, shape (boxes,)."""
    linear, bent = _linear(boxes)
    # the longest arms span the hull; sum |c| of all other terms and the pad are its radius
    longest = 1 + np.argsort(-np.linalg.norm(linear[:, :, 1:], axis=1).max(axis=0), kind="stable")
    kept, others = (np.append(0, longest[: ARMS - 1]), longest[ARMS - 1 :])
    rest = bent.sum(axis=(2, 3)) + np.abs(linear[:, :, others]).sum(axis=2) + boxes.pad
    rounding = 64 * UNIT * np.abs(boxes.c).sum(axis=(2, 3))
    return linear[:, :, kept], np.linalg.norm(rest + rounding, axis=1) * UP


def _bends(boxes: Boxes) -> Floats:
    """How much of what is not linear depends on time and on each parameter, shape (1 + parameters,)."""
    bent = _linear(boxes)[1].sum(axis=(0, 1))
    return np.array([bent[1:].sum(), *(bent[:, uses].sum() for uses in (boxes.basis.exponents > 0).T)])
