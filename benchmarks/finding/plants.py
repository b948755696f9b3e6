"""Systems of one's own: plants that swing up, tip over or run away, and a vehicle that can't stop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.systems.arrays import cos, sin

Floats = NDArray[np.float64]


class Pendulum(ec.OdeSystem):
    """A pendulum on a motor too weak to lift it at once; upright is at an angle of pi."""

    name, states, positions = "pendulum", ("first", "rate"), ("first",)
    controls, control_units, input_bounds = ("torque",), ("N m",), ((-4.0, 4.0),)
    parameters = {"damping": 0.2}

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        """Angle and rate."""
        return [x[1], u[0] - 9.81 * sin(x[0]) - psi["damping"] * x[1]]


class CartPole(ec.OdeSystem):
    """A cart with a pole that stands upright at an angle of zero, and falls."""

    name, states, positions = "cart_pole", ("first", "v", "angle", "rate"), ("first",)
    controls, control_units, input_bounds = ("force",), ("N",), ((-12.0, 12.0),)
    parameters = {"load": 0.15}

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        """Cart and pole of half a metre."""
        s, c, load = sin(x[2]), cos(x[2]), psi["load"]
        a = (u[0] + load * s * (0.5 * x[3] ** 2 - 9.81 * c)) / (1.0 + load * s**2)
        return [x[1], a, x[3], (9.81 * s - a * c) / 0.5]


class Escape(ec.OdeSystem):
    """A state that escapes in finite time where it is not held."""

    name, states, positions = "escape", ("first",), ("first",)
    controls, control_units, input_bounds = ("u",), ("1",), ((-2.0, 2.0),)
    parameters = {"k": 1.0}

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        """The square feeds itself."""
        return [psi["k"] * x[0] ** 2 + u[0]]


class Spin(ec.OdeSystem):
    """A spin (Bloch vector) under one drive, to be turned over: members differ in how strongly the drive acts."""

    name, states, positions = "spin", ("first", "y", "z"), ("first",)
    controls, control_units, input_bounds = ("drive",), ("rad/s",), ((-2.0, 2.0),)
    parameters = {"strength": 1.0}

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        """The Bloch equations, detuned by 0.1 rad/s, without decay."""
        drive = psi["strength"] * u[0]
        return [-0.1 * x[1], 0.1 * x[0] - drive * x[2], drive * x[1]]


class Glider(ec.OdeSystem):
    """A vehicle that can't stop, and turns in wide bends that it has to begin in time."""

    name, states, positions = "glider", ("x", "y", "yaw", "turn"), ("x", "y")
    controls, control_units, input_bounds = ("speed", "moment"), ("m/s", "1/s^2"), ((0.5, 1.0), (-0.6, 0.6))
    parameters = {"load": 1.0}

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        """Place, heading, and a turn rate with linear drag."""
        return [u[0] * cos(x[2]), u[0] * sin(x[2]), x[3], u[1] / psi["load"] - 0.8 * x[3]]


def pushes(model: type[ec.OdeSystem], rng: Generator, steps: int, step: float) -> Floats:
    """Commands that are worth knowing, found by driving the plant of the middle: shape (steps, 1)."""
    x, psi, rows = np.array([*START[model].values()]), model.parameters, []
    strength, phase = float(rng.uniform(0.7, 1.0)), float(rng.uniform(0.05, 0.15))
    top = model.input_bounds[0][1]
    for _ in range(steps):
        u = float(np.round(np.clip(POLICY[model](x, strength, phase), -top, top), 4))
        rows.append([u])
        for _ in range(20):
            x = x + step / 20 * np.array(model().xdot(x, [u], psi))
    return np.array(rows)


def pumped(x: Floats, strength: float, phase: float) -> float:
    """Push the pendulum the way that it swings."""
    return 4.0 * strength * float(np.sign(x[1] + phase))


def balanced(x: Floats, strength: float, phase: float) -> float:
    """A linear feedback that holds the pole upright and moves the cart."""
    return float(strength * (1.5 * (x[0] - phase) + 3.0 * x[1] + 32.0 * x[2] + 7.0 * x[3]))


def held(x: Floats, strength: float, phase: float) -> float:
    """Draw the state to a place below zero, where it rests, or nearly so."""
    return float(-(x[0] ** 2) - 2.0 * strength * (x[0] + phase))


def pulsed(x: Floats, strength: float, phase: float) -> float:
    """A drive that turns the spin by three quarters of a half turn or more in four seconds."""
    return float(np.pi / 4 * (0.4 + 0.6 * strength))


START: dict[type[ec.OdeSystem], dict[str, float]] = {
    Pendulum: {"first": 0.0, "rate": 0.0},
    CartPole: {"first": 0.0, "v": 0.0, "angle": 0.08, "rate": 0.0},
    Escape: {"first": 0.9},
    Spin: {"first": 0.0, "y": 0.0, "z": 1.0},
}
POLICY = {Pendulum: pumped, CartPole: balanced, Escape: held, Spin: pulsed}
