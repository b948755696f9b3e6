"""A nominal robot that follows a path in time: how a route becomes commands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.guesses.slowed import slowed
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

SHARES = np.array([0.95, 0.665])
"""Shares of the two commands' bounds that a guess uses, so that it starts inside them."""
CREEP = 0.3
"""Share of its speed at which a robot that can't turn in place drives while it turns."""


def smoothed(path: Floats) -> Floats:
    """A moving average over a sixteenth of the horizon, ends kept."""
    half = max(len(path) // 32, 1)
    padded = np.concatenate([np.repeat(path[:1], half, axis=0), path, np.repeat(path[-1:], half, axis=0)])
    # moving average with the ends repeated
    kernel = np.full(2 * half + 1, 1 / (2 * half + 1))
    return np.stack([np.convolve(padded[:, axis], kernel, "valid") for axis in (0, 1)], axis=1)


def follow(problem: Problem, path: Floats) -> Floats:
    """Commands with which the nominal robot follows `path`, within the input bounds."""
    fleet, step = problem.fleet, problem.duration / (len(path) - 1)
    grid = np.linspace(0.0, problem.duration, len(path))
    slow = slowed(problem, path, grid)
    path = np.stack([np.interp(grid, slow, path[:, axis]) for axis in (0, 1)], axis=1)
    linear, angular, heading = fleet.coefficients(fleet.center[None])[0, :3].tolist()
    low, high = (
        np.clip(SHARES * end, fleet.input_lower, fleet.input_upper) for end in (fleet.input_lower, fleet.input_upper)
    )
    sign, place, slowest = 1.0, fleet.start_place, 0.0 if fleet.arcs.turns_in_place else CREEP
    if fleet.arcs.heading_from == "y":
        sign, heading = -1.0, np.pi / 2 - heading
    controls = np.zeros((len(path) - 1, 2))
    for n in range(len(controls)):
        ahead = path[n + 1] - place
        distance = float(np.hypot(*ahead))
        wanted = np.arctan2(ahead[1], ahead[0]) if distance > 1e-3 else heading
        # proportional control: the turn that takes 1.4 times the heading error off in a step, slower while it is large
        error = (wanted - heading + np.pi) % (2 * np.pi) - np.pi
        turn = 1.4 * sign * error / (step * angular) if distance > 1e-3 else 0.0
        speed = distance * max(np.cos(error), slowest) / (step * linear)
        controls[n] = fleet.arcs.commands(speed, turn, low, high)
        v, omega = fleet.arcs.rates(*controls[n])
        # exact arc of the nominal robot: its chord, at the heading in the middle of the step
        half = sign * angular * omega * step / 2
        place = place + linear * v * step * np.array([np.cos(heading + half), np.sin(heading + half)])
        heading += 2 * half
    return controls
