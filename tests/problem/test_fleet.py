"""Fleets with one parameter, several, and an uncertain start."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import Distribution, Interval, Samples
from ensemble_ctrl.ocp.truncation import choose
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.report.text import ranges_text
from ensemble_ctrl.systems import Unicycle
from tests.paths import CONFIGS


def fleet(axis: Any = "x", **parameters: tuple[float, float]) -> Fleet:
    """A fleet at (1, 2) heading 0.5 rad."""
    distributions = {name: Interval(*ends) for name, ends in parameters.items()}
    return Fleet(Unicycle(axis), distributions, np.array([1.0, 2.0]), 0.5, np.full(2, -2.0), np.full(2, 2.0))


def test_one_traction_scales_both() -> None:
    one = fleet(traction=(0.9, 1.1))
    np.testing.assert_allclose(one.coefficients(np.array([[0.9]])), [[0.9, 0.9, 0.5, 1.0, 2.0]])
    assert (one.fastest, one.slowest, one.dynamic) == ((1.1, 1.1), 0.9, (0,))


def test_each_parameter_has_its_place_in_a_drive() -> None:
    whole = fleet("y", angular_traction=(0.9, 1.1), start_heading=(-0.1, 0.1), start_x=(0.0, 0.2), start_y=(-1, 1))
    drive = whole.coefficients(np.array([[1.05, 0.1, 0.2, -1.0]]))[0]
    np.testing.assert_allclose(drive, [1.0, 1.05, np.pi / 2 - 0.5 - 0.1, 1.2, 1.0])
    assert whole.dynamic == (0, 1)
    np.testing.assert_allclose(whole.shift, [0.1, 1.0])
    np.testing.assert_allclose(whole.start_place, [1.1, 2.0])


def test_equal_robots_need_no_parameter() -> None:
    same = fleet()
    assert same.names == ()
    np.testing.assert_allclose(same.coefficients(same.corners), [[1.0, 1.0, 0.5, 1.0, 2.0]])
    assert same.grid(10).shape == (1, 0)


def test_a_grid_holds_the_corners() -> None:
    two = fleet(linear_traction=(0.9, 1.1), angular_traction=(0.8, 1.2))
    grid = {tuple(row) for row in two.grid(25)}
    assert len(grid) == 25
    assert {tuple(row) for row in two.corners} <= grid


def test_members_by_number_and_by_name() -> None:
    one, two = fleet(traction=(0.9, 1.1)), fleet(linear_traction=(0.9, 1.1), start_x=(0.0, 1.0))
    np.testing.assert_array_equal(one.members([0.9, 1.0]), [[0.9], [1.0]])
    np.testing.assert_array_equal(two.members([{"start_x": 0.5, "linear_traction": 0.9}]), [[0.9, 0.5]])
    assert two.named(np.array([0.9, 0.5])) == {"linear_traction": 0.9, "start_x": 0.5}


@pytest.mark.parametrize("given", [[], [0.9], [[0.9]], [[0.9, np.nan]], [{"start_x": 1.0}], "fast", 3, [[1, 2], [3]]])
def test_wrong_members_are_refused(given: Any) -> None:
    two = fleet(linear_traction=(0.9, 1.1), start_x=(0.0, 1.0))
    with pytest.raises(
        ProblemError, match=r"^parameters: expected finite numbers of shape \(members, 2\) or names lin"
    ):
        two.members(given)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"mass": (1, 2)}, "expected names among traction, .*, start_<state>, got 'mass'"),
        ({"traction": (1, 2), "linear_traction": (1, 2)}, "expected one of traction and linear_traction, got both"),
        ({"angular_traction": (1, 2), "traction": (1, 2)}, "expected one of angular_traction and traction, got both"),
    ],
)
def test_wrong_names_are_refused(parameters: dict[str, tuple[float, float]], message: str) -> None:
    with pytest.raises(ProblemError, match=f"^fleet.parameters: {message}"):
        fleet(**parameters)


def test_parameters_are_a_mapping() -> None:
    with pytest.raises(
        ProblemError, match=r"^fleet.parameters: expected a mapping of names, each to a distribution such as"
    ):
        Fleet(Unicycle(), Interval(1, 2), np.zeros(2), 0.0, np.zeros(2), np.ones(2))  # type: ignore[arg-type]


def test_samples_are_the_same_for_a_seed_and_differ_between_parameters() -> None:
    two = fleet(linear_traction=(0.0, 1.0), angular_traction=(0.0, 1.0))
    drawn = two.sample(100, 3)
    np.testing.assert_array_equal(drawn, two.sample(100, 3))
    assert abs(float(np.corrcoef(drawn[:, 0], drawn[:, 1]).ravel()[1])) < 0.3
    np.testing.assert_array_equal(drawn[:, 0], fleet(traction=(0.0, 1.0)).sample(100, 3)[:, 0])


def test_public_names() -> None:
    assert ec.Fleet is Fleet
    assert ec.Bicycle.name == "bicycle"


def measured(robots: int = 40) -> tuple[Fleet, NDArray[np.float64]]:
    """A fleet of measured robots whose two tractions belong together, with a third parameter of its own."""
    values = 1.0 + np.random.default_rng(5).normal(size=(robots, 2)) @ np.array([[0.02, 0.018], [0.0, 0.004]])
    samples = {"linear_traction": values[:, 0], "angular_traction": values[:, 1]}
    distributions: dict[str, Distribution] = {name: Samples(column) for name, column in samples.items()}
    distributions["start_heading"] = Interval(-0.1, 0.1)
    return Fleet(
        Unicycle(), distributions, np.zeros(2), 0.0, np.full(2, -2.0), np.full(2, 2.0), samples=samples
    ), values


def test_joint_samples_are_integrated_robot_by_robot() -> None:
    fleet, values = measured()
    scaled, weights = fleet.rule(3)
    members = fleet.dynamic_members(scaled)
    assert weights.sum() == pytest.approx(2.0)
    assert len(members) == 40 * 3
    product = weights @ (members[:, 0] * members[:, 1] * members[:, 2] ** 2) / 2
    assert product == pytest.approx((values[:, 0] * values[:, 1]).mean() * 0.1**2 / 3, rel=1e-9)


def test_draws_from_joint_samples_are_its_robots() -> None:
    fleet, values = measured()
    drawn = {tuple(row) for row in fleet.sample(500, 1)[:, :2].tolist()}
    assert drawn <= {tuple(row) for row in values.tolist()}
    assert len(drawn) > 35


def test_means_and_squares_of_a_truncation_are_over_the_joint_samples() -> None:
    fleet, _ = measured()
    problem = five_with(fleet)
    truncation = choose(problem, np.tile([[0.5, 0.1]], (32, 1)))
    curve = np.random.default_rng(0).normal(size=truncation.count)
    scaled, weights = fleet.rule(12)
    states = truncation.evaluation(scaled) @ curve
    assert truncation.mean @ curve == pytest.approx(weights @ states / 2, abs=1e-9)
    assert curve @ truncation.square @ curve == pytest.approx(weights @ states**2, rel=1e-6)


def five_with(fleet: Fleet) -> ec.Problem:
    """A map for a fleet."""
    problem = ec.load(CONFIGS / "five_obstacles.yaml")
    return problem.with_(fleet=fleet, order=None)


def test_a_wrong_sample_is_refused() -> None:
    fleet, values = measured()
    for samples, message in (
        ({"linear_traction": values[:, 0], "angular_traction": values[:5, 1]}, "expected columns of one length"),
        (
            {"mass": values[:, 0]},
            r"expected .* bend trajectories \(linear_traction, angular_traction, start_heading\), got 'mass'",
        ),
        ({"linear_traction": values[:, 1]}, "expected the distribution of linear_traction to be its samples"),
    ):
        with pytest.raises(ProblemError, match=f"^fleet.samples: {message}"):
            replace(fleet, samples=samples)
    with pytest.raises(ProblemError, match=r"fleet\.parameters has none"):
        ec.Fleet(ec.DoubleIntegrator(), {}, samples={"mass": values[:, 0]})


def test_a_field_that_there_is_not_is_named() -> None:
    fleet = ec.load(CONFIGS / "five_obstacles.yaml").fleet
    with pytest.raises(ProblemError, match=r"^fleet.with_: expected names among system, .*, got 'wrong'$"):
        fleet.with_(wrong=1)
    assert fleet.with_(position=[1.0, 2.0], heading=0.5).heading == 0.5


def test_ranges_of_the_heading_are_printed_in_degrees() -> None:
    fleet = ec.load(CONFIGS / "five_obstacles.yaml").fleet
    turned = fleet.with_(parameters={"start_heading": Interval(-np.radians(10), np.radians(10))})
    assert ranges_text(turned) == "start_heading -10 to 10 deg"
