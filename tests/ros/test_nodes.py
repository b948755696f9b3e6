"""The ROS 2 nodes in a world with simulated time: what they publish, when, and that a bag of it can be read."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")

from rosbags.highlevel import AnyReader
from scipy.integrate import solve_ivp

import ensemble_ctrl as ec
from tests.paths import ROOT

from .world import World, blank

PACKAGE = ROOT / "ros" / "ensemble_ctrl_ros"
TASK = """\
name: lane
fleet: {{model: {model}, start: {{position: [0, 0], heading: {heading}}}, input_bounds: {{v: [-1, 1]}},
  parameters: {{traction: {{range: [0.95, 1.05]}}}}}}
horizon: {{duration: 3 s, steps: 30}}
regions: {{goal: {{box: [[1.4, 2.2], [-0.4, 0.4]]}}}}
obstacles: {{crate: {{box: [[0.7, 0.9], [0.1, 0.5]]}}}}
task: F[2.5, 3] in(goal) and G avoid(obstacles)
objective: {{terminal: {{target: [1.8, 0]}}}}
"""


@pytest.fixture
def nodes(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Makes a world with parameters, and a node's module in it."""
    monkeypatch.syspath_prepend(str(PACKAGE))

    def made(module: str, **parameters: str) -> tuple[World, Any]:
        world = World(parameters)
        world.install(monkeypatch)
        found = importlib.import_module(f"ensemble_ctrl_ros.{module}")
        if hasattr(found, "time"):
            monkeypatch.setattr(found, "time", world)
        return world, found

    return made


def saved(folder: Path, model: str = "unicycle", heading: str = "0 deg") -> ec.Plan:
    plan = ec.plan(ec.load_text(TASK.format(model=model, heading=heading), "lane"))
    plan.save(folder / "plan.npz")
    return plan


def test_a_plan_is_played_at_its_times_and_ends_at_rest(nodes: Any, tmp_path: Path) -> None:
    plan = saved(tmp_path)
    world, play = nodes("play", plan=str(tmp_path))
    node = play.PlayNode()
    with pytest.raises(SystemExit):
        world.sleep(10.0)
    sent: list[tuple[float, Any]] = [
        (t - node.began - play.WAIT, message) for t, topic, _, message in world.sent if topic == "cmd_vel"
    ]
    assert all(message.twist.linear.x == 0.0 for t, message in sent if t < -1e-6)
    for t, message in sent:
        if 0 <= t < 3.0 - 1e-6:
            v, omega = plan.controls[int(t / 0.1 + 1e-6)]
            assert (message.twist.linear.x, message.twist.angular.z) == (v, omega)
    times = [t for t, _ in sent]
    assert np.diff(times).max() < 0.03
    assert sent[-1][1].twist.linear.x == 0.0
    stamp = sent[5][1].header.stamp
    assert stamp.sec + stamp.nanosec * 1e-9 == pytest.approx(world.sent[5][0])


def test_a_bag_of_the_run_can_be_read(nodes: Any, tmp_path: Path) -> None:
    saved(tmp_path)
    world, play = nodes("play", plan=str(tmp_path))
    play.PlayNode()
    with pytest.raises(SystemExit):
        world.sleep(10.0)
    with AnyReader([world.record(tmp_path / "bag")]) as reader:
        read: list[Any] = [reader.deserialize(raw, connection.msgtype) for connection, _, raw in reader.messages()]
    assert len(read) == len(world.sent) > 150
    assert [one.twist.linear.x for one in read] == [message.twist.linear.x for _, _, _, message in world.sent]


def test_a_bicycles_commands_are_speed_and_steering(nodes: Any, tmp_path: Path) -> None:
    plan = saved(tmp_path, "bicycle")
    world, play = nodes("play", plan=str(tmp_path))
    play.PlayNode()
    world.sleep(play.WAIT + 0.5)
    drive = world.last("ackermann_cmd").drive
    assert [drive.speed, drive.steering_angle] == pytest.approx(plan.controls[5].tolist())


def test_a_plan_that_is_not_proven_says_so(nodes: Any, tmp_path: Path) -> None:
    problem = ec.load_text(TASK.format(model="unicycle", heading="0 deg"), "lane", ["verify.certificate=false"])
    ec.plan(problem).save(tmp_path / "plan.npz")
    world, play = nodes("play", plan=str(tmp_path))
    play.PlayNode()
    assert world.said == ["this plan is not proven"]


@pytest.mark.parametrize("traction", [0.96, 1.04])
def test_the_online_node_drives_a_robot_to_its_goal(nodes: Any, tmp_path: Path, traction: float) -> None:
    path = tmp_path / "lane.yaml"
    path.write_text(TASK.format(model="unicycle", heading="0 deg"), encoding="utf-8")
    world, online = nodes("online", problem=str(path))
    node = online.OnlineNode()
    pose, track = np.zeros(3), []
    due = world.t

    def moves(dt: float) -> None:
        nonlocal pose, due
        twist = world.last("cmd_vel").twist if world.last("cmd_vel") else None
        v, omega = (twist.linear.x, twist.angular.z) if twist else (0.0, 0.0)

        def rates(_: float, x: np.ndarray) -> list[float]:
            return [traction * v * np.cos(x[2]), traction * v * np.sin(x[2]), traction * omega]

        pose = solve_ivp(rates, (0.0, dt), pose, rtol=1e-9).y[:, -1]
        track.append(pose)
        if world.t >= due:
            due += 0.1
            message = blank("geometry_msgs/msg/PoseStamped")
            message.header.stamp = world.clock().to_msg()
            message.pose.position.x, message.pose.position.y = float(pose[0]), float(pose[1])
            message.pose.orientation.w, message.pose.orientation.z = np.cos(pose[2] / 2), np.sin(pose[2] / 2)
            world.heard["pose"](message)

    world.moves = moves
    node.run()
    assert node.outcome.ending == "success", world.said
    assert world.said[-1].startswith("success")
    places = np.array(track)[:, :2]
    inside = (np.abs(places - [0.8, 0.3]) < [0.1, 0.2]).all(axis=1)
    assert not inside.any()
    assert 1.4 < places[-1, 0] < 2.2
    world.sleep(0.2)
    assert world.last("cmd_vel").twist.linear.x == 0.0


def test_a_heading_from_y_turns_the_other_way(nodes: Any, tmp_path: Path) -> None:
    _, commands = nodes("commands")
    problem = ec.load_text(TASK.format(model="unicycle", heading="90 deg, heading_from: y"), "lane")
    topic, package, kind, fill = commands.topic_of(problem)
    message = blank("geometry_msgs/msg/TwistStamped")
    fill(message, np.array([0.5, 0.25]))
    assert (topic, f"{package}.{kind}") == ("cmd_vel", "geometry_msgs.msg.TwistStamped")
    assert (message.twist.linear.x, message.twist.angular.z) == (0.5, -0.25)


def test_commands_of_a_broadcast(nodes: Any) -> None:
    _, found = nodes("broadcast")
    broadcast = found.Broadcast(0.1, np.zeros(1))
    assert broadcast.command_at(0.0) == 0.0
    broadcast.send(1.0, np.array([[1.0], [2.0], [3.0]]))
    assert [float(broadcast.command_at(t)[0]) for t in (0.99, 1.0, 1.1, 1.25)] == [0.0, 1.0, 2.0, 3.0]
    broadcast.send(1.2, np.array([[7.0]]))  # in place of the third
    assert [float(broadcast.command_at(t)[0]) for t in (1.15, 1.2, 1.29, 1.31)] == [2.0, 7.0, 7.0, 0.0]
    broadcast.send(2.0, np.ones((5, 1)))
    broadcast.stop()
    assert broadcast.command_at(2.1) == 0.0


def test_only_the_newest_pose_is_read_and_only_once(nodes: Any) -> None:
    from ensemble_ctrl.planning.online.measurement import Measurement

    _, found = nodes("broadcast")
    broadcast = found.Broadcast(0.1, np.zeros(2))
    for time, x in ((1.0, 0.1), (1.2, 0.2), (1.1, 0.3), (1.3, float("nan"))):
        broadcast.observe(Measurement(time, x, 0.0, 0.0))
    assert broadcast.read().x == 0.2
    assert broadcast.read() is None


@pytest.mark.parametrize("angle", [0.0, 1.0, 3.0, -2.5])
def test_yaw_is_that_of_the_quaternion(nodes: Any, angle: float) -> None:
    from scipy.spatial.transform import Rotation

    _, found = nodes("broadcast")
    x, y, z, w = Rotation.from_euler("z", angle).as_quat()
    assert found.yaw_of(w, x, y, z) == pytest.approx(angle)


def test_the_package_names_what_is_there() -> None:
    import xml.etree.ElementTree as ET

    package = ET.parse(PACKAGE / "package.xml").getroot()
    assert package.findtext("name") == PACKAGE.name
    assert package.findtext("version") == ec.__version__
    assert (PACKAGE / "resource" / PACKAGE.name).is_file()
    assert {path.stem for path in (PACKAGE / PACKAGE.name).glob("*.py")} >= {"play", "online", "node", "broadcast"}
