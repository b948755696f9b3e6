"""Big-M rows: a binary at 1 keeps the points out, a binary at 0 takes nothing of the workspace away."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.ocp.facet_binaries import Choice, Facets, Workspace, binary_blocks, facet_binaries, facets, workspace
from ensemble_ctrl.ocp.layout import Layout
from ensemble_ctrl.ocp.margins import keeping, largest_bulge
from ensemble_ctrl.ocp.mixed import best, held, widened
from ensemble_ctrl.ocp.truncation import Truncation, points
from ensemble_ctrl.problem import Guarantee, Problem
from tests.examples import examples

from .problems import FLEET, five

Floats = NDArray[np.float64]
STEPS = 8
seeds = st.integers(0, 2**32 - 1)
guarantees = pytest.mark.parametrize("guarantee", ["nodes", "hull", "moment"])


def shapes(guarantee: Guarantee = "hull", **options: Any) -> Problem:
    """A triangle and a box on a short horizon."""
    problem = five(**options).with_(
        obstacles={
            "triangle": (Obstacle.polygon([[2.0, 1.0], [3.0, 1.4], [2.2, 2.4]]),),
            "box": (Obstacle.box([[0.0, 0.8], [2.0, 3.0]]),),
        },
        duration=4.0,
        steps=STEPS,
        task=parse("F[3,4] in(goal) and G avoid(triangle) and G[1,3] avoid(box)"),
        fleet=replace(FLEET, radius=0.1),
    )
    return problem.with_(solve=replace(problem.solve, guarantee=guarantee))


def truncation_of(problem: Problem) -> Truncation:
    return Truncation((3,), (2,), True) if problem.solve.guarantee == "hull" else Truncation((3,), (3,), False)


class Case:
    """A program's rows over all facets or over some, around random controls."""

    def __init__(self, problem: Problem, random: np.random.Generator, block: int = 1, share: float = 1.0) -> None:
        self.problem, self.truncation, self.random = problem, truncation_of(problem), random
        self.sides = facets(problem, STEPS)
        controls = random.uniform(-0.5, 2.0, (STEPS, 2)) * [1, 0.5]
        self.curve = points(problem, controls, self.truncation)
        self.where = workspace(problem, self.curve)
        self.tail = 0.01
        allowed = (random.random((len(self.sides.piece), STEPS)) <= share) | best(
            self.sides, self.sides.gaps(self.curve)
        )
        self.rows = facet_binaries(problem, self.truncation, self.sides, self.where, allowed, self.tail, block)
        self.choice = Choice(self.sides, self.where, self.rows, self.rows.setting(self.sides.gaps(self.curve)))
        self.layout = Layout(STEPS, self.truncation.count)
        self.slack = self.layout.slack(self.choice.slacks)
        self.blocks = binary_blocks(problem, self.truncation, self.layout, self.choice, self.slack, self.tail)

    def keeps(self, curve: Floats, setting: Floats, controls: Floats | None = None, slack: float = 0.0) -> bool:
        """Whether the points with these binaries satisfy every row."""
        x = np.zeros(self.layout.size)
        x[self.layout.controls] = np.zeros((STEPS, 2)) if controls is None else controls
        x[self.layout.points] = np.concatenate([curve[..., 0], curve[..., 1]], axis=1)
        x[self.layout.binaries], x[self.slack] = setting, slack
        for block in self.blocks:
            z, d = ca.SX.sym("z", block.columns.shape[1]), ca.SX.sym("d", block.data.shape[1])
            row = ca.Function("row", [z, d], [block.build(z, d)])
            values = np.array(row.map(len(block.columns))(x[block.columns].T, block.data.T)).T
            if (values < block.lower - 1e-9).any() or (values > block.upper + 1e-9).any():
                return False
        return True

    def anywhere(self) -> Floats:
        """Points in the workspace's boxes, corners included."""
        where = self.random.choice([0.0, 1.0, 0.5, 0.3], (STEPS + 1, self.truncation.count, 2))
        return self.where.low[:, None] + where * (self.where.high - self.where.low)[:, None]


@guarantees
@examples(30)
@given(seed=seeds, block=st.integers(1, 3), share=st.floats(0.3, 1.0))
def test_what_the_rows_admit_is_on_the_free_side(guarantee: Guarantee, seed: int, block: int, share: float) -> None:
    """Every pair of a piece and a step has one facet with all points (for `moment`: the mean) on its free side."""
    case = Case(shapes(guarantee), np.random.default_rng(seed), block, share)
    mean = case.truncation.to_moments[0] / np.sqrt(2.0)
    for _ in range(20):
        curve = case.anywhere()
        setting = np.round(case.random.random(case.rows.count))
        if not case.keeps(curve, setting):
            continue
        seen = np.einsum("p,tpd->td", mean, curve)[:, None] if guarantee == "moment" else curve
        free = case.sides.gaps(seen) >= keeping(case.problem, case.truncation, case.tail) - 1e-9
        missing = ~case.sides.of(free) & case.sides.of(case.sides.active)
        assert not missing.any()


@guarantees
@examples(30)
@given(seed=seeds)
def test_a_plan_that_holds_facets_is_admitted(guarantee: Guarantee, seed: int) -> None:
    """Not vacuous: with the facets that the points hold with the margin, the rows hold."""
    case = Case(shapes(guarantee), np.random.default_rng(seed))
    spare = keeping(case.problem, case.truncation, case.tail) + largest_bulge(case.problem, case.truncation, STEPS)
    far = np.repeat(case.where.low[:, None], case.truncation.count, axis=1)
    gaps = case.sides.gaps(far)
    assert (case.sides.of(gaps >= spare) | ~case.sides.of(case.sides.active)).all(), "left of one and below the other"
    assert case.keeps(far, case.rows.setting(gaps))
    assert not case.keeps(far, np.zeros(case.rows.count)), "no facet is chosen"


@guarantees
@examples(30)
@given(seed=seeds)
def test_a_switch_at_zero_takes_nothing_away(guarantee: Guarantee, seed: int) -> None:
    """With every binary at 0, all of the workspace satisfies the rows that have one, whatever the commands."""
    case = Case(shapes(guarantee), np.random.default_rng(seed))
    switched = [
        b for b in case.blocks if b.name.startswith("avoiding") and b.columns.shape[1] > 3 + 4 * case.layout.count
    ]
    case.blocks = switched
    extreme = case.random.choice([-2.0, 2.0], (STEPS, 2))
    assert case.keeps(case.anywhere(), np.zeros(case.rows.count), extreme)


@examples(30)
@given(seed=seeds)
def test_no_m_is_larger_than_it_must_be(seed: int) -> None:
    """Some point of the workspace needs all of it."""
    case = Case(shapes("nodes"), np.random.default_rng(seed))
    needed = case.sides.offset + keeping(case.problem, case.truncation, case.tail)
    for f, k, m in zip(case.rows.facet, case.rows.step, case.rows.big_m, strict=True):
        corners = [
            [box[i][0], box[j][1]]
            for at in (k, k + 1)
            for box in [(case.where.low[at], case.where.high[at])]
            for i in (0, 1)
            for j in (0, 1)
        ]
        assert m == pytest.approx(max(0.0, (needed[f] - np.array(corners) @ case.sides.normal[f]).max()))


@examples(30)
@given(seed=seeds)
def test_the_moment_rows_are_those_of_the_obstacle(seed: int) -> None:
    """Bounds equal `Obstacle.big_m_bounds` of an obstacle with the same facet, with the row's own M."""
    case = Case(shapes("moment"), np.random.default_rng(seed))
    blocks = [b for b in case.blocks if b.name == "avoiding (moments)"]
    keep = keeping(case.problem, case.truncation, case.tail)
    triangle = Obstacle.polygon([[2.0, 1.0], [3.0, 1.4], [2.2, 2.4]])
    G, h = triangle.unit_rows()
    grown = Obstacle(-G, -(h + 0.1 + keep))
    seen = 0
    for block in blocks:
        for (nx, ny, m), low, high in zip(block.data, block.lower, block.upper, strict=True):
            match = np.flatnonzero(np.abs(G - [nx, ny]).max(axis=1) < 1e-12)
            if match.size:
                rows = grown.big_m_bounds(case.truncation.basis, m)
                np.testing.assert_allclose(low, np.tile(rows.lower[:, match[0]], 2), atol=1e-12)
                np.testing.assert_allclose(high, np.tile(rows.upper[:, match[0]], 2), atol=1e-12)
                seen += 1
    assert seen == int((case.rows.piece == 0).sum())


@examples(50)
@given(seed=seeds)
def test_members_stay_in_the_workspace(seed: int) -> None:
    """Any controls within the bounds whose way stays on the map are inside at every grid time."""
    random = np.random.default_rng(seed)
    problem, truncation = shapes("nodes"), Truncation((3,), (3,), False)
    where = workspace(problem, points(problem, np.zeros((STEPS, 2)), truncation))
    lowest, highest = where.low.min(axis=0), where.high.max(axis=0)
    way = points(problem, random.uniform(-2, 2, (STEPS, 2)), truncation)
    for k in range(STEPS + 1):
        if (way[: k + 1] < lowest).any() or (way[: k + 1] > highest).any():
            return
        assert (way[k] >= where.low[k] - 1e-9).all()
        assert (way[k] <= where.high[k] + 1e-9).all()


def test_windows_and_reach_leave_rows_out() -> None:
    case = Case(shapes(), np.random.default_rng(1))
    assert set(case.rows.step[case.rows.piece == 1].tolist()) <= {2, 3, 4, 5}, "the box is kept out of from 1 s to 3 s"
    away = shapes().with_(
        obstacles={"triangle": (Obstacle.box([[90, 91], [90, 91]]),), "box": shapes().obstacles["box"]}
    )
    low = np.tile([-1.0, -1.0], (STEPS + 1, 1))
    sides = facets(away, STEPS)
    everything = np.ones((len(sides.piece), STEPS), dtype=bool)
    rows = facet_binaries(away, truncation_of(away), sides, Workspace(low, low + 9), everything, 0.0, 1)
    assert 0 not in rows.piece, "nobody gets to the far one"
    assert 1 in rows.piece


def test_one_choice_needs_no_switch_and_blocks_share_theirs() -> None:
    case = Case(shapes(), np.random.default_rng(2), share=0.0)
    assert (case.rows.count, case.rows.groups) == (0, ())
    assert len(case.rows.facet)
    single, shared = (Case(shapes(), np.random.default_rng(3), block) for block in (1, 4))
    assert shared.rows.count < single.rows.count
    np.testing.assert_array_equal(shared.rows.facet, single.rows.facet)


def test_without_obstacles_there_is_nothing() -> None:
    free = shapes().with_(task=parse("F[3,4] in(goal)"))
    sides = facets(free, STEPS)
    assert sides.pieces == 0
    nowhere = np.zeros((0, STEPS), dtype=bool)
    box = Workspace(np.zeros((STEPS + 1, 2)), np.ones((STEPS + 1, 2)))
    assert facet_binaries(free, truncation_of(free), sides, box, nowhere, 0.0, 1).count == 0


@examples(50)
@given(seed=seeds, least=st.floats(-1, 1), steps=st.integers(0, 9))
def test_neighbourhoods_contain_the_plan(seed: int, least: float, steps: int) -> None:
    random = np.random.default_rng(seed)
    sides: Facets = facets(shapes(), STEPS)
    gaps = random.normal(size=(len(sides.piece), STEPS))
    only, more = best(sides, gaps), held(sides, gaps, least)
    assert (only.sum(axis=0) == sides.pieces).all()
    assert (only <= more).all()
    assert (more == (only | (gaps >= least - 1e-6))).all()
    wide = widened(more, steps)
    for k in range(STEPS):
        near = more[:, max(0, k - steps) : k + steps + 1]
        np.testing.assert_array_equal(wide[:, k], near.any(axis=1))
