"""The cost against numbers worked out by hand, its slopes against differences; every program reads it."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from ensemble_ctrl import Objective
from ensemble_ctrl.ocp.cost import CommandCost, Scale, cost

AIM = Objective(robustness=2.0, effort=np.array([0.2, 0.7]), smoothness=0.3)


def test_effort_and_smoothness_by_hand() -> None:
    """(0.2 * 1^2 + 0.7 * 2^2) * 0.5 and (0.2 * 3^2 + 0.7 * 0^2) * 0.5; then 0.3 / 0.5 * (2^2 + 2^2)."""
    commands = CommandCost.of(AIM, Scale.none(), 0.5)
    u = np.array([[1.0, 2.0], [3.0, 0.0]])
    np.testing.assert_allclose(commands.effort(u.T), [1.5, 0.9])
    assert commands.total(u) == pytest.approx(1.5 + 0.9 + 4.8)
    assert commands.total(u, last=np.array([1.0, 1.0])) == pytest.approx(1.5 + 0.9 + 4.8 + 0.6)
    assert cost(AIM, 1.0, terminal=5.0, robustness=3.0, risk=0.25) == pytest.approx(1.0 + 5.0 - 6.0 + 0.25)


def test_expressions_are_what_arrays_are() -> None:
    commands, z = CommandCost.of(AIM, Scale(np.zeros(2), np.ones(2), np.array([0.1, -0.4])), 0.5), ca.SX.sym("z", 2)
    both = ca.Function("both", [z], [commands.effort(ca.vertsplit(z)), commands.roughness(ca.vertsplit(z))])
    at = np.array([0.3, -1.2])
    effort, roughness = both(at)
    assert float(effort) == pytest.approx(float(commands.effort(at)))
    assert float(roughness) == pytest.approx(float(commands.roughness(at)))


def test_slopes_are_those_of_differences() -> None:
    commands = CommandCost.of(AIM, Scale(np.zeros(2), np.ones(2), np.array([0.1, -0.4])), 0.5)
    u, h = np.random.default_rng(0).normal(size=(4, 2)), 1e-6
    gradient, bend = commands.effort_slopes(u)
    for n, i in np.ndindex(4, 2):
        step = np.zeros((4, 2))
        step[n, i] = h
        ahead, here, behind = (float(np.sum(commands.effort((u + k * step).T))) for k in (1, 0, -1))
        assert gradient[n, i] == pytest.approx((ahead - behind) / (2 * h), abs=1e-7)
        assert bend[i] == pytest.approx((ahead - 2 * here + behind) / h**2, rel=1e-2)
    assert commands.roughness_bend == pytest.approx(float(commands.roughness([1.0]) * 2))


def test_scaled_by_bounds_rest_takes_no_effort() -> None:
    scale = Scale.of_bounds(np.array([-1.0, 0.0, 2.0]), np.array([3.0, 10.0, 2.0]), np.array([0.0, 4.9, 2.0]))
    np.testing.assert_allclose(scale.scaled(np.array([[3.0, 0.0, 2.0]])), [[1.0, -1.0, 0.0]])
    np.testing.assert_allclose(scale.commands(scale.scaled(np.array([0.5, 7.0, 2.0]))), [0.5, 7.0, 2.0])
    aim = Objective(effort=1.0)
    assert CommandCost.of(aim, scale, 0.5).total(scale.scaled(np.array([[0.0, 4.9, 2.0]]))) == pytest.approx(0.0)
