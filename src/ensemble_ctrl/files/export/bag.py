"""A plan as a ROS 2 bag, written without ROS by ``rosbags`` (the extra ``ros``)."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import UnsupportedError
from ensemble_ctrl.core.storage import read_regular
from ensemble_ctrl.files.export.members import Members
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

FRAME = "map"
METADATA, MOST_METADATA = "metadata.yaml", 1_000_000
MARK = ("written_by", "ensemble-plan export")
"""What distinguishes an exported bag from a recorded one."""
COMMAND, DRIVE, COMMANDS = "/cmd_vel", "/ackermann_cmd", "/commands"
PATH = "/member_{}/path"
_ACKERMANN = "ackermann_msgs/msg/AckermannDrive"
_DEFINITIONS = {
    _ACKERMANN: "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\n"
    "float32 acceleration\nfloat32 jerk",
    f"{_ACKERMANN}Stamped": f"std_msgs/Header header\n{_ACKERMANN.replace('/msg', '')} drive",
}


def write_bag(path: Path, problem: Problem, controls: Floats, members: Members) -> None:
    """Write a bag: the commands at the start of each step, a stop at the end, and the path of each member.

    Parameters
    ----------
    path : Path
        A folder that does not exist.
    problem : Problem
        Whose plan it is.
    controls : ndarray, shape (steps, n_u)
        Broadcast commands.
    members : Members
        Whose paths are written.

    Raises
    ------
    UnsupportedError
        If ``rosbags`` is not installed.

    Notes
    -----
    A unicycle's commands are ``geometry_msgs/TwistStamped`` on ``/cmd_vel``, a bicycle's
    ``ackermann_msgs/AckermannDriveStamped`` on ``/ackermann_cmd``, whose numbers have single precision. Those of other
    systems are ``std_msgs/Float64MultiArray`` on ``/commands``, with the names in the label; the last one is the
    command at rest of the member in the middle of the ranges. Paths are ``nav_msgs/Path`` on ``/member_0/path`` and so
    on, in the frame ``map``, at time 0. Times count from 0.
    """
    try:
        from rosbags.rosbag2 import Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise UnsupportedError("rosbags is not installed: pip install 'ensemble-ctrl[ros]'") from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in _DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    messages = _Messages(store.types)
    with Writer(path, version=8) as writer:
        writer.set_custom_data(*MARK)

        def topic(name: str, kind: str) -> Any:
            connection = writer.add_connection(name, kind, typestore=store)
            return lambda t, message: writer.write(connection, _nanoseconds(t), store.serialize_cdr(message, kind))

        poses = _poses(problem, members)
        for k, (places, turns) in enumerate(poses):
            send = topic(PATH.format(k), "nav_msgs/msg/Path")
            send(0.0, messages.path(problem.times, places, turns))
        name, make = _commands(problem, messages)
        sent = [make(t, *u) for t, u in zip(problem.times, [*controls.tolist(), _last(problem)], strict=True)]
        send = topic(name, sent[0].__msgtype__)
        for t, message in zip(problem.times, sent, strict=True):
            send(t, message)


def _commands(problem: Problem, messages: _Messages) -> tuple[str, Callable[..., Any]]:
    """The topic of the commands, and what makes a message of a time and a command."""
    controls = problem.fleet.system.controls
    known = {"twist": (COMMAND, messages.twist), "drive": (DRIVE, messages.drive)}
    return known.get(problem.fleet.system.command_kind, (COMMANDS, partial(messages.numbers, ", ".join(controls))))


def _last(problem: Problem) -> list[float]:
    """What is sent at the end."""
    if problem.fleet.system.command_kind:
        return [0.0, 0.0]
    return [float(value) for value in problem.fleet.rest(problem.fleet.center)]


def _poses(problem: Problem, members: Members) -> list[tuple[Floats, Floats]]:
    """Places, shape (times, 3), and quaternions (x, y, z, w), shape (times, 4), of each member.

    A position that is named x, y or z is along that axis; others are along the axes that are left, in order.
    """
    values = members.values
    places = np.zeros((*values.shape[:2], 3))
    fleet = problem.fleet
    # positions under other names take the free axes in order; an axis without position stays 0
    left = [k for k, axis in enumerate("xyz") if axis not in fleet.places]
    for name in fleet.places:
        axis = "xyz".index(name) if name in tuple("xyz") else left.pop(0)
        places[..., axis] = values[..., fleet.system.states.index(name)]
    return [(place, fleet.system.attitude(x.T).T) for place, x in zip(places, values, strict=True)]


def is_own_bag(path: Path) -> bool:
    """Whether a folder holds a bag that `write_bag` wrote, and nothing else."""
    if path.is_symlink() or not path.is_dir():
        return False
    try:
        metadata = read_regular(path / METADATA, MOST_METADATA).decode()
    except (OSError, UnicodeDecodeError):
        return False
    own = all(re.search(rf"\b{word}\b", metadata) for word in MARK)
    return own and {entry.name for entry in path.iterdir()} == {METADATA, *re.findall(r"[\w.-]+\.db3\b", metadata)}


def _nanoseconds(t: float) -> int:
    """Seconds as nanoseconds."""
    return round(t * 1e9)


class _Messages:
    """Makes messages of the types in a store."""

    def __init__(self, types: Any) -> None:
        self._types = types

    def twist(self, t: float, speed: float, turn: float) -> Any:
        """Speed and turn rate."""
        twist = self._of("geometry_msgs/msg/Twist", self._vector(speed), self._vector(0.0, 0.0, turn))
        return self._of("geometry_msgs/msg/TwistStamped", self._header(t), twist)

    def drive(self, t: float, speed: float, steering: float) -> Any:
        """Speed and steering angle."""
        drive = self._of(_ACKERMANN, *(np.float32(x) for x in (steering, 0.0, speed, 0.0, 0.0)))
        return self._of(f"{_ACKERMANN}Stamped", self._header(t), drive)

    def numbers(self, label: str, t: float, *values: float) -> Any:
        """Any numbers, with their names as the label of the one dimension."""
        count = len(values)
        dimension = self._of("std_msgs/msg/MultiArrayDimension", label, count, count)
        layout = self._of("std_msgs/msg/MultiArrayLayout", [dimension], 0)
        return self._of("std_msgs/msg/Float64MultiArray", layout, np.array(values))

    def path(self, times: Floats, places: Floats, turns: Floats) -> Any:
        """The poses of one member at the grid times."""
        poses = [
            self._of("geometry_msgs/msg/PoseStamped", self._header(t), self._pose(place, turn))
            for t, place, turn in zip(times.tolist(), places.tolist(), turns.tolist(), strict=True)
        ]
        return self._of("nav_msgs/msg/Path", self._header(0.0), poses)

    def _pose(self, place: list[float], turn: list[float]) -> Any:
        """A place with an attitude."""
        point = self._of("geometry_msgs/msg/Point", *place)
        return self._of("geometry_msgs/msg/Pose", point, self._of("geometry_msgs/msg/Quaternion", *turn))

    def _vector(self, x: float, y: float = 0.0, z: float = 0.0) -> Any:
        """Three numbers."""
        return self._of("geometry_msgs/msg/Vector3", x, y, z)

    def _header(self, t: float) -> Any:
        """A time and the frame."""
        whole, rest = divmod(_nanoseconds(t), 1_000_000_000)
        return self._of("std_msgs/msg/Header", self._of("builtin_interfaces/msg/Time", whole, rest), FRAME)

    def _of(self, kind: str, *fields: Any) -> Any:
        """One message."""
        return self._types[kind](*fields)
