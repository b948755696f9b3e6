"""Several robots under one broadcast: each is measured, learnt and proven for itself."""

from __future__ import annotations

from dataclasses import replace
from time import process_time
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.certificate.remaining import SetCertificate, together
from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.planning.online.driver import Outcome, drive
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.measurement import Measurement
from ensemble_ctrl.planning.online.propagation import PoseSet
from ensemble_ctrl.planning.online.simulated import FINE, SimulatedFleet
from ensemble_ctrl.planning.online.step import Step

from .problems import NOISE, SHORT, clearance, options, plan, robot

Floats = NDArray[np.float64]

TRACTIONS = {"red": 0.9, "green": 1.0, "blue": 1.12}


def fleet() -> SimulatedFleet:
    """Three robots, each with a traction and a noise of its own, two of them measured later than the first."""
    noise = {"red": NOISE.position, "green": 0.5 * NOISE.position, "blue": 0.8 * NOISE.position}
    delay = {"red": 0.1, "green": 0.2, "blue": 0.3}
    return SimulatedFleet(
        {
            name: robot(traction, seed, position=noise[name], delay=delay[name])
            for seed, (name, traction) in enumerate(TRACTIONS.items())
        }
    )


def loop_of(driven: SimulatedFleet, **changes: Any) -> Receding:
    """A loop for them."""
    return Receding(SHORT, options(**changes), plan(), process_time, tuple(driven.robots))


def held(pose: PoseSet, truth: Floats) -> bool:
    """Whether a set holds a true pose."""
    turn = abs((truth[2] - pose.heading + np.pi) % (2 * np.pi) - np.pi)
    return bool((np.abs(truth[:2] - pose.position) <= pose.half + 1e-9).all() and turn <= pose.turn + 1e-9)


def test_three_robots_do_the_task_under_one_broadcast() -> None:
    driven = fleet()
    loop = loop_of(driven)
    held_at: list[bool] = []

    def look(step: Step, controls: Floats) -> None:
        for name, tracker in loop.trackers.items():
            track = driven.robots[name].track
            at = round((began + tracker.time) / SHORT.step) * FINE
            pose = tracker.pose(tracker.time)
            assert pose is not None
            held_at.append(held(pose, track[min(at, len(track) - 1)]))  # before the start they stand
            low, high = step.ranges[f"{name}.traction"]
            held_at.append(low - 1e-9 <= TRACTIONS[name] <= high + 1e-9)

    began = loop.options.lead(SHORT.step) * SHORT.step
    outcome = drive(loop, driven, driven, listener=look)
    assert (outcome.ending, outcome.start) == ("success", began)
    assert len(held_at) == 6 * len(outcome.steps)
    assert all(held_at)
    for name, each in driven.robots.items():
        assert clearance(SHORT, each) > 0, name
        assert SHORT.regions["goal"].margin(each.pose[:2]) > 0, name
        low, high = outcome.steps[-1].ranges[f"{name}.traction"]
        assert high - low < 0.06
    assert outcome.paths["blue"].shape == (51, 2)


def silenced(driven: SimulatedFleet, name: str, at: float) -> SimulatedFleet:
    """A fleet of which one robot says nothing from a time on."""
    read = driven.read

    def reading() -> dict[str, Measurement]:
        return {each: seen for each, seen in read().items() if each != name or driven.now() < at}

    driven.read = reading  # type: ignore[method-assign]
    return driven


def run_silenced() -> tuple[SimulatedFleet, Receding, Outcome, list[PoseSet]]:
    """Green falls silent on the way; its sets from then on, each of which has to hold it."""
    driven = silenced(fleet(), "green", 2.5)
    loop = loop_of(driven, silence=1.0)
    sets: list[PoseSet] = []
    began = loop.options.lead(SHORT.step)

    def look(step: Step, controls: Floats) -> None:
        at, poses = loop._now()
        if driven.now() > 2.5:
            sets.append(poses["green"])
            assert held(poses["green"], driven.robots["green"].track[(began + at) * FINE])

    return driven, loop, drive(loop, driven, driven, listener=look), sets


def test_the_set_of_a_silent_robot_grows_and_then_all_stop() -> None:
    driven, loop, outcome, sets = run_silenced()
    sizes = [pose.away for pose in sets]
    assert outcome.ending == "stopped"
    assert outcome.reason.startswith("green has said nothing for")
    assert len(sizes) >= 2
    assert (np.diff(sizes) >= -1e-12).all()
    assert sizes[-1] > sizes[0]
    assert loop.trackers["red"].time > loop.trackers["green"].time + 0.5
    there = {name: each.pose.copy() for name, each in driven.robots.items()}
    driven.wait(driven.now() + 2.0)
    for name, each in driven.robots.items():
        assert (each.pose == there[name]).all()
        assert clearance(SHORT, each) > 0


def test_a_receding_horizon_takes_them_where_they_are_to_stay() -> None:
    problem = SHORT.with_(
        task=parse("G in(goal) and G avoid(obstacles)"),
        regions={"goal": Polyhedron.box([[-1.0, 3.0], [-1.0, 1.0]])},
        duration=2.0,
        steps=20,
    )
    driven = SimulatedFleet({"red": robot(0.95, 1), "blue": robot(1.08, 2, delay=0.3)})
    changes = options(horizon="receding", run_for=5.0, deadline=0.5)
    loop = Receding(problem, changes, timer=process_time, robots=tuple(driven.robots))
    outcome = drive(loop, driven, driven)
    assert outcome.ending == "success"
    for each in driven.robots.values():
        assert clearance(problem, each) > 0
        assert np.linalg.norm(each.pose[:2] - [2.4, 0.0]) < 0.4


def test_what_is_proven_of_all_is_proven_of_each() -> None:
    """One robot that is too near the block spoils the proof, and only it."""
    loop = loop_of(fleet())
    loop.observe({name: Measurement(0.0, 0.0, 0.0, 0.0) for name in TRACTIONS})
    at, poses = loop._now()
    each = {name: loop._certified(loop.plan, at, {name: pose}) for name, pose in poses.items()}
    assert all(found.proven for found in each.values())
    assert loop._certified(loop.plan, at, poses).proven
    astray = {**poses, "green": replace(poses["green"], position=np.array([0.0, -0.6]))}
    spoilt = loop._certified(loop.plan, at, astray)
    assert not spoilt.proven
    assert spoilt.worst.startswith("green: ")
    assert spoilt.least == loop._certified(loop.plan, at, {"green": astray["green"]}).least


def test_plans_are_for_the_members_of_all() -> None:
    """Side by side, each robot's with its own place, ranges and past, to which a silent one's is carried along."""
    loop = loop_of(fleet())
    places = {name: np.array([0.005 * k, -0.005 * k]) for k, name in enumerate(TRACTIONS)}
    loop.step({name: Measurement(0.0, float(place[0]), float(place[1]), 0.0) for name, place in places.items()})
    loop.trackers["blue"].sets.ranges = np.array([[1.05, 1.1]])
    start = loop._present(loop.plan)
    for k, name in enumerate(TRACTIONS):
        rows = start.coefficients.reshape(3, -1, 5)[k]
        np.testing.assert_allclose(rows[:, 3:], np.tile(places[name], (len(rows), 1)), atol=1e-3)
        low, high = loop.trackers[name].ranges[0]
        assert ((rows[:, 0] > low) & (rows[:, 0] < high)).all()
    way = SHORT.fleet.arcs.paths(loop.plan, SHORT.fleet.coefficients(np.array([[1.0]])), SHORT.step)[0]
    seen = Measurement(0.8, float(way[8, 0]), float(way[8, 1]), headed(loop.plan, 8))
    loop.observe(dict.fromkeys(("red", "green"), seen))
    later = loop._present(loop.plan)
    assert (later.at, later.path.shape) == (8, (8, 3, 2))
    np.testing.assert_allclose(later.path[:, 2], places["blue"] + 1.075 * way[:8], atol=0.02)


def headed(controls: Floats, steps: int) -> float:
    """Where a robot that began at heading 0 is headed after some steps."""
    return SHORT.step * float(controls[:steps, 1].sum())


BOUNDS = st.floats(-1.0, 1.0)
CERTIFICATES = st.builds(
    lambda a, b: SetCertificate(a >= 0 and b >= 0, a, b, "a part", 0.1),
    BOUNDS,
    BOUNDS,
)


@given(st.dictionaries(st.sampled_from(["red", "green", "blue"]), CERTIFICATES, min_size=1))
def test_a_joint_proof_is_the_weakest(found: dict[str, SetCertificate]) -> None:
    joint = together(found)
    assert joint.proven == all(each.proven for each in found.values())
    assert joint.proven == (joint.least >= 0)
    assert joint.least == min(each.least for each in found.values())


def test_names_are_checked() -> None:
    loop = loop_of(fleet())
    with pytest.raises(ProblemError, match="expected by name, of red, green, blue, got one without"):
        loop.observe(Measurement(0.0, 0.0, 0.0, 0.0))
    with pytest.raises(ProblemError, match="expected of red, green, blue, got one of 'pink'"):
        loop.observe({"pink": Measurement(0.0, 0.0, 0.0, 0.0)})
    with pytest.raises(ProblemError, match="robots: expected different names"):
        Receding(SHORT, options(), plan(), robots=("red", "red"))


def test_without_a_measurement_of_each_nobody_starts() -> None:
    loop = loop_of(fleet())
    controls = loop.step({"red": Measurement(0.0, 0.0, 0.0, 0.0)})
    assert (controls[:, 0] == 0).all()
    assert loop.stopped == "there is no measurement of green"
