"""The program for loops: its slopes, its levels, and what it makes of a plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import ExactOps, StateSignals, robustness
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.ocp.chance import all_hyperplanes
from ensemble_ctrl.ocp.evaluate import evaluate
from ensemble_ctrl.ocp.levels import TaskLevels, smooth_maximum
from ensemble_ctrl.ocp.online import InitialCondition, OnlineProgram
from ensemble_ctrl.ocp.online.point import Point
from ensemble_ctrl.ocp.online.step import groups
from ensemble_ctrl.ocp.solvers.sqp import Condensed
from ensemble_ctrl.ocp.transcription import Avoiding, Iterate, transcribe
from ensemble_ctrl.ocp.truncation import coarse, points
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import ArcSystem, Bicycle, Unicycle

from .problems import FLEET, five, planned

Floats = NDArray[np.float64]
TWO = {"linear_traction": Interval(0.95, 1.05), "angular_traction": Interval(0.9, 1.1)}


def present_at(program: OnlineProgram, controls: Floats, at: int, free: int, growth: float = 0.0) -> InitialCondition:
    """The fleet where the commands before `at` lead its middle member, from there on."""
    problem, fleet = program.problem, program.problem.fleet
    middle = fleet.coefficients(fleet.center[None])
    path = fleet.arcs.paths(controls, middle, problem.step)[0]
    _, omega = fleet.arcs.rates(*controls.T)
    coefficients = fleet.coefficients(fleet.dynamic_members(program.truncation.nodes))
    coefficients[:, 2] += problem.step * omega[:at].sum()
    coefficients[:, 3:] = path[at]
    return InitialCondition(at, free, coefficients, path[: at + 1, None], np.full(problem.steps + 1, growth), controls)


@pytest.mark.parametrize(
    ("system", "distributions"),
    [
        (Unicycle(), {"traction": Interval(0.9, 1.1)}),
        (Unicycle(heading_from="y"), {"traction": Interval(0.9, 1.1)}),
        (Bicycle(wheelbase=0.4), TWO),
    ],
)
def test_slopes_are_those_of_finite_differences(system: ArcSystem, distributions: dict[str, Interval]) -> None:
    bounds = np.full(2, -1.0), np.full(2, 1.0)
    problem = replace(five(fleet=Fleet(system, distributions, np.ones(2), 0.3, *bounds)), steps=16)
    controls = np.random.default_rng(0).uniform([0.2, -0.4], [0.8, 0.4], (16, 2))
    program = OnlineProgram.of(problem, controls, 2)
    point = Point(program, present_at(program, controls, 3, 5), controls)
    count = point.curve.points.shape[1]
    at, which = (i.ravel() for i in np.meshgrid(np.array([4, 6, 11, 16]), np.arange(count)))
    normal = np.random.default_rng(1).normal(size=(len(at), 2))
    slopes = point.curve.slopes(at, which, normal).reshape(len(at), 11, 2)
    for step, command in ((0, 0), (0, 1), (4, 0), (4, 1), (10, 1)):
        change = np.zeros((11, 2))
        change[step, command] = 1e-6
        ahead, behind = point.moved(change).curve.points, point.moved(-change).curve.points
        wanted = ((ahead - behind)[at, which] / 2e-6 * normal).sum(axis=1)
        np.testing.assert_allclose(slopes[:, step, command], wanted, atol=1e-7)


def test_slopes_are_those_of_the_program_condensed() -> None:
    """The points' closed-form slopes are what eliminating the equations of the one program gives."""
    problem = five().with_(steps=16)
    controls = np.random.default_rng(0).uniform([0.2, -0.4], [0.8, 0.4], (16, 2))
    program = OnlineProgram.of(problem, controls, 3)
    truncation, curve = program.truncation, points(problem, controls, program.truncation)
    hyperplanes = all_hyperplanes(problem, truncation, curve)
    one = transcribe(problem, truncation, Iterate(controls), Avoiding(hyperplanes, hyperplanes.active))
    condensed = Condensed(one.nlp)
    by_commands = np.searchsorted(condensed.independent, one.layout.controls.ravel())
    Z = condensed.at(one.nlp.guess).directions()[:, by_commands]
    online = Point(program, present_at(program, controls, 0, 0), controls).curve
    at, which = (i.ravel() for i in np.meshgrid(np.arange(1, 17), np.arange(truncation.count), indexing="ij"))
    for axis in (0, 1):
        slopes = online.slopes(at, which, np.tile(np.eye(2)[axis], (len(at), 1)))
        wanted = Z[one.layout.points[at, axis * truncation.count + which]]
        np.testing.assert_allclose(slopes, wanted, atol=1e-9)
    assert np.abs(Z).max() > 1


def test_several_robots_are_each_of_them_and_cost_their_mean() -> None:
    """Side by side: curve and slopes are those of each alone, and the smooth cost is the mean of theirs."""
    problem, controls = five(), planned().controls
    program = OnlineProgram.of(problem, controls, 2)
    first = present_at(program, controls, 30, 40)
    second = replace(
        first, coefficients=first.coefficients + np.array([0.02, 0.02, 0.05, 0.1, -0.1]), path=first.path + 0.1
    )
    both = replace(
        first,
        coefficients=np.concatenate([first.coefficients, second.coefficients]),
        path=np.concatenate([first.path, second.path], axis=1),
    )
    alone = [Point(program, present, controls) for present in (first, second)]
    joint, count = Point(program, both, controls), alone[0].curve.points.shape[1]
    np.testing.assert_allclose(
        joint.curve.points, np.concatenate([point.curve.points for point in alone], axis=1), atol=1e-12
    )
    at, normal = np.full(count, 90), np.random.default_rng(0).normal(size=(count, 2))
    for k, point in enumerate(alone):
        slopes = joint.curve.slopes(at, k * count + np.arange(count), normal)
        np.testing.assert_allclose(slopes, point.curve.slopes(at, np.arange(count), normal), atol=1e-9)
    for i in (0, 1):
        mean = np.mean([point.smooth_cost()[i] for point in alone], axis=0)
        np.testing.assert_allclose(joint.smooth_cost()[i], mean, atol=1e-8)
    assert joint.levels[-1] <= min(point.levels[-1] for point in alone) + 1e-12


def test_groups_of_steps_cover_all_and_grow() -> None:
    for steps in (1, 7, 40, 160, 1000):
        starts = groups(steps)
        sizes = np.diff([*starts, steps])
        assert starts[0] == 0
        assert (sizes >= 1).all()
        assert len(starts) <= 42
        assert sizes[0] <= 2
        assert sizes.max() <= sizes[-3:].max() + 1


def test_levels_are_a_lower_bound_of_the_robustness() -> None:
    problem, controls = five(), planned().controls
    truncation = coarse(problem)
    curve = points(problem, controls, truncation)
    levels = TaskLevels.of(problem, truncation, curve)
    value = levels.values(levels.heights(curve, truncation.mean, np.zeros(161)))[-1]
    part = problem.specification.parts[0].formula
    members = points(problem, controls, replace(truncation, hull=False)).transpose(1, 0, 2)
    exact = float(robustness(part, StateSignals(members, ("x", "y"), problem.step), ExactOps()))
    assert exact - np.log(21) / 20 - 0.05 <= value <= exact
    grown = levels.values(levels.heights(curve, truncation.mean, np.full(161, 0.1)))[-1]
    assert grown == pytest.approx(value - 0.1)


def test_the_smooth_maximum_is_never_above_the_largest() -> None:
    parts = np.array([0.1, 0.3, -2.0])
    value, weights = smooth_maximum(parts)
    assert 0.3 - np.log(3) / 20 <= value <= 0.3
    assert weights.sum() == pytest.approx(1.0)


def test_it_comes_close_to_the_optimum_of_the_interior_point_method() -> None:
    """From a plan that is disturbed, back to within a few hundredths of the optimum's cost."""
    problem, plan = five(), planned().controls
    program = OnlineProgram.of(problem, plan, 3)
    wobble = 0.15 * np.sin(np.arange(160)[:, None] / 9 + np.array([0.0, 1.0]))
    bad = plan + wobble
    truncation = planned().attempt.truncation
    found = program.solve(present_at(program, bad, 0, 0), rounds=25)
    best, start, end = (evaluate(problem, u, truncation) for u in (plan, bad, found.controls))
    assert start.cost > best.cost + 1
    assert end.cost < best.cost + 0.1
    assert end.gap > -1e-3
    assert end.robustness > 0
    assert found.short < 1e-3


def test_what_was_sent_stays_as_it_is() -> None:
    problem, plan = five(), planned().controls
    program = OnlineProgram.of(problem, plan, 3)
    found = program.solve(present_at(program, plan, 40, 43, 0.02), rounds=2)
    assert (found.controls[:43] == plan[:43]).all()
    assert (found.controls[43:] != plan[43:]).any()
    assert (np.abs(found.controls) <= 2).all()


def test_growth_keeps_the_fleet_further_away() -> None:
    problem, plan = five(), planned().controls
    program = OnlineProgram.of(problem, plan, 3)
    found = program.solve(present_at(program, plan, 0, 0, 0.1), rounds=8)
    value = evaluate(problem, found.controls, planned().attempt.truncation)
    assert value.gap > 0.08


def test_rates_are_kept() -> None:
    fleet = replace(FLEET, rate_bounds=np.array([0.5, 0.5]), input_upper=np.array([0.8, 1.0]))
    problem = five(fleet=fleet)
    plan = np.column_stack([np.full(160, 0.55), np.zeros(160)])
    program = OnlineProgram.of(problem, plan, 2)
    found = program.solve(present_at(program, plan, 0, 1), rounds=6)
    assert np.abs(np.diff(found.controls, axis=0)).max() <= 0.5 * problem.step + 1e-3
    assert found.controls[:, 0].max() <= 0.8


def test_a_deadline_ends_it_after_a_quadratic_program() -> None:
    program = OnlineProgram.of(five(), planned().controls, 3)
    found = program.solve(present_at(program, planned().controls, 0, 0), deadline=1e-9, rounds=20)
    assert (found.status, found.iterations) == ("limit", 1)


def with_smoothness(problem: Problem) -> Problem:
    return problem.with_(objective=replace(problem.objective, smoothness=0.05))


def test_smoothness_makes_commands_smoother() -> None:
    plan = planned().controls
    rough = []
    for problem in (five(), with_smoothness(five())):
        program = OnlineProgram.of(problem, plan, 2)
        found = program.solve(present_at(program, plan, 20, 23), rounds=10).controls
        rough.append(float((np.diff(found[23:], axis=0) ** 2).sum()))
    assert rough[1] < 0.9 * rough[0]
