"""The quadrotor, against the paper's equations written with a rotation matrix, and what it can't do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ensemble_ctrl import Fleet, Interval, ProblemError, Quadrotor
from ensemble_ctrl.systems.quadrotor import GRAVITY

Floats = NDArray[np.float64]
QUADROTOR = Quadrotor(mass=5.0, inertia=(0.07, 0.09, 0.15), payload_arm=0.2)
FLEET = Fleet(QUADROTOR, {"payload": Interval(0.0, 0.5)}, start={"z": 1.0, "wx": 0.5, "wy": -1.0, "wz": 2.0})


def cross_matrix(w: Floats) -> Floats:
    """S(w) of the paper."""
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def by_matrix(payload: float, controls: Floats, step: float) -> Floats:
    """Position, velocity, rotation matrix and body rates at the end, by ``eq:quad_dynamics`` as it is printed."""
    mass, J = 5.0 + payload, np.diag([0.07, 0.09, 0.15]) + payload * 0.2**2 * np.eye(3)
    state = np.concatenate([[0, 0, 1], np.zeros(3), np.eye(3).ravel(), [0.5, -1.0, 2.0]])

    def rates(_: float, x: Floats, u: Floats) -> Floats:
        v, R, w = x[3:6], x[6:15].reshape(3, 3), x[15:]
        acceleration = np.array([0, 0, -GRAVITY]) + R @ [0, 0, u[0] / mass]
        turn = np.linalg.solve(J, np.cross(J @ w, w) + u[1:])
        return np.concatenate([v, acceleration, (R @ cross_matrix(w)).ravel(), turn])

    for u in controls:
        state = solve_ivp(rates, (0, step), state, args=(u,), method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    return state


@pytest.mark.parametrize("payload", [0.0, 0.3, 0.5])
def test_it_is_the_papers(payload: float) -> None:
    generator = np.random.default_rng(2)
    controls = np.column_stack([40 + 30 * generator.random(20), generator.uniform(-1, 1, (20, 3))])
    found = FLEET.trajectories(controls, np.array([[payload]]), 0.1)[0, -1]
    expected = by_matrix(payload, controls, 0.1)
    R = Rotation.from_quat(found[[7, 8, 9, 6]]).as_matrix()
    np.testing.assert_allclose(found[:6], expected[:6], atol=1e-7)
    np.testing.assert_allclose(R.ravel(), expected[6:15], atol=1e-7)
    np.testing.assert_allclose(found[10:], expected[15:], atol=1e-7)


def test_the_length_of_the_quaternion_does_not_matter() -> None:
    """A quaternion twice as long is the same attitude, and moves the same way."""
    controls = np.random.default_rng(1).uniform([30, -1, -1, -1], [60, 1, 1, 1], (10, 4))
    long = Fleet(QUADROTOR, FLEET.parameters, start={**FLEET.start, "qw": 2.0})
    members = FLEET.corners
    ours, theirs = (f.trajectories(controls, members, 0.1) for f in (FLEET, long))
    np.testing.assert_allclose(theirs[..., :6], ours[..., :6], atol=1e-8)
    np.testing.assert_allclose(theirs[..., 6:10], 2 * ours[..., 6:10], atol=1e-7)


def test_it_hovers_at_its_own_weight_and_no_other() -> None:
    """Unequal masses under one thrust drift apart by half (T/m - g) t^2: what no open-loop control can prevent."""
    fleet = Fleet(QUADROTOR, {"payload": Interval(0.0, 0.5)}, start={"z": 1.0})
    controls = np.tile(fleet.rest(np.array([0.25])), (20, 1))
    heights = fleet.trajectories(controls, np.array([[0.0], [0.25], [0.5]]), 0.1)[:, :, 2]
    times = 0.1 * np.arange(21)
    thrust = GRAVITY * 5.25
    for mass, height in zip((5.0, 5.25, 5.5), heights, strict=True):
        np.testing.assert_allclose(height, 1 + (thrust / mass - GRAVITY) * times**2 / 2, atol=1e-9)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"mass": -1.0}, "mass: expected a mass above 0 kg, got -1 kg"),
        ({"mass": float("nan")}, "mass: expected a mass above 0 kg"),
        ({"inertia": (0.1, 0.0, 0.1)}, "inertia: expected three moments above 0"),
        ({"inertia": (0.1, 0.1)}, "inertia: expected three moments above 0"),
        ({"payload_arm": -0.1}, "payload_arm: expected a length of at least 0 m"),
    ],
)
def test_bodies_that_there_are_not(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        Quadrotor(**settings)


@pytest.mark.parametrize(
    ("lower", "arm", "message"),
    [
        (-5.0, 0.0, "payload: expected a total mass above 0 kg, got -1 kg"),
        (-3.0, 0.2, "payload: expected an inertia above 0 kg m.2, got .* singular"),
    ],
)
def test_payloads_that_there_are_not(lower: float, arm: float, message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        Fleet(Quadrotor(mass=4.0, payload_arm=arm), {"payload": Interval(lower, 0.5)})
