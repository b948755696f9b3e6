"""What every distribution promises: draws, shares, equality, and words for what is wrong."""

from __future__ import annotations

import pickle
import subprocess
import sys
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from scipy.stats import beta, kstest, truncnorm

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import Beta, Distribution, Interval, Mixture, Samples, TruncatedNormal

MEASURED = np.random.default_rng(3).normal(1.0, 0.03, 60)
DISTRIBUTIONS: dict[str, Distribution] = {
    "uniform": Interval(0.9, 1.1),
    "bump": Beta(0.9, 1.1, 2, 5),
    "bath-tub": Beta(0.9, 1.1, 0.4, 0.7),
    "normal": TruncatedNormal(0.9, 1.1, 1.0, 0.03),
    "far mean": TruncatedNormal(0.9, 1.1, 1.6, 0.02),
    "far mean below": TruncatedNormal(0.9, 1.1, 0.5, 0.02),
    "two kinds": Mixture((Interval(0.9, 0.95), 2), (TruncatedNormal(1.0, 1.1, 1.05, 0.01), 1)),
    "measured": Samples(MEASURED),
}
distributions = pytest.mark.parametrize("distribution", DISTRIBUTIONS.values(), ids=DISTRIBUTIONS)
smooth = pytest.mark.parametrize(
    "distribution",
    [distribution for distribution in DISTRIBUTIONS.values() if not isinstance(distribution, Samples)],
    ids=list(DISTRIBUTIONS)[:-1],
)


@distributions
def test_draws_are_in_range_and_repeat(distribution: Distribution) -> None:
    draws = distribution.sample(5000, seed=7)
    assert draws.shape == (5000,)
    assert distribution.lower <= draws.min() <= draws.max() <= distribution.upper
    np.testing.assert_array_equal(draws, distribution.sample(5000, seed=7))
    assert (draws != distribution.sample(5000, seed=8)).any()
    assert distribution.sample(0, seed=7).shape == (0,)


@smooth
def test_draws_follow_the_cdf(distribution: Distribution) -> None:
    assert kstest(distribution.cdf(distribution.sample(20_000, seed=1)), "uniform").pvalue > 0.01


def test_draws_of_samples_are_the_samples_equally_often() -> None:
    distribution = Samples([0.9, 1.0, 1.0, 1.1])
    found, counts = np.unique(distribution.sample(40_000, seed=2), return_counts=True)
    np.testing.assert_array_equal(found, [0.9, 1.0, 1.1])
    np.testing.assert_allclose(counts / 40_000, [0.25, 0.5, 0.25], atol=0.01)


@distributions
def test_the_cdf_rises_from_nothing_to_everyone(distribution: Distribution) -> None:
    shares = distribution.cdf(np.linspace(distribution.lower - 0.1, distribution.upper + 0.1, 400))
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert (np.diff(shares) >= -1e-15).all()
    assert distribution.cdf(distribution.upper) == pytest.approx(1.0, abs=1e-15)


def test_cdfs_are_those_of_scipy() -> None:
    psi = np.linspace(0.9, 1.1, 50)
    np.testing.assert_allclose(DISTRIBUTIONS["bump"].cdf(psi), beta(2, 5, 0.9, 0.2).cdf(psi), atol=1e-13)
    for name, mean, deviation in (("normal", 1.0, 0.03), ("far mean", 1.6, 0.02), ("far mean below", 0.5, 0.02)):
        low, high = (0.9 - mean) / deviation, (1.1 - mean) / deviation
        expected = truncnorm(low, high, mean, deviation).cdf(psi)
        np.testing.assert_allclose(DISTRIBUTIONS[name].cdf(psi), expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(DISTRIBUTIONS["measured"].cdf(psi), (MEASURED[:, None] <= psi).mean(axis=0))


@distributions
def test_the_rule_has_the_mean_and_the_spread_of_the_draws(distribution: Distribution) -> None:
    s, weights = distribution.rule(6)
    psi, draws = distribution.to_parameter(s), distribution.sample(200_000, seed=5)
    assert weights.sum() == pytest.approx(2.0, abs=1e-13)
    assert (weights > 0).all()
    mean = weights @ psi / 2
    deviation = np.sqrt(weights @ (psi - mean) ** 2 / 2)
    assert draws.mean() == pytest.approx(mean, abs=4 * deviation / np.sqrt(len(draws)))
    assert draws.std() == pytest.approx(deviation, rel=0.01)


@distributions
def test_a_distribution_is_a_value(distribution: Distribution) -> None:
    again = eval(repr(distribution)) if not isinstance(distribution, Samples) else Samples(MEASURED[::-1])
    assert (again, hash(again)) == (distribution, hash(distribution))
    assert all(other != distribution for other in DISTRIBUTIONS.values() if other is not distribution)
    assert distribution.basis(5) == again.basis(5)
    assert hash(distribution.basis(5)) == hash(again.basis(5))


@distributions
def test_a_distribution_does_not_change(distribution: Distribution) -> None:
    with pytest.raises(FrozenInstanceError):
        distribution.lower = 0.5
    assert pickle.loads(pickle.dumps(distribution)) == distribution


def test_a_mixture_of_equal_robots_is_a_fleet_of_few() -> None:
    distribution = Mixture((Interval(1.0, 1.0), 1), (Samples([1.2, 1.2]), 3))
    assert distribution.max_order == 1
    np.testing.assert_allclose(distribution.to_parameter(distribution.basis(1).nodes), [1.0, 1.2])
    np.testing.assert_allclose(distribution.basis(1).weights, [0.5, 1.5])
    one = Mixture((Interval(1.0, 1.0), 1), (Beta(1.0, 1.0, 2, 2), 1))
    assert (one.max_order, one.sample(2, 0).tolist(), float(one.cdf(1.0))) == (0, [1.0, 1.0], 1.0)


def test_how_samples_and_mixtures_read() -> None:
    assert repr(Samples([1.1, 0.9, 1.1])) == "Samples(3 values, 2 different, 0.9 to 1.1)"
    assert repr(Samples([1.0])) == "Samples(1 value, 1 different, 1 to 1)"
    assert repr(Mixture((Beta(1, 2, 2, 5), 3.0))) == "Mixture((Beta(lower=1.0, upper=2.0, a=2.0, b=5.0), 3))"


@pytest.mark.parametrize(
    "distribution", [Beta(1, 1, 2, 5), TruncatedNormal(1, 1, 1, 0.1), Samples([1.0, 1.0]), Interval(1, 1)]
)
def test_a_range_without_width_is_a_fleet_of_equals(distribution: Distribution) -> None:
    np.testing.assert_array_equal(distribution.sample(3, seed=0), [1.0, 1.0, 1.0])
    np.testing.assert_array_equal(distribution.cdf([0.9, 1.0, 1.1]), [0.0, 1.0, 1.0])
    np.testing.assert_array_equal(
        distribution.to_parameter(distribution.rule(4)[0]), np.ones_like(distribution.rule(4)[0])
    )
    both = Mixture((distribution, 1), (Interval(2, 3), 1))
    assert both.basis(3).weights.sum() == pytest.approx(2)
    assert both.cdf(1.5) == 0.5


BAD = {
    "Beta, a zero": (lambda: Beta(0, 1, 0, 1), r"^a: expected a number from 0.001 to 1e\+06, got 0$"),
    "Beta, b below zero": (lambda: Beta(0, 1, 1, -2), r"^b: expected a number from 0.001 to 1e\+06, got -2$"),
    "Beta, a NaN": (lambda: Beta(0, 1, np.nan, 1), r"^a: expected a finite number, got nan$"),
    "Beta, ends swapped": (lambda: Beta(1, 0, 1, 1), r"^upper: expected at least lower = 1, got 0$"),
    "normal, deviation zero": (
        lambda: TruncatedNormal(0, 1, 0.5, 0),
        r"^deviation: expected a number above 0, got 0$",
    ),
    "normal, too narrow": (
        lambda: TruncatedNormal(0, 2, 0.5, 1e-7),
        r"^deviation: expected at least a millionth of the range's half-width, got 1e-07 for \[0, 2\]$",
    ),
    "normal, mean NaN": (lambda: TruncatedNormal(0, 1, np.nan, 1), r"^mean: expected a finite number, got nan$"),
    "normal, far mean": (
        lambda: TruncatedNormal(0, 1, 5, 0.001),
        r"^mean: expected at most 1000 deviations outside of \[0, 1\], got 5$",
    ),
    "no samples": (lambda: Samples([]), r"^values: expected one row of one or more numbers, got shape \(0,\)$"),
    "a table": (
        lambda: Samples([[1.0, 2.0]]),
        r"^values: expected one row of one or more numbers, got shape \(1, 2\)$",
    ),
    "a hole": (lambda: Samples([1.0, np.nan]), r"^values: expected finite numbers, got NaN or infinity$"),
    "no end": (lambda: Samples([1.0, np.inf]), r"^values: expected finite numbers, got NaN or infinity$"),
    "text": (lambda: Samples(["1.0"]), r"^values: expected an array of numbers, got text$"),
    "ragged": (lambda: Samples([[1.0], [1.0, 2.0]]), r"^values: expected an array of numbers, got"),
    "truths": (lambda: Samples([True, False]), r"^values: expected an array of numbers, got true or false$"),
    "no parts": (lambda: Mixture(), r"^parts: expected one or more pairs of a distribution and a weight, got none$"),
    "no weight": (lambda: Mixture(Interval(0, 1)), r"^parts\[0\]: expected a pair of a distribution and a weight, got"),  # type: ignore[arg-type]
    "weight zero": (
        lambda: Mixture((Interval(0, 1), 1), (Interval(0, 1), 0)),
        r"^parts\[1\]: weight: expected a number above 0, got 0$",
    ),
    "order": (
        lambda: Samples([1.0, 2.0, 2.0]).basis(2),
        r"^order: expected at most 1 for Samples\(3 values, 2 different, 1 to 2\), got 2$",
    ),
    "order of no distribution": (
        lambda: Beta(0, 1, 1, 1).basis(51),
        r"^order: expected a whole number from 0 to 50, got 51$",
    ),
    "root": (lambda: Beta(0, 1, 1, 1).basis(3).roots(4), r"^k: expected a whole number from 0 to 3, got 4$"),
}


@pytest.mark.parametrize("case", BAD.values(), ids=BAD)
def test_what_is_wrong_is_named(case: tuple[object, str]) -> None:
    make, message = case
    with pytest.raises(ProblemError, match=message):
        make()  # type: ignore[operator]


def test_scipy_is_loaded_for_draws_and_shares_only() -> None:
    code = """
import sys
from ensemble_ctrl.moments import Beta, Mixture, Samples, TruncatedNormal
distribution = Mixture((Beta(1, 2, 3, 4), 1), (TruncatedNormal(1, 2, 1, 1), 1), (Samples([1.0, 1.5]), 1))
distribution.basis(8).nodes, Beta(1, 2, 3, 4).sample(3, 0)
print("scipy" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
