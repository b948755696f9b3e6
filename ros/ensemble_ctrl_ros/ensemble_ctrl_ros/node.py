"""What both nodes share: a clock that starts at zero, and a timer that publishes the command of the present."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from rclpy.node import Node

from ensemble_ctrl.problem import Problem
from ensemble_ctrl_ros.broadcast import Broadcast
from ensemble_ctrl_ros.commands import rest_of, topic_of

RATE = 5
"""Messages for each control step: a lost one does little harm."""


class CommandNode(Node):  # type: ignore[misc]
    """Publishes what a `Broadcast` holds for the present."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.began = self.seconds()

    def start(self, problem: Problem) -> Broadcast:
        """Publish from now on; what is sent to the broadcast is played."""
        topic, module, kind, self.fill = topic_of(problem)
        self.kind = getattr(import_module(module), kind)
        self.publisher = self.create_publisher(self.kind, topic, 1)
        self.broadcast = Broadcast(problem.step, rest_of(problem))
        self.timer = self.create_timer(problem.step / RATE, self.publish)
        return self.broadcast

    def seconds(self) -> float:
        """The node's clock."""
        return float(self.get_clock().now().nanoseconds) * 1e-9

    def now(self) -> float:
        """Seconds since the node began."""
        return self.seconds() - self.began

    def publish(self) -> None:
        """The command of the present."""
        message: Any = self.kind()
        if hasattr(message, "header"):
            message.header.stamp = self.get_clock().now().to_msg()
        self.fill(message, self.broadcast.command_at(self.now()))
        self.publisher.publish(message)
