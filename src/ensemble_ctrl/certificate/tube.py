"""Where the whole fleet is during each step: hulls that hold every member, for drawing and for other programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.enclosure import CELLS, Flow, Ints, Track, first_cells, signs_of
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.moments import Distribution
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

TIGHT = 2e-3
"""Metres of radius below which cells are not made smaller."""
MOST_CELLS = 512


@dataclass(frozen=True, eq=False)
class Tube:
    """Hulls of points, each grown by a radius, for every step and cell of parameters.

    Attributes
    ----------
    points : ndarray, shape (steps, cells, points, d)
        Metres.
    radius : ndarray, shape (steps, cells)
        Metres.

    Notes
    -----
    *Guarantee*: every member with its parameters in the ranges is, at every instant of a step and under every
    disturbance within the fleet's bounds, in the hull of the points of one of the cells, grown by its radius; rounding
    included.
    """

    points: Floats
    radius: Floats


def tube(problem: Problem, controls: Floats, ranges: Mapping[str, Distribution] | None = None) -> Tube:
    """The tube of the fleet, or of one with other ranges of the same parameters.

    Parameters
    ----------
    problem : Problem
        Whose fleet moves.
    controls : ndarray, shape (steps, n_u)
        Broadcast commands.
    ranges : mapping of str to Distribution, optional
        The distributions of all parameters, instead of the fleet's.

    Raises
    ------
    Unenclosed
        For a system that is defined by an ODE, if it has no enclosure.
    """
    if problem.fleet.enclosure == "general":
        return general(problem, controls, ranges or problem.fleet.parameters)
    whole = Flow.of(problem, controls, ranges)
    flow, shift = whole.bent(), whole.shift()
    each = CELLS.get(len(flow.lower), 2)
    found = enclosed(flow, each)
    away = whole.error + whole.lag
    while (
        (found.radius - away[:, None]).max() > TIGHT and (2 * each) ** len(flow.lower) <= MOST_CELLS and len(flow.lower)
    ):
        # twice as many cells of each parameter: the remainder falls with the square of their width
        each *= 2
        found = enclosed(flow, each)
    # members that only start elsewhere: the Minkowski sum with the box of starts
    corners = shift * signs_of(2) if shift.any() else np.zeros((1, 2))
    points = (found.points[..., None, :] + corners).reshape(*found.points.shape[:2], -1, 2)
    return Tube(points, found.radius + whole.rounding())


def general(
    problem: Any, controls: Floats, ranges: Mapping[str, Distribution], slices: int = 1, timed: float = 0.0
) -> Tube:
    """The tube of a system that is defined by an ODE; `slices` and `timed` as for `hulls`."""
    from ensemble_ctrl.certificate.general.proof import GeneralProof
    from ensemble_ctrl.certificate.general.tube import hulls

    rows = np.eye(len(problem.fleet.states))[problem.fleet.place_columns]
    enclosure = GeneralProof(problem, controls, ranges).enclosure
    return Tube(*hulls(enclosure, rows, len(controls), slices, timed))


def enclosed(flow: Flow, each: int | Ints) -> Tube:
    """The tube with so many cells of each of the flow's parameters, those of `first_cells`, rounding not included.

    Errors of the model are in its radius.
    """
    centres, half = first_cells(flow.lower, flow.upper, each)
    track, steps = Track.of(flow, centres), np.arange(flow.steps)
    # corners p + sum_k +-half_k dp/dq_k at both ends of each step; what the linear picture misses is the radius
    arms = signs_of(half.shape[1]) @ (half[:, None, :, None] * track.slope)
    ends = track.position[:, :, None] + arms
    points = np.concatenate([ends[:, :-1], ends[:, 1:]], axis=2)
    coeffs = np.broadcast_to(flow.coefficients(centres)[:, None], (len(centres), flow.steps, 5))
    halves = np.broadcast_to(half[:, None], (len(centres), flow.steps, half.shape[1]))
    span = np.broadcast_to(flow.step, (len(centres), flow.steps))
    radius = flow.remainder_at(halves, steps + 1) + flow.growth(steps, span, coeffs, halves) + flow.error + flow.lag
    return Tube(points.swapaxes(0, 1), radius.T)
