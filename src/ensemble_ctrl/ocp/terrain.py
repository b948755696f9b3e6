"""About how far patches of terrain may take robots on arcs from their model: changes of their factors by steps.

An estimate along single members, by formulas of its own; the proof is the certificate's.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.starts import by_start

Floats = NDArray[np.float64]

ROUNDS = 60
"""Rounds in which errors and the steps in patches follow from each other, at most."""


def with_terrain(problem: Problem, members: Floats, paths: Floats, place: Callable[[Floats], Floats]) -> Floats:
    """Changes of the factors of members in the steps in which they may be in a patch, shape (2, members, steps).

    Parameters
    ----------
    problem : Problem
    members : ndarray, shape (members, parameters)
    paths : ndarray, shape (members, steps + 1, 2)
        Of the model.
    place : callable
        Errors of the place by steps, shape (members, steps), that follow from such changes.
    """
    count, steps = len(members), paths.shape[1] - 1
    found = np.zeros((2, count, steps))
    if not problem.terrain:
        return found
    gaps = _gaps(problem, paths)
    changes = [_changes(problem, members, name) for name in problem.terrain]
    for _ in range(ROUNDS):
        off = place(found)
        marks = [gap <= off for gap in gaps]
        new = np.max([change[..., None] * mark for change, mark in zip(changes, marks, strict=True)], axis=0)
        if (new <= found).all():
            break
        found = np.maximum(found, new)
    return found


def _changes(problem: Problem, members: Floats, name: str) -> Floats:
    """By how much both factors may be off in a patch, for each member, shape (2, members)."""
    fleet, patch = problem.fleet, problem.terrain[name]
    psi, found = fleet.psi(members), []
    for k in (0, 1):
        own, most, least = (np.ones(len(members)) for _ in range(3))
        for parameter in fleet.arcs.factors:
            if fleet.arcs.directions[parameter][k]:
                low, high = psi[parameter], psi[parameter]
                if parameter in patch.parameters:
                    low, high = patch.between(parameter, psi[parameter])
                own, most, least = own * psi[parameter], most * high, least * low
        found.append(np.maximum(most - own, own - least))
    return np.stack(found)


@dataclass(frozen=True)
class Crossing:
    """When members may be in a patch.

    Attributes
    ----------
    begin, end : float
        Seconds; of all steps with contact, from the first to the last.
    """

    begin: float
    end: float


def crossed(problem: Problem, controls: Floats) -> dict[str, Crossing]:
    """The patches that members may be in under a plan, by their names: about when.

    Parameters
    ----------
    problem : Problem
    controls : ndarray, shape (steps, n_u)
    """
    found: dict[str, Crossing] = {}
    for one in by_start(problem).values() if problem.terrain else ():
        for name, met in _crossed(one, controls).items():
            old = found.get(name, met)
            found[name] = Crossing(min(old.begin, met.begin), max(old.end, met.end))
    return found


def _crossed(problem: Problem, controls: Floats) -> dict[str, Crossing]:
    """The same for members of one start."""
    from ensemble_ctrl.ocp.disturbance import growth

    errors = growth(problem, controls)
    if errors is None:
        return {}
    fleet, step = problem.fleet, problem.duration / len(controls)
    members = np.concatenate([fleet.corners, fleet.center[None]])
    gaps = _gaps(problem, fleet.trajectories(controls, members, step))
    found: dict[str, Crossing] = {}
    for name, gap in zip(problem.terrain, gaps, strict=True):
        steps = np.flatnonzero((gap <= errors.within).any(axis=0))
        if len(steps):
            found[name] = Crossing(float(steps[0] * step), float((steps[-1] + 1) * step))
    return found


def _gaps(problem: Problem, paths: Floats) -> list[Floats]:
    """Distances of members from each patch during each step, shape (members, steps)."""
    # distance of the middle of each chord, less half of it
    half = np.linalg.norm(np.diff(paths, axis=1), axis=2) / 2
    middles = (paths[:, :-1] + paths[:, 1:]) / 2
    return [patch.distance(middles.reshape(-1, 2)).reshape(half.shape) - half for patch in problem.terrain.values()]
