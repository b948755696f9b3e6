"""The uniform distribution of the parameter."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import Interval

ends = st.floats(-1e6, 1e6)


def test_the_papers_robots() -> None:
    interval = Interval(0.9, 1.1)
    assert interval.center == pytest.approx(1.0, abs=1e-15)
    assert interval.half_width == pytest.approx(0.1, abs=1e-15)
    np.testing.assert_allclose(interval.to_parameter([-1, 0, 1]), [0.9, 1.0, 1.1], atol=1e-15)


@given(ends, st.floats(1e-3, 1e6), st.floats(-1, 1))
def test_scaling_goes_there_and_back(lower: float, width: float, s: float) -> None:
    interval = Interval(lower, lower + width)
    psi = interval.to_parameter(s)
    slack = 1e-9 * (1 + abs(lower))
    assert lower - slack <= psi <= lower + width + slack
    np.testing.assert_allclose(interval.to_scaled(psi), s, atol=1e-6)


def test_scaling_keeps_shapes() -> None:
    interval = Interval(0.0, 4.0)
    assert interval.to_parameter(np.zeros((2, 3))).shape == (2, 3)
    assert interval.to_scaled(np.zeros((2, 3))).shape == (2, 3)
    np.testing.assert_array_equal(interval.to_scaled([0.0, 3.0]), [-1.0, 0.5])


def test_a_range_without_width_is_a_fleet_of_equals() -> None:
    interval = Interval(1.5, 1.5)
    assert interval.half_width == 0
    np.testing.assert_array_equal(interval.to_parameter([-1.0, 1.0]), [1.5, 1.5])
    np.testing.assert_array_equal(interval.to_scaled([1.5, 1.5]), [0.0, 0.0])


def test_ends_become_floats_and_compare() -> None:
    assert Interval(1, 2) == Interval(1.0, 2.0)
    assert isinstance(Interval(1, 2).lower, float)


def test_samples_fill_the_range_and_repeat() -> None:
    interval = Interval(0.6, 1.4)
    draws = interval.sample(20_000, seed=7)
    assert draws.shape == (20_000,)
    assert 0.6 <= draws.min() < 0.601
    assert 1.399 < draws.max() <= 1.4
    assert draws.mean() == pytest.approx(1.0, abs=0.01)
    assert draws.var() == pytest.approx(0.8**2 / 12, rel=0.03)
    np.testing.assert_array_equal(draws, interval.sample(20_000, seed=7))
    assert (draws != interval.sample(20_000, seed=8)).any()


def test_a_generator_continues_its_stream() -> None:
    rng = np.random.default_rng(3)
    first, second = Interval(0, 1).sample(5, rng), Interval(0, 1).sample(5, rng)
    np.testing.assert_array_equal(np.concatenate([first, second]), Interval(0, 1).sample(10, seed=3))


@pytest.mark.parametrize("lower", [np.nan, np.inf, "1", None, True])
def test_bad_ends_are_named(lower: object) -> None:
    with pytest.raises(ProblemError, match=r"^lower: expected a finite number, got"):
        Interval(lower, 2.0)  # type: ignore[arg-type]


def test_swapped_ends_are_named() -> None:
    with pytest.raises(ProblemError, match=r"^upper: expected at least lower = 1.1, got 0.9"):
        Interval(1.1, 0.9)


@pytest.mark.parametrize(("n", "seed", "name"), [(-1, 0, "n"), (1.5, 0, "n"), (3, -1, "seed"), (3, None, "seed")])
def test_bad_draws_are_named(n: object, seed: object, name: str) -> None:
    with pytest.raises(ProblemError, match=rf"^{name}: expected a whole number"):
        Interval(0, 1).sample(n, seed)  # type: ignore[arg-type]
