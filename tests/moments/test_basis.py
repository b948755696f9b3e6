"""The basis against NumPy's Legendre polynomials, quadrature, and printed numbers."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Legendre
from scipy.integrate import quad

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import LegendreBasis

orders = st.integers(0, 50)


def phi(k: int) -> Legendre:
    """phi_k as NumPy writes it."""
    return Legendre(np.sqrt(k + 0.5) * np.eye(k + 1)[k])


def test_the_first_members_pin_the_convention() -> None:
    s = np.linspace(-1, 1, 7)
    expected = [
        np.full(7, 1 / np.sqrt(2)),
        np.sqrt(3 / 2) * s,
        np.sqrt(5 / 8) * (3 * s**2 - 1),
        np.sqrt(7 / 8) * (5 * s**3 - 3 * s),
    ]
    np.testing.assert_allclose(LegendreBasis(3).evaluate(s), np.transpose(expected), atol=1e-15)


@given(orders, st.floats(-1, 1))
def test_values_are_those_of_numpy(order: int, s: float) -> None:
    expected = [phi(k)(s) for k in range(order + 1)]
    np.testing.assert_allclose(LegendreBasis(order).evaluate(s), expected, atol=2e-13)


def test_values_keep_the_shape_of_the_points() -> None:
    basis = LegendreBasis(4)
    s = np.linspace(-1, 1, 6).reshape(2, 3)
    assert basis.evaluate(s).shape == (2, 3, 5)
    np.testing.assert_array_equal(basis.evaluate(s)[1, 2], basis.evaluate(1.0))


@pytest.mark.parametrize("order", [0, 1, 4, 8, 20, 50])
def test_the_basis_is_orthonormal(order: int) -> None:
    s, weights = np.polynomial.legendre.leggauss(order + 1)
    values = LegendreBasis(order).evaluate(s)
    np.testing.assert_allclose((weights[:, None] * values).T @ values, np.eye(order + 1), atol=1e-12)


@given(orders, st.floats(-1, 1))
def test_the_recurrence_multiplies_by_s(order: int, s: float) -> None:
    a, c = LegendreBasis(order).recurrence()
    values = LegendreBasis(50).evaluate(s) if order == 50 else LegendreBasis(order + 1).evaluate(s)
    k = np.arange(min(order + 1, 50))
    below = np.concatenate([[0.0], values])[k]
    np.testing.assert_allclose(s * values[k], a[k] * values[k + 1] + c[k] * below, atol=1e-13)


def test_recurrence_coefficients() -> None:
    a, c = LegendreBasis(6).recurrence()
    k = np.arange(1, 7)
    assert c[0] == 0.0
    np.testing.assert_allclose(c[1:], k / np.sqrt(4 * k**2 - 1), rtol=1e-15)
    np.testing.assert_array_equal(a[:-1], c[1:])
    assert a[6] == pytest.approx(7 / np.sqrt(195), rel=1e-15)


@pytest.mark.parametrize("order", [0, 1, 2, 8, 20, 50])
def test_gauss_nodes_and_weights(order: int) -> None:
    basis = LegendreBasis(order)
    nodes, weights = np.polynomial.legendre.leggauss(order + 1)
    np.testing.assert_allclose(basis.nodes, nodes, atol=1e-15)
    np.testing.assert_allclose(basis.weights, weights, rtol=2e-12)
    assert basis.weights.sum() == pytest.approx(2, abs=1e-14)


def test_three_gauss_points_are_known_in_closed_form() -> None:
    basis = LegendreBasis(2)
    np.testing.assert_allclose(basis.nodes, [-np.sqrt(0.6), 0, np.sqrt(0.6)], atol=1e-15)
    np.testing.assert_allclose(basis.weights, [5 / 9, 8 / 9, 5 / 9], atol=1e-15)


@pytest.mark.parametrize("order", [1, 3, 8, 20])
def test_the_gauss_rule_is_exact_up_to_its_degree(order: int) -> None:
    basis = LegendreBasis(order)
    power = np.arange(2 * order + 2)
    expected = np.where(power % 2 == 0, 2 / (power + 1), 0)
    got = basis.weights @ basis.nodes[:, None] ** power
    np.testing.assert_allclose(got, expected, atol=2e-15)


@given(st.integers(0, 50))
def test_roots(k: int) -> None:
    roots = LegendreBasis(50).roots(k)
    assert roots.shape == (k,)
    assert (np.diff(roots) > 0).all()
    np.testing.assert_allclose(LegendreBasis(k).evaluate(roots)[:, k], np.zeros(k), atol=1e-12)


PRINTED = {
    0: 2**0.5,
    1: 0.6123724356957945,
    2: 0.6085806194501845,
    3: 0.6080193253507654,
    4: 0.6079491842172731,
    8: 0.6081490625021447,
}


@pytest.mark.parametrize(("k", "printed"), PRINTED.items())
def test_signed_moments_are_the_printed_ones(k: int, printed: float) -> None:
    positive, negative = LegendreBasis(8).signed_moments()
    assert positive[k] == pytest.approx(printed, abs=1e-12)
    assert negative[k] == pytest.approx(printed if k else 0.0, abs=1e-12)


@pytest.mark.parametrize("k", [0, 1, 2, 5, 9, 20, 50])
def test_signed_moments_are_those_of_quadrature(k: int) -> None:
    positive, negative = LegendreBasis(k).signed_moments()
    breaks = [-1.0, *LegendreBasis(k).roots(k), 1.0]
    for sign, got in ((1, positive[k]), (-1, negative[k])):
        parts = [
            quad(lambda s, sign=sign: max(sign * float(phi(k)(s)), 0), a, b, epsabs=1e-14)[0]
            for a, b in pairwise(breaks)
        ]
        assert got == pytest.approx(sum(parts), abs=1e-12)


def test_signed_moments_differ_by_the_moment_of_one() -> None:
    positive, negative = LegendreBasis(50).signed_moments()
    np.testing.assert_allclose(positive - negative, np.sqrt(2) * np.eye(51)[0], atol=1e-14)
    assert (negative >= 0).all()


def test_equal_orders_are_equal_bases() -> None:
    assert LegendreBasis(np.int64(4)) == LegendreBasis(4)  # type: ignore[arg-type]
    assert hash(LegendreBasis(4)) == hash(LegendreBasis(4))
    assert LegendreBasis(4) != LegendreBasis(5)


@pytest.mark.parametrize("name", ["nodes", "weights"])
def test_shared_arrays_are_read_only(name: str) -> None:
    with pytest.raises(ValueError, match="read-only"):
        getattr(LegendreBasis(3), name)[0] = 0.0


@pytest.mark.parametrize("order", [-1, 51, 60, 2.0, True, "4", None])
def test_bad_orders_are_named(order: object) -> None:
    with pytest.raises(ProblemError, match=r"^order: expected a whole number from 0 to 50, got"):
        LegendreBasis(order)  # type: ignore[arg-type]


@pytest.mark.parametrize("k", [-1, 4, 1.5])
def test_bad_indices_of_roots_are_named(k: object) -> None:
    with pytest.raises(ProblemError, match=r"^k: expected a whole number from 0 to 3, got"):
        LegendreBasis(3).roots(k)  # type: ignore[arg-type]


@pytest.mark.parametrize("s", [[np.nan], np.inf, ["a"], [[1.0], [1.0, 2.0]]])
def test_bad_points_are_named(s: object) -> None:
    with pytest.raises(ProblemError, match=r"^s: expected"):
        LegendreBasis(3).evaluate(s)  # type: ignore[arg-type]
