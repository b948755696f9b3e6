import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from ensemble_ctrl.constraints import Obstacle, convex_pieces
from ensemble_ctrl.constraints.cover import with_fewer_corners
from ensemble_ctrl.constraints.exact import corner_turns
from ensemble_ctrl.constraints.polygon import is_convex, ring
from ensemble_ctrl.core.errors import ProblemError


@given(st.integers(0, 10_000), st.integers(3, 25))
def test_pieces_cover_the_polygon_once(seed: int, corners: int) -> None:
    rng = np.random.default_rng(seed)
    angle = (np.arange(corners) + rng.uniform(0, 0.8, corners)) * 2 * np.pi / corners
    star = (rng.uniform(0.3, 2, corners) * np.array([np.cos(angle), np.sin(angle)])).T
    if not shapely.Polygon(star).is_valid:
        return
    pieces = convex_pieces(star[::-1] if seed % 2 else star)
    shapes = [shapely.Polygon(piece) for piece in pieces]
    area = shapely.Polygon(star).area
    assert sum(shape.area for shape in shapes) == pytest.approx(area, abs=1e-9)
    assert shapely.unary_union(shapes).symmetric_difference(shapely.Polygon(star)).area < 1e-9
    reflex = int((corner_turns(ring(star, "star")) < 0).sum())
    assert reflex / 2 + 1 <= len(pieces) <= 2 * reflex + 1
    for piece in pieces:
        Obstacle.polygon(piece)


def test_a_star_of_many_corners_is_cut_in_no_time() -> None:
    """All pairs of its triangles round one corner would be millions of hulls."""
    angle = np.arange(3000) * 2 * np.pi / 3000
    star = (np.where(np.arange(3000) % 2, 1.0, 0.6) * np.array([np.cos(angle), np.sin(angle)])).T
    assert len(convex_pieces(star)) == 1501


def comb(teeth: int) -> list[list[float]]:
    upper = [[x, y] for i in range(teeth) for x, y in ((2 * i, 2.0), (2 * i, 1.0), (2 * i + 1, 1.0), (2 * i + 1, 2.0))]
    return [[-1.0, 2.0], [-1.0, 0.0], [2 * teeth, 0.0], [2 * teeth, 2.0], *upper[::-1]]


@pytest.mark.parametrize(
    ("corners", "count"),
    [
        ([[0, 0], [1, 0], [1, 1], [0, 1]], 1),
        ([[0, 0], [1, 0], [2, 0], [2, 1], [0, 1], [0, 0]], 1),
        ([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], 2),
        ([[0, 0], [3, 0], [3, 1], [2, 1], [2, 2], [1, 2], [1, 1], [0, 1]], None),
        (comb(6), None),
    ],
)
def test_pieces_of_known_shapes(corners: list[list[float]], count: int | None) -> None:
    pieces = convex_pieces(corners)
    assert count is None or len(pieces) == count
    assert all(is_convex(piece) for piece in pieces)
    assert sum(shapely.Polygon(p).area for p in pieces) == pytest.approx(shapely.Polygon(corners).area)


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        ([[0, 0], [2, 2], [2, 0], [0, 1]], "cross itself"),
        ([[0, 0], [4, 0], [4, 4], [2, 0], [0, 4]], "cross itself"),
        ([[0, 0], [2, 0], [1, 0]], "area"),
        ([[0, 0], [2, 0], [3, 0], [2, 0], [2, 2]], "cross itself"),
        ([[0, 0], [1, 0], [np.inf, 1]], "finite"),
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0]], "shape"),
    ],
)
def test_degenerate_polygons_are_refused(corners: list[list[float]], message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        convex_pieces(corners)


def test_a_pentagram_turns_one_way_and_still_crosses_itself() -> None:
    angles = 2 * np.pi * np.arange(5) / 5
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    assert Obstacle.polygon(ring).distance([0.0, 0.0]) < 0
    with pytest.raises(ProblemError, match="does not cross itself"):
        Obstacle.polygon(ring[[0, 2, 4, 1, 3]])


def test_sides_between_opposite_ones_have_no_tip() -> None:
    """A flat end between two parallel sides; it takes no division by zero to find that."""
    flat = np.array([(0.0, 0.0), (1.0, 0.0), (1.3, 0.2), (1.4, 0.5), (1.3, 0.8), (1.0, 1.0), (0.0, 1.0)])
    with np.errstate(all="raise"):
        few = with_fewer_corners(flat, shapely.box(-1, -1, 3, 3), 4)
    assert len(few) < len(flat)
    assert shapely.Polygon(few).buffer(1e-9).covers(shapely.Polygon(flat))
