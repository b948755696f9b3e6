r"""Proof that robots of one loop keep apart, for sets of their states.

Every pose of a robot's set is carried to within

.. math:: r(t) = \mathrm{away} + 2 \sin(\mathrm{turn} / 2)\, L(t) + \mathrm{drift}(t)

of where the robot with the same parameters gets that starts in the middle of the set, with the largest way `L(t)` that
it may have gone by then: a turn by an angle about the start moves nothing further than that.  So two robots are `d`
apart where these two are ``d`` plus both radii apart, for all pairs of their parameters
(`ensemble_ctrl.certificate.apart`), which is proven in a few slices of time with the radii at their ends.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.apart import apart_bounds
from ensemble_ctrl.certificate.remaining import SetCertificate
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.propagation import PoseSet, swung
from ensemble_ctrl.planning.online.slips import UP
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.specification import ApartConstraint

Floats = NDArray[np.float64]

SLICES = 4
"""Slices of time, each with the largest radii in it."""


def certify_apart(
    rests: Mapping[str, Problem],
    controls: Floats,
    poses: Mapping[str, PoseSet],
    departures: Mapping[str, Floats],
    wanted: Sequence[ApartConstraint],
) -> dict[str, SetCertificate]:
    """What is proven of the distance of every two robots, by their names.

    Parameters
    ----------
    rests : mapping of str to Problem
        What is left for each robot: its fleet starts in the middle of its set.
    controls : ndarray, shape (steps, n_u)
        Commands of what is left.
    poses : mapping of str to PoseSet
        Where each robot is.
    departures : mapping of str to ndarray of shape (steps,)
        Metres that each robot may be further away in each step.
    wanted : sequence of ApartConstraint
        How far they keep from each other, on the clock of what is left.

    Notes
    -----
    *Guarantee*: a clearance is at most the least distance of these robots in the windows, less what is wanted. With
    errors of the model nothing is proven.
    """
    radii = {name: _radii(rests[name], controls, pose, departures[name]) for name, pose in poses.items()}
    found = {}
    for one, other in combinations(poses, 2):
        began = time.perf_counter()
        pair = {name: rests[name] for name in (one, other)}
        slices = [part for each in wanted for part in _slices(each, radii[one] + radii[other], rests[one].step)]
        proven = -np.inf
        if not any(rest.uncertain for rest in pair.values()):
            bounds = apart_bounds(pair, slices, controls, _both(*(rest.fleet for rest in pair.values())))
            proven = min((bound.proven for bound in bounds), default=np.inf)
        what = " and ".join(map(str, wanted))
        found[f"{one} and {other}"] = SetCertificate(
            proven >= 0, float(proven), np.inf, what, time.perf_counter() - began
        )
    return found


def _radii(rest: Problem, controls: Floats, pose: PoseSet, departures: Floats) -> Floats:
    """How far a pose of the set may be from the middle's way up to the end of each step, shape (steps,), metres."""
    v, _ = rest.fleet.arcs.rates(*controls.T)
    # L: the longest way of any member
    way = np.cumsum(np.abs(v)) * rest.step * rest.fleet.fastest[0] * (1 + UP)
    return np.asarray(
        (pose.away + swung(pose.turn) * way) * (1 + UP) + np.maximum.accumulate(departures) + UP, dtype=np.float64
    )


def _slices(wanted: ApartConstraint, radii: Floats, step: float) -> Iterator[ApartConstraint]:
    """The constraint in turn, each time for robots that are in the middle of their sets."""
    steps = len(radii)
    edges = np.unique(np.linspace(0, steps, SLICES + 1).astype(int))
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        begin, end = max(wanted.begin, first * step), min(wanted.end, last * step)
        if begin <= end:
            yield ApartConstraint(wanted.distance + float(radii[last - 1]), begin, end)


def _both(one: Fleet, other: Fleet) -> dict[str, Interval]:
    """Ranges that hold the parameters of both robots."""
    low, high = np.minimum(one.lower, other.lower), np.maximum(one.upper, other.upper)
    return {name: Interval(float(a), float(b)) for name, a, b in zip(one.names, low, high, strict=True)}


def met(pasts: Mapping[str, Sequence[PoseSet]], step: float, wanted: Sequence[ApartConstraint]) -> str:
    """Which two robots must have been too close, by their past; empty for none."""
    for one, other in combinations(pasts, 2):
        for k, (here, there) in enumerate(zip(pasts[one], pasts[other], strict=False)):
            gap = float(np.linalg.norm(here.position - there.position)) + here.away + there.away
            for each in wanted:
                if each.begin <= k * step <= each.end and gap < each.distance:
                    return f"{one} and {other} were closer than {each.distance:g} m"
    return ""
