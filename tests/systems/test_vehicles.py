"""Bases and points beside robots on arcs: their equations by hand, their exact steps by SciPy, and a proof each."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import ensemble_ctrl as ec
from ensemble_ctrl import DifferentialDrive, Fleet, Interval, Mecanum, ProblemError, SingleIntegrator, Trailer, Unicycle
from ensemble_ctrl.systems import SYSTEMS, System
from ensemble_ctrl.systems.arrays import arc
from tests.systems.test_ode import by_scipy, random_controls

Floats = NDArray[np.float64]

FLEETS = {
    "mecanum": Fleet(
        Mecanum(), {"vx_factor": Interval(0.9, 1.0), "vy_factor": Interval(0.8, 1.0)}, position=[1, 2], heading=0.7
    ),
    "single_integrator": Fleet(SingleIntegrator(), {"gain": Interval(0.5, 2.0), "angle": Interval(-1.0, 1.0)}),
    "differential_drive": Fleet(
        DifferentialDrive(), {"left_factor": Interval(0.9, 1.1), "track_factor": Interval(0.9, 1.1)}, heading=2.0
    ),
    "trailer": Fleet(
        Trailer(hitch_offset=0.8), {"trailer_length": Interval(3.0, 6.0)}, start={"hitch": 0.3, "heading": 1.0}
    ),
    "trailer, of its car": Fleet(Trailer(axle="car"), {"trailer_length": Interval(3.0, 6.0)}, start={"hitch": -0.3}),
}


@pytest.mark.parametrize("name", FLEETS)
def test_trajectories_are_scipys(name: str) -> None:
    fleet, step = FLEETS[name], 0.2
    controls = random_controls(fleet, 12, seed=4)
    controls[:2] *= 1e-9  # hardly turning, where an arc's closed form divides by the turn
    members = np.concatenate([fleet.corners, fleet.sample(2, seed=3)])
    for member, states in zip(members, fleet.trajectories(controls, members, step), strict=True):
        np.testing.assert_allclose(states, by_scipy(fleet, controls, member, step), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", FLEETS)
def test_casadi_takes_the_same_steps(name: str) -> None:
    fleet = FLEETS[name]
    system, step = fleet.system, 0.3
    control = random_controls(fleet, 1, seed=2)[0]
    state = np.random.default_rng(7).standard_normal(len(system.states))
    psi = {key: float(value[0]) for key, value in fleet.psi(fleet.corners[:1]).items()}
    x, u = ca.SX.sym("x", len(state)), ca.SX.sym("u", len(control))
    for what in ("xdot", "exact") if system.has_exact else ("xdot",):
        rest = (psi, step) if what == "exact" else (psi,)
        rows = getattr(system, what)(ca.vertsplit(x), ca.vertsplit(u), *rest)
        found = np.array(ca.Function("f", [x, u], [ca.vertcat(*rows)])(state, control)).ravel()
        np.testing.assert_allclose(found, getattr(system, what)(list(state), list(control), *rest), rtol=1e-13)


def test_an_arc_near_no_turn_and_at_where_its_series_ends() -> None:
    heading = np.array([0.3, 0.3, 0.3, 0.3, -2.0, 1.0])
    turn = np.array([0.0, 1e-300, 0.999999999, 1.000000001, 7.0, -1.0])
    nodes, weights = np.polynomial.legendre.leggauss(20)
    angles = heading + turn * (nodes[:, None] + 1) / 2
    along, left = arc(heading, turn)
    np.testing.assert_allclose(along, weights @ np.cos(angles) / 2, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(left, weights @ np.sin(angles) / 2, rtol=1e-13, atol=1e-14)
    at = ca.SX.sym("at")
    slope = ca.Function("slope", [at], [ca.jacobian(ca.vertcat(*arc(0.3, at)), at)])
    np.testing.assert_allclose(np.array(slope(0.0)).ravel(), [-np.sin(0.3) / 2, np.cos(0.3) / 2], rtol=1e-14)


def test_a_differential_drive_of_equal_wheels_is_a_unicycle() -> None:
    drive = Fleet(DifferentialDrive(wheel_radius=0.1, track=0.4), {}, heading=0.5)
    unicycle = Fleet(Unicycle(), {}, position=[0, 0], heading=0.5)
    wheels = random_controls(drive, 20, seed=1)
    twist = np.column_stack([wheels.sum(axis=1) * 0.1 / 2, (wheels[:, 1] - wheels[:, 0]) * 0.1 / 0.4])
    member = np.zeros((1, 0))
    np.testing.assert_allclose(
        drive.trajectories(wheels, member, 0.1)[..., :2], unicycle.trajectories(twist, member, 0.1)[..., :2], atol=1e-12
    )


def test_the_trailers_axle_and_the_cars_are_two_points_of_one_vehicle() -> None:
    """The axle rolls: it never slips sideways, and stays the trailer's length behind the hitch."""
    offset, length, heading, hitch = 0.8, 4.0, 0.4, 0.5
    by_car = Trailer(hitch_offset=offset, axle="car")
    by_trailer = Trailer(hitch_offset=offset)
    psi, controls = {"traction": 0.9, "trailer_length": length}, np.array([[1.5, 0.4], [-1.0, -0.3], [2.0, 0.1]])

    def axle(state: Floats) -> Floats:
        px, py, theta, phi = state
        back = offset * np.array([np.cos(theta), np.sin(theta)])
        return np.array([px, py]) - back - length * np.array([np.cos(theta - phi), np.sin(theta - phi)])

    car = np.array([0.0, 0.0, heading, hitch])
    trailer = np.array([*axle(car), heading, hitch])

    def after(system: Trailer, state: Floats, u: Floats) -> Floats:
        def rates(_: float, at: Floats) -> Floats:
            return np.array(system.xdot(list(at), u, psi), dtype=float)

        return np.asarray(solve_ivp(rates, (0.0, 1.0), state, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1])

    for u in controls:
        car, trailer = after(by_car, car, u), after(by_trailer, trailer, u)
        np.testing.assert_allclose(axle(car), trailer[:2], atol=1e-9)
        np.testing.assert_allclose(car[2:], trailer[2:], atol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Fleet(Mecanum(), {"vy_factor": Interval(0.0, 1.0)}), "vy_factor: expected a factor above 0, got 0"),
        (lambda: Fleet(SingleIntegrator(), {"gain": Interval(-1.0, 1.0)}), "gain: expected a factor above 0, got -1"),
        (
            lambda: Fleet(DifferentialDrive(), {"track_factor": Interval(0.0, 1.0)}),
            "track_factor: expected a factor above 0, got 0",
        ),
        (lambda: DifferentialDrive(track=0.0), "track: expected a length above 0 m, got 0 m"),
        (lambda: DifferentialDrive(wheel_radius=np.inf), "wheel_radius: expected a length above 0 m, got inf m"),
        (lambda: Trailer(wheelbase=-1.0), "wheelbase: expected a length above 0 m, got -1 m"),
        (lambda: Trailer(hitch_offset=np.nan), "hitch_offset: expected a finite length, got nan m"),
        (lambda: Trailer(axle="front"), "axle: expected trailer or car, got 'front'"),
        (
            lambda: Fleet(Trailer(), {"trailer_length": Interval(-1.0, 1.0)}),
            "trailer_length: expected a length above 0 m, got -1 m",
        ),
        (lambda: Fleet(Trailer(), {"traction": Interval(0.0, 1.0)}), "traction: expected a factor above 0, got 0"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(make: object, message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        make()  # type: ignore[operator]


def test_a_file_names_a_wrong_setting_at_its_line() -> None:
    text = "fleet: {model: trailer, settings: {axle: front}}\nhorizon: {duration: 1 s, steps: 2}\ntask: G (x <= 1)\n"
    with pytest.raises(ec.ConfigError, match=r":1:\d+: error: fleet\.settings\.axle: expected trailer or car"):
        ec.load_text(text)


def test_gains_of_points_that_turn_the_command_are_no_common_factor() -> None:
    system = SingleIntegrator()
    assert system.gain({"gain": 0.9, "angle": 0.0}) == 0.9
    assert system.gain({"gain": 0.9, "angle": 0.1}) is None


SMALL = {
    "mecanum": ("vy_factor: {range: [0.95, 1.0]}", "{x: 0, y: 0}", "[0.8, 1.2], [0.8, 1.2]"),
    "single_integrator": ("gain: {range: [0.95, 1.05]}", "{x: 0, y: 0}", "[0.8, 1.2], [0.8, 1.2]"),
    "differential_drive": ("left_factor: {range: [0.99, 1.01]}", "{heading: 0.78}", "[0.6, 1.4], [0.6, 1.4]"),
    "trailer": ("trailer_length: {range: [3.9, 4.1]}", "{heading: 0.78}", "[0.6, 1.4], [0.6, 1.4]"),
}


@pytest.mark.parametrize("name", SMALL)
def test_a_plan_is_proven_and_its_bounds_hold_for_members_by_scipy(name: str) -> None:
    parameter, start, goal = SMALL[name]
    problem = ec.load_text(
        f"fleet: {{model: {name}, parameters: {{{parameter}}}, start: {start}}}\n"
        "horizon: {duration: 4 s, steps: 8}\n"
        f"regions: {{goal: {{box: [{goal}]}}}}\n"
        "task: G[3.5, 4] in(goal)\nverify: {members: 100}\n"
    )
    plan = ec.plan(problem)
    assert plan.certificate is not None
    assert plan.certificate.proven == "yes"
    low, high = (0.8, 1.2) if "0.8" in goal else (0.6, 1.4)
    for member in problem.fleet.grid(3):
        end = by_scipy(problem.fleet, plan.controls, member, 0.5)[-2:, :2]
        inside = min((end - low).min(), (high - end).min())
        assert inside >= plan.certificate.robustness


def test_every_model_has_a_complete_table() -> None:
    for system in SYSTEMS.values():
        system().require_complete()
        assert issubclass(system, System)
