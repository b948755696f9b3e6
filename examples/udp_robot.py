"""The loop with a robot in a process of its own: JSON datagrams on the loopback, in real time.

    python examples/udp_robot.py [--traction 1.07] [--log FILE]

The robot (``--robot PORT``, started by the loop) knows nothing of plans.  Ten times a second it sends its pose,
``{"time": .., "x": .., "y": .., "heading": ..}``, and it takes ``{"begin": .., "controls": [[v, omega], ..]}``:
commands of 0.1 s each from a time on, in place of what it was told before.  With none left it stands.
``{"hello": true}`` sets its clock to 0, ``{"stop": true}`` stops it, ``{"quit": true}`` ends it.

A robot trusts nobody: it hears the loop that started it and no other sender, passes over what it does not understand,
drives no faster than its own bounds, and follows a command for that command's time only.
"""

from __future__ import annotations

import argparse
import json
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

import ensemble_ctrl as ec
from ensemble_ctrl.planning.online.driver import Outcome, drive
from ensemble_ctrl.planning.online.log import RunLog
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.measurement import Measurement
from ensemble_ctrl.planning.online.robot import WallClock
from ensemble_ctrl.planning.online.simulated import Fixed, Flaws, SimulatedRobot

PROBLEM = """
name: udp
fleet:
  model: unicycle
  parameters: {traction: {range: [0.85, 1.15]}}
  start: {position: [0, 0], heading: 0 deg}
  input_bounds: {v: [-1, 1], omega: [-1.5, 1.5]}
  radius: 5 cm
horizon: {duration: 5 s, steps: 50}
regions: {goal: {box: [[2.0, 2.8], [-0.4, 0.4]]}}
obstacles: {block: {box: [[0.9, 1.3], [-0.5, 0.05]]}}
task: "F[4, 5] in(goal) and G avoid(obstacles)"
objective: {terminal: {target: [2.4, 0.0]}}
"""
LOOPBACK = "127.0.0.1"
LARGEST = 65_507
"""Bytes of a datagram."""
MOST = 1000
"""Commands in one message."""
WORDS = ("hello", "stop", "quit")
Commands = tuple[float, np.ndarray[Any, Any]]


def understood(datagram: bytes) -> dict[str, Any] | None:
    """The object in a datagram; None if there is none."""
    try:
        message = json.loads(datagram)
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) else None


def pose_in(datagram: bytes) -> Measurement | None:
    """The pose in a datagram; None if it is none, or not of finite numbers."""
    message = understood(datagram)
    if message is None or set(message) != {"time", "x", "y", "heading"} or not _numbers(list(message.values())):
        return None
    return Measurement(**message)


def commands_in(message: dict[str, Any], lower: Any, upper: Any, now: float, horizon: float) -> Commands | None:
    """When commands begin, and the commands within a robot's own bounds; None for what are none.

    Those begin at most `horizon` seconds away from now, earlier or later.
    """
    begin, rows = message.get("begin"), message.get("controls")
    if set(message) != {"begin", "controls"} or not isinstance(rows, list) or not 0 < len(rows) <= MOST:
        return None
    if not _numbers([begin]) or not all(isinstance(row, list) and len(row) == len(lower) for row in rows):
        return None
    if not all(_numbers(row) for row in rows) or abs(float(begin) - now) > horizon:
        return None
    return float(begin), np.clip(np.array(rows, dtype=float), lower, upper)


def _numbers(values: list[Any]) -> bool:
    """Whether all of some values are finite numbers."""
    return all(type(value) in (int, float) and abs(value) < 1e300 for value in values)  # NaN is not below anything


class UdpRobot:
    """A robot at the other end of a socket, as `ensemble_ctrl.planning.online.driver.drive` wants one."""

    def __init__(self, traction: float) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((LOOPBACK, 0))
        own = str(self.socket.getsockname()[1])
        self.process = subprocess.Popen([sys.executable, __file__, "--robot", own, "--traction", str(traction)])
        self.socket.settimeout(60.0)
        datagram, self.address = self.socket.recvfrom(LARGEST)
        while pose_in(datagram) is None:
            datagram, self.address = self.socket.recvfrom(LARGEST)
        self.socket.setblocking(False)

    def hello(self) -> WallClock:
        """Set the robot's clock to 0; returns ours, which starts with it."""
        self._tell(hello=True)
        return WallClock()

    def read(self) -> Measurement | None:
        """The newest pose that has arrived."""
        newest = None
        with suppress(BlockingIOError):
            while True:
                datagram, sender = self.socket.recvfrom(LARGEST)
                if sender == self.address:
                    newest = pose_in(datagram) or newest
        return newest

    def send(self, begin: float, controls: np.ndarray[Any, Any]) -> None:
        """Send commands."""
        self._tell(begin=begin, controls=controls.tolist())

    def stop(self) -> None:
        """Stand."""
        self._tell(stop=True)

    def close(self) -> None:
        """End the robot's process."""
        self._tell(quit=True)
        self.process.wait(timeout=10)
        self.socket.close()

    def _tell(self, **message: Any) -> None:
        with suppress(OSError):  # a robot that is gone hears nothing: silence tells the loop
            self.socket.sendto(json.dumps(message).encode(), self.address)


def be_the_robot(port: int, traction: float) -> None:
    """Drive in real time as commanded by datagrams of one peer, and send it the pose ten times a second."""
    peer = (LOOPBACK, port)
    problem = ec.load_text(PROBLEM)
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind((LOOPBACK, 0))
    link.setblocking(False)
    flaws = Flaws(position=0.01, heading=float(np.radians(1.0)))

    def fresh() -> SimulatedRobot:
        start = problem.fleet.start_place, problem.fleet.heading
        return SimulatedRobot(problem.fleet.system, *start, problem.step, Fixed(traction, traction), flaws, seed=1)

    bounds = problem.fleet.input_lower, problem.fleet.input_upper
    robot, clock = fresh(), WallClock()
    while True:
        with suppress(BlockingIOError, ConnectionError):
            while True:
                datagram, sender = link.recvfrom(LARGEST)
                message = understood(datagram) if sender == peer else None
                if message is None:
                    continue
                word = next((word for word in WORDS if message == {word: True}), "")
                if word == "quit":
                    return
                if word == "hello":
                    robot, clock = fresh(), WallClock()
                elif word == "stop":
                    robot.stop()
                elif commands := commands_in(message, *bounds, clock.now(), problem.duration):
                    robot.send(*commands)
        robot.wait(clock.now())
        pose = robot.read()
        if pose is not None:
            link.sendto(json.dumps(vars(pose)).encode(), peer)
        clock.wait(robot.now() + 0.01)


def run(traction: float, log: Path | None) -> Outcome:
    """Plan, start the robot, and drive it."""
    loop = Receding(ec.load_text(PROBLEM))
    robot = UdpRobot(traction)
    try:
        with RunLog(log or Path("/dev/null" if sys.platform != "win32" else "NUL")) as record:
            record.start(loop)
            outcome = drive(
                loop, robot, robot.hello(), listener=lambda step, controls: record.step(loop, step, controls)
            )
            record.end(outcome)
        return outcome
    finally:
        robot.close()


def main() -> None:
    """Run the loop, or be the robot."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--traction", type=float, default=1.07)
    parser.add_argument("--robot", type=int, metavar="PORT")
    parser.add_argument("--log", type=Path)
    given = parser.parse_args()
    if given.robot:
        be_the_robot(given.robot, given.traction)
        return
    outcome = run(given.traction, given.log)
    for step in outcome.steps:
        ranges = ", ".join(f"{name} {low:.3f} to {high:.3f}" for name, (low, high) in step.ranges.items())
        told = "; ".join(step.events)
        print(f"step {step.begin:3d}: {step.source}, proven {step.proof}, {1e3 * step.seconds:.0f} ms, {ranges} {told}")
    print(f"{outcome.ending}: {outcome.reason}")


if __name__ == "__main__":
    main()
