"""Multiplication by the parameter, and the shifts it is made of."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import (
    Interval,
    LegendreBasis,
    affine_multiplication_matrix,
    moments_of_function,
    multiplication_matrix,
    nodes_to_moments,
    shift_left,
    shift_right,
)

orders = st.integers(0, 30)


@given(orders)
def test_the_matrix_is_symmetric_tridiagonal_with_the_nodes_as_eigenvalues(order: int) -> None:
    basis = LegendreBasis(order)
    matrix = multiplication_matrix(basis)
    np.testing.assert_array_equal(matrix, matrix.T)
    np.testing.assert_array_equal(matrix, np.triu(np.tril(matrix, 1), -1))
    np.testing.assert_allclose(np.linalg.eigvalsh(matrix), basis.nodes, atol=1e-14)


@pytest.mark.parametrize("order", [1, 4, 8, 20])
def test_the_nodes_diagonalise_the_matrix(order: int) -> None:
    basis = LegendreBasis(order)
    vectors = nodes_to_moments(basis) / np.sqrt(basis.weights)
    np.testing.assert_allclose(vectors @ vectors.T, np.eye(order + 1), atol=1e-13)
    rebuilt = vectors @ np.diag(basis.nodes) @ vectors.T
    np.testing.assert_allclose(rebuilt, multiplication_matrix(basis), atol=1e-13)


@given(orders.filter(bool), st.integers(0, 2**32 - 1))
def test_the_matrix_multiplies_by_s(order: int, seed: int) -> None:
    basis = LegendreBasis(order)
    p = np.polynomial.Polynomial(np.random.default_rng(seed).normal(size=order))
    product = moments_of_function(basis, lambda s: s * p(s))
    got = multiplication_matrix(basis) @ moments_of_function(basis, p)
    np.testing.assert_allclose(got, product, atol=1e-11)


def test_the_top_moment_of_a_product_is_dropped() -> None:
    basis = LegendreBasis(2)
    product = moments_of_function(basis, lambda s: s * s**2)
    got = multiplication_matrix(basis) @ moments_of_function(basis, lambda s: s**2)
    np.testing.assert_allclose(got, product, atol=1e-14)
    kept = moments_of_function(LegendreBasis(3), lambda s: s**3)
    assert abs(kept[3]) > 0.1


def test_the_affine_matrix_multiplies_by_the_parameter() -> None:
    basis, interval = LegendreBasis(5), Interval(0.9, 1.3)
    product = moments_of_function(basis, lambda s: interval.to_parameter(s) * s**3)
    got = affine_multiplication_matrix(basis, interval) @ moments_of_function(basis, lambda s: s**3)
    np.testing.assert_allclose(got, product, atol=1e-14)
    eigenvalues = np.linalg.eigvalsh(affine_multiplication_matrix(basis, interval))
    np.testing.assert_allclose(eigenvalues, interval.to_parameter(basis.nodes), atol=1e-14)


@given(orders, st.integers(0, 2**32 - 1))
def test_the_shifts_make_up_the_matrix(order: int, seed: int) -> None:
    basis = LegendreBasis(order)
    moments = np.random.default_rng(seed).normal(size=(3, order + 1, 2))
    a, c = (coefficient[:, None] for coefficient in basis.recurrence())
    got = shift_right(a * moments) + shift_left(c * moments)
    np.testing.assert_allclose(got, multiplication_matrix(basis) @ moments, atol=1e-13)


def test_shifts_act_on_the_order_axis_and_leave_their_argument() -> None:
    moments = np.arange(1.0, 13.0).reshape(2, 3, 2)
    right, left = shift_right(moments), shift_left(moments)
    np.testing.assert_array_equal(right[:, 0], 0.0)
    np.testing.assert_array_equal(right[:, 1:], moments[:, :-1])
    np.testing.assert_array_equal(left[:, -1], 0.0)
    np.testing.assert_array_equal(left[:, :-1], moments[:, 1:])
    np.testing.assert_array_equal(moments, np.arange(1.0, 13.0).reshape(2, 3, 2))


def test_left_undoes_right_up_to_the_top() -> None:
    np.testing.assert_array_equal(shift_left(shift_right([1.0, 2.0, 3.0])), [1.0, 2.0, 0.0])
    np.testing.assert_array_equal(shift_right([5.0]), [0.0])


@pytest.mark.parametrize("moments", [1.0, [np.nan, 1.0]])
def test_bad_moments_are_named(moments: object) -> None:
    with pytest.raises(ProblemError, match=r"^moments: expected"):
        shift_left(moments)  # type: ignore[arg-type]
