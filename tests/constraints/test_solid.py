"""Convex polyhedra in space, against optimisation and against SciPy's geometry."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial import ConvexHull

from ensemble_ctrl import Polyhedron, ProblemError, Solid
from tests.examples import examples

Floats = NDArray[np.float64]


def random_solid(seed: int) -> Solid:
    """The hull of a dozen points."""
    return Solid.hull(np.random.default_rng(seed).standard_normal((12, 3)))


def by_optimisation(solid: Solid, point: Floats) -> float:
    """Distance of a point outside: the nearest convex combination of the corners."""
    corners, n = solid.vertices, len(solid.vertices)
    equal: Any = {"type": "eq", "fun": lambda share: share.sum() - 1, "jac": lambda share: np.ones(n)}
    solve: Any = minimize
    found = solve(
        lambda share: float(((share @ corners - point) ** 2).sum()),
        np.full(n, 1 / n),
        jac=lambda share: 2 * corners @ (share @ corners - point),
        bounds=[(0, 1)] * n,
        constraints=equal,
        options={"ftol": 1e-14, "maxiter": 500},
    )
    return float(np.sqrt(found.fun))


@examples(20)
@given(st.integers(0, 10_000))
def test_distances_outside_are_those_of_the_nearest_point(seed: int) -> None:
    solid = random_solid(seed)
    points = 3 * np.random.default_rng(seed + 1).standard_normal((5, 3))
    for point, distance in zip(points, solid.distance(points), strict=True):
        if distance > 0:
            assert distance == pytest.approx(by_optimisation(solid, point), abs=1e-5)


@examples(20)
@given(st.integers(0, 10_000))
def test_corners_and_depths(seed: int) -> None:
    points = np.random.default_rng(seed).standard_normal((12, 3))
    solid, hull = Solid.hull(points), ConvexHull(points)
    expected = points[hull.vertices]
    assert len(solid.vertices) == len(expected)
    assert all(np.linalg.norm(solid.vertices - corner, axis=1).min() < 1e-7 for corner in expected)
    inside = 0.3 * expected.mean(axis=0) + 0.7 * expected[0]
    depth = -(hull.equations @ [*inside, 1.0]).max()
    assert float(solid.distance(inside)) == pytest.approx(-depth, abs=1e-9)
    assert float(solid.facet_clearance(inside)) == pytest.approx(-depth, abs=1e-9)


def test_a_box_in_closed_form() -> None:
    box = Solid.box([[0, 1], [-2, 2], [0, 3]])
    points = np.random.default_rng(0).uniform(-4, 5, (500, 3))
    apart = np.maximum(np.maximum([0, -2, 0] - points, points - [1, 2, 3]), 0.0)
    away = np.linalg.norm(apart, axis=1)
    outside = away > 0
    np.testing.assert_allclose(box.distance(points)[outside], away[outside], atol=1e-12)
    assert (box.facet_clearance(points) <= box.distance(points) + 1e-12).all()
    assert (len(box.vertices), len(box.edges)) == (8, 12)


def test_regions_have_corners_in_one_to_three_dimensions() -> None:
    assert Polyhedron.box([[1.0, 2.0]]).vertices.ravel().tolist() == [1.0, 2.0]
    assert len(Polyhedron.box([[0, 1]] * 3).vertices) == 8


@pytest.mark.parametrize(
    ("A", "b", "message"),
    [
        ([[1, 0, 0]], [0.0], "bounded polyhedron"),
        (np.vstack([np.eye(3), -np.eye(3)]), [1, 1, 1, 0, 0, 0], "with a volume"),
        (np.vstack([np.eye(3), -np.eye(3)]), [0, 0, 0, 0, -1, -1], "with a volume"),
        (np.eye(2), [0.0, 0.0], r"expected A \(facets, 3\)"),
        (np.eye(3), [0.0, 0.0, np.nan], "finite numbers"),
    ],
)
def test_what_is_no_solid(A: object, b: object, message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        Solid(A, b)  # type: ignore[arg-type]


def test_flat_points_have_no_hull() -> None:
    with pytest.raises(ProblemError, match="points with a volume"):
        Solid.hull([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    with pytest.raises(ProblemError, match=r"Solid.box: expected low < high"):
        Solid.box([[0, 1], [2, 1], [0, 1]])
