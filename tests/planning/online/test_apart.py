"""Robots of one loop that start at different places: kept apart, and never said to be when they are not."""

from __future__ import annotations

from itertools import combinations
from time import process_time

import numpy as np
import pytest
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ConfigError, ProblemError, UnsupportedError
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.apart import certify_apart, met
from ensemble_ctrl.planning.online.driver import drive
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.measurement import Measurement
from ensemble_ctrl.planning.online.propagation import PoseSet
from ensemble_ctrl.planning.online.remaining import of_each, of_one_robot
from ensemble_ctrl.planning.online.settings import OnlineSettings, RobotSettings
from ensemble_ctrl.planning.online.simulated import FINE, Fixed, Flaws
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.specification import ApartConstraint
from ensemble_ctrl.systems import Unicycle
from tests.paths import CONFIGS

from .problems import NOISE, options

Floats = NDArray[np.float64]
STARTS = {"ann": (0.0, 0.0), "bob": (-0.8, 0.1)}


def problem_of(distance: float = 0.4, steps: int = 30) -> Problem:
    """Two robots, one behind the other, that go to the right."""
    fleet = Fleet(
        Unicycle(),
        {"traction": Interval(0.95, 1.05)},
        np.zeros(2),
        0.0,
        np.full(2, -1.2),
        np.full(2, 1.2),
        0.1,
        starts=STARTS,
    )
    return Problem(
        name="pair",
        fleet=fleet,
        duration=0.1 * steps,
        steps=steps,
        task=parse(f"F in(goal) and G apart({distance} m)"),
        regions={"goal": Polyhedron.box([[0.5, 9.0], [-3.0, 3.0]])},
    )


def straight(steps: int = 30, v: float = 0.8) -> Floats:
    """Commands that go ahead."""
    return np.column_stack([np.full(steps, v), np.zeros(steps)])


def wobbling(rng: np.random.Generator, steps: int) -> Floats:
    """Any commands."""
    return np.asarray(np.column_stack([rng.uniform(-1, 1, steps), rng.uniform(-1.2, 1.2, steps)]))


@pytest.mark.parametrize("seed", range(6))
def test_no_two_robots_of_their_sets_are_closer_than_proven(seed: int) -> None:
    """Sampled: any poses of the sets, any parameters, and 20 instants in each step."""
    rng, steps = np.random.default_rng(seed), 12
    problem = problem_of(steps=steps)
    each, controls = of_each(problem, tuple(STARTS)), wobbling(rng, steps)
    poses = {
        name: PoseSet(np.array(one.fleet.position), rng.uniform(0, 0.02, 2), 0.0, rng.uniform(0, 0.05))
        for name, one in each.items()
    }
    window = ApartConstraint(0.2, 0.25, 0.93)
    departures = {name: np.zeros(steps) for name in each}
    (proof,) = certify_apart(each, controls, poses, departures, [window]).values()
    places = {}
    for name, one in each.items():
        paths = []
        for _ in range(40):
            fleet, pose = one.fleet, poses[name]
            place = pose.position + rng.choice([-1.0, 1.0], 2) * pose.half
            turned = fleet.with_(position=place, heading=pose.heading + rng.choice([-1.0, 1.0]) * pose.turn)
            member = np.array([[rng.choice([0.95, 1.0, 1.05])]])
            paths.append(trajectories(one.with_(fleet=turned), controls, member, 20)[0])
        places[name] = np.array(paths)
    times = np.linspace(0.0, problem.duration, places["ann"].shape[1])
    during = (times >= window.begin) & (times <= window.end)
    away = np.linalg.norm(places["ann"][:, None, during] - places["bob"][None, :, during], axis=-1)
    assert proof.clearance <= away.min() - window.distance
    assert away.min() - window.distance - proof.clearance < 0.25
    assert proof.proven == (proof.clearance >= 0)


def test_robots_are_kept_apart_as_the_loop_says() -> None:
    problem = problem_of()
    tractions = {"ann": 0.95, "bob": 1.05}
    flaws = Flaws(NOISE.position, NOISE.heading, 0.1)
    robots = {name: RobotSettings(Fixed(each, each), flaws, k) for k, (name, each) in enumerate(tractions.items())}
    driven = OnlineSettings(options(), robots).simulated(problem)
    loop = Receding(problem, options(), straight(), process_time, tuple(robots))
    outcome = drive(loop, driven, driven)
    assert outcome.ending == "success"
    tracks = [np.array(robot.track)[:, :2] for robot in driven.robots.values()]
    assert (tracks[1][0] == [-0.8, 0.1]).all()
    assert np.linalg.norm(tracks[0] - tracks[1], axis=1).min() >= 0.4
    assert len(tracks[0]) > 30 * FINE


def test_a_distance_that_may_fall_short_is_not_proven() -> None:
    """The one behind may be faster: over 5 s of 1 m/s the two come 0.3 m closer than their 0.8 m."""
    problem = problem_of(0.6, 60)
    loop = Receding(problem, options(learn=False), straight(60, 1.0), process_time, tuple(STARTS))
    loop.step({name: Measurement(0.0, *place, 0.0) for name, place in STARTS.items()})
    assert loop.history[-1].proof != "whole"
    assert not loop.proven


def test_who_was_too_close_is_named() -> None:
    here, there = (PoseSet(np.array([x, 0.0]), np.full(2, 0.01), 0.0, 0.0) for x in (0.0, 0.3))
    wanted = [ApartConstraint(0.4, 0.0, 1.0)]
    assert met({"ann": [here], "bob": [there]}, 0.1, wanted) == "ann and bob were closer than 0.4 m"
    assert met({"ann": [here], "bob": [there]}, 0.1, [ApartConstraint(0.3, 0.0, 1.0)]) == ""
    assert met({"ann": [here], "bob": [there]}, 0.1, [ApartConstraint(0.4, 0.5, 1.0)]) == ""


def test_names_are_those_of_the_starts() -> None:
    with pytest.raises(ProblemError, match=r"robots: expected one for each start \(ann, bob\), got red"):
        Receding(problem_of(), options(), straight(), robots=("red",))
    with pytest.raises(UnsupportedError, match=r"fleet\.starts: expected one start, got ann, bob"):
        of_one_robot(problem_of())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("    bob: {traction: 1.05}\n", "", "expected a robot for each of fleet.starts, ann, bob, cid, got ann, cid"),
        (
            "  radius: 0.2 m\n",
            "  radius: 0.2 m\n  uncertainty: {disturbance: {position: 1 mm/s}}\n",
            "apart(0.4 m) is not supported for robots with errors of the model",
        ),
    ],
)
def test_what_cannot_be_proven_is_refused(old: str, new: str, message: str) -> None:
    text = (CONFIGS / "online" / "three_apart_online.yaml").read_text()
    assert old in text
    with pytest.raises(ConfigError) as error:
        ec.load_text(text.replace(old, new))
    assert message in str(error.value)


@pytest.mark.slow
def test_three_robots_of_the_config_stay_apart() -> None:
    problem = ec.load(CONFIGS / "online" / "three_apart_online.yaml")
    assert problem.online is not None
    driven = problem.online.simulated(problem)
    loop = Receding(problem, timer=process_time)
    outcome = drive(loop, driven, driven)
    assert outcome.ending in ("success", "finished")
    tracks = [np.array(robot.track)[:, :2] for robot in driven.robots.values()]
    assert min(np.linalg.norm(a - b, axis=1).min() for a, b in combinations(tracks, 2)) >= 0.4
