"""A search for the disturbance that brings a robot closest to what it avoids: random draws, then gradients.

Against one obstacle, one robot and one time, the distance is nearly linear in the settings of what disturbs the robot.
So the worst setting of each is at a bound, on the side that the gradient says; the robot is run with these, its closest
time is looked for again, and so on. What is found is a run that the bounds allow: it is never closer than is proven.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem.evaluation.disturbed import channels, disturbed, drawn
from ensemble_ctrl.problem.fleet import Member
from ensemble_ctrl.problem.problem import Problem
from ensemble_ctrl.problem.specification import AvoidConstraint
from ensemble_ctrl.problem.uncertainty import POSITION

Floats = NDArray[np.float64]

ROBOTS = 120
"""Robots with random disturbances, the corners of the ranges among them."""
TARGETS = 6
"""Robots against which gradients are used."""
ROUNDS = 3
"""Gradients for each of them."""
SUBSTEPS, FINE = 8, 32
"""Samples per step of the random draws, and of the runs that gradients lead to."""
NUDGE = 0.5
"""Change of a setting by which a slope is measured."""
SMALL = 1e-6
"""Metres by which a place is moved for the direction in which a distance grows."""
APART = 16
"""Parts of the horizon in which a closest time is looked for, each for itself."""


@dataclass(frozen=True, eq=False)
class Attack:
    """The closest that any disturbed robot came to what it avoids.

    Attributes
    ----------
    clearance : float
        Metres beyond the robot's radius; negative inside, infinite if nothing is avoided.
    obstacle : str
        To which one.
    time : float
        Seconds.
    parameters : dict of str to float
        Of that robot.
    settings : ndarray, shape (channels, steps)
        What disturbed it, as shares of the bounds (`ensemble_ctrl.problem.evaluation.disturbed`).
    runs : int
        Robots that were run.
    """

    clearance: float
    obstacle: str
    time: float
    parameters: Member
    settings: Floats
    runs: int


def attack(problem: Problem, controls: Floats, seed: int = 0) -> Attack:
    """Look for the worst disturbance within the fleet's bounds.

    Parameters
    ----------
    problem : Problem
    controls : ndarray, shape (steps, n_u)
    seed : int
        Of the random draws.

    Notes
    -----
    *Guarantee*: the clearance was reached by a run that the bounds allow, so that no proof can claim more; others may
    come closer.
    """
    fleet, steps = problem.fleet, len(controls)
    corners = fleet.corners[: ROBOTS // 2]
    members = np.concatenate([corners, fleet.sample(ROBOTS - len(corners), seed)])
    settings = drawn(problem, len(members), steps, seed)
    settings[: len(corners)] = 0.0  # the corners follow the model at first, in the middle of what terrain allows
    best = Attack(np.inf, "", 0.0, {}, np.zeros(settings.shape[1:]), len(members))
    paths = disturbed(problem, controls, members, settings, SUBSTEPS)[..., fleet.place_columns]
    found: list[_Target] = []
    for avoid in problem.specification.avoid:
        distances = _distances(problem, avoid, paths)
        best = _closer(problem, best, avoid, members, settings, distances)
        found += _targets(problem, avoid, members, distances, paths)
    targets = sorted(found, key=lambda target: target.distance)[:TARGETS]
    rounds = ROUNDS if targets and settings.shape[1] else 0
    base = np.zeros((len(targets), *settings.shape[1:]))
    for _ in range(rounds):
        # settings at the bounds, on the side to which each distance falls
        base = np.stack(
            [
                _worst(problem, _slopes(problem, controls, target, own))
                for target, own in zip(targets, base, strict=True)
            ]
        )
        some = np.stack([target.member for target in targets])
        paths = disturbed(problem, controls, some, base, FINE)[..., fleet.place_columns]
        best = replace(best, runs=best.runs + len(targets))
        for k, target in enumerate(targets):
            distances = _distances(problem, target.avoid, paths[[k]])
            best = _closer(problem, best, target.avoid, some[[k]], base[[k]], distances)
            targets[k] = _target(problem, target.avoid, target.member, distances[0], paths[k])
    return best


@dataclass(frozen=True, eq=False)
class _Target:
    """A robot and a place of it to push towards an obstacle, with the time and the direction away from the obstacle."""

    distance: float
    avoid: AvoidConstraint
    member: Floats
    time: float
    away: Floats


def _target(problem: Problem, avoid: AvoidConstraint, member: Floats, distances: Floats, path: Floats) -> _Target:
    """The closest sample of one run."""
    at = int(distances.argmin())
    time = problem.duration * at / (len(distances) - 1)
    return _Target(float(distances[at]), avoid, member, time, _away(avoid, path[at : at + 1], time))


def _distances(problem: Problem, avoid: AvoidConstraint, paths: Floats) -> Floats:
    """Distances of robots at all samples, infinite outside the window, shape (robots, samples)."""
    times = np.linspace(0.0, problem.duration, paths.shape[1])
    found = np.full(paths.shape[:2], np.inf)
    found[:, avoid.during(times)] = avoid.distances(paths, times)
    return found


def _targets(
    problem: Problem, avoid: AvoidConstraint, members: Floats, distances: Floats, paths: Floats
) -> list[_Target]:
    """The closest robot in each part of the horizon."""
    found = []
    for part in np.array_split(np.arange(distances.shape[1]), min(APART, distances.shape[1])):
        robot = int(distances[:, part].min(axis=1).argmin())
        some = np.full(distances.shape[1], np.inf)
        some[part] = distances[robot, part]
        if np.isfinite(some).any():
            found.append(_target(problem, avoid, members[robot], some, paths[robot]))
    return found


def _closer(
    problem: Problem, best: Attack, avoid: AvoidConstraint, members: Floats, settings: Floats, distances: Floats
) -> Attack:
    """The better of what was found and some runs."""
    robot, at = np.unravel_index(int(distances.argmin()), distances.shape)
    if not distances[robot, at] < best.clearance:
        return best
    time = float(problem.duration * at / (distances.shape[1] - 1))
    who = problem.fleet.named(members[robot])
    return Attack(float(distances[robot, at]), avoid.name, time, who, settings[robot], best.runs)


def _away(avoid: AvoidConstraint, place: Floats, time: float) -> Floats:
    """The direction in which the distance at one place and time grows, shape (d,)."""
    moves = SMALL * np.eye(place.shape[1])
    # central differences of the distance from the nearest piece, in the obstacle's frame
    ends = np.concatenate([place + moves, place - moves]) - avoid.offsets(np.array([time]))
    seen = np.minimum.reduce([piece.distance(ends) for piece in avoid.pieces])
    slope = seen[: len(moves)] - seen[len(moves) :]
    return np.asarray(slope / max(float(np.linalg.norm(slope)), 1e-300))


def _slopes(problem: Problem, controls: Floats, target: _Target, base: Floats) -> Floats:
    """How far a robot moves along a direction, at the end of the target's step, with each setting up to then."""
    count, last = len(base), min(len(controls), int(target.time / problem.step) + 1)
    # one run for each setting, changed from its base towards zero, or up from zero
    rows = np.arange(count * last)
    channel, step = np.divmod(rows, last)
    nudged = np.repeat(base[None], len(rows) + 1, axis=0)
    nudge = np.where(nudged[rows, channel, step] > 0, -NUDGE, NUDGE)
    nudged[rows, channel, step] += nudge
    some = np.repeat(target.member[None], len(nudged), axis=0)
    ends = disturbed(problem, controls, some, nudged, last=last)[:, -1, problem.fleet.place_columns] @ target.away
    found = np.zeros(base.shape)
    found[channel, step] = (ends[:-1] - ends[-1]) / nudge
    return found


def _worst(problem: Problem, slope: Floats) -> Floats:
    """The settings that lower a distance with these slopes most: at a bound, or across it for those of a ball."""
    found = -np.sign(slope)
    ball = [k for k, channel in enumerate(channels(problem)) if channel.kind == POSITION]
    if ball:
        length = np.linalg.norm(slope[ball], axis=0)
        found[ball] = -slope[ball] / np.where(length > 0, length, 1.0)
    return np.asarray(found)
