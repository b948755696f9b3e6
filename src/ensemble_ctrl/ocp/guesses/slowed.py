"""Time for the speed limits of zones: guesses that drive slowly where they have to, and faster elsewhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

SHARE = 0.85
"""Of a limit, for the slower of the fastest member."""
EARLY = 1.5
"""Steps before a zone from which a guess is slow."""
FINEST = 400
"""Pieces into which a way is cut, at least."""


def slowed(problem: Problem, places: Floats, times: Floats) -> Floats:
    """Other times to be at places, so that the way through a zone takes as long as its limit wants.

    Parameters
    ----------
    problem : Problem
    places : ndarray, shape (places, 2)
        Metres.
    times : ndarray, shape (places,)
        Seconds, increasing.

    Returns
    -------
    ndarray, shape (places,)
        With the same first and last time where that is possible.
    """
    limits = [(zone.pieces, zone.speed) for zone in problem.zones.values() if zone.speed is not None]
    if not limits or len(places) < 2:
        return times
    # the way in short pieces, each with the least seconds that limits allow
    fine = np.unique(np.concatenate([times, np.linspace(times[0], times[-1], FINEST)]))
    way = np.stack([np.interp(fine, times, places[:, axis]) for axis in (0, 1)], axis=1)
    length, spent = np.linalg.norm(np.diff(way, axis=0), axis=1), np.diff(fine)
    middle = (way[1:] + way[:-1]) / 2
    least = np.zeros(len(length))
    fastest = problem.fleet.fastest[0]
    for pieces, speed in limits:
        away = np.min([piece.distance(middle) for piece in pieces], axis=0) - problem.fleet.radius
        near = away <= EARLY * problem.step * speed + problem.solve.margin
        least = np.maximum(least, np.where(near, length * fastest / (SHARE * speed), 0.0))
    slow = least > spent
    taken = np.where(slow, least, spent)
    # what slow pieces take more is saved on the others, in proportion
    free = ~slow & (length > 0)
    left = float(spent.sum() - taken[~free].sum())
    if free.any() and left > 0:
        taken[free] *= left / float(taken[free].sum())
    moved = fine[0] + np.concatenate([[0.0], np.cumsum(taken)])
    return np.asarray(np.interp(times, fine, moved))


__all__ = ["slowed"]
