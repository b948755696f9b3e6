"""Rows and terms that every parametrisation shares; `ensemble_ctrl.ocp.transcription` puts them together."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.cost import CommandCost
from ensemble_ctrl.ocp.hyperplanes import Hyperplanes
from ensemble_ctrl.ocp.layout import Numbers
from ensemble_ctrl.ocp.parametrisation import Parametrisation
from ensemble_ctrl.ocp.program import Block, Build
from ensemble_ctrl.ocp.weights import LEVEL_WEIGHT, RATE_SPARE
from ensemble_ctrl.problem import Objective

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


def avoidance_rows(model: Parametrisation, avoiding: Avoiding, slack: Ints, keep: float) -> list[Block]:
    """``n . P_i - drift + slack - bulge >= support + radius + keep`` for a cell's points, at both ends of a step."""
    planes, layout = avoiding.hyperplanes, model.layout
    side, at = np.nonzero(avoiding.pairs)
    d = planes.normal.shape[2]
    # data of a pair: n (d numbers), then what n . P has to reach at the step's begin and at its end
    level = planes.support[side, at] + (planes.radius[side] + keep)
    data = np.column_stack([planes.normal[side, at], level[:, None] + planes.drift[side, at]])
    if model.bodies is not None:
        found: list[Block] = model.bodies.blocks(planes, side, at, slack, data, model.bulge)
        return found
    ends = layout.points[:, model.position_columns]
    columns = np.column_stack([layout.controls[at], slack, ends[at], ends[at + 1]])
    blocks = []
    for cell, part in enumerate(planes.parts):
        rows = planes.cell[side] == cell
        if rows.any():
            image = part if model.places is None else part @ model.places
            low = np.zeros((int(rows.sum()), 2 * len(part)))
            build = _on_its_side(model, image, d)
            blocks.append(Block("avoiding", build, columns[rows], data[rows], low, low + np.inf))
    return blocks


def _on_its_side(model: Parametrisation, image: Floats, d: int) -> Build:
    """The rows of one pair, for the points that `image` makes of the fleet's variables."""
    n_u, n = model.layout.controls.shape[1], image.shape[1]
    same = image.shape[0] == n and bool((image == np.eye(n)).all())
    matrix = ca.DM(image)

    def build(z: ca.SX, data: ca.SX) -> ca.SX:
        first = n_u + 1
        ends = (z[first : first + d * n], z[first + d * n :])
        # data: n_1 .. n_d, then the levels at the begin and the end of the step; z: u, slack, P_begin, P_end
        # n . P for every variable, mapped to the points: both are linear
        along = [sum((data[i] * p[i * n : (i + 1) * n] for i in range(1, d)), data[0] * p[:n]) for p in ends]
        reached = along if same else [ca.mtimes(matrix, a) for a in along]
        short = z[n_u] - model.bulge(z[:n_u])
        rows: ca.SX = ca.vertcat(*(end - data[d + k] for k, end in enumerate(reached))) + short
        return rows

    return build


def rate_rows(layout: Numbers, bounds: Floats | None, half: Floats, step: float) -> list[Block]:
    """Commands change no faster than they may; a little less, so that a solver's tolerance does no harm."""
    if bounds is None or layout.steps < 2:
        return []
    n_u = layout.controls.shape[1]
    # |s_(n+1) - s_n| <= rate bound * dt / half
    most = np.tile((1 - RATE_SPARE) * bounds * step / half, (layout.steps - 1, 1))
    columns = np.column_stack([layout.controls[:-1], layout.controls[1:]])
    return [Block("rates", lambda z, d: z[n_u:] - z[:n_u], columns, np.zeros((layout.steps - 1, 0)), -most, most)]


def level_row(level: int, slack: int, margin: float) -> Block:
    """The task holds with the margin, or falls short by the slack."""
    # rho + slack >= margin
    low = np.full((1, 1), margin)
    columns = np.array([[level, slack]])
    return Block("task", lambda z, d: z[0] + z[1], columns, np.zeros((1, 0)), low, low + np.inf)


def command_terms(layout: Numbers, cost: CommandCost) -> list[Block]:
    """Effort of every step, and smoothness between steps."""
    n_u = layout.controls.shape[1]

    def effort(z: ca.SX, d: ca.SX) -> ca.SX:
        value: ca.SX = cost.effort(ca.vertsplit(z))
        return value

    def roughness(z: ca.SX, d: ca.SX) -> ca.SX:
        value: ca.SX = cost.roughness(ca.vertsplit(z[n_u:] - z[:n_u]))
        return value

    # an instance for each step, and for each two steps in turn
    terms = [_term("effort", effort, layout.controls)]
    if cost.smoothness and layout.steps > 1:
        terms.append(_term("smoothness", roughness, np.column_stack([layout.controls[:-1], layout.controls[1:]])))
    return terms


def slack_term(layout: Numbers, weight: float) -> Block:
    """The penalty on slacks."""
    return _term("slack", lambda z, d: weight * z, layout.slacks[:, None])


def robustness_term(layout: Numbers, aim: Objective) -> Block:
    """The reward of the task's level, the first, and the pull on idle levels."""
    levels = layout.levels

    def reward(z: ca.SX, d: ca.SX) -> ca.SX:
        return -aim.robustness * z[0] - LEVEL_WEIGHT * ca.sum1(z[1:, :]) / max(len(levels) - 1, 1)

    return _term("robustness", reward, levels[None, :])


def _term(name: str, build: Build, columns: Ints) -> Block:
    """A term of the objective without data."""
    none = np.zeros((len(columns), 0))
    return Block(name, build, columns, none, none, none)
