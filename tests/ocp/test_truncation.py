"""How good the truncated curve is: the numbers of the method, and what the points stand for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from ensemble_ctrl.moments import Interval, LegendreBasis, nodes_to_moments
from ensemble_ctrl.ocp.truncation import (
    TAIL_TOLERANCE,
    Truncation,
    choose,
    points,
    positions,
    raised,
    tail,
)

from .problems import FLEET, five, planned

TABLE = {1: 4.5e-2, 2: 6.5e-4, 3: 2.0e-5, 4: 2.5e-7, 6: 3.9e-11}
"""The method's truncation errors in metres, of another plan around the same obstacles."""


@pytest.mark.parametrize("hull", [True, False])
@pytest.mark.parametrize("order", TABLE)
def test_the_error_of_a_real_plan_is_near_the_methods_table(order: int, hull: bool) -> None:
    error = tail(five(), planned().controls, Truncation((order,), (order,), hull))
    assert TABLE[order] / 3 < error < 3 * TABLE[order]


def test_order_eight_is_exact_to_rounding() -> None:
    assert tail(five(), planned().controls, Truncation((8,), (8,), True)) < 1e-12
    assert tail(five(), planned().controls, Truncation((8,), (8,), False)) < 1e-12


@pytest.mark.parametrize("hull", [True, False])
@pytest.mark.parametrize(
    ("low", "high", "least"),
    [(0.9, 1.1, 2), (0.95, 1.05, 2), (0.8, 1.2, 3), (0.7, 1.3, 4), (0.6, 1.4, 5), (1.0, 1.0, 1)],
)
def test_the_chosen_order_is_the_first_that_is_good_enough(low: float, high: float, least: int, hull: bool) -> None:
    problem = five(
        None, replace(FLEET, parameters={"traction": Interval(low, high)}), guarantee="hull" if hull else "nodes"
    )
    chosen, controls = choose(problem, planned().controls), planned().controls
    assert chosen.hull is hull
    assert chosen.degrees == chosen.orders >= (least,)
    assert tail(problem, controls, chosen) < TAIL_TOLERANCE
    if chosen.orders > (1,):
        before = Truncation((chosen.orders[0] - 1,), (chosen.orders[0] - 1,), hull)
        assert tail(problem, controls, before) >= TAIL_TOLERANCE


def test_an_order_that_is_asked_for_is_kept() -> None:
    controls = planned().controls
    hull, nodes = choose(five(8), controls), choose(five(8, guarantee="nodes"), controls)
    assert (hull.orders, hull.hull) == ((8,), True)
    assert hull.degrees < (8,)
    assert tail(five(8), controls, hull) < 1.1 * TAIL_TOLERANCE
    assert (nodes.orders, nodes.degrees, nodes.hull) == ((8,), (8,), False)
    low = choose(five(1), controls)
    assert (low.orders, low.degrees) == ((1,), (1,))


def test_raised_carries_one_more_moment() -> None:
    cases = {(8, 3, True): (8, 4), (3, 3, True): (4, 4), (3, 3, False): (4, 4), (50, 50, True): (50, 50)}
    for (order, degree, hull), wanted in cases.items():
        more = raised(Truncation((order,), (degree,), hull))
        assert (more.orders[0], more.degrees[0], more.hull) == (*wanted, hull)


@pytest.mark.parametrize(
    "truncation", [Truncation((1,), (1,), True), Truncation((2,), (2,), True), Truncation((8,), (3,), True)]
)
def test_members_are_in_the_hull_of_the_points_up_to_the_tail(truncation: Truncation) -> None:
    problem, controls = five(), planned().controls
    parameters = np.linspace(0.9, 1.1, 33)[:, None]
    exact, curve = positions(problem, controls, parameters), points(problem, controls, truncation)
    error = tail(problem, controls, truncation)
    furthest = max(
        shapely.distance(shapely.MultiPoint(curve[n]).convex_hull, shapely.points(exact[:, n])).max()
        for n in range(0, 161, 8)
    )
    assert furthest <= 1.02 * error
    if truncation.orders == (1,):
        assert furthest > 0.1 * error, "the hull of order 1 is a segment: members do leave it"


def test_the_points_of_the_nodes_are_members() -> None:
    problem, controls, truncation = five(), planned().controls, Truncation((4,), (4,), False)
    exact = positions(problem, controls, problem.fleet.dynamic_members(truncation.nodes))
    np.testing.assert_allclose(points(problem, controls, truncation), exact.transpose(1, 0, 2), atol=1e-15)


@pytest.mark.parametrize("hull", [True, False])
@pytest.mark.parametrize("order", [1, 3, 8, 16])
def test_points_and_moments_are_two_forms_of_one_curve(order: int, hull: bool) -> None:
    truncation = Truncation((order,), (order,), hull)
    moments = truncation.to_moments @ truncation.to_points
    np.testing.assert_allclose(moments, nodes_to_moments(LegendreBasis(order)), atol=1e-11)
    at_nodes = truncation.evaluation(truncation.nodes) @ truncation.to_points
    np.testing.assert_allclose(at_nodes, np.eye(order + 1), atol=1e-11)


def test_fewer_carried_moments_are_the_lowest_ones() -> None:
    truncation = Truncation((8,), (3,), True)
    assert truncation.count == 4
    lowest = nodes_to_moments(LegendreBasis(8))[:4]
    np.testing.assert_allclose(truncation.to_moments @ truncation.to_points, lowest, atol=1e-13)


@pytest.mark.parametrize("degrees", [(3,), (2, 1)])
@pytest.mark.parametrize("cells", [2, 5])
def test_members_of_a_cell_are_in_the_hull_of_its_points(degrees: tuple[int, ...], cells: int) -> None:
    rng = np.random.default_rng(cells)
    truncation = Truncation(degrees, degrees, True, cells=cells)
    curve = rng.normal(size=(truncation.count, 2))
    assert len(truncation.parts) == cells
    for c, part in enumerate(truncation.parts):
        s = rng.uniform(-1, 1, (200, len(degrees)))
        s[:, 0] = -1 + 2 * (c + (s[:, 0] + 1) / 2) / cells
        members, own = truncation.evaluation(s) @ curve, part @ curve
        for angle in np.linspace(0, 2 * np.pi, 16):
            normal = np.array([np.cos(angle), np.sin(angle)])
            assert (members @ normal).max() <= (own @ normal).max() + 1e-12
        assert np.ptp(own, axis=0).max() < np.ptp(curve, axis=0).max()


def test_cells_of_nodes_share_them_out() -> None:
    truncation = Truncation((4,), (4,), False, cells=2)
    assert [part.shape for part in truncation.parts] == [(3, 5), (3, 5)]  # the middle node is in both
    assert sum(part.sum(axis=0) for part in truncation.parts).tolist() == [1, 1, 2, 1, 1]
