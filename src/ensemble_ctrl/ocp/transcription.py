r"""The optimal-control problem ``eq:WayPointObsAvoid`` of Arias et al., in nodal coordinates::

    minimise    -w_rho level + w_T |m(T) - m_F|^2 + sum_n (w_v v_n^2 + w_omega omega_n^2) dt + w_s sum(slacks)
                (+ a risk penalty, `ensemble_ctrl.ocp.risk`)

    over        v_n, omega_n         the broadcast commands of step n
                turned_n             the integral of the turn rate before step n, shared by every member
                P_n                  points that represent the fleet's position curve at grid time n
                level, slacks        the task's robustness, and by how much constraints fall short

    subject to  turned_{n+1} = turned_n + rate(v_n, omega_n) dt
                P_{n+1} = P_n + C d(v_n, omega_n, turned_n)
                                     d: exact arcs of the Gauss-node robots, C their points
                n_on . P_i + slack_on >= support_on + margin + sagitta
                                     every point i, both ends of step n, each obstacle o in reach
                level + slack >= margin
                the rows of the task, which keep `level` at or below its robustness (`ensemble_ctrl.ocp.task`)

The slack weight w_s is so large that slacks are zero wherever a plan is possible.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import Mean
from ensemble_ctrl.ocp.arrays import CasadiArrays
from ensemble_ctrl.ocp.chance import asked
from ensemble_ctrl.ocp.facet_binaries import Choice, binary_blocks
from ensemble_ctrl.ocp.hyperplanes import Hyperplanes, separate
from ensemble_ctrl.ocp.layout import Layout
from ensemble_ctrl.ocp.margins import bulge, curvature, keeping
from ensemble_ctrl.ocp.moment_form import moment_blocks, region_blocks
from ensemble_ctrl.ocp.program import Block, Build, Program, assemble
from ensemble_ctrl.ocp.risk import RiskRows, risk_rows
from ensemble_ctrl.ocp.task import TaskRows, task_rows
from ensemble_ctrl.ocp.terminal import terminal_blocks
from ensemble_ctrl.ocp.truncation import Truncation, node_drives, points
from ensemble_ctrl.ocp.weights import LEVEL_WEIGHT, RATE_SPARE, SLACK_WEIGHT
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Pairs = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Avoiding:
    """Separating hyperplanes at the guess, and which pairs of a side and a step are constrained by theirs."""

    hyperplanes: Hyperplanes
    pairs: Pairs

    @property
    def slacks(self) -> int:
        """How many slacks the rows need."""
        return int(self.pairs.sum())


@dataclass(frozen=True, eq=False)
class Transcription:
    """The program with what is needed to start it and to read its solution."""

    program: Program
    layout: Layout
    truncation: Truncation
    guess: Floats
    lower: Floats
    upper: Floats

    def controls(self, x: Floats) -> Floats:
        """The commands in a decision vector, shape (steps, 2), clipped to their bounds."""
        where = self.layout.controls
        return np.clip(x[where], self.lower[where], self.upper[where])


def transcribe(
    problem: Problem, truncation: Truncation, controls: Floats, avoiding: Avoiding | Choice, tail: float
) -> Transcription:
    """Build the program around a guess.

    Parameters
    ----------
    problem : Problem
        What to plan.
    truncation : Truncation
        Which moments are kept.
    controls : ndarray, shape (steps, 2)
        The guess; its length is the number of steps of the program.
    avoiding : Avoiding or Choice
        How obstacles are kept out of: fixed separating hyperplanes, or facets chosen by binaries.
    tail : float
        Truncation error in metres that the margins cover.
    """
    steps, count = len(controls), truncation.count
    layout = Layout(steps, count)
    step = problem.duration / steps
    level, short = layout.level(), layout.slack(1)
    slack = layout.slack(avoiding.slacks)
    in_moments = problem.solve.guarantee == "moment"
    everybody, some = asked(problem, truncation.within)
    parts = [Mean(part.formula) if in_moments else part.formula for part in everybody]
    fewer = [part.formula for part in some]
    curve = points(problem, controls, truncation)
    inner = (fewer, truncation.inner) if fewer else None
    task = task_rows(parts, level, layout, step, truncation.mean, curve, problem.fleet.shift, some=inner)
    rated = bool(parts or fewer)
    blocks = [_turning(problem, layout, step), _moving(problem, truncation, layout, step)]
    if isinstance(avoiding, Choice):
        blocks += binary_blocks(problem, truncation, layout, avoiding, slack, tail)
        blocks += region_blocks(problem, truncation, layout) if in_moments else []
    elif in_moments:
        blocks += moment_blocks(problem, truncation, layout)
    else:
        blocks += _avoiding(problem, truncation, layout, slack, avoiding, tail)
    blocks += task.blocks
    blocks += _rates(problem, layout, step)
    blocks.append(_satisfying(level, short[0], problem.solve.margin if rated else 0.0))
    terms = _terms(problem, truncation, layout, rated)
    risk = _risk(problem, truncation, layout, curve, avoiding)
    if risk is not None:
        blocks += risk.blocks
        terms += risk.terms
    lower, upper = _bounds(problem, layout, None if rated else level)
    guess = _guess(problem, layout, controls, curve, step, task)
    if risk is not None:
        guess[risk.index], lower[risk.index], upper[risk.index] = risk.guess, risk.lower, risk.upper
    if isinstance(avoiding, Choice):
        _choosing(avoiding, layout, guess, lower, upper)
    return Transcription(assemble(layout.size, blocks, terms), layout, truncation, guess, lower, upper)


def _turning(problem: Problem, layout: Layout, step: float) -> Block:
    """``turned`` is the running integral of the turn rate."""
    system = problem.fleet.system
    columns = np.column_stack([layout.controls, layout.turned[:-1], layout.turned[1:]])
    zero = np.zeros((layout.steps, 1))

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        _, omega = system.rates(z[0], z[1], CasadiArrays)
        turned: ca.SX = z[3] - z[2] - step * omega
        return turned

    return Block("turning", build, columns, np.zeros((layout.steps, 0)), zero, zero)


def _moving(problem: Problem, truncation: Truncation, layout: Layout, step: float) -> Block:
    """The points move by the image of the Gauss-node robots' exact displacements."""
    system, image, n = problem.fleet.system, ca.DM(truncation.to_points), layout.count
    linear, angular, heading = (ca.DM(column) for column in node_drives(problem, truncation)[:, :3].T)

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        before, after = z[3 : 3 + 2 * n], z[3 + 2 * n :]
        dx: ca.SX
        dy: ca.SX
        v, omega = system.rates(z[0], z[1], CasadiArrays)
        dx, dy = system.displacement(v, omega, z[2], linear, angular, heading, step, CasadiArrays)
        return after - before - ca.vertcat(ca.mtimes(image, dx), ca.mtimes(image, dy))

    columns = np.column_stack([layout.controls, layout.turned[:-1], layout.points[:-1], layout.points[1:]])
    zero = np.zeros((layout.steps, 2 * n))
    return Block("moving", build, columns, np.zeros((layout.steps, 0)), zero, zero)


def _avoiding(
    problem: Problem, truncation: Truncation, layout: Layout, slack: Ints, avoiding: Avoiding, tail: float
) -> list[Block]:
    """Every point of a cell, at both ends of the step, on the free side of the pair's line, or short by the slack."""
    hyperplanes = avoiding.hyperplanes
    side, at = np.nonzero(avoiding.pairs)
    keep = hyperplanes.radius[side] + keeping(problem, truncation, tail)
    level = hyperplanes.support[side, at] + keep
    data = np.column_stack([hyperplanes.normal[side, at], level[:, None] + hyperplanes.drift[side, at]])
    columns = np.column_stack([layout.controls[at], slack, layout.points[at], layout.points[at + 1]])
    arc = curvature(problem, truncation, layout.steps)
    blocks = []
    for cell, part in enumerate(hyperplanes.parts):
        rows = hyperplanes.cell[side] == cell
        if rows.any():
            low = np.zeros((int(rows.sum()), 2 * len(part)))
            build = _on_its_side(problem, arc, part)
            blocks.append(Block("avoiding", build, columns[rows], data[rows], low, low + np.inf))
    return blocks


def _on_its_side(problem: Problem, arc: float, part: Floats) -> Build:
    """The rows of one pair, for the points that `part` makes of the fleet's."""
    image, n = ca.DM(part), part.shape[1]
    same = part.shape[0] == n and bool((part == np.eye(n)).all())

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        along = [d[0] * p[:n] + d[1] * p[n:] for p in (z[3 : 3 + 2 * n], z[3 + 2 * n :])]
        ends = along if same else [ca.mtimes(image, a) for a in along]
        short = z[2] - bulge(problem, arc, z[0], z[1])
        rows: ca.SX = ca.vertcat(*(end - d[2 + k] for k, end in enumerate(ends))) + short
        return rows

    return build


def _choosing(choice: Choice, layout: Layout, guess: Floats, lower: Floats, upper: Floats) -> None:
    """Start and bounds of the binaries, and the workspace that their rows rely on."""
    n, index = layout.count, layout.binaries
    guess[index], lower[index], upper[index] = choice.setting, 0.0, 1.0
    for at, low, high in zip(layout.points[1:], choice.where.low[1:], choice.where.high[1:], strict=True):
        lower[at], upper[at] = np.repeat(low, n), np.repeat(high, n)


def _rates(problem: Problem, layout: Layout, step: float) -> list[Block]:
    """Commands change no faster than they may; a little less, so that a solver's tolerance does no harm."""
    bounds = problem.fleet.rate_bounds
    if bounds is None or layout.steps < 2:
        return []
    most = np.tile((1 - RATE_SPARE) * bounds * step, (layout.steps - 1, 1))
    columns = np.column_stack([layout.controls[:-1], layout.controls[1:]])
    return [Block("rates", lambda z, d: z[2:] - z[:2], columns, np.zeros((layout.steps - 1, 0)), -most, most)]


def _satisfying(level: int, slack: int, margin: float) -> Block:
    """The task holds with the margin, or falls short by the slack."""
    low = np.full((1, 1), margin)
    columns = np.array([[level, slack]])
    return Block("task", lambda z, d: z[0] + z[1], columns, np.zeros((1, 0)), low, low + np.inf)


def _terms(problem: Problem, truncation: Truncation, layout: Layout, rated: bool) -> list[Block]:
    """Robustness, terminal moment error, effort, the slack penalty, and the pull on idle levels."""
    aim, step = problem.objective, problem.duration / layout.steps
    none = np.zeros((1, 0))

    def effort(z: ca.SX, d: ca.SX) -> ca.SX:
        cost: ca.SX = step * ca.dot(ca.DM(aim.efforts()), z**2)
        return cost

    terms = [Block("effort", effort, layout.controls, np.zeros((layout.steps, 0)), none, none)]
    if aim.smoothness and layout.steps > 1:

        def smoothness(z: ca.SX, d: ca.SX) -> ca.SX:
            return aim.smoothness / step * ca.sumsqr(z[2:] - z[:2])

        columns = np.column_stack([layout.controls[:-1], layout.controls[1:]])
        terms.append(Block("smoothness", smoothness, columns, np.zeros((layout.steps - 1, 0)), none, none))
    terms.append(
        Block(
            "slack",
            lambda z, d: SLACK_WEIGHT * z,
            layout.slacks[:, None],
            np.zeros((len(layout.slacks), 0)),
            none,
            none,
        )
    )
    levels = layout.levels

    def reward(z: ca.SX, d: ca.SX) -> ca.SX:
        return -aim.robustness * z[0] - LEVEL_WEIGHT * ca.sum1(z[1:, :]) / max(len(levels) - 1, 1)

    if rated:
        terms.append(Block("robustness", reward, levels[None, :], none, none, none))
    terms += terminal_blocks(problem, truncation, layout)
    return terms


def _risk(
    problem: Problem, truncation: Truncation, layout: Layout, curve: Floats, avoiding: Avoiding | Choice
) -> RiskRows | None:
    """The risk penalty; clearances are those that fixed hyperplanes leave."""
    if isinstance(avoiding, Avoiding):
        return risk_rows(problem, truncation, layout, curve, avoiding.hyperplanes, avoiding.pairs)
    none = separate(curve, (), problem.duration)
    return risk_rows(problem, truncation, layout, curve, none, none.active)


def _bounds(problem: Problem, layout: Layout, idle: int | None) -> tuple[Floats, Floats]:
    """Bounds of the decision vector: inputs, the common start, slacks, and the level of a task that has no rows."""
    fleet = problem.fleet
    lower, upper = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    lower[layout.controls], upper[layout.controls] = fleet.input_lower, fleet.input_upper
    for bound in (lower, upper):
        bound[layout.turned[0]] = 0.0
        bound[layout.points[0]] = np.repeat(fleet.start, layout.count)
    lower[layout.slacks] = 0.0
    if idle is not None:
        lower[idle] = upper[idle] = 0.0
    return lower, upper


def _guess(problem: Problem, layout: Layout, controls: Floats, curve: Floats, step: float, task: TaskRows) -> Floats:
    """The decision vector under the guessed controls."""
    _, omega = problem.fleet.system.rates(*controls.T)
    x = np.zeros(layout.size)
    x[layout.controls] = controls
    x[layout.turned] = np.concatenate([[0.0], np.cumsum(omega) * step])
    x[layout.points] = np.concatenate([curve[..., 0], curve[..., 1]], axis=1)
    for index, value in task.levels.items():
        x[index] = value
    x[layout.slacks] = 1e-3
    return x
