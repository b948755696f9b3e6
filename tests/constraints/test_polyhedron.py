import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import LegendreBasis

inf = np.inf


def random_polyhedron(seed: int, rows: int = 5) -> Polyhedron:
    """Random rows round a point near the origin, each bounded on both sides."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(rows, 2))
    centre = A @ rng.normal(size=2)
    return Polyhedron(A, centre - rng.uniform(0.1, 2, rows), centre + rng.uniform(0.1, 2, rows))


def legendre(order: int, s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Orthonormal Legendre polynomials, shape (order + 1, points)."""
    V = np.polynomial.legendre.legvander(s, order)
    return np.asarray((V * np.sqrt((2 * np.arange(order + 1) + 1) / 2)).T)


@given(st.integers(0, 10_000))
def test_moment_bounds_are_necessary(seed: int) -> None:
    """Random piecewise-constant functions into the polyhedron satisfy every bound."""
    rng = np.random.default_rng(seed)
    region = random_polyhedron(seed)
    mix = rng.dirichlet(np.full(len(region.vertices), 0.3), size=8)
    s, w = np.polynomial.legendre.leggauss(40)
    nodes = ((s + 1) / 8 + np.arange(8)[:, None] / 4 - 1).ravel()
    weights = np.tile(w / 8, 8)
    values = np.repeat(mix @ region.vertices, 40, axis=0)
    moments = (legendre(6, nodes) * weights) @ values
    lower, upper = region.moment_bounds(LegendreBasis(order=6))
    assert (moments @ region.A.T >= lower - 1e-9).all()
    assert (moments @ region.A.T <= upper + 1e-9).all()


def test_moment_bounds_are_not_sufficient() -> None:
    region = Polyhedron([[1.0, 0.0]], [-1.0], [1.0])
    moments = np.array([[0.0, 0.0], [0.6, 0.0]])
    lower, upper = region.moment_bounds(LegendreBasis(order=1))
    assert (moments @ region.A.T >= lower).all()
    assert (moments @ region.A.T <= upper).all()
    ends = legendre(1, np.array([-1.0, 1.0])).T @ moments
    assert region.contains(ends).tolist() == [True, True]
    wide = np.array([[1.4, 0.0], [0.6, 0.0]])
    assert (wide @ region.A.T <= upper).all()
    assert not region.contains(legendre(1, np.array([1.0])).T @ wide).any()


def test_moment_bounds_of_a_side_that_nothing_closes_are_infinite() -> None:
    lower, upper = Polyhedron([[1.0, 0.0]], [2.0], [inf]).moment_bounds(LegendreBasis(order=2))
    np.testing.assert_allclose(lower[0], 2 * np.sqrt(2))
    assert np.isposinf(upper).all()
    assert np.isneginf(lower[1:]).all()


STRIP = Polyhedron([[3, 2], [-3, 2], [0, 1]], [-0.5, -6, -0.1], [14, 1, 2.1])
"""The paper's polyhedron, two sides a line."""
ONE_SIDED = Polyhedron(
    [[3.0, 2.0], [-0.3 - 1e-12, -0.2], [-3.0, 2.0], [6.0, -4.0], [0.0, 1.0], [0.0, -7.0]],
    [-0.5, -1.4, -6.0, -2.0, -0.1, -14.7],
    [inf] * 6,
)
"""The same set, a side a row, as problem files are read."""


def test_moment_bounds_of_one_sided_rows_are_those_of_two_sided_ones() -> None:
    basis = LegendreBasis(order=4)
    lower, upper = STRIP.moment_bounds(basis)
    np.testing.assert_allclose(upper[1], [8.879, 4.287, 1.347], atol=5e-4)
    np.testing.assert_allclose(lower[1], [-8.879, -4.287, -1.347], atol=5e-4)
    low, high = ONE_SIDED.moment_bounds(basis)
    scale = np.array([1.0, -0.1, 1.0, -2.0, 1.0, -7.0])
    ends = np.stack([lower[:, [0, 0, 1, 1, 2, 2]], upper[:, [0, 0, 1, 1, 2, 2]]]) * scale
    np.testing.assert_allclose(low, ends.min(axis=0), atol=1e-9)
    np.testing.assert_allclose(high, ends.max(axis=0), atol=1e-9)


def test_two_sided_rows_are_one_for_each_line() -> None:
    merged = ONE_SIDED.two_sided()
    length = np.linalg.norm(STRIP.A, axis=1)
    np.testing.assert_allclose(merged.A * length[:, None], STRIP.A)
    np.testing.assert_allclose(merged.lower * length, STRIP.lower)
    np.testing.assert_allclose(merged.upper * length, STRIP.upper)


def test_the_tightest_of_parallel_rows_counts() -> None:
    merged = Polyhedron([[1, 0], [2, 0], [-1, 0]], [0, 1, -9], [5, inf, -0.25]).two_sided()
    np.testing.assert_allclose(np.hstack([merged.A[0], merged.lower, merged.upper]), [1, 0, 0.5, 5])


def test_an_open_side_has_the_bound_that_the_others_imply() -> None:
    triangle = Polyhedron([[1, 0], [0, 1], [-1, -1]], [0, 0, -3], [inf] * 3)
    lower, upper = triangle.moment_bounds(LegendreBasis(order=1))
    part = np.sqrt(3 / 2) / 2
    np.testing.assert_allclose(upper, [np.sqrt(2) * np.array([3, 3, 0]), np.full(3, 3 * part)], atol=1e-9)
    np.testing.assert_allclose(lower, [np.sqrt(2) * np.array([0, 0, -3]), np.full(3, -3 * part)], atol=1e-9)


def test_a_half_plane_leaves_a_wedge_its_open_sides() -> None:
    """The part of the quadrant x, y >= 0 with x + y >= 1: nothing bounds any row from above."""
    wedge = Polyhedron([[1, 0], [0, 1], [1, 1]], [0, 0, 1], [inf] * 3)
    assert np.isposinf(wedge.two_sided().upper).all()


@given(st.integers(0, 10_000))
def test_moment_bounds_of_one_sided_rows_are_necessary(seed: int) -> None:
    """The corners of a random polyhedron, each row's upper sides open, reach no further than what is implied."""
    region = random_polyhedron(seed)
    half = Polyhedron(np.vstack([region.A, -region.A[::-1]]), np.append(region.lower, -region.upper[::-1]), [inf] * 10)
    order = np.argsort(np.random.default_rng(seed).uniform(size=10))
    shuffled = Polyhedron(half.A[order], half.lower[order], half.upper[order])
    values = region.vertices @ shuffled.A.T
    lower, upper = (bound[0] / np.sqrt(2) for bound in shuffled.moment_bounds(LegendreBasis(order=1)))
    assert (values >= lower - 1e-7).all()
    assert (values <= upper + 1e-7).all()
    assert np.isfinite(upper).all()


@given(st.integers(0, 10_000))
def test_margin_agrees_with_contains_and_shapely(seed: int) -> None:
    from shapely import Polygon, boundary, contains_xy, distance, points

    region = random_polyhedron(seed)
    x = np.random.default_rng(seed).uniform(-5, 5, (50, 2))
    shape = Polygon(region.vertices)
    exact = distance(points(x), boundary(shape))
    inside = contains_xy(shape, x[:, 0], x[:, 1])
    margin = region.margin(x)
    clear = np.abs(margin) > 1e-7
    np.testing.assert_array_equal(region.contains(x)[clear], inside[clear])
    np.testing.assert_allclose(margin[inside], exact[inside], atol=1e-7)
    assert (-margin[~inside] <= exact[~inside] + 1e-7).all()


def test_unit_rows_skip_open_sides() -> None:
    G, h = Polyhedron([[3.0, 4.0], [0.0, 2.0]], [-inf, 1.0], [10.0, inf]).unit_rows()
    np.testing.assert_allclose(G, [[0.6, 0.8], [0.0, -1.0]])
    np.testing.assert_allclose(h, [2.0, -0.5])


def test_vertices_run_counter_clockwise() -> None:
    corners = Polyhedron.box([[0, 2], [1, 3]]).vertices
    np.testing.assert_allclose(corners, [[0, 1], [2, 1], [2, 3], [0, 3]])


@pytest.mark.parametrize(
    ("A", "lower", "upper", "empty", "bounded"),
    [
        ([[1, 0], [0, 1]], [0, 0], [1, 1], False, True),
        ([[1, 0], [0, 1]], [0, 0], [0, 0], False, True),
        ([[1, 0]], [0], [1], False, False),
        ([[1, 0], [0, 1]], [0, 0], [1, inf], False, False),
        ([[1, 0], [1, 0], [0, 1]], [0, 2, 0], [1, 3, 1], True, True),
        ([[1, 1], [1, 0], [0, 1]], [3, -inf, -inf], [inf, 1, 1], True, True),
        ([[1, 1], [1, 0], [0, 1]], [-inf, 0, 0], [1, inf, inf], False, True),
        (np.eye(3), [0, 0, 0], [1, 1, 1], False, True),
        (np.eye(3)[:2], [0, 0], [1, 1], False, False),
    ],
)
def test_empty_and_bounded(A: object, lower: object, upper: object, empty: bool, bounded: bool) -> None:
    region = Polyhedron(A, lower, upper)  # type: ignore[arg-type]
    assert (region.is_empty, region.is_bounded) == (empty, bounded)


def test_arrays_are_copies_and_read_only() -> None:
    A = np.eye(2)
    region = Polyhedron(A, np.zeros(2), np.ones(2))
    A[0, 0] = 7
    assert region.A[0, 0] == 1
    with pytest.raises(ValueError, match="read-only"):
        region.A[0, 0] = 2


@pytest.mark.parametrize(
    ("A", "lower", "upper", "message"),
    [
        ([[0, 0]], [0], [1], "Polyhedron.A.*zero"),
        ([[np.nan, 0]], [0], [1], "Polyhedron.A.*finite"),
        ([1, 0], [0], [1], "Polyhedron.A.*shape"),
        ([[1, 0]], [0, 1], [1], r"Polyhedron.lower.*\(1,\)"),
        ([[1, 0]], [2], [1], "lower <= upper"),
        ([[1, 0]], [np.nan], [1], "NaN"),
        ([[1, 0]], [inf], [inf], "Polyhedron.lower"),
    ],
)
def test_wrong_arguments_are_named(A: object, lower: object, upper: object, message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        Polyhedron(A, lower, upper)  # type: ignore[arg-type]


def test_vertices_need_a_bounded_plane_set() -> None:
    with pytest.raises(ProblemError, match="unbounded"):
        _ = Polyhedron([[1.0, 0.0]], [0.0], [1.0]).vertices
    with pytest.raises(ProblemError, match="at most 3 dimensions"):
        _ = Polyhedron.box([[0, 1]] * 4).vertices
    with pytest.raises(ProblemError, match="points"):
        Polyhedron.box([[0, 1]] * 2).margin([1.0, 2.0, 3.0])
