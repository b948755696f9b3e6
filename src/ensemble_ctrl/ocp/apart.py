r"""Members of different starts keep apart: rows of the program of one frame, and how far a plan keeps them.

A member with parameters ``a`` of one start and one with ``b`` of another, whose places differ by ``delta``, are
``delta + P_a - P_b`` apart in the common frame.  They are at least ``d`` apart if, for a direction ``n`` that is fixed
in a round::

    n . (P_a - P_b) >= d + margin + spare - n . delta        for every two points a, b of the fleet

At every grid time ``n`` is the direction in which the guess keeps them furthest.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.parametrisation import Parametrisation
from ensemble_ctrl.ocp.program import Block, Build
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.starts import Pair

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

DIRECTIONS = 96
"""Directions that are tried, beside that from one start to the other."""


def apart_rows(problem: Problem, model: Parametrisation, spare: float) -> list[Block]:
    """Rows for the pairs and grid times in reach of each other under the guess, each with a slack of its own."""
    layout = model.layout
    curve = model.curve[..., problem.fleet.place_columns]
    image = np.eye(curve.shape[1]) if model.places is None else model.places
    points, d = image @ curve, curve.shape[2]
    blocks = []
    for pair in problem.pairs:
        normal, room = _directions(pair, points)
        when = np.flatnonzero(_during(problem, pair, len(points)) & (room < 2 * pair.distance))
        if not len(when) or len(image) < 2:
            continue
        level = pair.distance + problem.solve.margin + spare - normal[when] @ np.array(pair.offset)
        columns = np.column_stack([layout.slack(len(when)), layout.points[when][:, model.position_columns]])
        rows = np.zeros((len(when), len(image) * (len(image) - 1)))
        build = _kept_apart(image, d)
        blocks.append(Block("apart", build, columns, np.column_stack([normal[when], level]), rows, rows + np.inf))
    return blocks


def _kept_apart(image: Floats, d: int) -> Build:
    """The rows of one pair at one time, for every two points that `image` makes of the fleet's variables."""
    n = image.shape[1]
    first, second = np.nonzero(~np.eye(len(image), dtype=bool))
    # row (a, b): the difference of the points a and b
    matrix = ca.DM(image[first] - image[second])

    def build(z: ca.SX, data: ca.SX) -> ca.SX:
        along = sum((data[i] * z[1 + i * n : 1 + (i + 1) * n] for i in range(1, d)), data[0] * z[1 : 1 + n])
        rows: ca.SX = ca.mtimes(matrix, along) - data[d] + z[0]
        return rows

    return build


def apart_gap(problem: Problem, points: Floats) -> float:
    """How much further than wanted the pairs are, for points of the fleet of shape (times, points, d), metres.

    Notes
    -----
    *Guarantee*: never above the true least distance of the points, less what is wanted, at these times.
    """
    found = (
        float((_directions(pair, points)[1] - pair.distance)[_during(problem, pair, len(points))].min(initial=np.inf))
        for pair in problem.pairs
    )
    return min(found, default=np.inf)


def _during(problem: Problem, pair: Pair, times: int) -> NDArray[np.bool_]:
    """Which of evenly spaced times are in a pair's window."""
    at = np.linspace(0.0, problem.duration, times)
    return np.asarray((at >= pair.begin - 1e-9) & (at <= pair.end + 1e-9))


def _directions(pair: Pair, points: Floats) -> tuple[Floats, Floats]:
    """At every time the direction in which a pair is furthest apart, shape (times, d), and how far, metres."""
    offset = np.array(pair.offset)
    tried = _tried(offset)
    # n . delta less the extent of the fleet along n
    along = points @ tried.T
    room = tried @ offset - (along.max(axis=1) - along.min(axis=1))
    best = room.argmax(axis=1)
    return tried[best], room[np.arange(len(points)), best]


def _tried(offset: Floats) -> Floats:
    """Unit vectors, shape (directions, d), that from one start to the other first."""
    own = np.asarray(offset / np.linalg.norm(offset), dtype=float)
    turns = np.arange(DIRECTIONS if len(offset) > 1 else 0)
    if len(offset) < 3:
        angle = 2 * np.pi * turns / DIRECTIONS
        return np.vstack([own, np.stack([np.cos(angle), np.sin(angle)], axis=1)[:, : len(offset)]])
    # a Fibonacci lattice on the sphere
    z, around = 1 - (2 * turns + 1) / DIRECTIONS, np.pi * (3 - 5**0.5) * turns
    flat = np.sqrt(1 - z**2)
    return np.vstack([own, np.stack([flat * np.cos(around), flat * np.sin(around), z], axis=1)])
