"""Routes against an independent visibility graph, and on maps whose answer is known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra

import ensemble_ctrl.ocp.guesses.routes as module
from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.ocp.guesses.routes import LONGEST, Route, is_simple, routes, swept
from tests.examples import examples

Floats = NDArray[np.float64]
START, GOAL, CLEARANCE = np.array([-4.0, 0.1]), np.array([4.0, -0.2]), 0.1
RING = [[[-1, 1], [1, 1.2]], [[-1, 1], [-1.2, -1]], [[-1.2, -1], [-1.2, 1.2]], [[1, 1.2], [-1.2, 1.2]]]


def random_boxes(seed: int, count: int) -> list[Obstacle]:
    """Rectangles between start and goal; they may overlap."""
    rng = np.random.default_rng(seed)
    low = rng.uniform([-3, -2], [2, 1.5], (count, 2))
    high = low + rng.uniform(0.2, 1.0, (count, 2))
    return [Obstacle.box(np.stack([a, b], axis=1)) for a, b in zip(low, high, strict=True)]


def grown(piece: Obstacle, by: float) -> shapely.Polygon:
    """The rectangle with every side moved outwards."""
    return shapely.Polygon(piece.vertices).buffer(by, join_style="mitre")


def shortest(pieces: Sequence[Obstacle]) -> float:
    """Length of the shortest way by shapely's visibility test and SciPy's search, infinite if there is none."""
    nodes = [START, GOAL]
    for piece in pieces:
        nodes.extend(np.array(grown(piece, 1.001 * CLEARANCE).exterior.coords)[:-1])
    blocked = shapely.union_all([grown(piece, 0.9 * CLEARANCE) for piece in pieces]).buffer(-1e-9)
    taken = shapely.union_all([shapely.Polygon(piece.vertices).buffer(0.99 * CLEARANCE) for piece in pieces])
    kept = [n for i, n in enumerate(nodes) if i < 2 or not taken.contains(shapely.Point(n))]
    lengths = np.zeros((len(kept), len(kept)))
    for i, a in enumerate(kept):
        for j, b in enumerate(kept[:i]):
            if not shapely.LineString([a, b]).intersects(blocked):
                lengths[i, j] = np.linalg.norm(a - b)
    return float(dijkstra(lengths, directed=False)[0, 1])


@examples(40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 5))
def test_the_first_route_is_the_shortest_and_the_others_are_of_other_kinds(seed: int, count: int) -> None:
    pieces = random_boxes(seed, count)
    found = routes(START, GOAL, pieces, CLEARANCE, 3)
    assert found[0].length == pytest.approx(shortest(pieces), rel=1e-6)
    assert [r.length for r in found] == sorted(r.length for r in found)
    assert len({r.word for r in found}) == len(found) >= 2
    for route in found:
        check(route, pieces)


def check(route: Route, pieces: Sequence[Obstacle]) -> None:
    """A route leads from start to goal, is as long as it says, and keeps most of its clearance."""
    np.testing.assert_array_equal(route.corners[[0, -1]], [START, GOAL])
    steps = np.linalg.norm(np.diff(route.corners, axis=0), axis=1)
    assert route.length == pytest.approx(steps.sum(), rel=1e-12)
    line = shapely.LineString(route.corners)
    for piece in pieces:
        assert line.distance(shapely.Polygon(piece.vertices)) >= 0.9 * CLEARANCE - 1e-6


@examples(30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12), st.floats(0.01, 0.5))
def test_shadows_hide_only_what_is_hit(seed: int, count: int, clearance: float) -> None:
    pieces = random_boxes(seed, count)
    corners = np.array([START, GOAL, *module._corners(pieces, clearance)])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "MANY", 0)
        hidden = module._shadowed(corners, pieces, 0.9 * clearance)
        found = module._visible_lengths(corners, pieces, clearance)
        patch.setattr(module, "MANY", count + 1)
        without = module._visible_lengths(corners, pieces, clearance)
    assert hidden.any()
    assert not hidden.diagonal().any()
    assert (found == without).all()
    # shapely: what is hidden meets the inside of a grown piece
    inside = shapely.union_all([grown(piece, 0.9 * clearance) for piece in pieces]).buffer(-1e-9)
    for i, j in np.argwhere(hidden).tolist():
        assert shapely.LineString(corners[[i, j]]).intersects(inside)


def test_a_square_is_passed_on_both_sides() -> None:
    start, goal = np.array([-2.0, 0.0]), np.array([2.0, 0.0])
    below, above = routes(start, goal, [Obstacle.box([[-1, 1], [-1, 2]])], 0.1, 2)
    out = 1 + 1.001 * 0.1
    assert below.length == pytest.approx(2 * out + 2 * np.hypot(2 - out, out), rel=1e-12)
    assert above.length == pytest.approx(2 * out + 2 * np.hypot(2 - out, out + 1), rel=1e-12)
    assert below.corners[:, 1].min() == pytest.approx(-out)
    assert below.word == ()
    assert above.word == (1,)


def test_the_way_back_has_the_opposite_word() -> None:
    start, goal, square = np.array([-2.0, 0.0]), np.array([2.0, 0.0]), Obstacle.box([[-1, 1], [-1, 2]])
    assert {r.word for r in routes(goal, start, [square], 0.1, 2)} == {(), (-1,)}


def test_an_open_map_has_one_straight_route() -> None:
    (only,) = routes(START, GOAL, [], CLEARANCE, 3)
    np.testing.assert_array_equal(only.corners, [START, GOAL])
    assert only.word == ()


@pytest.mark.parametrize("enclosed", [np.array([-4.0, 0.1]), np.array([4.0, -0.2])])
def test_an_enclosed_start_or_goal_has_no_route_and_is_not_searched_for_one(
    enclosed: Floats, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A search over words would go round the other obstacles for half a minute before it gave up."""

    def searched(*_: object) -> Iterator[Route]:
        raise AssertionError("searched for a route where there is none")

    monkeypatch.setattr(module, "_search", searched)
    walls = [Obstacle.box(np.array(box) + enclosed[:, None]) for box in RING]
    assert routes(START, GOAL, [*walls, *random_boxes(0, 4)], CLEARANCE, 2) == []


def test_a_gap_is_used_only_if_the_clearance_fits() -> None:
    wall = [Obstacle.box([[-0.2, 0.2], [0.2, 3]]), Obstacle.box([[-0.2, 0.2], [-3, -0.2]])]
    through, around = (routes(START, GOAL, wall, clearance, 1)[0] for clearance in (0.15, 0.3))
    assert np.abs(through.corners[:, 1]).max() < 0.3
    assert np.abs(around.corners[:, 1]).max() > 3


def row(count: int) -> list[Obstacle]:
    """Disjoint squares one behind the other between start and goal."""
    left = np.linspace(-3, 2.4, count)
    return [Obstacle.box([[x, x + 0.5], [-0.3, 0.25]]) for x in left.tolist()]


@pytest.mark.parametrize("count", range(6))
def test_a_row_of_obstacles_is_passed_in_every_way(count: int) -> None:
    """By brute force: above or below each of them, with one letter for each that is passed above."""
    found = routes(START, GOAL, row(count), CLEARANCE, 1000, loops=False)
    every = {tuple(i + 1 for i in range(count) if choice >> i & 1) for choice in range(2**count)}
    assert {route.word for route in found} == every
    assert len(found) == 2**count
    assert [route.length for route in found] == sorted(route.length for route in found)


@examples(15)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_routes_without_loops_are_among_those_with_them(seed: int, count: int) -> None:
    """Every kind is found that a search over all kinds finds, if its shortest route is simple by shapely's word."""
    pieces = random_boxes(seed, count)
    plain = {r.word for r in routes(START, GOAL, pieces, CLEARANCE, 1000, loops=False)}
    with_loops = routes(START, GOAL, pieces, CLEARANCE, 40)
    for route in routes(START, GOAL, pieces, CLEARANCE, 1000, loops=False):
        check(route, pieces)
        assert shapely.LineString(route.corners).is_simple
        assert route.length <= LONGEST * with_loops[0].length + 1e-6
    for route in with_loops:
        turns = [winding(route.corners, piece.vertices.mean(axis=0)) for piece in pieces]
        if route.word not in plain and route.length < LONGEST * with_loops[0].length:
            assert max(map(abs, turns)) >= 2 * np.pi or not shapely.LineString(route.corners).is_simple


def winding(path: Floats, point: Floats) -> float:
    """Largest angle swept round a point between any two places of a path, by fine steps."""
    fine = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(path)])
    angle = np.unwrap(np.arctan2(*(fine - point).T[::-1]))
    return float(np.ptp(angle))


def test_angles_swept() -> None:
    square = np.array([[1.0, -1.0], [1, 1], [-1, 1], [-1, -1]])
    np.testing.assert_allclose(np.degrees(swept(square, np.zeros((1, 2)))[:, 0]), [0, 90, 180, 270])
    np.testing.assert_allclose(np.degrees(swept(square[::-1], np.zeros((1, 2)))[-1]), -270)
    np.testing.assert_allclose(np.degrees(swept(square, np.array([[9.0, 0.0]]))[-1]), 0, atol=15)


def test_what_is_simple() -> None:
    anchor = np.array([[0.0, 0.0]])
    spiral = np.array([[0.5, 0], [0, 1], [-1, 0], [0, -1], [2, 0]])
    assert is_simple(spiral[:-1], anchor)
    assert not is_simple(spiral, anchor), "once round"
    assert is_simple(spiral, np.array([[0.0, 3.0]]))
    crossing = np.array([[0.0, 0], [2, 0], [2, 1], [1, 1], [1, -1]])
    assert is_simple(crossing[:-1], np.zeros((0, 2)))
    assert not is_simple(crossing, np.zeros((0, 2)))
