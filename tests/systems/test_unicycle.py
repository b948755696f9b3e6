"""Exact arcs against an integrator, in both heading conventions."""

from __future__ import annotations

from typing import Any, Literal

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.ocp.arrays import CasadiArrays
from ensemble_ctrl.systems import SYSTEMS, Unicycle, sinc
from tests.examples import examples

Floats = NDArray[np.float64]
Heading = Literal["x", "y"]
both_conventions = pytest.mark.parametrize("heading_from", ["x", "y"])
speeds = st.floats(-3, 3)
turn_rates = st.floats(-4, 4) | st.sampled_from([0.0, 1e-300, -1e-12, 1e-8, -1e-6, 1e-3])
tractions = st.floats(0.3, 2)


def integrated(heading_from: Heading, pose: Floats, v: float, omega: float, traction: float, times: Floats) -> Floats:
    """Poses at `times` by the definition ``px' = psi v cos`` (or sin), shape (3, times)."""

    def rate(_: float, z: Floats) -> list[float]:
        along, across = traction * v * np.cos(z[2]), traction * v * np.sin(z[2])
        dx, dy = (along, across) if heading_from == "x" else (across, along)
        return [dx, dy, traction * omega]

    run = solve_ivp(rate, (0, times[-1]), pose, "DOP853", times, rtol=1e-12, atol=1e-13)
    return np.asarray(run.y)


def coefficients(tractions: Floats, heading: float, start: tuple[float, float] = (0.0, 0.0)) -> Floats:
    """Coefficients of members of one heading and place."""
    return np.array([[t, t, heading, *start] for t in tractions])


@both_conventions
@examples(40)
@given(speeds, turn_rates, tractions, st.floats(-4, 4), st.floats(-2, 2))
def test_a_step_is_the_integral_of_the_dynamics(
    heading_from: Heading, v: float, omega: float, traction: float, heading: float, turned: float
) -> None:
    pose = np.array([0.0, 0.0, heading + traction * turned])
    wanted = integrated(heading_from, pose, v, omega, traction, np.array([0.0, 0.7]))[:2, -1]
    got = Unicycle(heading_from).displacement(v, omega, turned, traction, traction, heading, 0.7)
    np.testing.assert_allclose(got, wanted, atol=1e-10)


@both_conventions
def test_positions_accumulate_over_steps(heading_from: Heading) -> None:
    rng = np.random.default_rng(2)
    controls = rng.uniform(-2, 2, (6, 2))
    controls[2, 1] = 0.0
    tractions = np.array([0.5, 1.0, 1.4])
    paths = Unicycle(heading_from).paths(controls, coefficients(tractions, 0.4, (3.0, -1.0)), 0.25)
    assert paths.shape == (3, 7, 2)
    for traction, path in zip(tractions, paths, strict=True):
        pose = np.array([3.0, -1.0, 0.4])
        np.testing.assert_array_equal(path[0], pose[:2])
        for (v, omega), reached in zip(controls, path[1:], strict=True):
            pose = integrated(heading_from, pose, v, omega, traction, np.array([0.0, 0.25]))[:, -1]
            np.testing.assert_allclose(reached, pose[:2], atol=1e-10)


def test_the_conventions_are_mirror_images_at_the_diagonal() -> None:
    """From +y counts clockwise: the same robot has heading pi/2 - theta and the opposite turn rate."""
    controls = np.random.default_rng(0).uniform(-2, 2, (20, 2))
    traction = np.array([0.9, 1.1])
    by_x = Unicycle("x").paths(controls, coefficients(traction, 0.7), 0.1)
    by_y = Unicycle("y").paths(controls * [1, -1], coefficients(traction, np.pi / 2 - 0.7), 0.1)
    np.testing.assert_allclose(by_x, by_y, atol=1e-13)


@both_conventions
def test_generators_are_the_dynamics_of_the_lifted_state(heading_from: Heading) -> None:
    system, pose, h = Unicycle(heading_from), np.array([0.4, 0.2, 0.9]), 1e-3
    v, omega, traction = 1.3, -0.8, 1.1
    path = integrated(heading_from, pose, v, omega, traction, np.array([0.0, h, 2 * h, 3 * h, 4 * h]))
    lifted = system.lift(path[:2].T, path[2])
    rate = (lifted[0] - 8 * lifted[1] + 8 * lifted[3] - lifted[4]) / (12 * h)
    b1, b2 = system.generators()
    np.testing.assert_allclose((traction * (v * b1 + omega * b2)) @ lifted[2], rate, atol=1e-9)


@examples(200)
@given(speeds, st.floats(-9, 9), tractions, st.floats(0.01, 1.0))
def test_the_sagitta_bounds_the_way_between_arc_and_chord(v: float, omega: float, traction: float, step: float) -> None:
    part = np.linspace(0, 1, 65)
    system = Unicycle()
    times: Any = step * part
    arc = np.stack(system.displacement(v, omega, 0.0, traction, traction, 0.2, times), axis=-1)
    chord = part[:, None] * arc[-1]
    nearest = np.linalg.norm(arc[:, None] - chord[None], axis=-1).min(axis=1)
    assert nearest.max() <= system.sagitta(v, omega, traction, traction, step) + 1e-12


def test_the_sagitta_is_tight_for_a_gentle_arc() -> None:
    system, step, omega = Unicycle(), 0.1, 0.5
    arc = np.array(system.displacement(1.0, omega, 0.0, 1.0, 1.0, -omega * step / 2, step / 2))
    assert abs(arc[1]) == pytest.approx(system.sagitta(1.0, omega, 1.0, 1.0, step), rel=1e-3)
    assert system.sagitta(1.0, 0.0, 1.0, 1.0, step) == 0.0


def test_sinc_is_accurate_to_rounding() -> None:
    x = np.concatenate([np.linspace(-4, 4, 4001), np.logspace(-300, 0, 301), [np.nextafter(0.5, 0), 0.5]])
    with np.errstate(all="raise", under="ignore"):
        got = sinc(x)
    safe = np.where(x == 0, 1.0, x)
    wanted = np.where(x == 0, 1.0, np.sin(safe) / safe)
    np.testing.assert_allclose(got, wanted, rtol=4e-16, atol=4e-16)


@pytest.mark.parametrize("at", [0.0, 1e-9, 0.3, 0.4999999, 0.5, 0.5000001, -2.0])
def test_sincs_derivatives_are_right_through_casadi(at: float) -> None:
    x: Any = ca.SX.sym("x")
    value = sinc(x, CasadiArrays())
    slope = ca.gradient(value, x)
    got = [float(d) for d in ca.Function("f", [x], [value, slope, ca.gradient(slope, x)])(at)]
    s, c = np.sin(at), np.cos(at)
    if abs(at) < 1e-3:
        wanted = [1.0, -at / 3, -1 / 3]
    else:
        wanted = [s / at, (c - s / at) / at, (-s - 2 * (c - s / at) / at) / at]
    np.testing.assert_allclose(got, wanted, rtol=1e-11, atol=1e-15)


def test_casadi_and_numpy_give_the_same_displacement() -> None:
    symbols: Any = ca.SX.sym("z", 5)
    for heading_from in ("x", "y"):
        system = Unicycle(heading_from)
        v, omega, turned, heading, traction = (symbols[i] for i in range(5))
        pair = system.displacement(v, omega, turned, traction, traction, heading, 0.1, CasadiArrays())
        function = ca.Function("f", [symbols], list(pair))
        for row in [[1.0, 0.0, 0.2, 0.3, 1.1], [1.0, 1e-9, 0.2, 0.3, 1.1], [-2.0, 15.0, 0.2, 0.3, 0.9]]:
            wanted = system.displacement(row[0], row[1], row[2], row[4], row[4], row[3], step=0.1)
            np.testing.assert_allclose([float(d) for d in function(row)], wanted, atol=1e-15)


def test_systems_are_found_by_name_and_check_their_convention() -> None:
    assert SYSTEMS["unicycle"] is Unicycle
    with pytest.raises(ProblemError, match=r"^heading_from: expected 'x' or 'y', got 'north'"):
        Unicycle("north")  # type: ignore[arg-type]
