"""Coarser and finer grids of one horizon."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import Formula, negation_normal_form
from ensemble_ctrl.constraints.stl.dense import shrunk
from ensemble_ctrl.constraints.stl.robustness import Temporal
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

COARSE_STEPS = 32
"""The coarse grid has at most this many steps, unless a window of the task needs a finer one."""


def given(problem: Problem, guess: Floats, steps: int) -> Floats:
    """A guess within the input bounds, on at least `steps` steps so that each window holds a grid time."""
    controls, n_u = np.asarray(guess, dtype=float), len(problem.fleet.system.controls)
    if controls.ndim != 2 or not len(controls) or controls.shape[1] != n_u or not np.isfinite(controls).all():
        raise ProblemError(f"guess: expected finite controls of shape (steps, {n_u}), got shape {controls.shape}")
    fine = controls if len(controls) >= steps else refined(controls, steps)
    return np.clip(fine, problem.fleet.input_lower, problem.fleet.input_upper)


def coarse_steps(problem: Problem) -> int:
    """Steps of the coarse grid: a divisor of the problem's, fine enough for every window of the task."""
    wanted = COARSE_STEPS
    for a, b in windows(problem.task):
        # two grid times in the shortest window
        wanted = max(wanted, int(np.ceil(2 * problem.duration / max(b - a, problem.step))))
    divisors = [n for n in range(1, problem.steps + 1) if problem.steps % n == 0 and n >= wanted]
    return divisors[0] if divisors else problem.steps


def windows(formula: Formula) -> list[tuple[float, float]]:
    """Every finite window of the formula, in seconds."""
    own = []
    if isinstance(formula, Temporal) and formula.a is not None and formula.b is not None:
        own = [(formula.a, formula.b)] if np.isfinite(formula.b) else []
    return own + [w for part in formula.parts for w in windows(part)]


def between(problem: Problem) -> Formula:
    """The task with windows in which what is asked for again and again holds between grid times, too."""
    return shrunk(negation_normal_form(problem.specification.task), problem.duration / problem.steps)


def refined(controls: Floats, steps: int) -> Floats:
    """The same commands on a grid of `steps`, each repeated."""
    if steps % len(controls) == 0:
        return np.repeat(controls, steps // len(controls), axis=0)
    # the command at the middle of each new step
    middle = (np.arange(steps) + 0.5) / steps * len(controls)
    return np.asarray(controls[middle.astype(int)])
