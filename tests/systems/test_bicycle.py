"""The bicycle: exact arcs against an integrator, and what it can't do."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.systems import SYSTEMS, Bicycle
from tests.examples import examples

LOW, HIGH = np.array([-2.0, -0.6]), np.array([2.0, 0.6])


@examples(60)
@given(st.integers(0, 2**31), st.floats(0.1, 3.0), st.sampled_from(["x", "y"]))
def test_positions_are_the_integral_of_the_dynamics(seed: int, wheelbase: float, axis: Literal["x", "y"]) -> None:
    rng = np.random.default_rng(seed)
    controls = rng.uniform([-2.0, -0.6], [2.0, 0.6], (4, 2)) * (rng.random((4, 2)) < 0.8)
    linear, angular, heading, x, y = drive = rng.uniform(0.5, 1.5, 5)
    path = Bicycle(axis, wheelbase).paths(controls, drive[None], 0.2)[0]
    pose = np.array([x, y, heading])
    for (v, delta), reached in zip(controls, path[1:], strict=True):

        def rate(_: float, z: np.ndarray, v: float = v, delta: float = delta) -> list[float]:
            along, across = linear * v * np.cos(z[2]), linear * v * np.sin(z[2])
            turn = angular * v * np.tan(delta) / wheelbase
            return [along, across, turn] if axis == "x" else [across, along, turn]

        pose = solve_ivp(rate, (0, 0.2), pose, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        np.testing.assert_allclose(reached, pose[:2], atol=1e-9)


@given(st.floats(-2, 2), st.floats(-3, 3))
def test_commands_turn_as_asked_or_as_hard_as_they_can(v: float, omega: float) -> None:
    car = Bicycle("x", 0.5)
    speed, delta = car.commands(v, omega, LOW, HIGH)
    assert speed == v
    assert abs(delta) <= 0.6
    _, got = car.rates(speed, delta)
    if abs(delta) < 0.6 and abs(v) > 1e-6:
        assert got == pytest.approx(omega, abs=1e-9)
    else:
        assert abs(got) <= abs(omega) + 1e-9
        assert got * omega >= -1e-12


def test_a_standing_car_stays_whatever_its_steering_angle() -> None:
    path = Bicycle().paths(np.array([[0.0, 0.5], [0.0, -0.6]]), np.array([[1.0, 1.0, 0.3, 2.0, 3.0]]), 0.1)
    np.testing.assert_array_equal(path[0], [[2.0, 3.0]] * 3)


def test_it_is_found_by_name_and_checks_its_wheelbase() -> None:
    assert SYSTEMS["bicycle"] is Bicycle
    for bad in (0.0, -1.0, float("nan")):
        with pytest.raises(ProblemError, match=r"^wheelbase: expected a finite length above 0 m"):
            Bicycle(wheelbase=bad)
