"""Plays a saved plan: ``ros2 run ensemble_ctrl_ros play --ros-args -p plan:=/path/to/plans/office``."""

from __future__ import annotations

import rclpy

import ensemble_ctrl as ec
from ensemble_ctrl_ros.node import CommandNode

WAIT = 1.0
"""Seconds until the first command, in which subscribers are found."""


class PlayNode(CommandNode):
    """The commands of a plan at their times; then rest, and the end."""

    def __init__(self) -> None:
        super().__init__("ensemble_ctrl_play")
        plan = ec.Plan.load(self.declare_parameter("plan", "").value)
        if plan.certificate is None or plan.certificate.proven != "yes":
            self.get_logger().warning("this plan is not proven")
        self.start(plan.problem).send(self.now() + WAIT, plan.controls)
        self.ends = self.broadcast.ends

    def publish(self) -> None:
        """As of any command; after the last one the fleet rests, and the node ends."""
        super().publish()
        if self.now() > self.ends:
            raise SystemExit(0)


def main() -> None:
    """Play until the end, or until someone stops it."""
    rclpy.init()
    node = PlayNode()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, SystemExit):
        node.broadcast.stop()
        CommandNode.publish(node)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
