"""A nominal robot that follows a path in time: how a route becomes commands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

SHARE = 0.95
"""Share of the input bounds that a guess uses, so that it starts inside them."""


def smoothed(path: Floats) -> Floats:
    """A moving average over a sixteenth of the horizon, ends kept."""
    half = max(len(path) // 32, 1)
    padded = np.concatenate([np.repeat(path[:1], half, axis=0), path, np.repeat(path[-1:], half, axis=0)])
    kernel = np.full(2 * half + 1, 1 / (2 * half + 1))
    return np.stack([np.convolve(padded[:, axis], kernel, "valid") for axis in (0, 1)], axis=1)


def follow(problem: Problem, path: Floats) -> Floats:
    """Commands with which the nominal robot follows `path`, within the input bounds."""
    fleet, step = problem.fleet, problem.duration / (len(path) - 1)
    nominal = float(fleet.parameter.center)
    low = np.clip(SHARE * fleet.input_lower, fleet.input_lower, fleet.input_upper)
    high = np.clip(SHARE * fleet.input_upper, fleet.input_lower, fleet.input_upper)
    sign = 1.0 if fleet.system.heading_from == "x" else -1.0
    place, heading = fleet.position.copy(), fleet.heading
    controls = np.zeros((len(path) - 1, 2))
    for n in range(len(controls)):
        ahead = path[n + 1] - place
        distance = float(np.hypot(*ahead))
        wanted = np.arctan2(ahead[1], ahead[0]) if distance > 1e-3 else heading
        error = (wanted - heading + np.pi) % (2 * np.pi) - np.pi
        turn = np.clip(sign * 2 * error / (step * nominal), low[1], high[1]) if distance > 1e-3 else 0.0
        speed = np.clip(distance * max(np.cos(error), 0.0) / (step * nominal), low[0], high[0])
        controls[n] = speed, np.clip(0.7 * turn, low[1], high[1])
        half = sign * nominal * controls[n, 1] * step / 2
        place = place + nominal * speed * step * np.array([np.cos(heading + half), np.sin(heading + half)])
        heading += 2 * half
    return controls
