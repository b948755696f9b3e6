"""Loops of robots with errors of the model: simulated ones keep to the bounds, and what is said of them is so."""

from __future__ import annotations

from time import process_time

import numpy as np
import pytest

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.driver import drive
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.measurement import Measurement
from ensemble_ctrl.planning.online.membership import Membership
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.propagation import Commands, Errors
from ensemble_ctrl.planning.online.settings import OnlineSettings, RobotSettings
from ensemble_ctrl.planning.online.simulated import Fixed, Flaws, SimulatedRobot
from ensemble_ctrl.planning.online.simulated_errors import ErrorKind, SimulatedErrors
from ensemble_ctrl.planning.online.tracker import Tracker
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.terrain import Patch
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.systems import Bicycle, Unicycle
from tests.examples import quick

from .problems import FLEET, SHORT, clearance, options, plan

BOUNDS = Uncertainty({"position": 0.01, "heading": 0.01}, varies={"traction": 0.01}, heading_hold=0.5)
KINDS: tuple[ErrorKind, ...] = ("random", "bang-bang", "constant")
CHUNKS, SIZE = 8, 3
"""Batches of robots, each of which goes to the end."""


def driven(fleet: Fleet, controls: np.ndarray, kind: str, seed: int = 0, a: float = 1.0) -> SimulatedRobot:
    """A robot that has carried some commands out."""
    off = SimulatedErrors(fleet, 0.1, kind, seed)  # type: ignore[arg-type]
    robot = SimulatedRobot(fleet.arcs, np.zeros(2), 0.0, 0.1, Fixed(a, a), Flaws(), seed, off)
    robot.send(0.0, controls)
    robot.wait(len(controls) * 0.1)
    return robot


def fleet_of(bounds: Uncertainty, system: Unicycle | Bicycle | None = None) -> Fleet:
    """Robots that go to the origin's right, with a traction near 1."""
    most = np.array([2.0, 1.0])
    return Fleet(system or Unicycle(), FLEET.parameters, np.zeros(2), 0.0, -most, most, uncertainty=bounds)


# --- the simulated robot


def test_a_constant_disturbance_adds_up_to_its_bound() -> None:
    robot = driven(fleet_of(Uncertainty({"x": 0.01})), np.array([[1.0, 0.0]] * 20), "constant")
    assert abs(robot.pose[0] - 2.0) == pytest.approx(0.02)
    assert robot.pose[1:] == pytest.approx([0.0, 0.0])


def test_a_heading_that_is_held_keeps_near_that_of_the_model() -> None:
    bounds, controls = Uncertainty({"heading": 0.02}, heading_hold=0.5), np.array([[1.0, 0.4]] * 60)
    held = driven(fleet_of(bounds), controls, "constant")
    assert abs(held.pose[2] - 2.4) == pytest.approx(0.01, rel=1e-3)
    free = driven(fleet_of(bounds.with_(heading_hold=None)), controls, "constant")
    assert abs(free.pose[2] - 2.4) == pytest.approx(0.12)


def test_commands_and_factors_are_off_by_their_shares() -> None:
    robot = driven(fleet_of(Uncertainty(shares={"v": 0.1})), np.array([[1.0, 0.0]] * 10), "constant")
    assert abs(robot.pose[0] - 1.0) == pytest.approx(0.1)
    robot = driven(fleet_of(Uncertainty(varies={"traction": 0.02})), np.array([[1.0, 0.0]] * 10), "constant", a=1.1)
    assert abs(robot.pose[0] - 1.1) == pytest.approx(0.022)


@pytest.mark.parametrize("system", [Unicycle(), Unicycle("y"), Bicycle(wheelbase=0.4)])
def test_without_errors_it_is_the_model(system: Unicycle | Bicycle) -> None:
    controls = np.array([[1.0, 0.4]] * 10)
    robot = driven(fleet_of(BOUNDS, system), controls, "none")
    plain = SimulatedRobot(system, np.zeros(2), 0.0, 0.1)
    plain.send(0.0, controls)
    plain.wait(1.0)
    assert robot.pose == pytest.approx(plain.pose)


def test_how_errors_go() -> None:
    steps = {kind: driven(fleet_of(Uncertainty({"x": 1.0})), np.array([[1.0, 0.0]] * 200), kind) for kind in KINDS}
    pushed = {kind: np.diff(np.array(robot.track)[::10, 0]) - 0.1 for kind, robot in steps.items()}
    assert np.ptp(pushed["constant"]) < 1e-9
    assert sorted(set(np.round(pushed["bang-bang"], 6))) == [-0.1, 0.1]
    assert (np.diff(np.sign(pushed["bang-bang"])) != 0).sum() >= 2
    assert len(set(np.round(pushed["random"], 6))) > 100
    with pytest.raises(ProblemError, match=r"robot.errors: expected random, bang-bang, constant, none, got 'worst'"):
        SimulatedErrors(FLEET, 0.1, "worst")  # type: ignore[arg-type]


def test_a_robot_that_stands_is_not_moved() -> None:
    robot = driven(fleet_of(BOUNDS), np.zeros((10, 2)), "constant")
    assert (robot.pose == 0).all()


@pytest.mark.parametrize("kind", KINDS)
def test_commands_come_late_by_one_delay_and_by_less_than_the_jitter(kind: str) -> None:
    bounds, controls = Uncertainty(delay=0.25, jitter=0.02), np.array([[1.0, 0.0], [0.0, 0.0]] * 10)
    for seed in range(4):
        robot = driven(fleet_of(bounds), np.concatenate([controls, np.zeros((3, 2))]), kind, seed)
        assert robot.errors is not None
        assert 0 <= robot.errors.delay <= 0.25
        # it drives in every second step, a little longer or shorter than that takes
        moves = np.flatnonzero(np.diff(np.array(robot.track)[:, 0]) > 0)
        first = moves[0] / 100
        assert -0.021 - 0.01 <= first - robot.errors.delay <= 0.021
        assert abs(robot.pose[0] - 1.0) <= 10 * 2 * 0.02 + 1e-9


def test_on_a_patch_it_has_what_the_patch_allows() -> None:
    mud = {"mud": Patch((Obstacle.box([[0.5, 1.0], [-1.0, 1.0]]),), {"traction": (0.5, 0.8)})}
    speeds = set()
    for seed in range(6):
        off = SimulatedErrors(FLEET, 0.1, "constant", seed, mud)
        robot = SimulatedRobot(FLEET.arcs, np.zeros(2), 0.0, 0.1, Fixed(1.1, 1.1), Flaws(), seed, off)
        robot.send(0.0, np.array([[1.0, 0.0]] * 20))
        robot.wait(2.0)
        x = np.array(robot.track)[:, 0]
        rate = np.diff(x) / 0.01
        inside = (x[:-1] > 0.52) & (x[1:] < 0.98)
        assert rate[(x[1:] < 0.5) | (x[:-1] > 1.0)] == pytest.approx(1.1)
        assert np.ptp(rate[inside]) < 1e-9
        speeds.add(round(float(rate[inside][0]), 9))
    assert speeds == {0.5, 1.1}


# --- sets


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("hold", [None, 0.3])
def test_the_pose_is_in_the_set_whatever_the_errors(kind: str, hold: float | None) -> None:
    bounds = BOUNDS.with_(heading_hold=hold, actuators={"v": 0.02, "omega": 0.01})
    fleet, rng = fleet_of(bounds), np.random.default_rng(3)
    controls = np.repeat(rng.uniform([0.2, -0.8], [1.0, 0.8], (10, 2)), 6, axis=0)
    robot = driven(fleet, controls, kind, 5, 1.05)
    sets, commands = Membership(fleet, Errors(0.002, 0.005)), Commands(fleet, controls, 0.1)
    for k in range(0, 60, 7):
        seen = robot.track[10 * k] + rng.uniform(-1, 1, 3) * [0.002, 0.002, 0.005]
        assert sets.observe(commands, 0.1 * k, seen[:2], float(seen[2]))
        assert sets.ranges[0, 0] <= 1.05 <= sets.ranges[0, 1]
        for at in (k, min(k + 10, 60), k // 2):
            pose, true = sets.pose(commands, 0.1 * at), robot.track[10 * at]
            assert pose is not None
            assert (np.abs(true[:2] - pose.position) <= pose.half).all()
            assert abs(true[2] - pose.heading) <= pose.turn


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("hold", [None, 0.3])
def test_a_robot_that_is_late_is_in_the_sets(kind: str, hold: float | None) -> None:
    bounds = BOUNDS.with_(heading_hold=hold, delay=0.17, jitter=0.03)
    fleet, rng = fleet_of(bounds), np.random.default_rng(4)
    controls = np.repeat(rng.uniform([-0.2, -0.8], [1.0, 0.8], (20, 2)), 3, axis=0)
    for seed in range(3):
        robot = driven(fleet, controls, kind, seed, 0.95)
        sets, commands = Membership(fleet, Errors(0.002, 0.005)), Commands(fleet, controls, 0.1)
        for k in range(0, 60, 4):
            seen = robot.track[10 * k] + rng.uniform(-1, 1, 3) * [0.002, 0.002, 0.005]
            assert sets.observe(commands, 0.1 * k, seen[:2], float(seen[2]))
            assert sets.ranges[0, 0] <= 0.95 <= sets.ranges[0, 1]
            for at in (k, min(k + 5, 60), k // 2):
                pose, true = sets.present(commands, 0.1 * at), robot.track[10 * at]
                assert pose is not None
                assert (np.abs(true[:2] - pose.position) <= pose.half).all()
                assert abs(true[2] - pose.heading) <= pose.turn


def test_a_held_heading_stays_known() -> None:
    controls = np.array([[0.5, 0.2]] * 100)
    turns = []
    for hold in (None, 0.5):
        fleet = fleet_of(Uncertainty({"heading": 0.02}, heading_hold=hold))
        sets, commands = Membership(fleet, Errors(0.01, 0.01)), Commands(fleet, controls, 0.1)
        sets.ranges = np.array([[1.0, 1.0]])
        sets.observe(commands, 0.0, np.zeros(2), 0.0)
        pose = sets.pose(commands, 10.0)
        assert pose is not None
        turns.append(pose.turn)
    assert turns == pytest.approx([0.01 + 10 * 0.02, 0.01 + 2 * 0.5 * 0.02], abs=1e-6)


# --- loops


@pytest.mark.parametrize("chunk", quick(range(CHUNKS), 1))
def test_robots_with_errors_hit_nothing_and_contradict_nothing(chunk: int) -> None:
    problem = SHORT.with_(fleet=FLEET.with_(uncertainty=BOUNDS))
    for seed in range(chunk * SIZE, (chunk + 1) * SIZE):
        settings = OnlineSettings(options(), {"robot": RobotSettings(seed=seed, errors=KINDS[seed % 3])})
        fleet = settings.simulated(problem)
        loop = Receding(problem, options(), plan(), process_time)
        outcome = drive(loop, fleet, fleet)
        assert loop.holds
        assert outcome.ending in ("success", "finished")
        assert clearance(problem, fleet.robots["robot"]) > 0


@pytest.mark.parametrize("chunk", quick(range(2), 2))
def test_loops_prove_what_late_robots_on_terrain_do(chunk: int) -> None:
    """Gravel across the way and mud beside it: all plans are proven, and no robot comes closer than that."""
    late = Uncertainty({"position": 0.005}, delay=0.04, jitter=0.002) if chunk % 2 else Uncertainty()
    terrain = {
        "gravel": Patch((Obstacle.box([[0.4, 0.6], [-2.0, 2.0]]),), {"linear_traction": (0.8, 1.0)}),
        "mud": Patch((Obstacle.box([[0.9, 1.3], [0.7, 2.0]]),), {"traction": (0.4, 1.2)}),
    }
    problem = SHORT.with_(fleet=FLEET.with_(uncertainty=late), terrain=terrain)
    for seed in range(2):
        settings = OnlineSettings(options(), {"robot": RobotSettings(seed=seed, errors=KINDS[seed + 1])})
        fleet = settings.simulated(problem)
        loop, robot = Receding(problem, options(), plan(), process_time), fleet.robots["robot"]
        outcome = drive(loop, fleet, fleet)
        assert loop.holds
        assert outcome.ending == "success"
        assert clearance(problem, robot) > max(step.clearance for step in outcome.steps[:1])
        begin = round(outcome.start / 0.1)
        for k, pose in enumerate(loop.trackers["robot"].past):
            true = robot.track[10 * (begin + k)]
            assert (np.abs(true[:2] - pose.position) <= pose.half).all()
            assert abs(true[2] - pose.heading) <= pose.turn


def test_a_heading_that_was_let_go_before_may_lead_into_a_patch_beside_the_way() -> None:
    """Bends come before a straight way on which no command has an error: the heading goes back, towards the mud."""
    tau, share, step, bend = 3.0, 0.15, 0.1, 30
    fleet = fleet_of(Uncertainty(shares={"omega": share}, heading_hold=tau)).with_(
        parameters={"traction": Interval(1.0, 1.0)}
    )
    controls = np.repeat([[0.2, 1.0], [1.0, 0.0]], bend, axis=0)

    def driven_on(mud: Patch | None) -> np.ndarray:
        """The robot that turns too far for the whole bend, and is slow in the mud, at the grid times."""
        x, y, model, off, parts = 0.0, 0.0, 0.0, 0.0, 50
        poses = [(x, y, 0.0)]
        for v, omega in controls:
            for _ in range(parts):
                inside = mud is not None and bool(mud.contains(np.array([x, y])))
                way, heading = v * step / parts * (0.3 if inside else 1.0), model + off
                x, y = x + way * np.cos(heading), y + way * np.sin(heading)
                model, off = model + omega * step / parts, off + (share * omega - off / tau) * step / parts
            poses.append((x, y, model + off))
        return np.array(poses)

    start = driven_on(None)[bend]
    along = np.array([np.cos(start[2]), np.sin(start[2])])
    aside = np.array([along[1], -along[0]])  # to the right, where the heading goes back to
    corners = [(0.3, 0.15), (4.0, 0.15), (4.0, 3.0), (0.3, 3.0)]
    mud = Patch((Obstacle.polygon([start[:2] + a * along + b * aside for a, b in corners]),), {"traction": (0.3, 1.0)})
    problem = SHORT.with_(
        fleet=fleet, terrain={"mud": mud}, duration=6.0, steps=2 * bend, task=parse("F[5,6] in(goal)")
    )
    tracker = Tracker(problem, Errors(1e-3, 1e-3), True)
    tracker.observe(Measurement(0.0, 0.0, 0.0, 0.0))
    tracker.send(controls)
    assert tracker.observe(Measurement(bend * step, *start)) == []
    pose = tracker.onset(bend)
    assert pose is not None
    late = np.linalg.norm(driven_on(mud)[-1, :2] - driven_on(None)[-1, :2])
    assert late > 0.5
    assert tracker.departures(controls[bend:], bend, pose)[-1] >= late


def test_a_patch_beside_the_way_is_kept_out_of() -> None:
    """As an obstacle of the program, for no proof: one that the plan crosses is not."""
    mud = Patch((Obstacle.box([[0.9, 1.3], [0.7, 2.0]]),), {"traction": (0.4, 1.2)})
    gravel = Patch((Obstacle.box([[0.4, 0.6], [-2.0, 2.0]]),), {"linear_traction": (0.8, 1.0)})
    loop = Receding(SHORT.with_(terrain={"mud": mud, "gravel": gravel}), options(), plan())
    assert loop.trackers["robot"].kept_out == {"mud"}
    assert "mud" not in loop.problem.obstacles


def test_a_robot_with_larger_errors_than_assumed_is_noticed() -> None:
    problem = SHORT.with_(fleet=FLEET.with_(uncertainty=BOUNDS))
    worse = RobotSettings(Fixed(), errors="constant", uncertainty=BOUNDS.scaled(20.0))
    fleet = OnlineSettings(options(), {"robot": worse}).simulated(problem)
    loop = Receding(problem, options(), plan(), process_time)
    assert drive(loop, fleet, fleet).ending != "success"
    assert not loop.holds


def test_a_proof_counts_how_far_a_heading_had_been_let_go() -> None:
    """A robot that was off by all that its loop lets it be, when it was measured, may turn back on the way."""
    problem = SHORT.with_(fleet=FLEET.with_(uncertainty=Uncertainty({"heading": 0.05}, heading_hold=2.0)))
    loop = Receding(problem, OnlineOptions(errors=Errors(0.001, 0.001)), plan())
    onwards = loop.trackers["robot"].onwards
    assert onwards.disturbance["heading"] == pytest.approx(0.1)
    assert onwards.heading_hold == 2.0
    assert problem.fleet.uncertainty.disturbance["heading"] == 0.05
