"""What is made once for all solves online, and what each starts from."""

from __future__ import annotations

from functools import cached_property
from typing import Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.cost import CommandCost, Scale
from ensemble_ctrl.ocp.layout import Layout
from ensemble_ctrl.ocp.levels import TaskLevels
from ensemble_ctrl.ocp.terminal import terminal_blocks
from ensemble_ctrl.ocp.truncation import Truncation, plain, points
from ensemble_ctrl.ocp.weights import RATE_SPARE
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.specification import AvoidConstraint

Floats = NDArray[np.float64]

NEAR = 0.3
"""Metres beyond what is required within which a row takes part."""


@dataclass(frozen=True, eq=False)
class InitialCondition:
    """What a solve starts from.

    Attributes
    ----------
    at : int
        Grid time of the measurement.
    free : int
        First step whose commands may still be changed.
    coefficients : ndarray, shape (robots * nodes, 5)
        Drives of the node robots at grid time `at`, those of one robot after the other: factors, heading and place.
    path : ndarray, shape (at or more, robots, 2)
        Where the robots have been at the grid times before `at`, metres.
    growth : ndarray, shape (steps + 1,)
        Metres by which the sets of states are larger than the node robots' curves, at each grid time.
    controls : ndarray, shape (steps, n_u)
        Commands: those sent before `free`, and a guess from there on.
    avoid : tuple of AvoidConstraint or None
        What to keep out of on the grid's clock, where that is not the problem's.
    """

    at: int
    free: int
    coefficients: Floats
    path: Floats
    growth: Floats
    controls: Floats
    avoid: tuple[AvoidConstraint, ...] | None = None


@dataclass(frozen=True, eq=False)
class OnlineModel:
    """A problem made ready to be solved again and again.

    Attributes
    ----------
    problem : Problem
        On its whole horizon. Parameters of its fleet bend trajectories; where robots start is measured.
    truncation : Truncation
        Which moments are kept.
    levels : TaskLevels
        The task's rows.
    avoid : tuple of AvoidConstraint
        What to keep out of.
    terminal : casadi.Function or None
        Value, gradient and Hessian of the terminal term by the final points, all x and then all y.
    """

    problem: Problem
    truncation: Truncation
    levels: TaskLevels
    avoid: tuple[AvoidConstraint, ...]
    terminal: ca.Function | None

    @classmethod
    def of(cls, problem: Problem, controls: Floats, order: int) -> Self:
        """Ready for moments 0..order; `controls` of shape (steps, n_u) are any commands."""
        truncation = plain((order,) * len(problem.fleet.dynamic), hull=True)
        levels = TaskLevels.of(problem, truncation, points(problem, controls, truncation))
        return cls(problem, truncation, levels, problem.specification.avoid, _terminal(problem, truncation))

    @cached_property
    def commands(self) -> CommandCost:
        """What commands cost."""
        return CommandCost.of(self.problem.objective, Scale.none(), self.problem.step)

    @cached_property
    def most(self) -> Floats | None:
        """Largest change of each command over a step; None where it may change at any rate."""
        bounds = self.problem.fleet.rate_bounds
        return None if bounds is None else (1 - RATE_SPARE) * bounds * self.problem.step


def _terminal(problem: Problem, truncation: Truncation) -> ca.Function | None:
    """The terminal term with its slopes, as the program has it."""
    blocks = terminal_blocks(problem, truncation, Layout(problem.steps, truncation.count).points[-1])
    if not blocks:
        return None
    # value, gradient and dense Hessian of the terminal term by (x_1..x_n, y_1..y_n)
    z = ca.SX.sym("z", 2 * truncation.count)
    value = blocks[0].build(z, ca.SX(0, 1))
    hessian, gradient = ca.hessian(value, z)
    return ca.Function("terminal", [z], [value, gradient, ca.densify(hessian)])
