"""Separating hyperplanes against shapely's distance between convex hulls."""

from __future__ import annotations

import numpy as np
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.files.config import load
from ensemble_ctrl.ocp import chance
from ensemble_ctrl.ocp.chance import AHEAD, all_hyperplanes, map_size, reach
from ensemble_ctrl.ocp.hyperplanes import separate
from ensemble_ctrl.ocp.truncation import coarse, occupied
from ensemble_ctrl.problem.specification import AvoidConstraint
from tests.examples import examples
from tests.paths import CONFIGS

Floats = NDArray[np.float64]


def random_piece(rng: np.random.Generator, stretch: float) -> Obstacle | None:
    """A random convex polygon, or None where it is nearly flat."""
    hull = shapely.MultiPoint(rng.normal(size=(rng.integers(3, 9), 2)) * [1, stretch]).convex_hull
    return Obstacle.polygon(np.array(hull.exterior.coords)[:-1]) if hull.area > 1e-3 else None


@examples(300)
@given(st.integers(0, 2**32 - 1), st.floats(0, 4), st.sampled_from([0.02, 0.3, 1.0]))
def test_the_gap_is_a_lower_bound_and_close_where_they_are_apart(seed: int, away: float, stretch: float) -> None:
    rng = np.random.default_rng(seed)
    piece = random_piece(rng, stretch)
    assume(piece is not None)
    assert piece is not None
    angle = rng.uniform(0, 2 * np.pi)
    points = rng.normal(size=(4, 5, 2)) * [0.6, 0.1] + away * np.array([np.cos(angle), np.sin(angle)])
    hyperplanes = separate(points, [AvoidConstraint("o", (piece,), 0.0, 0.0, 3.0)], 3.0)
    np.testing.assert_allclose(np.linalg.norm(hyperplanes.normal, axis=-1), 1.0, rtol=1e-12)
    for n in range(3):
        both = np.concatenate([points[n], points[n + 1]])
        distance = shapely.MultiPoint(both).convex_hull.distance(shapely.Polygon(piece.vertices))
        assert hyperplanes.gap[0, n] <= distance + 1e-12
        if distance > 0.02:
            assert hyperplanes.gap[0, n] >= 0.99 * distance - 3e-3
        along = hyperplanes.normal[0, n]
        np.testing.assert_allclose(hyperplanes.support[0, n], (piece.vertices @ along).max(), atol=1e-14)
        np.testing.assert_allclose((both @ along).min() - hyperplanes.support[0, n], hyperplanes.gap[0, n], atol=1e-12)


def test_the_gap_is_negative_where_no_line_separates() -> None:
    square = Obstacle.box([[0, 1], [0, 1]])
    inside = np.full((2, 3, 2), 0.4)
    through = np.array([[[-1.0, 0.5]], [[2.0, 0.5]]])
    for points in (inside, through):
        assert separate(points, [AvoidConstraint("o", (square,), 0.0, 0.0, 1.0)], 1.0).gap[0, 0] < -0.3


def test_both_ends_of_a_step_count_together() -> None:
    """Clear at both grid times, but the chord crosses the corner."""
    square = Obstacle.box([[0, 1], [0, 1]])
    points = np.array([[[-0.2, 0.7]], [[0.3, 1.1]], [[0.6, 1.4]]])
    assert (square.distance(points) > 0).all()
    gap = separate(points, [AvoidConstraint("o", (square,), 0.0, 0.0, 2.0)], 2.0).gap[0]
    assert gap[0] < 0
    assert 0.0999 < gap[1] <= 0.1 + 1e-12


def test_radius_and_window_of_what_is_avoided() -> None:
    pieces = (Obstacle.box([[0, 1], [0, 1]]), Obstacle.box([[5, 6], [0, 1]]))
    points = np.full((5, 1, 2), 3.0) * [1, 0]
    hyperplanes = separate(points, [AvoidConstraint("o", pieces, 0.25, 1.0, 2.5)], 4.0)
    np.testing.assert_array_equal(hyperplanes.active, [[False, True, True, False]] * 2)
    np.testing.assert_allclose(hyperplanes.gap[:, 1:3], 1.75, atol=1e-12)
    assert np.isinf(hyperplanes.gap[:, [0, 3]]).all()
    np.testing.assert_array_equal(hyperplanes.radius, [0.25, 0.25])


def test_nothing_to_keep_out_of() -> None:
    hyperplanes = separate(np.zeros((4, 2, 2)), [], 1.0)
    assert hyperplanes.gap.shape == (0, 3)
    assert hyperplanes.normal.shape == (0, 3, 2)


def test_many_pieces_at_once_are_what_each_is_alone() -> None:
    """With moving ones, a box of starts, and only those within reach refined."""
    rng = np.random.default_rng(3)
    pieces = [piece for piece in (random_piece(rng, 0.5) for _ in range(12)) if piece is not None]
    motion = Motion.steady([0.4, -0.2], 3.0)
    moved = [
        AvoidConstraint(
            f"o{k}",
            (Obstacle.polygon(piece.vertices + 6 * rng.normal(size=2)),),
            0.1 * k,
            0.0,
            3.0,
            motion if k % 3 == 0 else None,
        )
        for k, piece in enumerate(pieces)
    ]
    points, shift = np.cumsum(rng.normal(size=(5, 4, 2)), axis=0), np.array([0.1, 0.2])
    together = separate(points, moved, 3.0, shift, near=2.0, within=9.0)
    for k, each in enumerate(moved):
        alone = separate(points, [each], 3.0, shift, near=2.0, within=9.0)
        for name in ("normal", "support", "gap", "drift", "active"):
            np.testing.assert_array_equal(getattr(together, name)[k], getattr(alone, name)[0])
    assert np.isfinite(together.gap).any()
    assert not np.isfinite(together.gap).all()


def test_only_what_is_close_is_constrained_among_many_obstacles() -> None:
    few = load(CONFIGS / "five_obstacles.yaml")
    posts = {f"p{k}": (Obstacle.box([[k, k + 0.5], [50.0, 50.5]]),) for k in range(60)}
    many = few.with_(obstacles={**few.obstacles, **posts})
    curve = np.zeros((3, 2, 2))
    assert reach(few, curve) == 0.15 * map_size(few, curve)
    fastest = float(few.fleet.input_upper[0])
    assert reach(many, curve) == AHEAD * fastest * few.duration < 0.15 * map_size(many, curve)


def test_hyperplanes_are_looked_for_once_for_the_same_curve_and_anew_for_another() -> None:
    problem = load(CONFIGS / "five_obstacles.yaml")
    truncation, controls = coarse(problem), np.full((32, 2), 0.3)
    curve = occupied(problem, controls, truncation)
    first = all_hyperplanes(problem, truncation, curve, 1.0, controls)
    assert all_hyperplanes(problem, truncation, curve.copy(), 1.0, controls.copy()) is first
    curve += 0.5  # in place: what was found before is of the curve as it was
    again = all_hyperplanes(problem, truncation, curve, 1.0, controls)
    fresh = chance._all_hyperplanes(problem, truncation, curve, 1.0, controls)
    assert (again.gap == fresh.gap).all()
    assert (again.gap != first.gap).any()
    for others in ((problem, coarse(problem), curve, 1.0), (problem, truncation, curve, 0.5), (problem.with_(),)):
        args = (*others, *(problem, truncation, curve, 1.0)[len(others) :], controls)
        assert all_hyperplanes(*args) is not again
        again = all_hyperplanes(problem, truncation, curve, 1.0, controls)
