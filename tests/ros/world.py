"""A stand-in for ROS: nodes, timers and topics in simulated time, with the real message types of ROS 2 Humble."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ensemble_ctrl.files.export.bag import _DEFINITIONS

STORE = get_typestore(Stores.ROS2_HUMBLE)
for _name, _text in _DEFINITIONS.items():
    STORE.register(get_types_from_msg(_text, _name))
FINE = 0.01
"""Seconds in which the world moves on."""


def blank(kind: str) -> Any:
    """A message of a type, all numbers zero, as ROS makes it."""
    definition = STORE.types[kind]
    _, fields = STORE.fielddefs[kind]
    return definition(**{name: _zero(*description) for name, description in fields})


def _zero(kind: Any, detail: Any) -> Any:
    """The value that ROS gives a field."""
    if kind.name == "NAME":
        return blank(detail)
    if kind.name == "BASE":
        return "" if detail[0] == "string" else 0.0 if detail[0].startswith("float") else 0
    inner, inner_detail = detail[0]
    return np.zeros(0) if inner.name == "BASE" and inner_detail[0].startswith("float") else []


@dataclass
class World:
    """Time, the nodes' timers, and everything that was published."""

    parameters: dict[str, str]
    t: float = 100.0
    timers: list[tuple[float, float, Callable[[], None]]] = field(default_factory=list)
    heard: dict[str, Callable[[Any], None]] = field(default_factory=dict)
    sent: list[tuple[float, str, str, Any]] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    moves: Callable[[float], None] = lambda dt: None

    def sleep(self, seconds: float) -> None:
        """Let time pass: timers fire, and the robot moves."""
        for _ in range(max(round(seconds / FINE), 1)):
            self.t += FINE
            for k, (due, period, call) in enumerate(self.timers):
                if self.t >= due - 1e-9:
                    self.timers[k] = (due + period, period, call)
                    call()
            self.moves(FINE)

    def last(self, topic: str) -> Any:
        """The newest message of a topic."""
        return next((message for _, name, _, message in reversed(self.sent) if name == topic), None)

    def record(self, folder: Path) -> Path:
        """Everything that was published, as a bag."""
        with Writer(folder, version=8) as writer:
            named = dict.fromkeys((name, kind) for _, name, kind, _ in self.sent)
            topics = {key: writer.add_connection(f"/{key[0]}", key[1], typestore=STORE) for key in named}
            for t, name, kind, message in self.sent:
                writer.write(topics[name, kind], round(t * 1e9), STORE.serialize_cdr(message, kind))
        return folder

    def clock(self) -> Any:
        """As a node's clock answers."""
        nanoseconds = round(self.t * 1e9)
        stamp = STORE.types["builtin_interfaces/msg/Time"](nanoseconds // 10**9, nanoseconds % 10**9)
        return SimpleNamespace(nanoseconds=nanoseconds, to_msg=lambda: stamp)

    def node_class(self) -> type:
        """`rclpy.node.Node` of this world."""
        world = self

        class Node:
            def __init__(self, name: str) -> None:
                self.name = name

            def declare_parameter(self, name: str, default: str) -> Any:
                return SimpleNamespace(value=world.parameters.get(name, default))

            def create_publisher(self, kind: Any, topic: str, depth: int) -> Any:
                sent, name = world.sent, kind.func_name
                return SimpleNamespace(publish=lambda message: sent.append((world.t, topic, name, message)))

            def create_subscription(self, kind: Any, topic: str, call: Callable[[Any], None], depth: int) -> None:
                world.heard[topic] = call

            def create_timer(self, period: float, call: Callable[[], None]) -> None:
                world.timers.append((world.t + period, period, call))

            def get_clock(self) -> Any:
                return SimpleNamespace(now=world.clock)

            def get_logger(self) -> Any:
                return SimpleNamespace(info=world.said.append, warning=world.said.append)

        return Node

    def install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Put stand-ins where the nodes import ROS from, and nodes that were imported before away."""
        for name in [name for name in sys.modules if name.startswith("ensemble_ctrl_ros")]:
            monkeypatch.delitem(sys.modules, name)
        modules: dict[str, dict[str, Any]] = {"rclpy": {"ok": lambda: True}, "rclpy.node": {"Node": self.node_class()}}
        for package, kinds in {
            "geometry_msgs": ("TwistStamped", "PoseStamped"),
            "ackermann_msgs": ("AckermannDriveStamped",),
            "std_msgs": ("Float64MultiArray",),
        }.items():
            modules |= {package: {}, f"{package}.msg": {kind: _maker(f"{package}/msg/{kind}") for kind in kinds}}
        for name, content in modules.items():
            module = ModuleType(name)
            vars(module).update(content)
            monkeypatch.setitem(sys.modules, name, module)


def _maker(kind: str) -> Any:
    """The class of a message: called without arguments it is a blank one."""
    make: Any = partial(blank, kind)
    make.func_name = kind
    return make
