"""Commands as messages: by the kind of the system, the same topics as in a bag of ``ensemble-plan export``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Fill = Callable[[Any, Floats], None]


def topic_of(problem: Problem) -> tuple[str, str, str, Fill]:
    """Topic, package and name of the message type, and what fills a message with a command.

    Notes
    -----
    A unicycle's heading may count from +y, clockwise; a Twist's turn rate is counter-clockwise all the same.
    """
    system = problem.fleet.system
    sign = -1.0 if getattr(system, "heading_from", "x") == "y" else 1.0

    def twist(message: Any, command: Floats) -> None:
        message.twist.linear.x, message.twist.angular.z = float(command[0]), sign * float(command[1])

    def drive(message: Any, command: Floats) -> None:
        message.drive.speed, message.drive.steering_angle = float(command[0]), sign * float(command[1])

    def numbers(message: Any, command: Floats) -> None:
        message.data = command.tolist()

    known = {
        "twist": ("cmd_vel", "geometry_msgs.msg", "TwistStamped", twist),
        "drive": ("ackermann_cmd", "ackermann_msgs.msg", "AckermannDriveStamped", drive),
    }
    return known.get(system.command_kind, ("commands", "std_msgs.msg", "Float64MultiArray", numbers))


def rest_of(problem: Problem) -> Floats:
    """The command of a fleet that stands: the middle member's at rest."""
    fleet = problem.fleet
    if fleet.system.command_kind:
        return np.zeros(len(fleet.input_lower))
    return np.asarray(fleet.rest(fleet.center))
