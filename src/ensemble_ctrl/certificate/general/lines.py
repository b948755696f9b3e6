"""Where the members of cells of any system are during pieces of time: straight lines, and all that leaves them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.apart import Lines
from ensemble_ctrl.certificate.general.basis import UNIT, UP
from ensemble_ctrl.certificate.general.boxes import Boxes
from ensemble_ctrl.certificate.general.proof import GeneralProof

if TYPE_CHECKING:
    from ensemble_ctrl.moments import Distribution
    from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]


def of_states(
    problem: Problem, controls: Floats, distributions: Mapping[str, Distribution]
) -> Callable[[int, int], Lines]:
    """The lines of a system that an ODE defines, from the polynomials of its enclosure.

    Raises
    ------
    Unenclosed
        If it has no enclosure.
    """
    enclosure = GeneralProof(problem, controls, distributions).enclosure
    rows = np.eye(len(problem.fleet.states))[problem.fleet.place_columns]
    pieces = np.arange(len(controls) * enclosure.parts)
    span = problem.duration / len(pieces)

    def lines(each: int, cut: int) -> Lines:
        whole = np.ones(len(pieces))
        boxes, parts = Boxes.of(enclosure, rows, pieces, -whole, whole), 1
        while parts < cut:
            boxes, parts = boxes.halved(np.zeros(len(boxes), dtype=np.int64)), 2 * parts
        # every parameter halved until there are so many cells of each, at least one
        for side in range(1, 1 + len(boxes.wide)):
            cells = 1
            while cells < each:
                boxes, cells = boxes.halved(np.full(len(boxes), side)), 2 * cells
        boxes = boxes.where(np.lexsort((*boxes.centre.T, boxes.begin, boxes.piece)))
        shape = (len(pieces) * parts, -1)
        # |T_k| <= 1: constant and linear terms in time are the line, sum |c| of all others and the pad the radius
        middle, arm = boxes.c[:, :, 0, 0], boxes.c[:, :, 1, 0]
        rest = np.abs(boxes.c)
        size = rest.sum(axis=(2, 3))
        rest[:, :, 0, 0] = rest[:, :, 1, 0] = 0.0
        radius = np.linalg.norm(rest.sum(axis=(2, 3)) + boxes.pad + 64 * UNIT * size, axis=1) * UP
        ends = [(middle + way * arm).reshape(*shape, rows.shape[0]) for way in (-1.0, 1.0)]
        radius = radius.reshape(shape)
        members = boxes.centre[: radius.shape[1]]
        # ends of the pieces in seconds, from shares of -1 to 1
        at = boxes.piece.reshape(shape)[:, 0]
        begin, end = ((at + (1 + share.reshape(shape)[:, 0]) / 2) * span for share in (boxes.begin, boxes.end))
        return Lines(ends[0], ends[1], radius, radius, members, begin, end)

    return lines
