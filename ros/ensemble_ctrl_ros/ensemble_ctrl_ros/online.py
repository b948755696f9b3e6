"""Replans from measured poses: ``ros2 run ensemble_ctrl_ros online --ros-args -p problem:=/path/to/problem.yaml``."""

from __future__ import annotations

import threading
import time
from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped

import ensemble_ctrl as ec
from ensemble_ctrl.planning.online.driver import Outcome, drive
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.measurement import Measurement
from ensemble_ctrl_ros.broadcast import yaw_of
from ensemble_ctrl_ros.node import CommandNode


class OnlineNode(CommandNode):
    """Poses in, commands out; planning is in a thread of its own, so that commands are published on time.

    The clock of the poses' stamps has to be the node's own (``use_sim_time``, or one machine).
    """

    def __init__(self) -> None:
        super().__init__("ensemble_ctrl_online")
        self.loop = Receding(ec.load(self.declare_parameter("problem", "").value))
        self.start(self.loop.problem)
        self.create_subscription(PoseStamped, "pose", self.on_pose, 1)
        self.outcome: Outcome | None = None

    def on_pose(self, message: Any) -> None:
        """A measured pose, at the time of its stamp."""
        stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        place, q = message.pose.position, message.pose.orientation
        self.broadcast.observe(Measurement(stamp - self.began, place.x, place.y, yaw_of(q.w, q.x, q.y, q.z)))

    def wait(self, until: float) -> None:
        """Sleep until a time of the node's clock."""
        while (left := until - self.now()) > 0:
            time.sleep(min(left, 0.02))

    def run(self) -> None:
        """Run the loop to its end."""
        self.outcome = drive(self.loop, self.broadcast, self, wanted=lambda: not rclpy.ok())
        self.get_logger().info(f"{self.outcome.ending}: {self.outcome.reason or 'the task is done'}")


def main() -> None:
    """Plan and publish until the end, or until someone stops it."""
    rclpy.init()
    node = OnlineNode()
    planner = threading.Thread(target=node.run)
    planner.start()
    try:
        while planner.is_alive() and rclpy.ok():
            rclpy.spin_once(node, timeout_sec=0.1)
    except KeyboardInterrupt:
        pass
    finally:
        node.broadcast.stop()
        node.publish()
        rclpy.try_shutdown()
        planner.join()
        node.destroy_node()
