r"""The optimal-control problem for a fleet that follows a differential equation, by multiple shooting::

    minimise    -w_rho level + 2 w_T E|p(T) - r|^2 + w_u sum_n |u_n - u_rest|^2 dt + w_s sum(slacks)

    over        u_n         the broadcast commands of step n, in half widths of their bounds
                X_jn        the state of the Gauss-node robot j at grid time n
                level, slacks

    subject to  X_j,n+1 = Phi(X_jn, u_n, psi_j)          Phi: the system's own map, or a Runge-Kutta rule
                n_on . (C p)_i + slack_on >= support_on + radius + margin + spare
                                                         every place i of the hull, both ends of step n, each obstacle o
                level + slack >= margin
                the rows of the task (`ensemble_ctrl.ocp.task`) at every place C X

With the guarantee ``hull`` the places are the Bernstein coefficients of the polynomial through the nodes' states, with
``nodes`` the nodes themselves.  What the polynomial misses, and what happens between grid times, is measured by a finer
replay and comes back as `spare`.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.program import Block, Program, assemble
from ensemble_ctrl.ocp.shooting.layout import ShootingLayout
from ensemble_ctrl.ocp.shooting.planes import Planes
from ensemble_ctrl.ocp.shooting.traced import moved
from ensemble_ctrl.ocp.task import TaskRows, task_rows
from ensemble_ctrl.ocp.truncation import Truncation
from ensemble_ctrl.ocp.weights import LEVEL_WEIGHT, RATE_SPARE, SHOOTING_SLACK_WEIGHT
from ensemble_ctrl.problem import OdeProblem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Iterate:
    """Commands and the states of the node robots under them, or near them.

    Attributes
    ----------
    controls : ndarray, shape (steps, n_u)
    states : ndarray, shape (steps + 1, n_x, nodes)
    """

    controls: Floats
    states: Floats


@dataclass(frozen=True, eq=False)
class Shooting:
    """The program with what is needed to start it and to read its solution."""

    program: Program
    layout: ShootingLayout
    guess: Floats
    lower: Floats
    upper: Floats
    middle: Floats
    half: Floats

    def iterate(self, x: Floats) -> Iterate:
        """Commands, clipped to their bounds, and states in a decision vector."""
        scaled = np.clip(x[self.layout.controls], -1.0, 1.0)
        return Iterate(self.middle + self.half * scaled, x[self.layout.states])


def transcribe(
    problem: OdeProblem,
    truncation: Truncation,
    guess: Iterate,
    planes: Planes,
    pairs: NDArray[np.bool_],
    substeps: int,
    spare: tuple[float, float],
) -> Shooting:
    """Build the program around a guess.

    Parameters
    ----------
    problem : OdeProblem
        What to plan.
    truncation : Truncation
        Which node robots stand for the fleet, and which combinations of them have to keep the constraints.
    guess : Iterate
        Commands and states to start from.
    planes : Planes
        Separating planes at the guess.
    pairs : ndarray of bool, shape (pieces, steps)
        Which of them are rows.
    substeps : int
        Runge-Kutta steps in a step of control.
    spare : (float, float)
        Metres to keep beyond the margin: from obstacles, and in the task.
    """
    fleet, steps = problem.fleet, len(guess.controls)
    layout = ShootingLayout(steps, guess.states.shape[2], len(fleet.system.controls), len(fleet.states))
    step = problem.duration / steps
    lower, upper = np.asarray(fleet.input_lower), np.asarray(fleet.input_upper)
    middle, half = (lower + upper) / 2, np.maximum((upper - lower) / 2, 1e-9)
    level, short = layout.level(), layout.slack(1)
    slack = layout.slack(int(pairs.sum()))
    parts = [part.formula for part in problem.specification.parts]
    places = truncation.to_points
    mean = truncation.mean @ places
    curve = guess.states.transpose(0, 2, 1)
    shift = np.zeros(len(fleet.states))
    task = task_rows(parts, level, layout, step, mean, curve, shift, fleet.states, places)
    blocks = [_moving(problem, truncation, layout, middle, half, step, substeps)]
    blocks += _avoiding(problem, layout, places, planes, pairs, slack, problem.solve.margin + spare[0])
    blocks += task.blocks
    blocks += _rates(problem, layout, half, step)
    margin = problem.solve.margin + spare[1] if parts else 0.0
    bound = np.full((1, 1), margin)
    satisfying = np.array([[level, short[0]]])
    blocks.append(Block("task", lambda z, d: z[0] + z[1], satisfying, np.zeros((1, 0)), bound, bound + np.inf))
    terms = _terms(problem, truncation, layout, (fleet.rest(fleet.center) - middle) / half, step, bool(parts))
    low, high = _bounds(problem, layout, truncation, level, bool(parts), upper == lower)
    x = _guess(layout, guess, middle, half, task)
    return Shooting(assemble(layout.size, blocks, terms), layout, x, low, high, middle, half)


def _moving(
    problem: OdeProblem,
    truncation: Truncation,
    layout: ShootingLayout,
    middle: Floats,
    half: Floats,
    step: float,
    substeps: int,
) -> Block:
    """Each node robot's state follows from its last one."""
    system, fleet = problem.fleet.system, problem.fleet
    psi = fleet.psi(fleet.bent_members(truncation.nodes))
    names, n_u, n_x = list(psi), layout.n_u, layout.n_x

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        u = [float(m) + float(h) * z[i] for i, (m, h) in enumerate(zip(middle, half, strict=True))]
        own = {name: d[i] for i, name in enumerate(names)}
        before, after = z[n_u : n_u + n_x], z[n_u + n_x :]
        defect: ca.SX = after - moved(system, before, u, own, step, substeps)
        return defect

    states, nodes = layout.states, layout.count
    rows = [layout.controls.repeat(nodes, axis=0)]
    rows += [part.transpose(0, 2, 1).reshape(-1, n_x) for part in (states[:-1], states[1:])]
    data = np.tile(
        np.stack([psi[name] for name in names], axis=1) if names else np.zeros((nodes, 0)), (layout.steps, 1)
    )
    zero = np.zeros((layout.steps * nodes, n_x))
    return Block("moving", build, np.hstack(rows), data, zero, zero)


def _avoiding(
    problem: OdeProblem,
    layout: ShootingLayout,
    places: Floats,
    planes: Planes,
    pairs: NDArray[np.bool_],
    slack: Ints,
    keep: float,
) -> list[Block]:
    """Every place of the hull, at both ends of the step, on its side of the pair's plane, or short by the slack."""
    if not pairs.any():
        return []
    side, at = np.nonzero(pairs)
    fleet, n, image = problem.fleet, layout.count, ca.DM(places)
    d = len(fleet.places)
    ends = layout.states[:, fleet.place_columns].reshape(layout.steps + 1, -1)
    data = np.column_stack([planes.normal[side, at], planes.support[side, at] + planes.radius[side] + keep])

    def build(z: ca.SX, data: ca.SX) -> ca.SX:
        rows = []
        for k in range(2):
            at_end = z[1 + k * d * n : 1 + (k + 1) * d * n]
            along = sum((data[i] * at_end[i * n : (i + 1) * n] for i in range(1, d)), data[0] * at_end[:n])
            rows.append(ca.mtimes(image, along) - data[d] + z[0])
        result: ca.SX = ca.vertcat(*rows)
        return result

    low = np.zeros((len(at), 2 * len(places)))
    return [Block("avoiding", build, np.column_stack([slack, ends[at], ends[at + 1]]), data, low, low + np.inf)]


def _rates(problem: OdeProblem, layout: ShootingLayout, half: Floats, step: float) -> list[Block]:
    """Commands change no faster than they may; a little less, so that a solver's tolerance does no harm."""
    bounds = problem.fleet.rate_bounds
    if bounds is None or layout.steps < 2:
        return []
    most = np.tile((1 - RATE_SPARE) * bounds * step / half, (layout.steps - 1, 1))
    columns = np.column_stack([layout.controls[:-1], layout.controls[1:]])
    none = np.zeros((layout.steps - 1, 0))
    return [Block("rates", lambda z, d: z[layout.n_u :] - z[: layout.n_u], columns, none, -most, most)]


def _terms(
    problem: OdeProblem, truncation: Truncation, layout: ShootingLayout, rest: Floats, step: float, tasked: bool
) -> list[Block]:
    """Robustness, terminal error, effort, the slack penalty, and the pull on idle levels."""
    aim, none, n_u = problem.objective, np.zeros((1, 0)), layout.n_u
    empty = np.zeros((layout.steps, 0))
    still = ca.DM(rest)
    weights = ca.DM(aim.efforts(n_u))

    def effort(z: ca.SX, d: ca.SX) -> ca.SX:
        cost: ca.SX = step * ca.dot(weights, (z - still) ** 2)
        return cost

    terms = [Block("effort", effort, layout.controls, empty, empty, empty)]
    if aim.smoothness and layout.steps > 1:
        columns = np.column_stack([layout.controls[:-1], layout.controls[1:]])
        few = np.zeros((layout.steps - 1, 0))
        terms.append(
            Block(
                "smoothness",
                lambda z, d: aim.smoothness / step * ca.sumsqr(z[n_u:] - z[:n_u]),
                columns,
                few,
                few,
                few,
            )
        )
    slacks = layout.slacks[:, None]
    terms.append(Block("slack", lambda z, d: SHOOTING_SLACK_WEIGHT * z, slacks, np.zeros((len(slacks), 0)), none, none))
    levels = layout.levels

    def reward(z: ca.SX, d: ca.SX) -> ca.SX:
        return -aim.robustness * z[0] - LEVEL_WEIGHT * ca.sum1(z[1:, :]) / max(len(levels) - 1, 1)

    if tasked:
        terms.append(Block("robustness", reward, levels[None, :], none, none, none))
    if isinstance(aim.target, np.ndarray) and aim.terminal:
        terms.append(_terminal(problem, truncation, layout, aim.target, aim.terminal))
    return terms


def _terminal(
    problem: OdeProblem, truncation: Truncation, layout: ShootingLayout, target: Floats, weight: float
) -> Block:
    """Twice the fleet's mean squared distance from the target."""
    n, none = layout.count, np.zeros((1, 0))
    form = ca.DM(truncation.to_points.T @ truncation.square @ truncation.to_points)

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        off = [z[i * n : (i + 1) * n] - float(goal) for i, goal in enumerate(target)]
        return weight * sum((ca.bilin(form, one, one) for one in off), ca.SX(0))

    return Block("terminal", build, layout.states[-1, problem.fleet.place_columns].reshape(1, -1), none, none, none)


def _bounds(
    problem: OdeProblem,
    layout: ShootingLayout,
    truncation: Truncation,
    level: int,
    tasked: bool,
    fixed: NDArray[np.bool_],
) -> tuple[Floats, Floats]:
    """Bounds of the decision vector: inputs, the start, and slacks."""
    lower, upper = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    lower[layout.controls], upper[layout.controls] = -np.where(fixed, 0.0, 1.0), np.where(fixed, 0.0, 1.0)
    fleet = problem.fleet
    start = fleet.start_states(fleet.bent_members(truncation.nodes))
    for bound in (lower, upper):
        bound[layout.states[0]] = start
    lower[layout.slacks] = 0.0
    if not tasked:
        lower[level] = upper[level] = 0.0
    return lower, upper


def _guess(layout: ShootingLayout, guess: Iterate, middle: Floats, half: Floats, task: TaskRows) -> Floats:
    """The decision vector at the guess."""
    x = np.zeros(layout.size)
    x[layout.controls] = (guess.controls - middle) / half
    x[layout.states] = guess.states
    for index, value in task.levels.items():
        x[index] = value
    x[layout.slacks] = 1e-3
    return x
