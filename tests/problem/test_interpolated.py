"""Positions by interpolation in the angular factor, against arcs in 40 digits and against all positions."""

from __future__ import annotations

from typing import Any, Literal

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem.evaluation.chebyshev import coefficients, interpolation_error, points, polynomials
from ensemble_ctrl.problem.evaluation.groups import StatesGroup, ordered
from ensemble_ctrl.problem.evaluation.interpolated import MOST, ArcCurves
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import Bicycle, Unicycle
from tests.problem.test_replay import five, random_controls

Floats = NDArray[np.float64]

FLEETS: dict[str, tuple[Any, dict[str, Interval]]] = {
    "unicycle from y": (Unicycle("y"), {"traction": Interval(0.9, 1.1)}),
    "wide": (Unicycle("x"), {"traction": Interval(0.3, 1.7)}),
    "two factors": (
        Unicycle("x"),
        {"linear_traction": Interval(0.7, 1.2), "angular_traction": Interval(0.8, 1.3)},
    ),
    "starts": (
        Unicycle("y"),
        {
            "angular_traction": Interval(0.9, 1.1),
            "start_heading": Interval(-0.3, 0.2),
            "start_x": Interval(-0.1, 0.2),
            "start_y": Interval(-0.3, 0.0),
        },
    ),
    "bicycle": (Bicycle(), {"traction": Interval(0.8, 1.1), "start_heading": Interval(-3.0, 3.0)}),
    "equal": (Unicycle("x"), {}),
}


def fleet_of(name: str) -> Fleet:
    system, parameters = FLEETS[name]
    return Fleet(system, parameters, position=[1.0, -2.0], heading=0.4)


def exact_path(fleet: Fleet, controls: Floats, member: Floats, step: float) -> list[tuple[Any, Any]]:
    """One robot's arcs in 40 digits, each chord along its heading at mid-step."""
    with mpmath.workdps(40):
        linear, angular, heading, x, y = map(mpmath.mpf, fleet.coefficients(member[None])[0].tolist())
        found, turned, dt = [(x, y)], mpmath.mpf(0), mpmath.mpf(step)
        for speed, rate in zip(*(r.tolist() for r in fleet.arcs.rates(*controls.T)), strict=True):
            half = angular * mpmath.mpf(rate) * dt / 2
            chord = linear * mpmath.mpf(speed) * dt * (mpmath.sin(half) / half if half else 1)
            angle = heading + angular * turned + half
            along, across = chord * mpmath.cos(angle), chord * mpmath.sin(angle)
            dx, dy = (along, across) if fleet.arcs.heading_from == "x" else (across, along)
            x, y, turned = x + dx, y + dy, turned + mpmath.mpf(rate) * dt
            found.append((x, y))
        return found


@pytest.mark.parametrize("name", FLEETS)
def test_positions_are_within_the_stated_error_of_exact_arcs(name: str) -> None:
    fleet, controls = fleet_of(name), np.clip(random_controls(3), -0.5, 1.2)
    members = np.concatenate([fleet.corners[:3], fleet.sample(4, 1)])
    curves = ArcCurves.of(fleet, controls, 0.1, fleet.corners)
    assert curves is not None
    places = curves.group(members).places(np.arange(161))
    for k, member in enumerate(members):
        path = exact_path(fleet, controls, member, 0.1)
        away = [
            float(mpmath.hypot(x - places[0, k, n].item(), y - places[1, k, n].item())) for n, (x, y) in enumerate(path)
        ]
        assert max(away) <= curves.error
    assert curves.error < 1e-10


def test_the_error_is_small_for_the_five_obstacles() -> None:
    curves = ArcCurves.of(five().fleet, random_controls(), 0.1, five().fleet.corners)
    assert curves is not None
    assert curves.error < 1e-11
    assert curves.table.shape[1] < 25


@pytest.mark.parametrize("turn", [0.3, 2.0, 9.0])
def test_the_bound_holds_and_is_of_the_size_of_the_error(turn: float) -> None:
    """For one turn all along the way: f(z) = exp(i turn z)."""
    z = np.linspace(-1, 1, 1001)
    for count in range(2, 40):
        nodes = points(count)
        seen = np.exp(1j * turn * nodes)
        found = coefficients(seen.real) @ polynomials(z, count) + 1j * (coefficients(seen.imag) @ polynomials(z, count))
        error, bound = float(np.abs(found - np.exp(1j * turn * z)).max()), interpolation_error(turn, count)
        assert error <= bound + 1e-14
        if error > 1e-12:
            assert bound < 200 * error


def test_fleets_that_turn_too_much_are_not_interpolated() -> None:
    assert interpolation_error(1e4, MOST) > 1e80
    assert interpolation_error(1e6, MOST) == np.inf
    controls = np.tile([1.0, 50.0], (160, 1))
    assert ArcCurves.of(fleet_of("wide"), controls, 0.1, fleet_of("wide").corners) is None


def test_very_many_times_are_not_interpolated() -> None:
    fleet, slow = fleet_of("two factors"), np.full((2_000_000, 2), 1e-3)
    assert ArcCurves.of(fleet, slow, 1e-5, fleet.corners) is None
    assert ArcCurves.of(fleet, slow[:2000], 1e-5, fleet.corners) is not None


@pytest.mark.parametrize("name", FLEETS)
def test_no_member_is_further_from_the_middle_than_the_reach(name: str) -> None:
    fleet, controls = fleet_of(name), random_controls(5)
    curves = ArcCurves.of(fleet, controls, 0.1, fleet.corners)
    assert curves is not None
    members = fleet.sample(400, 2)
    problem = five().with_(fleet=fleet)
    for here in ordered(members, 60):
        arcs = curves.group(members[here])
        paths = fleet.trajectories(controls, members[here], 0.1)
        for group in (arcs, StatesGroup(problem, paths)):
            away = np.linalg.norm(paths - group.middle, axis=2).max(axis=0)
            assert (away <= group.reach + 1e-11).all()
            np.testing.assert_allclose(group.places(np.arange(7)).transpose(1, 2, 0), paths[:, :7], atol=1e-11)
        assert arcs.reach.max() < 1.5 + paths.std(axis=0).max() * 20


@pytest.mark.parametrize("columns", [0, 1, 3])
def test_groups_hold_every_member_once_and_near_ones_together(columns: int) -> None:
    members = np.random.default_rng(4).uniform(-1, 1, (1000, columns)) * [1.0, 100.0, 1e-3][:columns]
    groups = list(ordered(members, 90))
    np.testing.assert_array_equal(np.sort(np.concatenate(groups)), np.arange(1000))
    assert max(map(len, groups)) <= 90
    assert len(groups) <= 16
    if columns == 3:
        widths = np.mean([np.ptp(members[g], axis=0) for g in groups], axis=0) / np.ptp(members, axis=0)
        assert (widths < 0.7).all()


@pytest.mark.parametrize("heading_from", ["x", "y"])
def test_members_beyond_the_ranges_are_judged_too(heading_from: Literal["x", "y"]) -> None:
    """A replay may be of any members: the polynomials are for those that it is of."""
    from ensemble_ctrl.problem.evaluation.judge import Judge

    fleet = Fleet(Unicycle(heading_from), {"traction": Interval(0.99, 1.01)}, position=[1.0, 1.0], heading=0.7)
    problem, controls = five().with_(fleet=fleet), random_controls(2)
    members = np.linspace(0.2, 3.0, 30)[:, None]
    for judge in (Judge(problem, controls, 1), Judge(problem, controls, 1, members)):
        found = judge.judge(members).closest
        paths = fleet.trajectories(controls, members, 0.1)
        wanted = [piece.distance(paths).min() for _, piece in problem.pieces]
        np.testing.assert_allclose([one.distance for one in found], wanted, atol=1e-11)
