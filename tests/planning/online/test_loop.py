"""The loop on simulated robots: what it does when all is as assumed, and when something is not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import process_time
from typing import Any

import numpy as np
import pytest

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ProblemError, UnsupportedError
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.driver import Outcome, drive
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.measurement import Measurement
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.propagation import Errors
from ensemble_ctrl.planning.online.simulated import Drifting, SimulatedRobot
from ensemble_ctrl.planning.online.simulated_errors import SimulatedErrors
from ensemble_ctrl.problem.uncertainty import Uncertainty

from .problems import NOISE, SHORT, clearance, options, plan, robot

NAN = float("nan")


def run(driven: SimulatedRobot, loop: Receding | None = None, **changes: Any) -> tuple[Receding, Outcome]:
    """Drive a robot to the end."""
    loop = Receding(SHORT, options(**changes), plan(), process_time) if loop is None else loop
    return loop, drive(loop, driven, driven)


def events(outcome: Outcome) -> str:
    """All that was out of the ordinary."""
    return "\n".join(event for step in outcome.steps for event in step.events)


def disturbed(driven: SimulatedRobot, at: float, what: Callable[[SimulatedRobot], None]) -> SimulatedRobot:
    """A robot to which something happens at a time."""
    wait = driven.wait
    done: list[bool] = []

    def waiting(until: float) -> None:
        wait(until)
        if driven.now() >= at - 1e-9 and not done:
            done.append(True)
            what(driven)

    driven.wait = waiting  # type: ignore[method-assign]
    return driven


# --- all is as assumed


@pytest.mark.parametrize(("traction", "seed"), [(0.86, 0), (1.14, 2)])
def test_it_does_the_task_and_learns_the_traction(traction: float, seed: int) -> None:
    driven = robot(traction, seed)
    _, outcome = run(driven)
    assert (outcome.ending, outcome.reason) == ("success", "done, and proven")
    assert clearance(SHORT, driven) > 0
    assert SHORT.regions["goal"].margin(driven.pose[:2]) > 0
    assert np.linalg.norm(driven.pose[:2] - [2.4, 0.0]) < 0.05
    low, high = outcome.steps[-1].ranges["traction"]
    assert low <= traction <= high
    assert high - low < 0.05
    assert outcome.robustness <= SHORT.regions["goal"].margin(driven.pose[:2]) + 0.1
    assert {step.proof for step in outcome.steps} == {"whole"}


def test_robots_end_closer_together_than_under_the_first_plan() -> None:
    tractions = [0.87, 1.13]
    ends = [np.array(robot_end(traction)) for traction in tractions]
    blind = SHORT.fleet.arcs.paths(plan(), SHORT.fleet.coefficients(np.array(tractions)[:, None]), SHORT.step)[:, -1]
    assert spread(np.array(ends)) < 0.5 * spread(blind)


def robot_end(traction: float) -> np.ndarray[Any, Any]:
    driven = robot(traction, 5)
    run(driven)
    return driven.pose[:2]


def spread(places: np.ndarray[Any, Any]) -> float:
    return float(np.linalg.norm(places - places.mean(axis=0), axis=1).max())


def test_without_learning_the_range_stays() -> None:
    _, outcome = run(robot(1.1), learn=False)
    assert outcome.ending == "success"
    assert {step.ranges["traction"] for step in outcome.steps} == {(0.85, 1.15)}


def test_a_robot_that_says_little_and_hears_badly_gets_there() -> None:
    driven = robot(1.08, 3, lost_measurements=0.5, lost_commands=0.3)
    _, outcome = run(driven)
    assert outcome.ending == "success"
    assert clearance(SHORT, driven) > 0


def test_errors_of_actuators_that_are_told_are_kept_clear_of() -> None:
    fleet = SHORT.fleet.with_(uncertainty=Uncertainty(actuators={"v": 0.02, "omega": 0.02}))
    driven = robot(1.05, 4)
    driven.errors = SimulatedErrors(fleet, SHORT.step, seed=4)
    _, outcome = run(driven, Receding(SHORT.with_(fleet=fleet), options(), plan(), process_time))
    assert outcome.ending in ("success", "finished")
    assert clearance(SHORT, driven) > 0
    assert "fit" not in events(outcome)


def test_a_drift_that_is_told_contradicts_nothing() -> None:
    factors = Drifting(1.0, 0.03, 15.0)
    driven = robot(factors, 4)
    loop, outcome = run(driven, errors=replace(NOISE, drift=factors.fastest), deadline=0.4)
    assert loop.holds
    assert outcome.ending in ("success", "finished")
    assert clearance(SHORT, driven) > 0


def test_a_moving_obstacle_is_where_it_is_at_each_time() -> None:
    obstacles = {**SHORT.obstacles, "cart": (Obstacle.box([[1.9, 2.1], [-1.6, -1.2]]),)}
    problem = SHORT.with_(obstacles=obstacles, motions={"cart": Motion.steady([0.0, 0.3], 5.0)})
    driven = robot(1.1, 1)
    _, outcome = run(driven, Receding(problem, options(), timer=process_time))
    assert outcome.ending == "success"
    track = np.array(driven.track)[:, :2]
    times = np.linspace(0.0, 5.0, len(track))
    cart = problem.obstacles["cart"][0]
    assert float(cart.distance(track - problem.motions["cart"].at(times)).min()) - problem.fleet.radius > 0


def test_a_receding_horizon_goes_on_as_long_as_it_is_told() -> None:
    task = parse("G in(goal) and G avoid(obstacles)")
    problem = SHORT.with_(
        task=task,
        regions={"goal": Polyhedron.box([[-1.0, 3.0], [-1.0, 1.0]])},
        duration=2.0,
        steps=20,
    )
    loop = Receding(problem, options(horizon="receding", run_for=6.0, deadline=0.5), timer=process_time)
    driven = robot(1.05, 2)
    outcome = drive(loop, driven, driven)
    assert driven.now() >= 6.0
    assert outcome.ending == "success"
    assert clearance(problem, driven) > 0
    assert np.linalg.norm(driven.pose[:2] - [2.4, 0.0]) < 0.2


# --- something is not


@pytest.mark.parametrize("traction", [0.6, 1.3])
def test_a_traction_outside_the_range_is_noticed_and_never_a_success(traction: float) -> None:
    driven = robot(traction, 1)
    loop, outcome = run(driven)
    assert not loop.holds
    assert outcome.ending != "success"
    assert "no parameters in the assumed ranges fit" in events(outcome)
    assert clearance(SHORT, driven) > 0


def test_measurements_that_are_none_are_told_and_ignored() -> None:
    loop = Receding(SHORT, options(), plan(), process_time)
    driven = robot(1.0, 0)
    read = driven.read
    looks = iter(range(1000))

    def strange() -> Measurement | None:
        seen, k = read(), next(looks)
        if k % 7 == 3:
            return Measurement(k * 0.1, NAN, 0.0, 0.0)
        return Measurement(1.05, 9.0, 9.0, 0.0) if k % 7 == 5 and k > 15 else seen

    driven.read = strange  # type: ignore[method-assign]
    _, outcome = run(driven, loop)
    assert outcome.ending == "success"
    assert "measurement ignored: it is not finite" in events(outcome)
    assert "measurement ignored: 0.05 s is not after" in events(outcome)


def test_a_measurement_of_the_future_is_ignored() -> None:
    loop = Receding(SHORT, options(), plan())
    loop.step(Measurement(0.0, 0.0, 0.0, 0.0))
    loop.step(Measurement(77.0, 0.0, 0.0, 0.0))
    assert "measurement ignored: 77.00 s is not within" in loop.history[-1].events[0]


def test_a_silent_robot_is_stopped() -> None:
    driven = disturbed(robot(1.0, 0), 1.0, lambda r: setattr(r, "read", lambda: None))
    _, outcome = run(driven, silence=1.0)
    assert outcome.ending == "stopped"
    assert "the robot has said nothing for" in outcome.reason
    assert clearance(SHORT, driven) > 0


def test_a_robot_that_never_says_anything_does_not_start() -> None:
    driven = robot(1.0, 0)
    driven.read = lambda: None  # type: ignore[method-assign]
    _, outcome = run(driven)
    assert outcome.ending == "stopped"
    assert outcome.reason == "there is no measurement"
    assert (driven.pose[:2] == 0).all()


def test_a_robot_that_was_carried_away_is_noticed() -> None:
    driven = disturbed(robot(1.0, 0), 1.5, lambda r: r.put(0.4, 0.9, 0.5))
    loop, outcome = run(driven)
    assert not loop.holds
    assert outcome.ending in ("finished", "stopped", "failed")
    assert "it was moved, or measured wrongly" in events(outcome)
    assert clearance(SHORT, driven) > 0


def test_where_it_was_carried_into_a_dead_end_it_stands() -> None:
    """Behind the block, too close to drive on and too late for the goal."""
    driven = disturbed(robot(1.0, 0), 3.0, lambda r: r.put(-2.0, 0.0, 3.1))
    _, outcome = run(driven)
    assert outcome.ending in ("stopped", "failed")
    assert clearance(SHORT, driven) > 0


def test_a_blocked_route_stops_it() -> None:
    loop = Receding(SHORT, options(recovery=0.5), plan(), process_time)
    wall = (Obstacle.box([[1.6, 1.8], [-3.0, 3.0]]),)
    driven = disturbed(robot(1.0, 0), 1.5, lambda r: loop.add_obstacle("wall", wall))
    outcome = drive(loop, driven, driven)
    assert outcome.ending in ("stopped", "failed")
    assert driven.pose[0] < 1.6 - 0.05
    assert "an obstacle was added to the map: wall" in events(outcome)
    assert clearance(loop.problem, driven) > 0


def test_a_route_that_is_partly_blocked_is_left() -> None:
    loop = Receding(
        SHORT.with_(duration=8.0, steps=80, task=parse("F[7,8] in(goal) and G avoid(obstacles)")), options()
    )
    stone = (Obstacle.box([[1.5, 1.7], [-0.2, 0.6]]),)
    driven = disturbed(robot(1.0, 0), 1.5, lambda r: loop.add_obstacle("stone", stone))
    outcome = drive(loop, driven, driven)
    assert outcome.ending in ("success", "finished")
    assert clearance(loop.problem, driven) > 0
    assert loop.problem.regions["goal"].margin(driven.pose[:2]) > 0


def test_whoever_wants_to_stop_it_can() -> None:
    driven, loop = robot(1.0, 0), Receding(SHORT, options(), plan())
    outcome = drive(loop, driven, driven, wanted=lambda: driven.now() >= 2.0)
    assert outcome.ending == "interrupted"
    there = driven.pose.copy()
    driven.wait(4.0)
    assert (driven.pose == there).all()


def test_a_robot_that_breaks_the_link_is_told_to_stop() -> None:
    driven, loop = robot(1.0, 0), Receding(SHORT, options(), plan())

    def broken() -> Measurement | None:
        if driven.now() > 1.0:
            raise OSError("the cable came off")
        return SimulatedRobot.read(driven)

    driven.read = broken  # type: ignore[method-assign]
    with pytest.raises(OSError, match="the cable came off"):
        drive(loop, driven, driven)
    there = driven.pose.copy()
    driven.wait(3.0)
    assert (driven.pose == there).all()


# --- calls that make no sense


def test_a_deadline_longer_than_a_period_is_refused() -> None:
    with pytest.raises(ProblemError, match=r"online\.deadline: expected at most the 1 s of 10 applied steps, got 2 s"):
        Receding(SHORT, options(deadline=2.0), plan())


def test_a_plan_of_another_length_is_refused() -> None:
    with pytest.raises(ProblemError, match=r"controls: expected finite numbers of shape \(50, 2\), got \(49, 2\)"):
        Receding(SHORT, options(), plan()[1:])


def test_a_task_of_a_fleet_is_refused() -> None:
    problem = SHORT.with_(task=parse("mean(F[4,5] in(goal)) and G avoid(obstacles)"))
    with pytest.raises(UnsupportedError, match="a loop drives one robot, and this speaks of the whole fleet"):
        Receding(problem, options(), plan())


def test_a_taken_name_is_refused() -> None:
    loop = Receding(SHORT, options(), plan())
    with pytest.raises(ProblemError, match="obstacle: expected a new name, got 'block'"):
        loop.add_obstacle("block", SHORT.obstacles["block"])


@pytest.mark.parametrize(
    "wrong",
    [
        {"applied_steps": 0},
        {"order": 9},
        {"deadline": 0.0},
        {"horizon": "growing"},
        {"horizon": "receding"},
        {"run_for": 3.0},
    ],
)
def test_options_are_checked(wrong: dict[str, Any]) -> None:
    with pytest.raises(ProblemError, match=r"online\.\w+: expected"):
        OnlineOptions(**wrong)


def test_a_fleet_that_differs_in_its_start_only_has_nothing_to_learn() -> None:
    fleet = replace(SHORT.fleet, parameters={"start_x": Interval(-0.01, 0.01)})
    driven = robot(1.0, 0)
    loop = Receding(SHORT.with_(fleet=fleet), options(errors=Errors(0.01, 0.02)), plan(), process_time)
    outcome = drive(loop, driven, driven)
    assert outcome.ending == "success"
    assert outcome.steps[-1].ranges == {}
