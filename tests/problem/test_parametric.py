"""States of systems that an ODE defines, as polynomials of the parameters: against the integration of every member."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.core.errors import RunawayError
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.judge import MANY, Judge
from ensemble_ctrl.problem.evaluation.parametric import ParameterCurves
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.systems import PlanarQuadrotor
from tests.paths import CONFIGS

Floats = NDArray[np.float64]


class Shifted(PlanarQuadrotor):
    """One that says that its position at the start only shifts its way."""

    shifts = ("x", "z")


def loaded(name: str) -> tuple[Problem, Floats]:
    """A problem, and commands around what costs no effort."""
    problem = ec.load(CONFIGS / "systems" / f"{name}.yaml")
    if name == "planar_slalom":
        more = {**problem.fleet.parameters, "start_x": ec.Interval(-0.3, 0.1)}
        problem = problem.with_(fleet=problem.fleet.with_(system=Shifted(), parameters=more))
    fleet = problem.fleet
    rest, wide = fleet.rest(fleet.center), (fleet.input_upper - fleet.input_lower) / 2
    noise = np.random.default_rng(3).uniform(-0.01, 0.01, (problem.steps, len(rest)))
    return problem, rest + noise * wide


@pytest.mark.parametrize("name", ["planar_slalom", "quadrotor_delivery"])
def test_states_are_those_of_the_integration(name: str) -> None:
    problem, controls = loaded(name)
    fleet = problem.fleet
    curves = ParameterCurves.of(fleet, controls, problem.step, fleet.corners)
    assert curves is not None
    members = np.concatenate([fleet.corners, fleet.sample(60, 9)])
    group, states = curves.group(members), fleet.trajectories(controls, members, problem.step)
    found = group.during(0, problem.steps).transpose(1, 2, 0)
    np.testing.assert_allclose(found, states, rtol=2e-10, atol=2e-10)
    paths = states[..., fleet.place_columns]
    np.testing.assert_allclose(group.places(np.arange(5)).transpose(1, 2, 0), paths[:, :5], rtol=1e-9, atol=1e-9)
    assert (np.linalg.norm(paths - group.middle, axis=2).max(axis=0) <= group.reach + 1e-9).all()


@pytest.mark.parametrize("name", ["planar_slalom", "quadrotor_delivery"])
def test_a_replay_is_the_same_with_them(name: str) -> None:
    problem, controls = loaded(name)
    members = problem.fleet.sample(MANY, 4)
    run = replay(problem, controls, parameters=members, substeps=2)
    judge = Judge(problem, controls, 2, members)
    assert judge.curves is not None
    one_by_one = [judge.judge(members[i : i + 250]) for i in range(0, MANY, 250)]
    np.testing.assert_allclose(
        run.robustness, np.concatenate([one.robustness for one in one_by_one]), rtol=1e-9, atol=1e-9
    )
    for o, clearance in enumerate(run.clearances):
        assert clearance.distance == pytest.approx(min(one.closest[o].distance for one in one_by_one), abs=1e-9)
        assert clearance.inside == sum(one.closest[o].inside for one in one_by_one)


def test_starts_that_only_shift_the_way_are_no_matter_for_the_polynomials() -> None:
    problem, controls = loaded("planar_slalom")
    fleet = problem.fleet
    curves = ParameterCurves.of(fleet, controls, problem.step, fleet.corners)
    assert curves is not None
    assert len(curves.counts) == len(fleet.names) - 1
    members = np.tile(fleet.center, (3, 1))
    members[:, fleet.names.index("start_x")] = -0.3, 0.0, 0.1
    group = curves.group(members)
    assert group.reach == pytest.approx(np.full(problem.steps + 1, 0.3))
    paths = fleet.trajectories(controls, members, problem.step)[..., fleet.place_columns]
    np.testing.assert_allclose(group.places(np.arange(4)).transpose(1, 2, 0), paths[:, :4], atol=1e-9)


class Stick(ec.OdeSystem):
    """A mass with dry friction: its flow has a corner in the mass."""

    name, states, positions = "stick", ("x", "v"), ("x",)
    controls, control_units, input_bounds = ("force",), ("N",), ((-5.0, 5.0),)
    parameters = {"mass": 1.0}  # noqa: RUF012

    def xdot(self, x: Any, u: Any, psi: Any) -> Sequence[Any]:
        return [x[1], u[0] / psi["mass"] - 0.5 * abs(x[1] - 0.3)]


class Bolt(Stick):
    """A state that runs away for the larger masses."""

    name = "bolt"

    def xdot(self, x: Any, u: Any, psi: Any) -> Sequence[Any]:
        return [x[1], psi["mass"] * x[1] ** 2 + u[0]]


def test_a_flow_with_corners_is_integrated() -> None:
    fleet = ec.Fleet(Stick(), {"mass": ec.Interval(0.5, 3.0)})
    assert ParameterCurves.of(fleet, np.full((20, 1), 1.0), 0.1, fleet.corners) is None


def test_an_exact_flow_needs_no_polynomials() -> None:
    problem, controls = loaded("unknown_mass")
    assert ParameterCurves.of(problem.fleet, controls, problem.step, problem.fleet.corners) is None


def test_what_runs_away_is_said_of_a_member() -> None:
    fleet = ec.Fleet(Bolt(), {"mass": ec.Interval(0.1, 3.0)})
    controls = np.full((20, 1), 1.0)
    assert ParameterCurves.of(fleet, controls, 0.1, fleet.corners) is None
    problem = ec.Problem("bolt", fleet, 2.0, 20, ec.parse("G x >= -1"))
    with pytest.raises(RunawayError, match="mass = "):
        replay(problem, controls, members=2 * MANY)


def test_members_beyond_the_ranges_are_integrated() -> None:
    problem, controls = loaded("quadrotor_delivery")
    curves = ParameterCurves.of(problem.fleet, controls, problem.step, problem.fleet.corners)
    assert curves is not None
    assert curves.covers(problem.fleet.corners)
    assert not curves.covers(problem.fleet.corners + 0.01)
