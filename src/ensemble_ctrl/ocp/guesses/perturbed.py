"""Guesses off a symmetry: commands that failed, with slow waves added to them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.guesses.registry import Guess, Request
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

COUNT = 2
"""Guesses that are made."""
WAVES = 3
"""Half waves over the horizon at most."""
AMPLITUDE = 0.25
"""Size of the waves, as a share of half the width of the commands' bounds."""


class PerturbedGuesses:
    """Waves around the best attempt."""

    at_once = False

    def accepts(self, problem: Problem) -> bool:
        """Robots on arcs: other systems start from the middle member's states."""
        return problem.fleet.system.transcription == "positions"

    def propose(self, request: Request) -> Iterator[list[Guess]]:
        """All of them together."""
        if request.best is not None:
            yield list(perturbed(request.problem, request.best))


def perturbed(problem: Problem, controls: Floats) -> Iterator[Guess]:
    """`COUNT` guesses around commands of shape (steps, n_u), drawn by the problem's seed.

    Parameters
    ----------
    problem : Problem
    controls : ndarray, shape (steps, n_u)
        That are no plan, and from which the solver does not leave by itself: by symmetry, no side is the better one.
    """
    random, fleet = np.random.default_rng(problem.solve.seed), problem.fleet
    # cosines of 0 to WAVES half waves over the horizon with normal amplitudes of `size` together
    phase = np.pi * (np.arange(len(controls)) + 0.5) / len(controls)
    waves = np.cos(phase[:, None] * np.arange(WAVES + 1))
    size = AMPLITUDE * (fleet.input_upper - fleet.input_lower) / 2
    for k in range(COUNT):
        moved = controls + waves @ random.normal(size=(WAVES + 1, controls.shape[1])) / np.sqrt(WAVES + 1) * size
        commands = np.clip(moved, fleet.input_lower, fleet.input_upper)
        yield Guess(commands, np.zeros((0, 2)), 0.0, (), f"commands with waves added, {k + 1}", "waves")


__all__ = ["COUNT", "PerturbedGuesses", "perturbed"]
