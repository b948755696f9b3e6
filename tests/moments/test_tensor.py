"""Products of bases against quadrature on the box, and against their factors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import LegendreBasis, TensorBasis, bernstein_to_moments, nodes_to_bernstein, nodes_to_moments
from tests.examples import examples

Floats = NDArray[np.float64]
orders = st.lists(st.integers(0, 4), min_size=0, max_size=3)


def basis_of(orders: list[int]) -> TensorBasis:
    """A product of Legendre bases."""
    return TensorBasis(tuple(LegendreBasis(order) for order in orders))


@examples(60)
@given(orders)
def test_functions_are_orthonormal_for_a_measure_of_mass_two(orders: list[int]) -> None:
    basis = basis_of(orders)
    fine = basis_of([order + 1 for order in orders])
    phi = basis.evaluate(fine.nodes)
    assert fine.weights.sum() == pytest.approx(2.0)
    np.testing.assert_allclose(phi.T @ (fine.weights[:, None] * phi), np.eye(basis.count), atol=1e-12)
    np.testing.assert_allclose(phi[:, 0], np.sqrt(0.5))


@examples(60)
@given(orders, st.integers(0, 2**31))
def test_nodes_points_and_moments_are_forms_of_one_polynomial(orders: list[int], seed: int) -> None:
    basis = basis_of(orders)
    nodal = np.random.default_rng(seed).normal(size=basis.count)
    moments = basis.nodes_to_moments() @ nodal
    np.testing.assert_allclose(basis.evaluate(basis.nodes) @ moments, nodal, atol=1e-11)
    points = basis.nodes_to_bernstein(orders) @ nodal
    np.testing.assert_allclose(basis.bernstein_to_moments() @ points, moments, atol=1e-10)
    inside = np.random.default_rng(seed).uniform(-1, 1, (50, len(orders)))
    values = basis.evaluate(inside) @ moments
    assert values.min() >= points.min() - 1e-9
    assert values.max() <= points.max() + 1e-9


def test_one_factor_is_the_factor_itself() -> None:
    basis, factor = basis_of([5]), LegendreBasis(5)
    s = np.linspace(-1, 1, 9)
    np.testing.assert_allclose(basis.evaluate(s[:, None]), factor.evaluate(s), atol=1e-14)
    np.testing.assert_allclose(basis.nodes_to_moments(), nodes_to_moments(factor), atol=1e-14)
    np.testing.assert_allclose(basis.nodes_to_bernstein([3]), nodes_to_bernstein(factor, degree=3), atol=1e-14)
    np.testing.assert_allclose(basis.bernstein_to_moments(), bernstein_to_moments(factor), atol=1e-14)
    np.testing.assert_allclose(basis.signed_moments(), factor.signed_moments(), atol=1e-14)
    np.testing.assert_allclose(basis.weights, factor.weights, atol=1e-14)


def test_signed_moments_are_the_integrals_of_the_parts() -> None:
    basis = basis_of([2, 3])
    s = np.linspace(-1, 1, 1201)
    mid = (s[1:] + s[:-1]) / 2
    grid = np.stack(np.meshgrid(mid, mid, indexing="ij"), axis=-1).reshape(-1, 2)
    phi = basis.evaluate(grid)
    positive, negative = basis.signed_moments()
    np.testing.assert_allclose(positive, 2 * np.maximum(phi, 0).mean(axis=0), atol=1e-4)
    np.testing.assert_allclose(negative, 2 * np.maximum(-phi, 0).mean(axis=0), atol=1e-4)


def test_points_of_another_dimension_are_refused() -> None:
    with pytest.raises(ProblemError, match=r"^s: expected shape \(points, 2\), got \(3, 1\)"):
        basis_of([1, 1]).evaluate(np.zeros((3, 1)))
