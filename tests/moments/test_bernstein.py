"""Bernstein coefficients against evaluation, de Casteljau's algorithm, and exact fractions."""

from __future__ import annotations

from fractions import Fraction
from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import (
    LegendreBasis,
    bernstein_to_moments,
    evaluate_moments,
    moments_to_bernstein,
    nodes_to_bernstein,
    nodes_to_moments,
)

FloatArray = NDArray[np.float64]
orders = st.integers(0, 12)
seeds = st.integers(0, 2**32 - 1)
parts = st.tuples(st.floats(-1, 1), st.floats(-1, 1)).map(sorted)


def normal(seed: int, *shape: int) -> FloatArray:
    """Random states."""
    return np.random.default_rng(seed).normal(size=shape)


def de_casteljau(coefficients: FloatArray, t: float) -> list[FloatArray]:
    """All levels of the triangle, the coefficients first and the point on the curve last."""
    levels = [coefficients]
    while len(levels[-1]) > 1:
        levels.append((1 - t) * levels[-1][:-1] + t * levels[-1][1:])
    return levels


def exact_legendre_to_bernstein(order: int) -> list[list[Fraction]]:
    """Row i, column k: Bernstein coefficient i of P_k, by way of powers of t, in fractions."""
    powers = [[Fraction(1)], [Fraction(-1), Fraction(2)]]
    for k in range(1, order):
        doubled = [2 * x - y for x, y in zip([Fraction(0), *powers[k]], [*powers[k], Fraction(0)], strict=True)]
        below = [*powers[k - 1], Fraction(0), Fraction(0)]
        powers.append([((2 * k + 1) * x - k * y) / (k + 1) for x, y in zip(doubled, below, strict=True)])
    weight = [[Fraction(comb(i, j), comb(order, j)) for j in range(i + 1)] for i in range(order + 1)]
    return [
        [sum((w * p for w, p in zip(row, power, strict=False)), Fraction(0)) for power in powers[: order + 1]]
        for row in weight
    ]


@pytest.mark.parametrize("order", [1, 2, 5, 8, 20, 40])
def test_the_matrix_is_that_of_exact_fractions(order: int) -> None:
    exact = np.array([[float(x) for x in row] for row in exact_legendre_to_bernstein(order)])
    norms = np.sqrt(np.arange(order + 1) + 0.5)
    np.testing.assert_allclose(moments_to_bernstein(LegendreBasis(order)), exact * norms, rtol=1e-14)


@given(orders, seeds, parts, st.floats(0, 1))
def test_the_coefficients_give_the_state_back(order: int, seed: int, part: list[float], t: float) -> None:
    basis, nodal, (lower, upper) = LegendreBasis(order), normal(seed, order + 1, 2), part
    coefficients = nodes_to_bernstein(basis, lower, upper) @ nodal
    s = lower + t * (upper - lower)
    expected = evaluate_moments(basis, nodes_to_moments(basis) @ nodal, s)
    atol = 1e-13 * (1 + np.abs(coefficients).max())
    np.testing.assert_allclose(de_casteljau(coefficients, t)[-1][0], expected, atol=atol)


@given(orders, seeds, parts)
def test_the_end_coefficients_are_the_states_at_the_ends(order: int, seed: int, part: list[float]) -> None:
    basis, moments = LegendreBasis(order), normal(seed, order + 1)
    coefficients = moments_to_bernstein(basis, part[0], part[1]) @ moments
    ends = evaluate_moments(basis, moments, part)
    np.testing.assert_allclose(coefficients[[0, -1]], ends, atol=1e-11)


@given(orders, seeds, parts)
def test_the_curve_lies_between_the_coefficients(order: int, seed: int, part: list[float]) -> None:
    basis, nodal, (lower, upper) = LegendreBasis(order), normal(seed, order + 1, 3), part
    direction = normal(seed + 1, 3)
    support = nodes_to_bernstein(basis, lower, upper) @ nodal @ direction
    moments = nodes_to_moments(basis) @ nodal
    curve = evaluate_moments(basis, moments, np.linspace(lower, upper, 101)) @ direction
    slack = 1e-13 * (1 + np.abs(support).max())
    assert support.min() - slack <= curve.min()
    assert curve.max() <= support.max() + slack


@given(orders, parts)
def test_rows_sum_to_one(order: int, part: list[float]) -> None:
    matrix = nodes_to_bernstein(LegendreBasis(order), part[0], part[1])
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, atol=1e-12 * np.abs(matrix).max())


@given(orders.filter(bool), seeds, st.floats(0, 1))
def test_a_part_is_the_subdivision_of_the_whole(order: int, seed: int, t: float) -> None:
    basis, nodal = LegendreBasis(order), normal(seed, order + 1)
    levels = de_casteljau(nodes_to_bernstein(basis) @ nodal, t)
    left, right = [level[0] for level in levels], [level[-1] for level in reversed(levels)]
    atol = 1e-13 * (1 + np.abs(levels[0]).max())
    np.testing.assert_allclose(nodes_to_bernstein(basis, upper=2 * t - 1) @ nodal, left, atol=atol)
    np.testing.assert_allclose(nodes_to_bernstein(basis, lower=2 * t - 1) @ nodal, right, atol=atol)


def test_halving_the_part_tightens_the_hull() -> None:
    basis = LegendreBasis(8)
    nodal = np.sin(4 * basis.nodes)
    whole = nodes_to_bernstein(basis) @ nodal
    halves = [nodes_to_bernstein(basis, *ends) @ nodal for ends in ((-1.0, 0.0), (0.0, 1.0))]
    assert max(half.max() for half in halves) < whole.max() - 0.01
    assert halves[0][-1] == pytest.approx(halves[1][0], abs=1e-13)


def test_a_part_without_width_is_one_state() -> None:
    basis, nodal = LegendreBasis(6), normal(0, 7)
    expected = evaluate_moments(basis, nodes_to_moments(basis) @ nodal, 0.3)
    np.testing.assert_allclose(nodes_to_bernstein(basis, 0.3, 0.3) @ nodal, np.full(7, expected), atol=1e-13)


@given(st.integers(1, 12), seeds, parts)
def test_a_lower_degree_is_a_projection_on_the_first_moments(order: int, seed: int, part: list[float]) -> None:
    basis, nodal, degree = LegendreBasis(order), normal(seed, order + 1), order // 2
    matrix = nodes_to_bernstein(basis, part[0], part[1], degree)
    kept = (nodes_to_moments(basis) @ nodal)[: degree + 1]
    assert matrix.shape == (degree + 1, order + 1)
    expected = moments_to_bernstein(LegendreBasis(degree), part[0], part[1]) @ kept
    np.testing.assert_allclose(matrix @ nodal, expected, atol=1e-11)


@given(orders, seeds)
def test_a_higher_degree_is_the_same_curve_in_a_smaller_hull(order: int, seed: int) -> None:
    basis, moments = LegendreBasis(order), normal(seed, order + 1)
    low = moments_to_bernstein(basis) @ moments
    high = moments_to_bernstein(basis, degree=order + 1) @ moments
    i = np.arange(1, order + 1) / (order + 1)
    elevated = np.concatenate([low[:1], i * low[:-1] + (1 - i) * low[1:], low[-1:]])
    np.testing.assert_allclose(high, elevated, atol=1e-11)


@pytest.mark.parametrize(("order", "atol"), [(0, 0), (1, 1e-15), (4, 1e-13), (8, 1e-13), (16, 1e-11)])
def test_moments_and_bernstein_are_inverse(order: int, atol: float) -> None:
    basis = LegendreBasis(order)
    identity = bernstein_to_moments(basis) @ moments_to_bernstein(basis)
    np.testing.assert_allclose(identity, np.eye(order + 1), atol=max(atol, 1e-15))


def test_moments_of_bernstein_polynomials_are_integrals() -> None:
    basis, degree = LegendreBasis(3), 6
    s, weights = np.polynomial.legendre.leggauss(12)
    i = np.arange(degree + 1)
    t = ((1 + s) / 2)[:, None]
    bernstein = np.array([comb(degree, j) for j in i]) * t**i * (1 - t) ** (degree - i)
    expected = (weights[:, None] * basis.evaluate(s)).T @ bernstein
    np.testing.assert_allclose(bernstein_to_moments(basis, degree), expected, atol=1e-14)
    np.testing.assert_allclose(bernstein_to_moments(basis, 1)[2:], 0.0, atol=1e-15)


def test_nodes_to_bernstein_goes_by_way_of_moments() -> None:
    basis = LegendreBasis(5)
    expected = moments_to_bernstein(basis, -0.5, 0.25) @ nodes_to_moments(basis)
    np.testing.assert_array_equal(nodes_to_bernstein(basis, -0.5, 0.25), expected)


def test_high_orders_keep_their_accuracy() -> None:
    basis = LegendreBasis(20)
    coefficients = nodes_to_bernstein(basis) @ basis.nodes
    np.testing.assert_allclose(coefficients, np.linspace(-1, 1, 21), atol=1e-9)


@pytest.mark.parametrize(("lower", "upper"), [(-1.1, 0.0), (0.0, 1.01), (-2.0, 2.0)])
def test_parts_outside_the_range_are_named(lower: float, upper: float) -> None:
    with pytest.raises(ProblemError, match=r"^lower, upper: expected scaled parameters in \[-1, 1\], got"):
        nodes_to_bernstein(LegendreBasis(2), lower, upper)


@pytest.mark.parametrize(("lower", "upper", "name"), [(np.nan, 1, "lower"), (0, "x", "upper"), (0.5, 0.2, "upper")])
def test_bad_ends_are_named(lower: float, upper: float, name: str) -> None:
    with pytest.raises(ProblemError, match=rf"^{name}: expected"):
        moments_to_bernstein(LegendreBasis(2), lower, upper)


@pytest.mark.parametrize("degree", [-1, 51, 1.0, True])
def test_bad_degrees_are_named(degree: object) -> None:
    for call in (nodes_to_bernstein, moments_to_bernstein, bernstein_to_moments):
        with pytest.raises(ProblemError, match=r"^degree: expected a whole number from 0 to 50, got"):
            call(LegendreBasis(2), degree=degree)  # type: ignore[arg-type]


def test_cached_matrices_are_read_only() -> None:
    basis = LegendreBasis(2)
    for matrix in (nodes_to_bernstein(basis), moments_to_bernstein(basis), bernstein_to_moments(basis)):
        with pytest.raises(ValueError, match="read-only"):
            matrix[0, 0] = 0.0
