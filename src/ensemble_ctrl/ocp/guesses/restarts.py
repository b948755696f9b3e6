"""Further starts for the whole fleet, where the middle member's plan does not lead to one: fleets of unstable systems.

Members of an unstable fleet part exponentially under one command. A start that is simulated then is far from any plan,
and the polynomial through a few node robots misses the members between them. So the states of all node robots start at
those of one member, which the program's constraints pull apart only as far as they must, and there are more of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.guesses.registry import Guess
from ensemble_ctrl.ocp.parametrisation import Iterate
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

HIGHER = {1: (6, 9, 13), 2: (4,), 3: (2,)}
"""Truncation orders that are tried for so many parameters where the problem says none, else the usual one."""
RANDOM = 3
"""Starts with commands at random for each order."""
WANDERING = 4
"""Starts with commands at random for the middle member alone."""
WAVES = 4
"""Half waves over the horizon at most."""


@dataclass(frozen=True, eq=False)
class Restart:
    """A start of the program for the whole fleet.

    Attributes
    ----------
    name : str
    order : int or None
        Truncation order; None for the usual one.
    controls : ndarray, shape (steps, n_u)
    states : ndarray, shape (steps + 1, n_x, 1)
        Of every node robot.
    barrier : float
        First of the solver's barrier parameters: a large one leaves the start behind.
    """

    name: str
    order: int | None
    controls: Floats
    states: Floats
    barrier: float = 1e-1

    kind = "start"
    length = 0.0

    @property
    def corners(self) -> Floats:
        """None."""
        return np.zeros((0, self.states.shape[1]))


def restarts(problem: Problem, guess: Iterate, middle: Iterate) -> Iterator[list[Restart]]:
    """Batches of starts, cheap and promising ones first: the middle member's plan, the guess, and commands at random.

    Each at higher orders and at the usual one; the highest, and random commands at higher ones, come last.
    """
    higher = HIGHER.get(len(problem.fleet.names), ()) if problem.order is None else ()
    draws = np.random.default_rng(problem.solve.seed)
    yield [_planned(middle, order) for order in higher[:2]]
    yield [_guessed(guess, None), *(_drawn(problem, k, None, guess, draws) for k in range(RANDOM))]
    for order in higher[2:]:
        yield [_planned(middle, order), _guessed(guess, order)]
    for order in higher[:2]:
        yield [_guessed(guess, order), *(_drawn(problem, k, order, guess, draws) for k in range(RANDOM))]


def _planned(middle: Iterate, order: int | None) -> Restart:
    """The middle member's plan."""
    return Restart(f"from the middle member{_at(order)}", order, middle.controls, middle.states, 1e-2)


def _guessed(guess: Iterate, order: int | None) -> Restart:
    """The guess that the middle member's plan came from."""
    return Restart(f"from the guess{_at(order)}", order, guess.controls, guess.states)


def _drawn(problem: Problem, k: int, order: int | None, guess: Iterate, draws: np.random.Generator) -> Restart:
    """The states of a guess, with commands at random."""
    return Restart(f"commands at random {k + 1}{_at(order)}", order, _random(problem, k, draws), guess.states)


def _at(order: int | None) -> str:
    """The order in words."""
    return "" if order is None else f", order {order}"


def wandering(problem: Problem, guess: Guess) -> list[Guess]:
    """Starts for the middle member alone: the states of a guess, with commands at random."""
    draws = np.random.default_rng(problem.solve.seed)
    drawn = [_random(problem, k, draws) for k in range(WANDERING)]
    return [
        replace(guess, controls=controls, name=f"{guess.name}, random {k + 1}", kind="random")
        for k, controls in enumerate(drawn)
    ]


def _random(problem: Problem, k: int, draws: np.random.Generator) -> Floats:
    """Commands of all steps: for odd `k` slow waves, which push one way for a while, otherwise each step by itself."""
    low, high = np.asarray(problem.fleet.input_lower), np.asarray(problem.fleet.input_upper)
    if k % 2 == 0:
        return np.asarray(low + (high - low) * draws.random((problem.steps, len(low))))
    # cosines of 0 to WAVES half waves over the horizon with normal amplitudes, in half widths of the bounds
    phase = np.pi * (np.arange(problem.steps) + 0.5) / problem.steps
    waves = np.cos(phase[:, None] * np.arange(WAVES + 1)) @ draws.normal(size=(WAVES + 1, len(low)))
    return np.asarray(np.clip((low + high) / 2 + (high - low) / 2 * waves / np.sqrt(WAVES + 1), low, high))
