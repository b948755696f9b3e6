"""Progression along a known past, against the robustness walk over the whole signal."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ensemble_ctrl.constraints.stl import (
    ExactOps,
    Formula,
    Known,
    Mean,
    Not,
    Predicate,
    Release,
    Share,
    SmoothOps,
    StateSignals,
    Until,
    leaves,
    negation_normal_form,
    parse,
    progressed,
    robustness,
    settled,
)
from ensemble_ctrl.constraints.stl.formula import Always, Eventually
from ensemble_ctrl.constraints.stl.progression import Reading
from ensemble_ctrl.core.errors import ProblemError, UnsupportedError
from tests.examples import examples

from .stl_strategies import NAMES, formulas, predicates, signals

EXACT = ExactOps()
STEP = 0.5
random_formulas = formulas(predicates(), st.sampled_from([0.0, 0.5, 1.0, 1.6, 3.0])).filter(
    lambda f: not _speaks_of_a_fleet(f)
)


def _speaks_of_a_fleet(formula: Formula) -> bool:
    return isinstance(formula, Mean | Share) or any(map(_speaks_of_a_fleet, formula.parts))


def reader(data: StateSignals) -> Reading:
    return lambda leaf, k: float(robustness(leaf, data, EXACT, k))


def rest_of(data: StateSignals, past: int) -> StateSignals:
    return StateSignals(data.states[:, past:], NAMES, data.step)


def whole_value(formula: Formula, data: StateSignals) -> float:
    """The robustness walk over everything; the example is dropped if the formula doesn't fit on the grid."""
    try:
        return float(robustness(formula, data, EXACT))
    except ProblemError:
        assume(False)
        raise


@examples(150)
@given(random_formulas, st.integers(0, 1000), st.integers(0, 20))
def test_the_rest_of_the_formula_over_the_rest_of_the_signal_is_the_whole(
    formula: Formula, seed: int, past: int
) -> None:
    data = signals(seed, members=1)
    wanted = whole_value(formula, data)
    left = progressed(formula, reader(data), past, data.steps, STEP)
    assert robustness(left, rest_of(data, past), EXACT) == pytest.approx(wanted, rel=1e-12, abs=1e-12)
    assert (robustness(settled(left), rest_of(data, past), EXACT) >= 0) == (wanted >= 0)


@examples(100)
@given(random_formulas, st.integers(0, 1000))
def test_at_the_end_a_number_is_left(formula: Formula, seed: int) -> None:
    data = signals(seed, members=1)
    wanted = whole_value(formula, data)
    left = progressed(formula, reader(data), data.steps + 1, data.steps, STEP)
    assert isinstance(left, Known)
    assert left.value == pytest.approx(wanted, rel=1e-12, abs=1e-12)


@examples(100)
@given(random_formulas, st.integers(0, 1000), st.integers(0, 20), st.floats(0, 5))
def test_lower_bounds_of_the_past_give_lower_bounds(formula: Formula, seed: int, past: int, less: float) -> None:
    data = signals(seed, members=1)
    wanted = whole_value(formula, data)
    read = reader(data)
    left = progressed(formula, lambda leaf, k: read(leaf, k) - less, past, data.steps, STEP)
    value = float(robustness(left, rest_of(data, past), EXACT))
    assert wanted - less - 1e-9 <= value <= wanted + 1e-9


@examples(100)
@given(predicates(), predicates(), st.sampled_from([(0.0, 1.0), (0.5, 2.0), (None, None)]), st.integers(0, 12))
def test_release_is_the_dual_of_until(
    f: Formula, g: Formula, window: tuple[float | None, float | None], k: int
) -> None:
    data = signals(k, members=1)
    until = Until(f, g, *window)
    dual = Release(negation_normal_form(f, True), negation_normal_form(g, True), *window)
    left = progressed(dual, reader(data), k, data.steps, STEP)
    wanted = -float(robustness(until, data, EXACT))
    assert robustness(left, rest_of(data, k), EXACT) == pytest.approx(wanted, abs=1e-12)


def test_what_has_been_done_stays_done_and_windows_come_closer() -> None:
    data = StateSignals(np.array([[[0.0, 0], [2.0, 0], [0.5, 0], [0, 0], [0, 0]]]), NAMES, 1.0)
    task = parse("F[0, 3] x >= 1 and G[0, 4] x >= -1 and F[3, 4] x >= 5")
    left = settled(progressed(task, reader(data), 2, 4, 1.0))
    assert {type(part) for part in left.parts} == {Always, Eventually}
    assert str(left) == "G[0,2] x >= -1 and F[1,2] x >= 5"


def test_what_has_been_violated_stays_violated() -> None:
    data = StateSignals(np.array([[[0.0, 0], [2.0, 0], [0.5, 0]]]), NAMES, 1.0)
    left = settled(progressed(parse("G[0, 2] x <= 1 and F[2, 2] x >= 0"), reader(data), 2, 2, 1.0))
    assert left == Known(-1.0)


def test_nested_windows_do_not_pile_up() -> None:
    """Of ``G F[0,2]`` at most a few instances wait at a time, however long the past."""
    data = signals(3, members=1, steps=60)
    task = parse("G[0, 20] F[0, 2] x >= 0")
    sizes = [sum(1 for _ in leaves(progressed(task, reader(data), k, 60, STEP))) for k in (5, 20, 35)]
    assert max(sizes) <= 12


@pytest.mark.parametrize("text", ["mean(x >= 0)", "share(0.9, x >= 0)"])
def test_one_robots_past_does_not_tell_the_fleets(text: str) -> None:
    data = signals(0, members=1)
    with pytest.raises(UnsupportedError, match="the past of one robot does not tell"):
        progressed(parse(text), reader(data), 1, 20, STEP)


def test_a_known_number_in_every_walk() -> None:
    data = signals(0, members=3)
    formula = Not(Known(0.25)) | Predicate((("x", 1.0),), -1e3)
    assert robustness(formula, data, EXACT) == -0.25
    assert robustness(formula, data, SmoothOps(1e6)) == pytest.approx(-0.25, abs=1e-5)
    assert str(Known(0.25)) == "known(0.25)"
    with pytest.raises(ProblemError, match="expected a number, got nan"):
        Known(float("nan"))


@pytest.mark.parametrize("step", [1 / 6, 1 / 7, 3e-5])
@pytest.mark.parametrize("steps", [1, 4000])
def test_a_window_loses_no_grid_time_however_long_the_past_is(step: float, steps: int) -> None:
    task = Always(Eventually(parse("x >= 0"), 0.0, 2 * step), 0.0, steps * step)
    horizon = steps + 2
    left = progressed(task, lambda leaf, k: 1.0, steps, horizon, step)
    signals = StateSignals(np.array([[[-1.0], [-1.0], [-1.0]]]), ("x",), step)
    assert robustness(left, signals, EXACT) == -1.0  # the last grid time of the window counts
    left = progressed(task, lambda leaf, k: 1.0, steps + 1, horizon, step)
    assert robustness(left, StateSignals(signals.states[:, 1:], ("x",), step), EXACT) == 1.0
