"""Polynomials of distributions against closed forms, quadrature, and sums over the distribution's own values."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.special import roots_jacobi
from scipy.stats import truncnorm

from ensemble_ctrl.moments import (
    Beta,
    Distribution,
    Interval,
    LegendreBasis,
    Mixture,
    Samples,
    TruncatedNormal,
    affine_multiplication_matrix,
    bernstein_to_moments,
    change_of_basis,
    evaluate_moments,
    inner_products,
    moments_of_function,
    moments_to_bernstein,
    moments_to_nodes,
    multiplication_matrix,
    nodes_to_bernstein,
    nodes_to_moments,
    shift_left,
    shift_right,
)
from ensemble_ctrl.moments.lanczos import recurrence_of_points
from tests.examples import examples

Floats = NDArray[np.float64]
ORDER = 40
SHAPES = [(1, 1), (0.5, 0.5), (2, 5), (0.3, 4), (30, 3), (1000, 1000)]
RNG = np.random.default_rng(4)
BUMP = TruncatedNormal(0.9, 1.1, 1.02, 0.03)
DISTRIBUTIONS: dict[str, Distribution] = {
    "uniform": Interval(0.9, 1.1),
    "Beta": Beta(0.9, 1.1, 2, 5),
    "bath-tub": Beta(0.9, 1.1, 0.2, 0.3),
    "normal": BUMP,
    "mixture": Mixture((Interval(0.9, 0.95), 2), (Beta(1.0, 1.1, 3, 3), 1)),
    "samples": Samples(RNG.normal(1.0, 0.03, 60)),
    "few samples": Samples([0.9, 0.95, 1.0, 1.1, 1.1]),
    "a kind and a robot": Mixture((Interval(0.9, 1.0), 3), (Samples([1.1]), 1)),
}
distributions = pytest.mark.parametrize("distribution", DISTRIBUTIONS.values(), ids=DISTRIBUTIONS)


def generic(distribution: Distribution) -> Mixture:
    """The same distribution by the Lanczos process instead of a closed form."""
    return Mixture((distribution, 1.0))


def order_of(distribution: Distribution) -> int:
    """An order that the distribution has a basis for."""
    return min(8, distribution.max_order)


# --- known families


@pytest.mark.parametrize(("a", "b"), SHAPES)
def test_beta_has_jacobis_gauss_rule(a: float, b: float) -> None:
    nodes, weights = roots_jacobi(ORDER + 1, b - 1, a - 1)
    basis = Beta(0.9, 1.1, a, b).basis(ORDER)
    np.testing.assert_allclose(basis.nodes, nodes, atol=1e-14)
    np.testing.assert_allclose(basis.weights, 2 * weights / weights.sum(), atol=1e-12)


@pytest.mark.parametrize(("a", "b"), SHAPES)
def test_the_lanczos_process_finds_the_closed_form(a: float, b: float) -> None:
    closed, found = Beta(0.9, 1.1, a, b).basis(ORDER), generic(Beta(0.9, 1.1, a, b)).basis(ORDER)
    np.testing.assert_allclose(found.recurrence(), closed.recurrence(), atol=1e-13)
    np.testing.assert_allclose(found.diagonal, closed.diagonal, atol=1e-13)
    np.testing.assert_allclose(found.weights, closed.weights, atol=1e-12)


def test_chebyshevs_recurrence_and_nodes() -> None:
    basis = Beta(0.0, 1.0, 0.5, 0.5).basis(ORDER)
    a, c = basis.recurrence()
    np.testing.assert_allclose(a, [np.sqrt(0.5)] + ORDER * [0.5], atol=1e-15)
    np.testing.assert_allclose(c[1:], a[:-1])
    np.testing.assert_allclose(basis.diagonal, 0.0, atol=1e-15)
    np.testing.assert_allclose(basis.nodes, -np.cos((np.arange(ORDER + 1) + 0.5) * np.pi / (ORDER + 1)), atol=1e-14)
    np.testing.assert_allclose(basis.weights, 2 / (ORDER + 1), atol=1e-13)


@pytest.mark.parametrize(
    "distribution", [Beta(0.0, 1.0, 1, 1), generic(Interval(0.0, 1.0)), TruncatedNormal(0, 1, 0.5, 1e9)]
)
def test_legendre_by_another_way(distribution: Distribution) -> None:
    basis, legendre = distribution.basis(ORDER), LegendreBasis(ORDER)
    s = np.linspace(-1, 1, 101)
    np.testing.assert_allclose(basis.recurrence(), legendre.recurrence(), atol=1e-13)
    np.testing.assert_allclose(basis.nodes, legendre.nodes, atol=1e-14)
    np.testing.assert_allclose(basis.weights, legendre.weights, atol=1e-13)
    np.testing.assert_allclose(basis.evaluate(s), legendre.evaluate(s), atol=1e-11)
    np.testing.assert_allclose(basis.signed_moments(), legendre.signed_moments(), atol=1e-12)
    np.testing.assert_allclose(basis.partial_moments(s), legendre.partial_moments(s), atol=1e-12)


def test_legendres_partial_moments_are_integrals() -> None:
    basis = LegendreBasis(6)
    got = basis.partial_moments(np.array([-np.inf, -1.0, 0.3, 1.0, np.inf]))
    expected = [quad(lambda s, k=k: float(basis.evaluate(s)[k]), -1, 0.3)[0] for k in range(7)]
    np.testing.assert_allclose(got[2], expected, atol=1e-14)
    np.testing.assert_allclose(got[[0, 1]], 0.0, atol=1e-15)
    np.testing.assert_allclose(got[[3, 4]], [np.sqrt(2) * np.eye(7)[0]] * 2, atol=1e-15)


def test_a_narrow_normal_distribution_has_hermites_recurrence() -> None:
    basis = TruncatedNormal(-1.0, 1.0, 0.1, 0.02).basis(ORDER)
    np.testing.assert_allclose(basis.recurrence()[0] / 0.02, np.sqrt(np.arange(1, ORDER + 2)), rtol=1e-12)
    np.testing.assert_allclose(basis.diagonal, 0.1, rtol=1e-13)


def test_a_mean_far_outside_gives_laguerres_recurrence() -> None:
    distribution = TruncatedNormal(0.0, 2.0, -20.0, 0.02)
    basis, decay = distribution.basis(10), 0.02**2 / 20
    k = np.arange(11)
    np.testing.assert_allclose((basis.diagonal + 1) / decay, 2 * k + 1, rtol=1e-4)
    np.testing.assert_allclose(basis.recurrence()[0] / decay, k + 1, rtol=1e-4)


# --- integrals


@pytest.mark.parametrize(("mean", "deviation"), [(1.0, 0.03), (1.3, 0.05), (0.95, 0.5), (0.8, 0.011)])
def test_moments_of_a_normal_distribution_are_those_of_quadrature(mean: float, deviation: float) -> None:
    distribution = TruncatedNormal(0.9, 1.1, mean, deviation)
    exact = truncnorm((0.9 - mean) / deviation, (1.1 - mean) / deviation, mean, deviation)
    got = moments_of_function(distribution.basis(6), lambda s: np.exp(np.sin(9 * distribution.to_parameter(s))))
    peak = min(max(mean, 0.9), 1.1)
    for k in range(7):

        def integrand(psi: float, k: int = k) -> float:
            phi = distribution.basis(6).evaluate(distribution.to_scaled(psi))[k]
            return float(2 * exact.pdf(psi) * phi * np.exp(np.sin(9 * psi)))

        expected = quad(integrand, 0.9, 1.1, points=[peak], epsabs=1e-13, limit=200)[0]
        assert got[k] == pytest.approx(expected, abs=1e-10)


def test_polynomials_of_samples_are_orthonormal_in_sums() -> None:
    distribution = Samples(RNG.uniform(0.9, 1.1, 200).round(3))
    s = distribution.to_scaled(distribution.values)
    phi = distribution.basis(20).evaluate(s)
    np.testing.assert_allclose(phi.T @ phi * 2 / len(s), np.eye(21), atol=1e-11)


def test_the_gauss_rule_of_samples_is_exact_on_sums() -> None:
    distribution = DISTRIBUTIONS["samples"]
    assert isinstance(distribution, Samples)
    s, basis = distribution.to_scaled(distribution.values), distribution.basis(9)
    for power in range(20):
        expected = 2 * np.mean(s**power)
        assert basis.weights @ basis.nodes**power == pytest.approx(expected, abs=1e-14)


def test_as_many_orders_as_values_give_the_values_back() -> None:
    distribution = DISTRIBUTIONS["few samples"]
    basis = distribution.basis(distribution.max_order)
    assert distribution.max_order == 3
    np.testing.assert_allclose(distribution.to_parameter(basis.nodes), [0.9, 0.95, 1.0, 1.1], atol=1e-14)
    np.testing.assert_allclose(basis.weights, [0.4, 0.4, 0.4, 0.8], atol=1e-13)


def test_a_value_far_from_the_others_lowers_the_order() -> None:
    values = np.append(np.random.default_rng(1).normal(1.0, 0.03, 60), 1.5)
    distribution = Samples(values)
    assert 6 <= distribution.max_order < 20
    phi = distribution.basis(distribution.max_order).evaluate(distribution.to_scaled(distribution.values))
    np.testing.assert_allclose(phi.T @ phi * 2 / 61, np.eye(distribution.max_order + 1), atol=2e-9)


def test_a_mixture_is_the_weighted_sum_of_its_parts() -> None:
    parts: list[tuple[Distribution, float]] = [(Interval(0.9, 0.95), 2.0), (BUMP, 1.0), (Samples([0.8, 1.2]), 1.0)]
    distribution = Mixture(*parts)
    assert (distribution.lower, distribution.upper) == (0.8, 1.2)
    s, weights = distribution.rule(6)
    for power in range(12):
        own = [part.rule(6)[1] @ part.to_parameter(part.rule(6)[0]) ** power for part, _ in parts]
        assert weights @ distribution.to_parameter(s) ** power == pytest.approx(
            (2 * own[0] + own[1] + own[2]) / 4, rel=1e-13
        )
    psi = np.linspace(0.8, 1.2, 30)
    shares = [part.cdf(psi) for part, _ in parts]
    np.testing.assert_allclose(distribution.cdf(psi), (2 * shares[0] + shares[1] + shares[2]) / 4, atol=1e-15)


def test_a_million_samples() -> None:
    distribution = Samples(np.random.default_rng(0).normal(1.0, 0.03, 1_000_000))
    basis = distribution.basis(8)
    s = distribution.to_scaled(distribution.values)
    phi = basis.evaluate(s)
    np.testing.assert_allclose(phi.T @ phi * 2e-6, np.eye(9), atol=1e-10)
    for power in range(18):
        assert basis.weights @ basis.nodes**power == pytest.approx(2 * np.mean(s**power), abs=1e-12)


# --- what every basis does


@distributions
def test_the_basis_is_orthonormal(distribution: Distribution) -> None:
    basis = distribution.basis(order_of(distribution))
    np.testing.assert_allclose(inner_products(distribution, basis), np.eye(basis.order + 1), atol=1e-10)
    np.testing.assert_allclose(basis.evaluate(0.3)[0], np.sqrt(0.5), atol=1e-15)


@distributions
def test_the_recurrence_multiplies_by_s(distribution: Distribution) -> None:
    basis = distribution.basis(order_of(distribution))
    s = np.linspace(-1, 1, 9)
    phi = basis.evaluate(s)
    a, c = basis.recurrence()
    b = basis.diagonal
    for k in range(basis.order):
        below = phi[:, k - 1] if k else 0.0
        np.testing.assert_allclose(
            s * phi[:, k], a[k] * phi[:, k + 1] + b[k] * phi[:, k] + c[k] * below, rtol=1e-9, atol=1e-9
        )


@distributions
def test_multiplication_by_the_parameter(distribution: Distribution) -> None:
    basis = distribution.basis(order_of(distribution))
    matrix = affine_multiplication_matrix(basis, distribution)
    got = matrix @ moments_of_function(basis, lambda s: (1 + s) ** (basis.order - 1))
    expected = moments_of_function(basis, lambda s: distribution.to_parameter(s) * (1 + s) ** (basis.order - 1))
    np.testing.assert_allclose(got, expected, atol=1e-9)
    np.testing.assert_allclose(np.linalg.eigvalsh(matrix), distribution.to_parameter(basis.nodes), atol=1e-12)


@distributions
def test_the_shifts_and_the_diagonal_make_up_the_matrix(distribution: Distribution) -> None:
    basis = distribution.basis(order_of(distribution))
    moments = RNG.normal(size=(3, basis.order + 1, 2))
    a, b, c = (part[:, None] for part in (basis.recurrence()[0], basis.diagonal, basis.recurrence()[1]))
    got = shift_right(a * moments) + b * moments + shift_left(c * moments)
    np.testing.assert_allclose(got, multiplication_matrix(basis) @ moments, atol=1e-13)


@distributions
def test_nodes_and_moments_are_inverse(distribution: Distribution) -> None:
    basis = distribution.basis(order_of(distribution))
    np.testing.assert_allclose(moments_to_nodes(basis) @ nodes_to_moments(basis), np.eye(basis.order + 1), atol=2e-9)


@distributions
def test_signed_moments_are_sums_over_the_parts_of_one_sign(distribution: Distribution) -> None:
    basis = distribution.basis(order_of(distribution))
    positive, negative = basis.signed_moments()
    np.testing.assert_allclose(positive - negative, np.sqrt(2) * np.eye(basis.order + 1)[0], atol=1e-9)
    psi = distribution.sample(400_000, seed=11)
    phi = basis.evaluate(distribution.to_scaled(psi))
    np.testing.assert_allclose(2 * np.maximum(phi, 0).mean(axis=0), positive, atol=0.02)
    np.testing.assert_allclose(2 * np.maximum(-phi, 0).mean(axis=0), negative, atol=0.02)
    assert (negative >= 0).all()


def test_signed_moments_of_samples_are_sums() -> None:
    distribution = DISTRIBUTIONS["samples"]
    assert isinstance(distribution, Samples)
    phi = distribution.basis(8).evaluate(distribution.to_scaled(distribution.values))
    positive, negative = distribution.basis(8).signed_moments()
    np.testing.assert_allclose(positive, 2 * np.maximum(phi, 0).mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(negative, 2 * np.maximum(-phi, 0).mean(axis=0), atol=1e-12)


@pytest.mark.parametrize("distribution", [Beta(0, 1, 2, 5), Beta(0, 1, 0.4, 3), TruncatedNormal(0, 1, 0.3, 0.2)])
@pytest.mark.parametrize("k", [1, 2, 7])
def test_signed_moments_are_those_of_quadrature(distribution: Distribution, k: int) -> None:
    """By parts, with the cdf, for a density may be infinite at an end."""
    basis = distribution.basis(k)
    at = np.cos(np.linspace(0, np.pi, k + 1))
    polynomial = np.polynomial.Chebyshev.fit(distribution.to_parameter(at), basis.evaluate(at)[:, k], k, domain=[0, 1])
    positive = 0.0
    for low, high in pairwise([0.0, *distribution.to_parameter(basis.roots(k)), 1.0]):
        ends = polynomial(high) * distribution.cdf(high) - polynomial(low) * distribution.cdf(low)
        inner = quad(lambda psi: float(polynomial.deriv()(psi) * distribution.cdf(psi)), low, high, epsabs=1e-13)[0]
        positive += max(2 * (float(ends) - inner), 0)
    assert basis.signed_moments()[0][k] == pytest.approx(positive, abs=1e-10)


@distributions
def test_bernstein_there_and_back(distribution: Distribution) -> None:
    basis = distribution.basis(order_of(distribution))
    identity = bernstein_to_moments(basis) @ moments_to_bernstein(basis)
    np.testing.assert_allclose(identity, np.eye(basis.order + 1), atol=1e-8)
    np.testing.assert_allclose(nodes_to_bernstein(basis).sum(axis=1), 1.0, atol=1e-6)


@distributions
@pytest.mark.parametrize(("lower", "upper"), [(-1.0, 1.0), (-0.2, 0.7)])
def test_the_hull_contains_the_state(distribution: Distribution, lower: float, upper: float) -> None:
    basis = distribution.basis(min(5, order_of(distribution)))
    moments = RNG.normal(size=basis.order + 1)
    coefficients = moments_to_bernstein(basis, lower, upper) @ moments
    states = evaluate_moments(basis, moments, np.linspace(lower, upper, 50))
    slack = 1e-10 * np.abs(coefficients).max()
    assert coefficients.min() - slack <= states.min() <= states.max() <= coefficients.max() + slack
    np.testing.assert_allclose(coefficients[[0, -1]], states[[0, -1]], atol=slack)


@distributions
def test_a_change_of_basis_keeps_the_state(distribution: Distribution) -> None:
    basis = distribution.basis(order_of(distribution))
    legendre = LegendreBasis(basis.order)
    moments = RNG.normal(size=basis.order + 1)
    changed = change_of_basis(legendre, basis) @ moments
    s = distribution.rule(6)[0]
    np.testing.assert_allclose(evaluate_moments(basis, changed, s), evaluate_moments(legendre, moments, s), atol=1e-8)
    energy = moments @ inner_products(distribution, legendre) @ moments
    assert changed @ changed == pytest.approx(energy, rel=1e-8)


def test_low_orders_begin_high_ones() -> None:
    low, high = BUMP.basis(3), BUMP.basis(20)
    s = np.linspace(-1, 1, 5)
    np.testing.assert_array_equal(low.evaluate(s), high.evaluate(s)[:, :4])


@pytest.mark.parametrize("name", ["nodes", "weights", "diagonal"])
def test_shared_arrays_are_read_only(name: str) -> None:
    with pytest.raises(ValueError, match="read-only"):
        getattr(BUMP.basis(3), name)[0] = 0.0


def test_points_that_coincide_end_the_recurrence() -> None:
    found = recurrence_of_points(np.array([0.0, 1.0, 1.0 + 1e-15]), np.ones(3), 5)
    assert found.order == 1
    assert found.a[1] == 0.0


# --- random distributions


beta_distributions = st.builds(Beta, st.just(0.5), st.just(1.5), st.floats(0.05, 100), st.floats(0.05, 100))
normal_distributions = st.builds(TruncatedNormal, st.just(0.5), st.just(1.5), st.floats(-1, 3), st.floats(0.02, 10))
sample_distributions = st.lists(st.floats(0.5, 1.5), min_size=1, max_size=40).map(Samples)
simple: st.SearchStrategy[Distribution] = st.one_of(beta_distributions, normal_distributions, sample_distributions)
mixtures = st.lists(st.tuples(simple, st.floats(0.01, 100)), min_size=1, max_size=3).map(lambda parts: Mixture(*parts))
random_distributions = st.one_of(simple, mixtures)


@examples(150)
@given(random_distributions, st.integers(0, 20))
def test_any_distribution_has_orthonormal_polynomials(distribution: Distribution, order: int) -> None:
    basis = distribution.basis(min(order, distribution.max_order))
    np.testing.assert_allclose(inner_products(distribution, basis), np.eye(basis.order + 1), atol=1e-7)
    assert (np.diff(basis.nodes) > 0).all()
    assert (basis.weights > 0).all()
    assert np.abs(basis.nodes).max() <= 1 + 1e-12


@examples(100)
@given(random_distributions, st.integers(0, 2**32 - 1))
def test_any_distribution_integrates_polynomials_exactly(distribution: Distribution, seed: int) -> None:
    coefficients = np.random.default_rng(seed).normal(size=10)
    polynomial = np.polynomial.Chebyshev(coefficients)
    few, many = distribution.rule(5), distribution.rule(30)
    assert few[1] @ polynomial(few[0]) == pytest.approx(many[1] @ polynomial(many[0]), abs=1e-11)
