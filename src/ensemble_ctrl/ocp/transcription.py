r"""The optimal-control problem ``eq:WayPointObsAvoid`` of Arias et al., in nodal coordinates, for any parametrisation::

    minimise    -w_rho level + w_T |m(T) - m_F|^2 + sum_n sum_i w_i (s_n,i - r_i)^2 dt + w_s sum(slacks)
                (+ smoothness, `ensemble_ctrl.ocp.cost`; + a risk penalty, `ensemble_ctrl.ocp.risk`)

    over        s_n                  the scaled broadcast commands of step n
                P_n                  what represents the fleet at grid time n
                level, slacks        the task's robustness, and by how much constraints fall short

    subject to  P_n+1 follows from P_n and s_n          (`positions`: exact arcs; `states`: multiple shooting)
                n_on . P_i + slack_on >= support_on + radius + margin + spare + bulge
                                     every point i, both ends of step n, each obstacle o in reach
                level + slack >= margin + spare
                the rows of the task, which keep `level` at or below its robustness (`ensemble_ctrl.ocp.task`)

The slack weight w_s is so large that slacks are zero wherever a plan is possible.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import Mean
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import UnsupportedError
from ensemble_ctrl.ocp.apart import apart_rows
from ensemble_ctrl.ocp.chance import required_parts
from ensemble_ctrl.ocp.cost import CommandCost
from ensemble_ctrl.ocp.disturbance import growth
from ensemble_ctrl.ocp.facet_binaries import Choice, binary_blocks
from ensemble_ctrl.ocp.hyperplanes import separate
from ensemble_ctrl.ocp.layout import Layout, Numbers
from ensemble_ctrl.ocp.modal_moments import Moments
from ensemble_ctrl.ocp.moment_form import Read, moment_blocks, region_blocks
from ensemble_ctrl.ocp.parametrisation import Entry, Iterate, Parametrisation, parametrise, register
from ensemble_ctrl.ocp.positions import Positions
from ensemble_ctrl.ocp.program import Block, Program, assemble
from ensemble_ctrl.ocp.risk import RiskRows, risk_rows
from ensemble_ctrl.ocp.rows import (
    Avoiding,
    avoidance_rows,
    command_terms,
    level_row,
    rate_rows,
    robustness_term,
    slack_term,
)
from ensemble_ctrl.ocp.signals import Commanded
from ensemble_ctrl.ocp.solvers import Nlp
from ensemble_ctrl.ocp.states import States
from ensemble_ctrl.ocp.task import TaskRows, task_rows
from ensemble_ctrl.ocp.terminal import terminal_blocks
from ensemble_ctrl.ocp.truncation import Truncation
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SLACK_START = 1e-3
"""Slack to start from, in metres or the unit of the task."""


register(Entry("states", lambda problem: problem.fleet.system.transcription == "states", States))
register(Entry("positions", lambda problem: problem.fleet.system.transcription == "positions", Positions))
register(Entry("modal", lambda problem: problem.coordinates == "modal", Moments))


@dataclass(frozen=True, eq=False)
class Transcription:
    """The program with what is needed to start it and to read its solution."""

    nlp: Nlp
    model: Parametrisation

    @property
    def program(self) -> Program:
        """Assembled, with its derivatives."""
        return self.nlp.program

    @property
    def guess(self) -> Floats:
        """The decision vector to start from."""
        return self.nlp.guess

    @property
    def layout(self) -> Numbers:
        """Where each quantity stands in the decision vector."""
        return self.model.layout

    def iterate(self, x: Floats) -> Iterate:
        """What a decision vector stands for, commands within their bounds."""
        return self.model.iterate(x)


def transcribe(
    problem: Problem,
    truncation: Truncation,
    guess: Iterate,
    avoiding: Avoiding | Choice,
    spare: tuple[float, float] = (0.0, 0.0),
) -> Transcription:
    """Build the program around a guess.

    Parameters
    ----------
    problem : Problem
        What to plan.
    truncation : Truncation
        Which moments are kept.
    guess : Iterate
        Commands, whose number is that of the program's steps, and states where the parametrisation needs them.
    avoiding : Avoiding or Choice
        How obstacles are kept out of: fixed separating hyperplanes, or facets chosen by binaries.
    spare : (float, float)
        Metres to keep beyond the margin: from obstacles (truncation error, and what a finer replay missed), and in
        the task.
    """
    model = parametrise(problem, truncation, guess)
    layout, step = model.layout, problem.duration / len(guess.controls)
    # the level of the whole task, its slack, and a slack for each pair of a side and a step
    level, short = layout.level(), layout.slack(1)
    slack = layout.slack(avoiding.slacks)
    task, rated = _task(problem, truncation, model, level, step, guess.controls)
    limits = _limits(problem, truncation, model, step, guess.controls, spare[1])
    margin = problem.solve.margin + spare[1] if rated else 0.0
    # rows: dynamics, obstacles, task, rates, and level + slack >= margin
    blocks = [
        *model.dynamics(),
        *_avoidance(problem, truncation, model, avoiding, slack, spare[0]),
        *apart_rows(problem, model, spare[0]),
        *task.blocks,
        *limits.blocks,
        *rate_rows(layout, problem.fleet.rate_bounds, model.scale.half, step),
        level_row(level, int(short[0]), margin),
    ]
    # cost: effort and smoothness, slacks, -w_rho level, terminal error
    terms = [
        *command_terms(layout, CommandCost.of(problem.objective, model.scale, step)),
        slack_term(layout, model.slack_weight),
        *([robustness_term(layout, problem.objective)] if rated else []),
        *terminal_blocks(problem, truncation, layout.points[-1, model.position_columns], model.places),
    ]
    risk = _risk(problem, truncation, model, avoiding)
    if risk is not None:
        blocks += risk.blocks
        terms += risk.terms
    # a task without rows leaves its level at 0
    lower, upper = _bounds(model, None if rated else level)
    x = _start(model, task.levels | limits.levels)
    if risk is not None:
        x[risk.index], lower[risk.index], upper[risk.index] = risk.guess, risk.lower, risk.upper
    if isinstance(avoiding, Choice):
        _set_binaries(avoiding, layout, x, lower, upper)
    program = assemble(layout.size, blocks, terms)
    return Transcription(Nlp(program, x, lower, upper, model.dependent, layout.slacks, layout.binaries), model)


def _task(
    problem: Problem, truncation: Truncation, model: Parametrisation, level: int, step: float, controls: Floats
) -> tuple[TaskRows, bool]:
    """Rows that keep the level below the task's robustness, and whether the task has one."""
    in_moments = problem.solve.guarantee == "moment"
    everybody, some = required_parts(problem, truncation.within)
    everybody = tuple(part for part in everybody if not part.limit)
    # with the guarantee `moment` every part is about the mean member
    parts = [Mean(part.formula) if in_moments else part.formula for part in everybody]
    fewer = [part.formula for part in some]
    places = np.eye(model.layout.count) if model.places is None else model.places
    # mean, everybody and some are matrices from the variables: weights, places, and places of the members in `within`
    task = task_rows(
        parts,
        level,
        model.layout,
        step,
        truncation.mean @ places,
        model.curve,
        model.shift,
        model.names,
        places,
        (fewer, truncation.inner @ places) if fewer else None,
        None if in_moments else growth(problem, controls),
        _commanded(problem, model, controls),
    )
    return task, bool(parts or fewer)


def _limits(
    problem: Problem, truncation: Truncation, model: Parametrisation, step: float, controls: Floats, spare: float
) -> TaskRows:
    """Rows that keep the rules of zones with the margin, or fall short by a slack; nothing rewards more than that."""
    parts = [part.formula for part in problem.specification.parts if part.limit]
    if not parts:
        return TaskRows([], {})
    layout = model.layout
    level, short = layout.level(), layout.slack(1)
    errors, commanded = growth(problem, controls), _commanded(problem, model, controls)
    mean, fixed = truncation.mean, (model.curve, model.shift, model.names)
    # outside, beyond one side, or slow: as at the guess, chosen again in every round
    rows = task_rows(parts, level, layout, step, mean, *fixed, errors=errors, commanded=commanded, band=0.0)
    kept = level_row(level, int(short[0]), problem.solve.margin + spare)
    return TaskRows([*rows.blocks, kept], rows.levels)


def _commanded(problem: Problem, model: Parametrisation, controls: Floats) -> Commanded | None:
    """What rows about headings and rates are made of, where the task has any."""
    if not problem.specification.signals or not isinstance(model.layout, Layout):
        return None
    return Commanded(problem, model.layout, controls)


def _avoidance(
    problem: Problem,
    truncation: Truncation,
    model: Parametrisation,
    avoiding: Avoiding | Choice,
    slack: Ints,
    spare: float,
) -> list[Block]:
    """Rows that keep the fleet out of obstacles, in the form that the guarantee and the method ask for."""
    layout, in_moments = model.layout, problem.solve.guarantee == "moment"
    if isinstance(avoiding, Choice):
        if model.places is not None:
            raise UnsupportedError("method minlp needs points of the fleet as variables")
        rows = binary_blocks(problem, truncation, layout, avoiding, slack, spare)
        return rows + (region_blocks(problem, truncation, Read.of(truncation, model)) if in_moments else [])
    if in_moments:
        return moment_blocks(problem, truncation, Read.of(truncation, model), spare)
    return avoidance_rows(model, avoiding, slack, problem.solve.margin + spare)


def _risk(
    problem: Problem, truncation: Truncation, model: Parametrisation, avoiding: Avoiding | Choice
) -> RiskRows | None:
    """The risk penalty; clearances are those that fixed hyperplanes leave."""
    if problem.objective.cvar is None:
        return None
    ends, curve = model.layout.points[:, model.position_columns], model.curve[..., problem.fleet.place_columns]
    if isinstance(avoiding, Avoiding):
        planes, pairs = avoiding.hyperplanes, avoiding.pairs
    else:
        planes = separate(curve, (), problem.duration)
        pairs = planes.active
    return risk_rows(problem, truncation, model.layout, ends, curve, planes, pairs, model.places)


def _set_binaries(choice: Choice, layout: Numbers, x: Floats, lower: Floats, upper: Floats) -> None:
    """Start and bounds of the binaries, and the workspace that their rows rely on."""
    n, index = layout.count, layout.binaries
    x[index], lower[index], upper[index] = choice.setting, 0.0, 1.0
    # big-M values hold for points in the workspace, so points are bounded by it
    for at, low, high in zip(layout.points[1:], choice.where.low[1:], choice.where.high[1:], strict=True):
        lower[at], upper[at] = np.repeat(low, n), np.repeat(high, n)


def _bounds(model: Parametrisation, idle: int | None) -> tuple[Floats, Floats]:
    """Bounds of the decision vector: the model's own, slacks, and the level of a task that has no rows."""
    layout = model.layout
    lower, upper = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    model.bound(lower, upper)
    lower[layout.slacks] = 0.0
    if idle is not None:
        lower[idle] = upper[idle] = 0.0
    return lower, upper


def _start(model: Parametrisation, levels: Mapping[int, float]) -> Floats:
    """The decision vector at the guess."""
    x = np.zeros(model.layout.size)
    model.start(x)
    for index, value in levels.items():
        x[index] = value
    x[model.layout.slacks] = SLACK_START
    return x


__all__ = ["Avoiding", "Iterate", "Transcription", "transcribe"]
