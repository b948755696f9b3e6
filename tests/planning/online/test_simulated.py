"""Simulated robots: exact where nothing is wrong with them, and wrong as told."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.simulated import SMALL_CAR, Drifting, Factors, Fixed, Flaws, SimulatedRobot, Terrain
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import ArcSystem, Unicycle

Floats = NDArray[np.float64]
CONTROLS = np.column_stack([np.linspace(0.2, 1.0, 20), np.linspace(-0.3, 0.3, 20)])


def driven(factors: Factors, controls: Floats = CONTROLS, system: ArcSystem | None = None, **flaws: Any) -> Floats:
    """The pose after 2 s."""
    robot = SimulatedRobot(system or Unicycle(), np.ones(2), 0.4, 0.1, factors, Flaws(**flaws))
    robot.send(0.0, controls)
    robot.wait(2.0)
    return robot.pose


@pytest.mark.parametrize("system", [Unicycle(), Unicycle(heading_from="y"), SMALL_CAR])
def test_without_flaws_it_moves_as_the_model(system: ArcSystem) -> None:
    fleet = Fleet(system, {"traction": Interval(0.5, 2.0)}, np.ones(2), 0.4, np.full(2, -1.0), np.full(2, 1.0))
    wanted = system.paths(CONTROLS, fleet.coefficients(np.array([[1.2]])), 0.1)[0, -1]
    np.testing.assert_allclose(driven(Fixed(1.2, 1.2), system=system)[:2], wanted, atol=1e-12)


def test_commands_are_cut_rounded_and_late() -> None:
    straight = np.column_stack([np.full(20, 0.83), np.zeros(20)])
    way = np.array([np.cos(0.4), np.sin(0.4)])
    for flaws, speed, seconds in (
        ({"saturation": (0.5, 1.0)}, 0.5, 2.0),
        ({"quantum": (0.1, 0.1)}, 0.8, 2.0),
        ({"command_delay": 0.3}, 0.83, 1.7),
    ):
        np.testing.assert_allclose(driven(Fixed(), straight, **flaws)[:2], 1 + speed * seconds * way, atol=1e-9)


def test_ground_has_a_traction_of_its_own() -> None:
    ground = Terrain([(Polyhedron.box([[1.5, 9.0], [-9.0, 9.0]]), 0.5)], elsewhere=1.0)
    robot = SimulatedRobot(Unicycle(), np.ones(2), 0.0, 0.1, ground)
    robot.send(0.0, np.tile([1.0, 0.0], (20, 1)))
    robot.wait(2.0)
    assert robot.pose[0] == pytest.approx(1.5 + 1.5 * 0.5, abs=0.02)


def test_factors_swing() -> None:
    factors = Drifting(1.0, 0.1, 4.0)
    values = [factors(t, np.zeros(2))[0] for t in np.linspace(0, 4, 400)]
    assert min(values) == pytest.approx(0.9, abs=1e-4)
    assert max(values) == pytest.approx(1.1, abs=1e-4)
    assert np.abs(np.diff(values)).max() / (4 / 399) <= factors.fastest


def test_measurements_are_wrong_by_no_more_than_told_and_late() -> None:
    flaws = Flaws(position=0.02, heading=0.05, delay=0.25)
    robot = SimulatedRobot(Unicycle(), np.ones(2), 0.4, 0.1, flaws=flaws, seed=2)
    robot.send(0.0, CONTROLS)
    seen = [robot.read()]
    for k in range(1, 20):
        robot.wait(0.1 * k)
        seen.append(robot.read())
    late = [(0.1 * k, one) for k, one in enumerate(seen) if one is not None and k]
    assert len(late) > 10
    for now, one in late:
        true = robot.track[round(one.time * 100)]
        assert np.abs(true[:2] - [one.x, one.y]).max() <= 0.02
        assert abs(true[2] - one.heading) <= 0.05
        assert now - one.time >= 0.25 - 1e-9


def test_messages_get_lost() -> None:
    robot = SimulatedRobot(Unicycle(), np.ones(2), 0.4, 0.1, flaws=Flaws(lost_measurements=0.5), seed=2)
    seen = 0
    for k in range(200):
        robot.wait(0.1 * k)
        seen += robot.read() is not None
    assert 60 < seen < 140


@pytest.mark.parametrize("wrong", [{"position": -1.0}, {"delay": np.nan}, {"lost_commands": 1.0}])
def test_flaws_are_checked(wrong: dict[str, Any]) -> None:
    with pytest.raises(ProblemError, match=r"robot\.\w+: expected"):
        Flaws(**wrong)
