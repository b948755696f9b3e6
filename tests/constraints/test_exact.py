"""Obstacles may only grow and regions only shrink on the way in; rational arithmetic is the judge."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog

from ensemble_ctrl.constraints import Obstacle, Polyhedron, convex_cover, convex_pieces
from ensemble_ctrl.constraints.cells import Cells
from ensemble_ctrl.constraints.exact import hull, intersection, space_corners
from ensemble_ctrl.core.errors import ProblemError
from tests.examples import examples

Array = NDArray[np.float64]
Point = tuple[Fraction, Fraction]


def rational(points: Array) -> list[Point]:
    return [(Fraction(x), Fraction(y)) for x, y in points.tolist()]


def cross(a: Point, b: Point, c: Point) -> Fraction:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def inside(point: Point, corners: list[Point]) -> bool:
    """Whether a point is in a convex counter-clockwise polygon."""
    return all(cross(a, b, point) >= 0 for a, b in pairwise([*corners, corners[0]]))


def area(corners: list[Point]) -> Fraction:
    return sum((a[0] * b[1] - a[1] * b[0] for a, b in pairwise([*corners, corners[0]])), Fraction(0)) / 2


def satisfies(point: Point, A: Array, b: Array) -> bool:
    return all(
        Fraction(r) * point[0] + Fraction(s) * point[1] >= Fraction(t) for (r, s), t in zip(A.tolist(), b, strict=True)
    )


SIZES = st.sampled_from([1e-6, 1e-3, 0.045, 1.0, 300.0])
PLACES = st.sampled_from([(0.0, 0.0), (0.1, -3.7), (431_234.5, 5_000_000.3), (-1e7, 1e7), (1e-7, 1e7)])


@st.composite
def convex(draw: st.DrawFn) -> Array:
    """Corners on an ellipse that may be a sliver, turned, of any size, near or far; some doubled, some straight."""
    count = draw(st.integers(3, 24))
    angles = np.sort(draw(st.lists(st.floats(0, 6.28), min_size=count, max_size=count)))
    thin, turn, size = draw(st.sampled_from([1.0, 0.1, 1e-4, 1e-7])), draw(st.floats(0, 7)), draw(SIZES)
    points = np.column_stack([np.cos(angles), thin * np.sin(angles)])
    if draw(st.booleans()):  # middles of the sides: straight, or a little to either side
        points = np.stack([points, (points + np.roll(points, -1, axis=0)) / 2], axis=1).reshape(-1, 2)
    if draw(st.booleans()):
        points = np.repeat(points, 2, axis=0)
    c, s = np.cos(turn), np.sin(turn)
    return np.asarray(size * points @ np.array([[c, s], [-s, c]]) + np.array(draw(PLACES)))


def made(kind, corners: Array):  # type: ignore[no-untyped-def]
    """A polygon, where the corners make one."""
    try:
        return kind.polygon(corners)
    except ProblemError:
        assume(False)


@examples(40)
@given(convex())
def test_an_obstacle_holds_every_corner_that_was_given(corners: Array) -> None:
    obstacle = made(Obstacle, corners)
    stored = rational(obstacle.vertices)
    for point in rational(corners):
        assert inside(point, stored)
        assert satisfies(point, obstacle.A, obstacle.b)
    assert {tuple(corner) for corner in obstacle.vertices.tolist()} <= {tuple(corner) for corner in corners.tolist()}


@examples(40)
@given(convex())
def test_a_region_has_no_point_that_was_not_given(corners: Array) -> None:
    region = made(Polyhedron, corners)
    assert region.is_bounded
    around = hull(corners)
    limits = rational(around)
    rows = [(Fraction(a), Fraction(b), Fraction(c)) for (a, b), c in zip(region.A.tolist(), region.lower, strict=True)]
    for i, (a, b, c) in enumerate(rows):  # every corner of the stored set, exactly
        for d, e, f in rows[i + 1 :]:
            w = a * e - b * d
            point = ((c * e - b * f) / w, (a * f - c * d) / w) if w else None
            if point and all(r * point[0] + s * point[1] >= t for r, s, t in rows):
                assert inside(point, limits)


@examples(40)
@given(convex(), st.floats(0, 3), st.floats(0, 3))
def test_a_grown_obstacle_holds_every_shifted_corner(corners: Array, right: float, up: float) -> None:
    stored = rational(made(Obstacle, corners).widened(np.array([right, up])).vertices)
    for x, y in rational(corners):
        for dx in (right, -right):
            for dy in (up, -up):
                assert inside((x + Fraction(dx), y + Fraction(dy)), stored)


@examples(40)
@given(st.integers(0, 10_000), SIZES, PLACES)
def test_pieces_of_a_polygon_lose_nothing_of_it(seed: int, size: float, place: tuple[float, float]) -> None:
    """The pieces are made of the polygon's own corners, so equal areas without an overlap make a cover."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 20))
    angle = (np.arange(count) + rng.uniform(0, 0.8, count)) * 2 * np.pi / count
    star = size * (rng.uniform(0.3, 2, count) * np.array([np.cos(angle), np.sin(angle)])).T + np.array(place)
    try:
        pieces = convex_pieces(star)
    except ProblemError:
        assume(False)
    whole = rational(star)
    assert sum((area(rational(piece)) for piece in pieces), Fraction(0)) >= abs(area(whole))
    for piece in pieces:
        assert {tuple(corner) for corner in piece.tolist()} <= {tuple(corner) for corner in star.tolist()}
    stored = [rational(Obstacle.polygon(piece).vertices) for piece in pieces]
    for a, b in pairwise([*whole, whole[0]]):
        for share in (Fraction(0), Fraction(1, 3), Fraction(1, 2)):
            point = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
            assert any(inside(point, corners) for corners in stored)


@examples(40)
@given(st.integers(0, 10_000), SIZES, PLACES)
def test_a_cover_loses_nothing_of_its_polygon(seed: int, size: float, place: tuple[float, float]) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(9, 40))
    angle = (np.arange(count) + rng.uniform(0, 0.8, count)) * 2 * np.pi / count
    star = size * (rng.uniform(1.6, 2, count) * np.array([np.cos(angle), np.sin(angle)])).T + np.array(place)
    try:
        stored = [rational(Obstacle.polygon(piece).vertices) for piece in convex_cover(star, [], 0.3 * size)]
    except ProblemError:
        assume(False)
    for a, b in pairwise(rational(np.vstack([star, star[:1]]))):
        for share in (Fraction(0), Fraction(1, 3), Fraction(1, 2)):
            point = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
            assert any(inside(point, corners) for corners in stored)


@examples(40)
@given(convex(), st.integers(0, 10_000))
def test_the_corners_of_rows_are_exact_ones_rounded(corners: Array, seed: int) -> None:
    rows = made(Obstacle, corners)
    order = np.random.default_rng(seed).permutation(len(rows.b))
    found, bounded = intersection(-rows.A[order], -rows.b[order])
    assert bounded
    again = Obstacle(rows.A[order], rows.b[order])
    step = np.spacing(np.abs(corners).max())
    for x, y in rational(corners):  # each is inside, but for the rounding of the stored corners
        about = [(x + Fraction(step) * i, y + Fraction(step) * j) for i in (-1, 1) for j in (-1, 1)]
        assert all(
            any(cross(a, b, point) >= 0 for point in about)
            for a, b in pairwise([*rational(again.vertices), rational(again.vertices)[0]])
        )
    assert len(found) >= 3


@pytest.mark.parametrize(
    ("rows", "count", "bounded"),
    [
        ([(1, 0, 1), (-1, 0, 0), (0, 1, 1), (0, -1, 0)], 4, True),
        ([(1, 0, 1), (-1, 0, -1), (0, 1, 1), (0, -1, 0)], 2, True),
        ([(1, 0, 1), (-1, 0, -1), (0, 1, 1), (0, -1, -1)], 1, True),
        ([(1, 0, 1), (-1, 0, -1 - 1e-15), (0, 1, 1), (0, -1, 0)], 0, True),
        ([(1, 0, 1), (0, 1, 1), (-1, -1, 0), (1, 0, 5), (1, 1, 2)], 3, True),
        ([(1, 0, 1), (0, 1, 1)], 4, False),
        ([(1, 0, 1e7 + 1e-8), (-1, 0, -1e7), (0, 1, 1), (0, -1, 0)], 4, True),
    ],
)
def test_corners_of_known_sets(rows: list[tuple[float, float, float]], count: int, bounded: bool) -> None:
    table = np.array(rows, dtype=float)
    corners, closed = intersection(table[:, :2], table[:, 2])
    assert (len(corners), closed) == (count, bounded)


def regular(count: int, radius: float, centre: tuple[float, float]) -> Array:
    angles = 2 * np.pi * np.arange(count) / count
    return np.array(centre) + radius * np.column_stack([np.cos(angles), np.sin(angles)])


@pytest.mark.parametrize(
    ("corners", "point", "distance"),
    [
        (regular(6, 0.05, (5e6, 0.0)), (5e6, 0.25), 0.25 - 0.05 * np.sqrt(3) / 2),
        (regular(24, 0.045, (0.0, 5e6)), (0.045, 5e6), 0.0),
        (regular(24, 0.1, (1e7, 1e7)), (1e7, 1e7), -0.1 * np.cos(np.pi / 24)),
        (regular(10_000, 1.0, (0.0, 0.0)), (0.0, 0.0), -np.cos(np.pi / 10_000)),
    ],
)
def test_a_polygon_far_away_is_as_large_as_near(corners: Array, point: tuple[float, float], distance: float) -> None:
    obstacle = Obstacle.polygon(corners)
    assert len(obstacle.vertices) == len(corners)
    assert float(obstacle.distance(point)) == pytest.approx(distance, abs=1e-7)
    assert float(obstacle.distance(point)) <= distance + 2e-8


@pytest.mark.parametrize("far", [1e300, -1e9, np.inf, np.nan])
def test_coordinates_beyond_any_map_are_refused(far: float) -> None:
    corners: list[list[float]] = [[0, 0], [1, 0], [1, far]]
    for make in (
        lambda: Obstacle.polygon(corners),
        lambda: Polyhedron.polygon(corners),
        lambda: convex_pieces([*corners, [0.5, 0.5]]),
    ):
        with pytest.raises(ProblemError, match="finite numbers of at most 1e"):
            make()


@pytest.mark.parametrize(
    ("size", "origin", "yaw"),
    [(0.05, (-10.35, 2.1), 0.0), (1 / 3, (0.0, 0.0), 0.0), (0.05, (1.0, 2.0), 0.3), (0.05, (5e6, 4e5), 0.3)],
)
def test_a_grid_loses_nothing_of_its_cells(size: float, origin: tuple[float, float], yaw: float) -> None:
    """Corners are computed in floats: twice their rounding is allowed, and no nanometre."""
    mask = np.zeros((9, 9), dtype=bool)
    mask[3, 2:6] = mask[4:7, 4] = True
    stored = [rational(Obstacle.polygon(piece).vertices) for piece in Cells(mask, size, origin, yaw).pieces(0.0)]
    c, s = Fraction(np.cos(yaw)), Fraction(np.sin(yaw))
    noise = Fraction(8 * np.spacing(max(map(abs, (*origin, 9 * size)))))
    for row, column in np.argwhere(mask).tolist():
        for u, v in ((column, row), (column + 1, row), (column, row + 1), (column + 1, row + 1)):
            x, y = (
                Fraction(o) + Fraction(size) * d for o, d in zip(origin, (c * u - s * v, s * u + c * v), strict=True)
            )
            about = [(x + i * noise, y + j * noise) for i in (-1, 1) for j in (-1, 1)]
            assert any(
                all(any(cross(a, b, point) >= 0 for point in about) for a, b in pairwise([*corners, corners[0]]))
                for corners in stored
            )


@given(st.data())
def test_no_corner_of_a_solid_is_missing(data: st.DataObject) -> None:
    """For cuts of a box by random planes, near-parallel and near-equal ones among them, all corners are found: the
    largest value of any direction over them is that of a linear program.
    """
    far = data.draw(st.sampled_from([0.0, 1e3, 1e6]))
    count = data.draw(st.integers(0, 4))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    normals = rng.normal(size=(count, 3)) * np.where(rng.random((count, 3)) < 0.3, 1e-9, 1.0) + 1e-12
    A = np.vstack([np.eye(3), -np.eye(3), normals])
    b = np.concatenate([np.full(3, far + 1.0), np.full(3, 1.0 - far), normals @ np.full(3, far) + rng.random(count)])
    corners = space_corners(A, b)
    assert len(corners) >= 4
    for direction in rng.normal(size=(3, 3)).tolist():
        best = linprog(-np.array(direction), A, b - A @ np.full(3, far), bounds=[(None, None)] * 3)
        assert best.fun is not None
        ours = float(((corners - far) @ np.array(direction)).max())
        assert ours == pytest.approx(-best.fun, rel=1e-7, abs=1e-7 + 1e-14 * far)
