"""The program that IPOPT solves: what it costs is what the plan is worth, and its rows hold between grid times too."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.ocp.chance import all_hyperplanes
from ensemble_ctrl.ocp.evaluate import evaluate
from ensemble_ctrl.ocp.online import InitialCondition, OnlineProgram
from ensemble_ctrl.ocp.online.point import Point
from ensemble_ctrl.ocp.risk import ROUND
from ensemble_ctrl.ocp.transcription import Avoiding, Iterate, Transcription, transcribe
from ensemble_ctrl.ocp.truncation import Truncation, points, positions, tail
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.risk import Risk
from ensemble_ctrl.problem.target import Formation, MomentTarget, SpreadTarget

from .problems import FLEET, five

Floats = NDArray[np.float64]
STEPS = 32


def controls_of(seed: int, most: tuple[float, float] = (1.0, 0.6)) -> Floats:
    """Random commands."""
    return np.asarray(np.random.default_rng(seed).uniform(-1, 1, (STEPS, 2)) * most)


def program_of(problem: Problem, controls: Floats, truncation: Truncation, spare: float = 0.0) -> Transcription:
    """The program around the controls, with every pair constrained."""
    hyperplanes = all_hyperplanes(problem, truncation, points(problem, controls, truncation))
    return transcribe(problem, truncation, Iterate(controls), Avoiding(hyperplanes, hyperplanes.active), (spare, 0.0))


def at_the_guess(program: Transcription) -> Floats:
    """The decision vector under the guessed controls, with no slack and with the smallest risk penalty."""
    x, more = program.guess.copy(), np.array(program.layout._more, dtype=int)
    x[program.layout.slacks] = 0.0
    x[more[1:]] = np.maximum(x[more[1:]] - ROUND, 0.0)  # the guess keeps a little off the bound
    return x


def cost_of_the_program(problem: Problem, controls: Floats, truncation: Truncation) -> float:
    """What the program minimises, at the controls."""
    program = program_of(problem, controls, truncation)
    value, _ = program.program.functions["grad_f"](at_the_guess(program), program.program.parameters)
    return float(value)


def cost_online(problem: Problem, controls: Floats, order: int) -> float:
    """What the program for loops minimises before the first step, at the controls."""
    program, fleet = OnlineProgram.of(problem, controls, order), problem.fleet
    coefficients = fleet.coefficients(fleet.dynamic_members(program.truncation.nodes))
    present = InitialCondition(0, 0, coefficients, fleet.start_place[None, None], np.zeros(STEPS + 1), controls)
    point = Point(program, present, controls)
    cost, short = point.cost(point.hyperplanes())
    assert short == 0
    return cost


def aimed(task: str, **objective: Any) -> Problem:
    """No obstacle in the way of anybody, one of the objectives."""
    problem = five().with_(steps=STEPS, task=parse(task))
    return problem.with_(objective=replace(problem.objective, **objective))


TARGETS = {
    "place": np.array([3.0, 2.0]),
    "formation": Formation("traction", np.array([0.9, 1.1]), np.array([[2.0, 1.0], [3.0, 2.0]])),
    "moments": MomentTarget(np.array([[4.0, 3.0], [0.2, 0.1]]), np.array([1.0, 3.0])),
    "spread": SpreadTarget(np.array([3.0, 2.0]), np.array([[0.2, 0.05], [0.05, 0.1]])),
}


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("target", TARGETS)
def test_both_programs_cost_what_the_plan_is_worth(target: str, seed: int) -> None:
    """Effort, rates and the terminal term of a fleet, whose task has no robustness."""
    problem = aimed("G x <= 100", target=TARGETS[target], effort=np.array([0.2, 0.7]), smoothness=0.3, robustness=0.0)
    controls, truncation = controls_of(seed), Truncation((10,), (10,), True)
    worth = evaluate(problem, controls, truncation)
    assert min(worth.terminal, worth.effort) > 0.1
    assert cost_of_the_program(problem, controls, truncation) == pytest.approx(worth.cost, rel=1e-4)
    assert cost_online(problem, controls, 10) == pytest.approx(worth.cost, rel=1e-4)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("task", ["G[2,5] x + 2*y <= 30", "G (x >= -20 and y <= 19)", "y <= 8"])
def test_both_programs_count_the_robustness_of_a_robot_as_it_is(task: str, seed: int) -> None:
    problem = aimed(task, robustness=0.7, smoothness=0.3)
    problem = problem.with_(fleet=replace(FLEET, parameters={}))
    controls, truncation = controls_of(seed), Truncation((), (), True)
    worth = evaluate(problem, controls, truncation)
    assert abs(worth.robustness) > 0.5
    assert cost_of_the_program(problem, controls, truncation) == pytest.approx(worth.cost, abs=1e-9)
    assert cost_online(problem, controls, 0) == pytest.approx(worth.cost, abs=1e-9)


@pytest.mark.parametrize("of", ["terminal", "clearance"])
def test_the_program_counts_the_risk_as_it_is(of: Any) -> None:
    problem = five().with_(steps=STEPS, task=parse("G avoid(obstacles)"))
    problem = problem.with_(objective=replace(problem.objective, cvar=Risk(of, 0.8, 5.0)))
    controls, truncation = np.tile([0.1, -0.4], (STEPS, 1)), Truncation((10,), (10,), True)
    worth = evaluate(problem, controls, truncation)
    assert abs(worth.risk) > 0.1
    assert cost_of_the_program(problem, controls, truncation) == pytest.approx(worth.cost, abs=2e-2 * abs(worth.risk))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("half", "order"), [(0.02, 4), (0.1, 4), (0.2, 1)])
def test_rows_that_hold_keep_every_member_out_through_whole_steps(seed: int, half: float, order: int) -> None:
    """What a row leaves at the ends of a step is at most what the arc between them leaves, along the pair's line."""
    problem = five(fleet=replace(FLEET, parameters={"traction": Interval(1 - half, 1 + half)})).with_(steps=STEPS)
    truncation, controls = Truncation((order,), (order,), True), controls_of(seed, (2.0, 2.0))
    program = program_of(problem, controls, truncation, tail(problem, controls, truncation))
    hyperplanes = all_hyperplanes(problem, truncation, points(problem, controls, truncation))
    side, step = np.nonzero(hyperplanes.active)
    g = np.array(program.program.functions["g"](at_the_guess(program), program.program.parameters)).ravel()
    (rows,) = [g[first:last] for name, first, last in program.program.rows if name == "avoiding"]
    left = rows.reshape(len(side), -1).min(axis=1)
    members = problem.fleet.dynamic_members(np.linspace(-1, 1, 9)[:, None])
    fine = positions(problem, np.repeat(controls, 8, axis=0), members)
    within = np.stack([fine[:, 8 * n : 8 * n + 9] for n in range(STEPS)])
    along = np.einsum("kmtd,kd->kmt", within[step], hyperplanes.normal[side, step]).min(axis=(1, 2))
    true = along - hyperplanes.support[side, step] - hyperplanes.radius[side] - problem.solve.margin
    assert (left <= true + 1e-9).all()
