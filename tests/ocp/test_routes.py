"""Routes against an independent visibility graph, and on maps whose answer is known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra

import ensemble_ctrl.ocp.routes as module
from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.ocp.routes import Route, routes

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


@settings(max_examples=40, deadline=None)
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
