"""The paper's program on a problem's own grid, assembled from the equations that are switched on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.cost import CommandCost
from ensemble_ctrl.ocp.moment_form import Read, big_m, region_blocks
from ensemble_ctrl.ocp.parametrisation import Parametrisation, parametrise
from ensemble_ctrl.ocp.program import Block, assemble
from ensemble_ctrl.ocp.published.equations import Equations, PublishedTask
from ensemble_ctrl.ocp.published.rows import Facets, Levels, disjunction_rows, obstacle_rows, robustness_term
from ensemble_ctrl.ocp.rows import command_terms, rate_rows
from ensemble_ctrl.ocp.solvers import Nlp
from ensemble_ctrl.ocp.terminal import terminal_blocks
from ensemble_ctrl.ocp.transcription import Iterate
from ensemble_ctrl.ocp.truncation import Truncation
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

DEFAULT_ORDER = 8
"""Truncation order where a problem leaves it open: that of the paper's experiments."""
EVERYTHING = Equations()


@dataclass(frozen=True, eq=False)
class PublishedProgram:
    """The program with what is needed to start it and to read its solution.

    Attributes
    ----------
    nlp : Nlp
        With the binaries as discrete variables.
    model : Parametrisation
        What stands for commands and moments.
    facets : tuple of Facets
        One for each convex piece.
    """

    nlp: Nlp
    model: Parametrisation
    facets: tuple[Facets, ...]

    def controls(self, x: Floats) -> Floats:
        """Commands of a decision vector, within their bounds, shape (steps, 2)."""
        return self.model.iterate(x).controls

    def chosen(self, x: Floats) -> list[Floats]:
        """The binaries of a decision vector, for each piece of shape (times, facets)."""
        return [x[one.binaries] for one in self.facets]

    def fixed(self, choice: Sequence[Floats]) -> Nlp:
        """The nonlinear program that is left when the binaries are given, for each piece of shape (times, facets)."""
        lower, upper, guess = self.nlp.lower.copy(), self.nlp.upper.copy(), self.nlp.guess.copy()
        for one, z in zip(self.facets, choice, strict=True):
            lower[one.binaries] = upper[one.binaries] = guess[one.binaries] = z
        return replace(self.nlp, guess=guess, lower=lower, upper=upper, discrete=np.zeros(0, dtype=np.int64))


def published_truncation(problem: Problem) -> Truncation:
    """Moments of every order up to the problem's, against the distributions' polynomials."""
    orders = (problem.order or DEFAULT_ORDER,) * len(problem.fleet.dynamic)
    return Truncation(orders, orders, False, problem.fleet.dynamic_distributions)


def published_program(problem: Problem, controls: Floats, equations: Equations = EVERYTHING) -> PublishedProgram:
    """Build the paper's program around a guess, in the problem's coordinates.

    Parameters
    ----------
    problem : Problem
        With ``coordinates: modal`` the variables are the moments, as in the paper.
    controls : ndarray, shape (problem.steps, 2)
        Commands to start from.
    equations : Equations
        Which of the paper's equations it has.

    Raises
    ------
    UnsupportedError
        For a task that the paper has no equations for.
    """
    truncation, task = published_truncation(problem), PublishedTask.of(problem)
    model = parametrise(problem, truncation, Iterate(controls))
    layout, read = model.layout, Read.of(truncation, model)
    facets = tuple(Facets.of(block, layout) for block in task.blocks) if equations.obstacles else ()
    levels = [Levels.of(visit, truncation, layout) for visit in task.visits] if equations.robustness else []
    big = big_m(problem)
    blocks = [
        *model.dynamics(),
        *rate_rows(layout, problem.fleet.rate_bounds, model.scale.half, problem.step),
        *(region_blocks(problem, truncation, read) if equations.polyhedron else []),
        *(obstacle_rows(one, truncation, read, big) for one in facets),
        *(disjunction_rows(one) for one in facets if equations.disjunction),
        *(block for one in levels for block in one.blocks(read)),
    ]
    terms = _terms(problem, truncation, model, equations, levels)
    x = _start(model, read, facets, levels)
    lower, upper = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    model.bound(lower, upper)
    lower[layout.binaries], upper[layout.binaries] = 0.0, 1.0
    program = assemble(layout.size, blocks, terms)
    nlp = Nlp(program, x, lower, upper, model.dependent, layout.slacks, layout.binaries)
    return PublishedProgram(nlp, model, facets)


def _terms(
    problem: Problem, truncation: Truncation, model: Parametrisation, equations: Equations, levels: list[Levels]
) -> list[Block]:
    """The objective of ``eq:WayPointObsAvoid`` with the problem's weights; without way-points ``eq:poly_explor``."""
    aim, final = problem.objective, model.layout.points[-1, model.position_columns]
    cost = CommandCost.of(aim, model.scale, problem.step)
    return [
        *(terminal_blocks(problem, truncation, final, model.places) if equations.terminal else []),
        *(command_terms(model.layout, cost) if equations.effort else []),
        *([robustness_term(levels, aim.robustness)] if levels else []),
    ]


def _start(model: Parametrisation, read: Read, facets: tuple[Facets, ...], levels: list[Levels]) -> Floats:
    """The decision vector at the guess, with the best facets and the largest levels there."""
    x = np.zeros(model.layout.size)
    model.start(x)
    positions = x[read.at].reshape(read.steps + 1, 2, read.count)
    mean, moments = positions @ read.mean, (positions @ read.to_moments.T).transpose(0, 2, 1)
    for one in facets:
        x[one.binaries] = one.best(mean)
    for level in levels:
        x[level.index] = level.start(moments)
    return x
