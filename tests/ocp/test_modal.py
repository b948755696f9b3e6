"""The nodal form solves the paper's moment system: two programs for one thing."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import Interval, LegendreBasis, nodes_to_moments
from ensemble_ctrl.ocp.modal import moment_generators, propagate
from ensemble_ctrl.systems import Unicycle

Floats = NDArray[np.float64]
Heading = Literal["x", "y"]
INTERVAL, STEP = Interval(0.8, 1.3), 0.1


def commands(steps: int) -> Floats:
    """Random commands; some turn rates are zero."""
    rng = np.random.default_rng(7)
    controls = rng.uniform(-2, 2, (steps, 2))
    controls[::5, 1] = 0.0
    return controls


def nodal_moments(system: Unicycle, basis: LegendreBasis, controls: Floats) -> Floats:
    """Moments of the robots at the Gauss nodes, moved on exact arcs, shape (steps + 1, order + 1, 4)."""
    parameters = INTERVAL.to_parameter(basis.nodes)
    coefficients = np.array([[p, p, 0.3, 1.0, -2.0] for p in parameters])
    paths = system.paths(controls, coefficients, STEP)
    turned = np.concatenate([[0.0], STEP * np.cumsum(controls[:, 1])])
    lifted = system.lift(paths, 0.3 + parameters[:, None] * turned)
    return np.asarray(np.einsum("kj,jtn->tkn", nodes_to_moments(basis), lifted))


@pytest.mark.parametrize("heading_from", ["x", "y"])
@pytest.mark.parametrize("order", [0, 1, 4, 8, 20])
def test_the_exponential_agrees_with_arcs_at_the_nodes(order: int, heading_from: Heading) -> None:
    system, basis, controls = Unicycle(heading_from), LegendreBasis(order), commands(20)
    wanted = nodal_moments(system, basis, controls)
    got = propagate(system, basis, INTERVAL, wanted[0], controls, STEP)
    assert got.shape == (21, order + 1, 4)
    np.testing.assert_allclose(got, wanted, atol=1e-12)


@pytest.mark.parametrize("heading_from", ["x", "y"])
def test_runge_kutta_agrees_with_enough_substeps_and_is_of_order_four(heading_from: Heading) -> None:
    system, basis, controls = Unicycle(heading_from), LegendreBasis(6), commands(20)
    wanted = nodal_moments(system, basis, controls)

    def error(substeps: int) -> float:
        got = propagate(system, basis, INTERVAL, wanted[0], controls, STEP, "rk4", substeps)
        return float(np.abs(got - wanted).max())

    assert error(40) < 1e-10
    assert 13 < error(2) / error(4) < 19


def test_the_other_heading_convention_is_another_system() -> None:
    basis, controls = LegendreBasis(3), commands(5)
    start = nodal_moments(Unicycle("y"), basis, controls)[0]
    paths = [propagate(Unicycle(axis), basis, INTERVAL, start, controls, STEP) for axis in ("x", "y")]
    assert np.abs(paths[0] - paths[1]).max() > 0.1


def test_generators_act_through_both_neighbours() -> None:
    """``m_k' = c v B1 m_k + h (a_k m_{k+1} + c_k m_{k-1})``, written out."""
    basis, system = LegendreBasis(4), Unicycle("y")
    a, c = basis.recurrence()
    moments = np.random.default_rng(0).normal(size=(5, 4))
    padded = np.vstack([np.zeros((1, 4)), moments, np.zeros((1, 4))])
    for big, small in zip(moment_generators(system, basis, INTERVAL), system.generators(), strict=True):
        neighbours = a[:, None] * padded[2:] + c[:, None] * padded[:-2]
        wanted = (INTERVAL.center * moments + INTERVAL.half_width * neighbours) @ small.T
        np.testing.assert_allclose((big @ moments.ravel()).reshape(5, 4), wanted, atol=1e-13)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"initial_moments": np.zeros((3, 4))}, "initial_moments"),
        ({"initial_moments": np.full((2, 4), np.nan)}, "initial_moments"),
        ({"controls": np.zeros((5, 3))}, "controls"),
        ({"controls": np.zeros(2)}, "controls"),
        ({"step": 0.0}, "step"),
        ({"step": np.inf}, "step"),
        ({"substeps": 0}, "substeps"),
        ({"method": "euler"}, "method"),
    ],
)
def test_bad_arguments_are_named(change: dict[str, Any], name: str) -> None:
    good: dict[str, Any] = {"initial_moments": np.zeros((2, 4)), "controls": np.zeros((5, 2)), "step": 0.1}
    with pytest.raises(ProblemError, match=rf"^{name}: expected"):
        propagate(Unicycle(), LegendreBasis(1), INTERVAL, **(good | change))
