import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import LegendreBasis

Array = NDArray[np.float64]


def random_polygon(seed: int) -> Array:
    """Corners of the hull of random points, counter-clockwise; every third one is a turned rectangle."""
    rng = np.random.default_rng(seed)
    if seed % 3 == 0:
        angle = rng.uniform(0, 7)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * rng.uniform(0.2, 2, 2) @ turn.T
        return np.asarray(corners + rng.normal(size=2))
    hull = shapely.MultiPoint(rng.normal(size=(rng.integers(3, 12), 2))).convex_hull
    return np.array(shapely.orient_polygons(hull).exterior.coords)[:-1]


def signed_distance(corners: Array, x: Array) -> Array:
    polygon = shapely.Polygon(corners)
    exact = shapely.distance(shapely.points(x), shapely.boundary(polygon))
    return np.asarray(np.where(shapely.contains_xy(polygon, x[..., 0], x[..., 1]), -exact, exact))


@given(st.integers(0, 10_000), st.booleans())
def test_distance_is_shapelys(seed: int, clockwise: bool) -> None:
    corners = random_polygon(seed)
    obstacle = Obstacle.polygon(corners[::-1] if clockwise else corners)
    x = np.random.default_rng(seed).normal(scale=2, size=(10, 20, 2))
    exact = signed_distance(corners, x)
    np.testing.assert_allclose(obstacle.distance(x), exact, atol=1e-9)
    clearance = obstacle.facet_clearance(x)
    assert (clearance <= exact + 1e-9).all()
    np.testing.assert_array_equal(clearance > 1e-9, exact > 1e-9)
    np.testing.assert_allclose(clearance[exact < 0], exact[exact < 0], atol=1e-9)


@given(st.integers(0, 10_000))
def test_vertices_give_the_polygon_back(seed: int) -> None:
    corners = random_polygon(seed)
    found = Obstacle.polygon(corners).vertices
    assert shapely.Polygon(found).exterior.is_ccw
    assert shapely.hausdorff_distance(shapely.Polygon(found), shapely.Polygon(corners)) < 1e-6


def test_distance_in_blocks_and_for_rows_of_any_length() -> None:
    x = np.random.default_rng(1).uniform(0, 8, (3, 9001, 2))
    box = Obstacle.box([[2, 6], [1, 3]])
    scaled = Obstacle(box.A * [[2.0], [3.0], [0.5], [7.0]], box.b * [2.0, 3.0, 0.5, 7.0])
    np.testing.assert_allclose(scaled.distance(x), box.distance(x), atol=1e-12)
    np.testing.assert_allclose(box.distance(x), signed_distance(box.vertices, x), atol=1e-12)
    assert box.distance([3.0, 2.0]).shape == ()


@given(st.integers(0, 10_000))
def test_big_m_bounds_are_necessary(seed: int) -> None:
    """All members on the free side of the facets whose switch is one: the rows hold."""
    rng = np.random.default_rng(seed)
    obstacle = Obstacle.polygon(random_polygon(seed))
    z = rng.integers(0, 2, len(obstacle.b))
    s, w = np.polynomial.legendre.leggauss(60)
    values = rng.normal(size=2) * 3 + np.outer(s, rng.normal(size=2)) + np.outer(s**2, rng.normal(size=2))
    z = z * (values @ obstacle.A.T <= obstacle.b).all(axis=0)
    phi = (np.polynomial.legendre.legvander(s, 5) * np.sqrt((2 * np.arange(6) + 1) / 2)).T
    moments = (phi * w) @ values
    bounds = obstacle.big_m_bounds(LegendreBasis(order=5), M=50.0)
    rows = moments @ obstacle.A.T + np.outer(bounds.switch, z)
    assert (rows >= bounds.lower - 1e-9).all()
    assert (rows <= bounds.upper + 1e-9).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Obstacle.box([[3, 2], [0, 1]]), "low < high"),
        (lambda: Obstacle.box([[0, 1]]), "Obstacle.box"),
        (lambda: Obstacle([[1, 0], [0, 1]], [0, 0]), "unbounded"),
        (lambda: Obstacle([[1, 0], [-1, 0], [0, 1], [0, -1]], [0, 1, 0, 0]), "empty or flat"),
        (lambda: Obstacle([[1, 0], [-1, 0], [0, 1], [0, -1]], [0, 0, 0, -1]), "empty or flat"),
        (lambda: Obstacle([[1, 0]], [0, 1]), "facets"),
        (lambda: Obstacle([[1, 0], [-1, 0], [0, 1], [0, -1]], [0, 0, np.nan, -1]), "Obstacle.b"),
        (lambda: Obstacle.polygon([[0.0, 0.0], [2.0, 0.0], [1.0, 0.5], [2.0, 2.0]]), "convex_pieces"),
        (lambda: Obstacle.polygon([[0, 0], [1, 1], [1, 0], [0, 1]]), "cross itself|area"),
        (lambda: Obstacle.polygon([[0, 0], [1, 1], [2, 2]]), "area"),
        (lambda: Obstacle.polygon([[0, 0], [1, 1]]), "area"),
        (lambda: Obstacle.box([[0, 1], [0, 1]]).distance([1.0, 2.0, 3.0]), "points"),
        (lambda: Obstacle.box([[0, 1], [0, 1]]).big_m_bounds(LegendreBasis(order=1), -1.0), "M:"),
    ],
)
def test_wrong_arguments_are_named(make, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ProblemError, match=message):
        make()
