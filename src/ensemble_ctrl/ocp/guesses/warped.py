"""Guesses with another timing: the way of the best attempt so far, driven sooner or later."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.guesses.driven import driven
from ensemble_ctrl.ocp.guesses.registry import Guess, Request
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.systems.integration import rk4

Floats = NDArray[np.float64]

SHARES: dict[str, Callable[[Floats], Floats]] = {
    "sooner": lambda s: 1.0 - (1.0 - s) ** 1.5,
    "later": lambda s: s**1.5,
    "faster, then waiting": lambda s: np.minimum(1.0, s / 0.75),
    "waiting, then faster": lambda s: np.maximum(0.0, (s - 0.25) / 0.75),
}
"""Share of the way's time at each share of the plan's time; both ends stay."""
SUBSTEPS = 2
"""Steps of integration in a step of control."""
LARGE = 1e3
"""Size of a state beyond which a member runs away."""


class WarpedGuesses:
    """The best attempt's way with other timings."""

    at_once = False

    def accepts(self, problem: Problem) -> bool:
        """Tasks in which there is something to do, not only to avoid."""
        return bool(problem.specification.rest)

    def propose(self, request: Request) -> Iterator[list[Guess]]:
        """All of them together."""
        if request.best is not None:
            yield from filter(None, [list(warped(request.problem, request.best))])


def warped(problem: Problem, controls: Floats) -> Iterator[Guess]:
    """A guess for each of `SHARES`, from commands of shape (steps, n_u) that are no plan."""
    if problem.fleet.system.transcription == "positions":
        for name, share in SHARES.items():
            yield _on_arcs(problem, controls, share, f"the same way {name}")
        return
    fleet, step = problem.fleet, problem.duration / len(controls)
    states = fleet.integrated(controls, fleet.center[None], step, SUBSTEPS, rk4)[0]
    # under commands that run away there is no way to keep
    for name, share in SHARES.items() if (np.abs(states) < LARGE).all() else ():
        yield _in_states(problem, controls, states, share, f"the same way {name}")


def _on_arcs(problem: Problem, controls: Floats, share: Callable[[Floats], Floats], name: str) -> Guess:
    """Commands with which the nominal robot drives the way at other times, as well as its bounds let it."""
    steps = len(controls)
    grid = np.linspace(0.0, 1.0, steps + 1)
    poses = _poses(problem, controls)
    # when each pose is reached: the inverse of the share, at the end of where it is flat
    fine = np.linspace(0.0, 1.0, 20 * steps + 1)
    reached, first = np.unique(share(fine)[::-1], return_index=True)
    times = problem.duration * np.interp(grid, reached, fine[::-1][first])
    times = np.maximum.accumulate(times + 1e-9 * np.arange(steps + 1))
    length = float(np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).sum())
    commands = driven(problem, poses, times, steps)
    return Guess(commands, poses[:: max(steps // 60, 1), :2], length, (), name, "timing")


def _poses(problem: Problem, controls: Floats) -> Floats:
    """Poses of the nominal robot at the ends of all steps, shape (steps + 1, 3)."""
    fleet, step = problem.fleet, problem.duration / len(controls)
    linear, angular, turned = fleet.coefficients(fleet.center[None])[0, :3].tolist()
    sign = 1.0 if fleet.arcs.heading_from == "x" else -1.0
    rates = np.array([fleet.arcs.rates(*command) for command in controls])
    # exact arcs: each chord at the heading in the middle of its step
    half = sign * angular * rates[:, 1] * step / 2
    headings = fleet.heading + turned - fleet.own_heading + np.concatenate([[0.0], np.cumsum(2 * half)])
    chords = linear * rates[:, 0] * step * np.sinc(half / np.pi)
    moves = chords[:, None] * np.stack([np.cos(headings[:-1] + half), np.sin(headings[:-1] + half)], axis=1)
    places = fleet.start_place + np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
    return np.column_stack([places, headings])


def _in_states(
    problem: Problem, controls: Floats, states: Floats, share: Callable[[Floats], Floats], name: str
) -> Guess:
    """The middle member's states and commands at other times; the program makes them fit together."""
    steps = len(controls)
    grid = np.linspace(0.0, 1.0, steps + 1)
    moved = np.stack([np.interp(share(grid), grid, column) for column in states.T], axis=1)
    commands = controls[np.minimum((share((grid[:-1] + grid[1:]) / 2) * steps).astype(int), steps - 1)]
    corners = moved[:, problem.fleet.place_columns]
    length = float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum())
    return Guess(commands, np.asarray(corners), length, (), name, "timing", moved[:, :, None])


__all__ = ["WarpedGuesses", "warped"]
