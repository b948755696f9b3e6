"""States to moments and back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from scipy.integrate import quad

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import (
    Interval,
    LegendreBasis,
    evaluate_moments,
    moments_of_function,
    moments_of_samples,
    moments_to_nodes,
    nodes_to_moments,
)

orders = st.integers(0, 30)
seeds = st.integers(0, 2**32 - 1)


def normal(seed: int, *shape: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Random moments or states."""
    return np.random.default_rng(seed).normal(size=shape)


@pytest.mark.parametrize("k", [0, 1, 3, 7])
def test_moments_are_integrals_against_the_basis(k: int) -> None:
    basis = LegendreBasis(7)
    expected, _ = quad(lambda s: float(basis.evaluate(s)[k]) * np.exp(np.sin(3 * s)), -1, 1, epsabs=1e-14)
    got = moments_of_function(basis, lambda s: np.exp(np.sin(3 * s)))
    assert got[k] == pytest.approx(expected, abs=1e-12)


@given(orders, seeds)
def test_parseval(order: int, seed: int) -> None:
    basis, moments = LegendreBasis(order), normal(seed, order + 1)
    s, weights = np.polynomial.legendre.leggauss(order + 1)
    energy = weights @ evaluate_moments(basis, moments, s) ** 2
    assert moments @ moments == pytest.approx(energy, rel=1e-11)


@given(orders, seeds)
def test_moments_of_what_moments_stand_for(order: int, seed: int) -> None:
    basis, moments = LegendreBasis(order), normal(seed, order + 1, 3)
    again = moments_of_function(basis, lambda s: evaluate_moments(basis, moments, s))
    np.testing.assert_allclose(again, moments, atol=1e-11)


@given(orders, seeds)
def test_nodes_and_moments_are_inverse(order: int, seed: int) -> None:
    basis, nodal = LegendreBasis(order), normal(seed, 4, order + 1, 2)
    moments = nodes_to_moments(basis) @ nodal
    np.testing.assert_allclose(moments_to_nodes(basis) @ moments, nodal, atol=1e-11)
    np.testing.assert_allclose(evaluate_moments(basis, moments, basis.nodes), nodal, atol=1e-11)


def test_the_matrix_from_nodes_is_the_gauss_rule() -> None:
    basis = LegendreBasis(6)
    expected = moments_of_function(basis, lambda s: s**5 - s, quadrature=7)
    np.testing.assert_allclose(nodes_to_moments(basis) @ (basis.nodes**5 - basis.nodes), expected, atol=1e-15)


def test_a_smooth_state_converges_with_the_order() -> None:
    s = np.linspace(-1, 1, 101)

    def error(order: int) -> float:
        basis = LegendreBasis(order)
        return float(np.abs(evaluate_moments(basis, moments_of_function(basis, np.exp), s) - np.exp(s)).max())

    for order, first_dropped in ((4, 11 / 10395), (8, 19 / 654729075)):
        assert first_dropped < error(order) < 1.25 * first_dropped
    assert error(16) < 1e-13


def test_the_default_quadrature_integrates_more_than_the_nodes_do() -> None:
    basis = LegendreBasis(2)
    assert moments_of_function(basis, lambda s: s**6)[0] == pytest.approx(np.sqrt(2) / 7, abs=1e-15)
    coarse = moments_of_function(basis, lambda s: s**6, quadrature=3)[0]
    assert coarse == pytest.approx(0.24 * 0.5**0.5, abs=1e-15)


def test_shapes_of_states() -> None:
    basis, moments = LegendreBasis(3), normal(0, 5, 4, 2)
    assert evaluate_moments(basis, moments, 0.5).shape == (5, 2)
    assert evaluate_moments(basis, moments, np.zeros(6)).shape == (5, 6, 2)
    assert evaluate_moments(basis, moments, np.zeros((6, 7))).shape == (5, 6, 7, 2)
    assert evaluate_moments(basis, moments[0, :, 0], 0.5).shape == ()
    assert evaluate_moments(basis, moments[0, :, 0], np.zeros((6, 7))).shape == (6, 7)


def test_each_axis_of_states_is_its_own() -> None:
    basis, moments, s = LegendreBasis(3), normal(0, 5, 4, 2), np.array([[-0.3, 0.1], [0.4, 0.9]])
    states = evaluate_moments(basis, moments, s)
    one = sum(moments[3, k, 1] * basis.evaluate(0.4)[k] for k in range(4))
    assert states[3, 1, 0, 1] == pytest.approx(one, abs=1e-14)


@given(st.integers(0, 10), seeds)
def test_samples_of_a_polynomial_give_its_moments(order: int, seed: int) -> None:
    basis, moments = LegendreBasis(order), normal(seed, 2, order + 1, 3)
    s = np.cos(np.linspace(0, np.pi, 2 * order + 3))
    got = moments_of_samples(basis, s, evaluate_moments(basis, moments, s))
    np.testing.assert_allclose(got, moments, atol=1e-11)


def test_noisy_samples_are_fitted_in_least_squares() -> None:
    basis, s = LegendreBasis(3), np.linspace(-1, 1, 60)
    values = np.exp(s) + 0.1 * normal(1, 60)
    expected = np.polynomial.Legendre.fit(s, values, 3, domain=[-1, 1])
    got = evaluate_moments(basis, moments_of_samples(basis, s, values), s)
    np.testing.assert_allclose(got, expected(s), atol=1e-12)


def test_even_samples_tend_to_the_integral() -> None:
    basis, s = LegendreBasis(4), np.linspace(-1, 1, 4001)
    got = moments_of_samples(basis, s, np.exp(2 * s))
    np.testing.assert_allclose(got, moments_of_function(basis, lambda s: np.exp(2 * s)), atol=1e-3)


def test_scaled_ends_with_rounding_are_accepted() -> None:
    interval = Interval(0.1, 0.3)
    s = interval.to_scaled([0.1, 0.2, 0.3]) * (1 + 1e-15)
    assert moments_of_samples(LegendreBasis(1), s, [1.0, 2.0, 3.0]).shape == (2,)


@pytest.mark.parametrize(
    ("s", "values", "message"),
    [
        ([0.9, 1.0, 1.1], [1.0, 2.0, 3.0], r"^s: .*\[-1, 1\], got 0.9 to 1.1; Interval.to_scaled"),
        ([0.5, 0.5, 0.5], [1.0, 2.0, 3.0], "^s: expected one row of at least 2 different points"),
        ([[0.1, 0.2]], [1.0, 2.0], "^s: expected one row"),
        ([], [], "^s: expected one row"),
        ([0.1, 0.2, 0.3], [1.0, 2.0], r"^values: expected shape \(3,\) or \(..., 3, n\), got \(2,\)"),
        ([0.1, 0.2], [1.0, np.inf], "^values: expected finite"),
    ],
)
def test_bad_samples_are_named(s: ArrayLike, values: ArrayLike, message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        moments_of_samples(LegendreBasis(1), s, values)


@pytest.mark.parametrize("quadrature", [3, 201, 8.0])
def test_bad_quadratures_are_named(quadrature: object) -> None:
    with pytest.raises(ProblemError, match=r"^quadrature: expected a whole number from 4 to 200"):
        moments_of_function(LegendreBasis(3), np.exp, quadrature)  # type: ignore[arg-type]


def test_functions_of_the_wrong_shape_are_named() -> None:
    with pytest.raises(ProblemError, match=r"^values of f: expected shape"):
        moments_of_function(LegendreBasis(3), lambda s: 1.0)
    with pytest.raises(ProblemError, match=r"^values of f: expected shape"):
        moments_of_function(LegendreBasis(3), lambda s: np.stack([s, s]))


def test_bad_moments_are_named() -> None:
    with pytest.raises(ProblemError, match=r"^moments: expected shape \(4,\) or \(..., 4, n\), got \(3, 4\)$"):
        evaluate_moments(LegendreBasis(3), np.zeros((3, 4)), 0.0)


def test_cached_matrices_are_read_only() -> None:
    for matrix in (nodes_to_moments(LegendreBasis(2)), moments_to_nodes(LegendreBasis(2))):
        with pytest.raises(ValueError, match="read-only"):
            matrix[0, 0] = 0.0
