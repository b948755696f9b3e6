"""The task's rows: a level that they allow is never above the exact robustness of any member."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import (
    Always,
    And,
    Avoid,
    Eventually,
    ExactOps,
    Formula,
    Inside,
    Mean,
    Not,
    Or,
    Predicate,
    Share,
    StateSignals,
    Until,
    ground,
    member_robustness,
    parse,
)
from ensemble_ctrl.core.errors import ProblemError, UnsupportedError
from ensemble_ctrl.ocp.layout import Layout
from ensemble_ctrl.ocp.program import assemble
from ensemble_ctrl.ocp.task import SHARPNESS, TaskRows, task_rows
from ensemble_ctrl.ocp.truncation import Truncation, points
from tests.examples import examples

from .problems import five

Floats = NDArray[np.float64]
STEPS, STEP, COUNT = 12, 0.5, 3
REGIONS = {"goal": Polyhedron.box([[0.0, 1.5], [-0.5, 1.0]])}
OBSTACLES = {
    "o1": Obstacle.box([[0.3, 0.9], [0.2, 2.0]]),
    "o2": Obstacle.polygon([[-1, 0], [1, -1], [0, 1]]),
}
numbers = st.floats(-3, 3).map(lambda v: round(v, 2))
times = st.sampled_from([0.0, 0.5, 1.0, 1.6, 3.0])


def predicate(c: tuple[float, float], d: float) -> Formula:
    return Predicate((("x", c[0]), ("y", c[1])), d)


def grow(child: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
    """Every operator over `child`, but for the mean, whose members are weighted."""
    window = st.tuples(times, times).map(sorted) | st.just((None, None))
    some = st.lists(child, min_size=2, max_size=3).map(tuple)
    return st.one_of(
        st.builds(Not, child),
        st.builds(And, some),
        st.builds(Or, some),
        st.builds(lambda f, w: Eventually(f, *w), child, window),
        st.builds(lambda f, w: Always(f, *w), child, window),
        st.builds(lambda f, g, w: Until(f, g, *w), child, child, window),
        st.builds(Share, st.sampled_from([0.1, 0.5, 1.0]), child),
    )


leaves = st.one_of(
    st.builds(predicate, st.tuples(numbers, numbers).filter(any), numbers),
    st.just(Inside("goal")),
    st.sampled_from(["o1", "o2", "obstacles", "goal"]).map(Avoid),
)
formulas = st.recursive(leaves, grow, max_leaves=6)


def rows_of(parts: list[Formula], guess: Floats, mean: Floats | None = None) -> tuple[TaskRows, Layout, int]:
    """The rows of a task made around the points `guess`, with the level of the whole."""
    layout = Layout(len(guess) - 1, guess.shape[1])
    level = layout.level()
    weights = np.full(layout.count, 1 / layout.count) if mean is None else mean
    grounded = [ground(part, REGIONS, OBSTACLES) for part in parts]
    return task_rows(grounded, level, layout, STEP, weights, guess, np.zeros(2)), layout, level


def largest(rows: TaskRows, layout: Layout, curve: Floats) -> dict[int, float]:
    """The largest levels that the program's rows allow at a curve, found from the rows themselves.

    Each row is ``something that grows with other levels, less one level``: from far above, every level falls to what
    its rows allow, again and again until none moves.
    """
    program, x, levels = assemble(layout.size, rows.blocks, []), np.full(layout.size, 1e4), layout.levels
    x[layout.points] = np.concatenate([curve[..., 0], curve[..., 1]], axis=1)
    for _ in range(100):
        g, jacobian = (np.array(ca.densify(v)) for v in program.functions["jac_g"](x, program.parameters))
        slopes = jacobian[:, levels]
        np.testing.assert_allclose(slopes.min(axis=1), -1, atol=1e-12)
        assert (np.sort(slopes, axis=1)[:, 1:] >= 0).all()
        allowed, bounded = np.full(len(levels), np.inf), slopes.argmin(axis=1)
        np.minimum.at(allowed, bounded, x[levels][bounded] + g.ravel() - program.lower)
        moved = np.abs(allowed - x[levels]).max()
        x[levels] = allowed
        if moved < 1e-12 * max(1.0, np.abs(allowed).max()):
            return dict(zip(levels.tolist(), allowed.tolist(), strict=True))
    raise AssertionError("the levels bound each other in a circle")


def exact(parts: list[Formula], paths: Floats, step: float = STEP) -> float:
    """The worst member's robustness, shape of `paths` (members, steps + 1, 2)."""
    signals = StateSignals(paths, ("x", "y"), step)
    grounded = [ground(part, REGIONS, OBSTACLES) for part in parts]
    return min(float(np.min(member_robustness(f, signals, ExactOps()))) for f in grounded)


def members_of(curve: Floats, rng: np.random.Generator) -> Floats:
    """Members in the hull of the points: each a fixed mixture of them, the points themselves among them."""
    mixtures = np.concatenate([np.eye(COUNT), rng.dirichlet(np.full(COUNT, 0.7), 20)])
    return np.asarray(np.einsum("mp,tpd->mtd", mixtures, curve))


def random_curve(rng: np.random.Generator, spread: float = 2.0) -> Floats:
    """Points that jump about the places, at every time `spread` apart."""
    middle = rng.normal(scale=2, size=(STEPS + 1, 1, 2))
    return middle + rng.normal(scale=spread, size=(STEPS + 1, COUNT, 2))


def readable(parts: list[Formula]) -> None:
    """Give up an example whose windows do not fit the horizon or the grid."""
    try:
        exact(parts, np.zeros((1, STEPS + 1, 2)))
    except ProblemError as error:
        assume("windows" not in str(error))
        raise


@examples(150)
@given(st.lists(formulas, min_size=1, max_size=2), st.integers(0, 2**32 - 1), st.sampled_from([0.1, 1.0, 5.0]))
def test_the_level_at_the_guess_is_never_above_any_members_robustness(
    parts: list[Formula], seed: int, spread: float
) -> None:
    readable(parts)
    rng = np.random.default_rng(seed)
    curve = random_curve(rng, spread)
    rows, _, level = rows_of(parts, curve)
    assert rows.levels[level] <= exact(parts, members_of(curve, rng)) + 1e-12


@examples(50)
@given(formulas, st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_rows_made_around_one_guess_are_sound_at_every_other_curve(formula: Formula, seed: int, change: float) -> None:
    readable([formula])
    rng = np.random.default_rng(seed)
    guess = random_curve(rng)
    curve = guess + change * (random_curve(rng) - guess)
    rows, layout, level = rows_of([formula], guess)
    assert largest(rows, layout, curve)[level] <= exact([formula], members_of(curve, rng)) + 1e-9


@examples(30)
@given(formulas, st.integers(0, 2**32 - 1))
def test_the_levels_to_start_from_are_the_largest_that_the_rows_allow(formula: Formula, seed: int) -> None:
    readable([formula])
    guess = random_curve(np.random.default_rng(seed))
    rows, layout, _ = rows_of([formula], guess)
    wanted = largest(rows, layout, guess)
    assert set(rows.levels) == set(wanted)
    np.testing.assert_allclose([rows.levels[i] for i in wanted], list(wanted.values()), atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "text",
    [
        "F[14,16] in(goal)",
        "G avoid(obstacles)",
        "(avoid(o1) U[2,9] in(goal)) or F G[0,2] avoid(o3)",
        "not G[3,9] (x <= 4 and y <= 4)",
    ],
)
def test_the_level_holds_for_the_truncated_fleet_under_random_controls(text: str, seed: int) -> None:
    problem, truncation = five(), Truncation((4,), (2,), True)
    rng = np.random.default_rng(seed)
    curve = points(problem, rng.uniform(-1, 1, (32, 2)) * [2, 0.5], truncation)
    members = np.einsum("ij,tjd->itd", truncation.evaluation(np.linspace(-1, 1, 15)[:, None]), curve)
    formula = ground(parse(text), problem.regions, problem.obstacles)
    layout = Layout(32, truncation.count)
    level = layout.level()
    found = task_rows([formula], level, layout, 0.5, truncation.mean, curve, np.zeros(2)).levels[level]
    signals = StateSignals(members, ("x", "y"), 0.5)
    wanted = float(np.min(member_robustness(formula, signals, ExactOps())))
    assert found <= wanted + 1e-12
    assert found >= wanted - 2.0, "sound but useless"


def test_the_level_is_exact_without_a_maximum_and_within_log_n_over_k_with_one() -> None:
    curve = random_curve(np.random.default_rng(0))
    parts = [parse("G in(goal)"), parse("G[1,3] x + 2*y >= -1")]
    rows, _, level = rows_of(parts, curve)
    assert rows.levels[level] == pytest.approx(exact(parts, curve.transpose(1, 0, 2)), abs=1e-12)
    one = np.repeat(curve[:, :1], COUNT, axis=1)
    visit = [parse("F[1,3] in(goal)")]
    rows, _, level = rows_of(visit, one)
    gap = exact(visit, one[:, :1].transpose(1, 0, 2)) - rows.levels[level]
    assert -1e-12 <= gap <= np.log(5) / SHARPNESS


def test_the_mean_is_read_with_its_weights() -> None:
    curve, weights = random_curve(np.random.default_rng(1)), np.array([0.5, 0.2, 0.3])
    mean = np.einsum("p,tpd->td", weights, curve)
    rows, layout, level = rows_of([Mean(parse("G in(goal)"))], curve, weights)
    wanted = exact([parse("G in(goal)")], mean[None])
    assert rows.levels[level] == pytest.approx(wanted, abs=1e-12)
    assert largest(rows, layout, curve)[level] == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize("scale", [1e6, -1e6])
@pytest.mark.parametrize(
    "text", ["F x >= 0", "G (x >= 0 or x <= -5)", "x >= 0 U[0,1] y >= 3", "not F (x >= 0 and y <= 7)"]
)
def test_huge_values_do_not_overflow(text: str, scale: float) -> None:
    curve = np.full((STEPS + 1, COUNT, 2), scale) + np.arange(COUNT)[:, None] * 1.0
    with np.errstate(all="raise", under="ignore"):
        rows, layout, level = rows_of([parse(text)], curve)
    wanted = exact([parse(text)], curve.transpose(1, 0, 2))
    assert wanted - 1 <= rows.levels[level] <= wanted + 1e-9
    program, x = assemble(layout.size, rows.blocks, []), np.zeros(layout.size)
    x[layout.points] = np.concatenate([curve[..., 0], curve[..., 1]], axis=1)
    for index, value in rows.levels.items():
        x[index] = value
    g, jacobian = program.functions["jac_g"](x, program.parameters)
    hessian = program.functions["hess_lag"](x, program.parameters, 1, np.ones(program.lower.size))
    assert all(np.isfinite(np.array(ca.vec(value))).all() for value in (g, jacobian, hessian))
    assert np.array(g).min() >= -1e-6


def test_no_parts_make_no_rows() -> None:
    rows, _, _ = rows_of([], np.zeros((STEPS + 1, COUNT, 2)))
    assert rows.blocks == []
    assert rows.levels == {}


def test_a_state_that_the_planner_does_not_have_is_named() -> None:
    with pytest.raises(UnsupportedError, match=r"^task: the planner needs predicates over x and y, got .*heading"):
        rows_of([parse("F heading >= 0")], np.zeros((STEPS + 1, COUNT, 2)))
