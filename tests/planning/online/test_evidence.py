"""What a step says of the commands that it sends, and what happens to it when the map or the time changes."""

from __future__ import annotations

import math
from itertools import count
from time import process_time

import numpy as np
import pytest
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.ocp.online import InitialCondition, OnlineProgram, Replan
from ensemble_ctrl.planning.online.driver import Outcome, drive
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.measurement import Measurement
from ensemble_ctrl.planning.online.simulated import SimulatedRobot
from tests.paths import CONFIGS

from .problems import SHORT, clearance, options, plan, robot
from .test_loop import disturbed, events
from .test_sets import problem_of, straight

Floats = NDArray[np.float64]
FILES = CONFIGS / "online"
START = Measurement(0.0, 0.0, 0.0, 0.0)


def planned(monkeypatch: pytest.MonkeyPatch, controls: Floats | None) -> None:
    """Let every solve on line find some commands, the ones it started from if None."""

    def solve(self: OnlineProgram, initial: InitialCondition, *rest: object, **more: object) -> Replan:
        found = initial.controls.copy()
        if controls is not None:
            found[initial.free :] = controls[initial.free :]
        return Replan(found, "improved", 1, 1, 0.0, 0.0, 0.0)

    monkeypatch.setattr(OnlineProgram, "solve", solve)


# --- numbers are of the commands sent


def test_a_kept_plan_has_the_numbers_of_its_own_proof(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = Receding(SHORT, options(), plan(), process_time)
    loop.step(START)
    first = loop.history[-1]
    kept = loop.plan.copy()
    planned(monkeypatch, straight(5.0, v=1.2))  # into the block
    sent = loop.step()
    step = loop.history[-1]
    assert (first.proof, step.source, step.proof) == ("whole", "kept", "whole")
    np.testing.assert_array_equal(sent, kept[10:20])
    assert (step.clearance, step.robustness) == (first.clearance, first.robustness)
    assert step.clearance >= 0


def test_what_nothing_is_proven_of_has_no_clearance(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = Receding(SHORT, options(), plan(), process_time)
    planned(monkeypatch, straight(5.0, v=1.2))
    loop.plan = straight(5.0, v=1.2)
    assert not loop.step(START).any()
    step = loop.history[-1]
    assert (step.source, step.proof, step.clearance, step.robustness) == ("stopped", "none", -math.inf, -math.inf)


def test_a_plan_that_comes_late_is_not_used() -> None:
    ticks = count()
    timer = process_time
    loop = Receding(SHORT, options(), plan(), lambda: timer())
    loop.step(START)
    timer = lambda: 10.0 * next(ticks)  # noqa: E731
    kept = loop.plan.copy()
    sent = loop.step()
    step = loop.history[-1]
    assert step.source == "kept"
    assert step.events[0].startswith("planning took ")
    np.testing.assert_array_equal(sent, kept[10:20])


def test_a_plan_in_time_is_used() -> None:
    loop = Receding(SHORT, options(), plan(), lambda: 0.0)
    loop.step(START)
    loop.step()
    assert [step.source for step in loop.history] == ["new", "new"]


def test_a_task_that_is_read_anew_is_proven_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """It has been in the region, and has left it: from 1 s on that is no visit within the next two seconds."""
    planned(monkeypatch, None)
    problem = problem_of("F[1, 2] in(b)", duration=2.0, regions={"b": [[1.2, 1.8], [-1.0, 1.0]]})
    loop = Receding(problem, options(horizon="receding", run_for=4.0), straight(2.0), process_time)
    loop.step(START)
    loop.step(Measurement(1.0, 1.0, 0.0, 0.0))
    assert [step.proof for step in loop.history] == ["whole", "period"]
    assert not loop.proven


def test_without_a_measurement_for_a_whole_horizon_all_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    planned(monkeypatch, None)
    problem = problem_of("G avoid(o)", duration=1.0, obstacles={"o": [[2.5, 3.0], [-0.2, 0.3]]})
    run = options(horizon="receding", run_for=4.0, applied_steps=5, deadline=0.5, silence=9.0)
    loop = Receding(problem, run, straight(1.0), process_time)
    loop.step(START)
    assert loop.step().any()
    assert not loop.step().any()
    assert loop.stopped == "nothing was measured for a whole horizon"
    assert loop.history[-1].proof == "none"
    assert not loop.step().any()  # nor is a way looked for that begins after the horizon


# --- obstacles that come on the way


def run(loop: Receding, driven: SimulatedRobot) -> Outcome:
    """Drive a robot to the end."""
    return drive(loop, driven, driven)


def test_an_obstacle_does_not_count_before_it_came() -> None:
    loop = Receding(SHORT, options(), plan(), process_time)
    behind = (Obstacle.box([[-0.1, 0.1], [-0.1, 0.1]]),)
    driven = disturbed(robot(1.0, 0), 3.5, lambda r: loop.add_obstacle("late", behind))
    outcome = run(loop, driven)
    assert (outcome.ending, outcome.reason) == ("success", "done, and proven")


def test_an_obstacle_where_the_robot_is_stops_it() -> None:
    loop = Receding(SHORT, options(recovery=0.5), plan(), process_time)
    at: list[Floats] = []

    def fall(driven: SimulatedRobot) -> None:
        x, y, _ = driven.pose
        at.append(driven.pose[:2].copy())
        loop.add_obstacle("stone", [Obstacle.box([[x - 0.3, x + 0.3], [y - 0.3, y + 0.3]])])
        assert not loop.proven

    driven = disturbed(robot(1.0, 0), 1.5, fall)
    outcome = run(loop, driven)
    assert (outcome.ending, outcome.reason) == ("stopped", "the robot may be in stone")
    assert float(np.linalg.norm(driven.pose[:2] - at[0])) <= 1.2 * SHORT.step  # in the present step
    assert "stone" in loop.problem.obstacles
    assert "an obstacle was added to the map: stone" in events(outcome)
    assert "deep inside obstacle 'stone'" in events(outcome)
    there = driven.pose.copy()
    driven.wait(driven.now() + 1.0)
    np.testing.assert_array_equal(driven.pose, there)


@pytest.mark.parametrize("box", [[[1.5, 3.0], [-0.6, 0.6]], [[-3.0, -2.0], [0.0, 1.0]]], ids=["goal", "far"])
def test_any_obstacle_may_come_whatever_is_left_to_do(box: list[list[float]]) -> None:
    """Over the whole goal; or far away, when a visit of the past could not be made from here any more."""
    problem = SHORT.with_(
        task=parse("F[0,1] in(home) and F[4,5] in(goal) and G avoid(obstacles)"),
        regions={**SHORT.regions, "home": Polyhedron.box([[-0.2, 0.2], [-0.2, 0.2]])},
    )
    loop = Receding(problem, options(recovery=0.5), plan(), process_time)
    driven = disturbed(robot(1.0, 0), 3.0, lambda r: loop.add_obstacle("late", [Obstacle.box(box)]))
    outcome = run(loop, driven)
    assert outcome.ending == ("stopped" if box[0][0] > 0 else "success")
    assert clearance(loop.problem, driven) > 0 or box[0][0] < 0


def test_a_task_of_obstacles_alone_can_be_planned_for() -> None:
    problem = problem_of("G avoid(o)", obstacles={"o": [[1.0, 1.5], [-0.2, 0.3]]})
    loop = Receding(problem, options(), straight(4.0), process_time)
    loop.step(START)
    assert loop.history[-1].proof in ("whole", "period")


# --- the section of a file


def test_a_loop_of_a_file_runs_as_the_file_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Receding, "_prepare", lambda self: None)
    problem = ec.load(str(FILES / "three_robots_online.yaml"))
    loop = Receding(problem, controls=np.zeros((160, 2)))
    assert (loop.options.deadline, tuple(loop.robots)) == (0.8, ("ada", "ben", "cleo"))
    own = Receding(problem, options(deadline=0.3), np.zeros((160, 2)), robots=("one",))
    assert (own.options.deadline, tuple(own.robots)) == (0.3, ("one",))
