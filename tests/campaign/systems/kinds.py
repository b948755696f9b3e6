"""Systems of the campaign: random right-hand sides of every function, and some whose difficulty is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ensemble_ctrl import OdeSystem
from ensemble_ctrl.systems import DoubleIntegrator, PlanarQuadrotor, Quadrotor
from ensemble_ctrl.systems.arrays import arctan, cos, exp, log, sin, sqrt, tan, tanh

Rng = np.random.Generator
Term = Callable[[Any, Any, Mapping[str, Any]], Any]

SHAPES: tuple[Callable[[Any], Any], ...] = (
    sin,
    cos,
    tanh,
    arctan,
    lambda a: tan(0.4 * tanh(a)),
    lambda a: sqrt(1.5 + a * a),
    lambda a: exp(-a * a),
    lambda a: exp(0.5 * tanh(a)),
    lambda a: log(2 + a**2),
    lambda a: 1 / (1 + a**2),
    lambda a: a / (2 + cos(a)),
    lambda a: a * a - 0.1 * a**3,
    lambda a: (1 + a * a) ** 0.7,
    lambda a: (2 + sin(a)) ** -1.5,
    lambda a: 1.3 ** sin(a),
    lambda a: np.sin(a) * np.float64(0.7),
    lambda a: 0.3 - a,
)
"""Functions that are smooth everywhere, of all operations of `ensemble_ctrl.systems.arrays`."""


@dataclass(frozen=True)
class Kind:
    """A system with how it is driven.

    Attributes
    ----------
    system : OdeSystem
    start : tuple of float
        Middle of the starts.
    ranges : dict of str to (float, float)
        Ranges of its parameters that may be asked for, each a part of it.
    rest : tuple of float
        Commands.
    size : float
        By how much commands differ from them.
    duration : float
        Seconds at most.
    """

    system: OdeSystem
    start: tuple[float, ...]
    ranges: dict[str, tuple[float, float]]
    rest: tuple[float, ...]
    size: float
    duration: float


def _linear(rng: Rng, states: int, commands: int, parameters: Sequence[str]) -> Term:
    """A random linear form in a few states, and at times in a command or a parameter."""
    weight = np.where(rng.random(states) < 0.5, rng.uniform(-1.5, 1.5, states), 0.0).tolist()
    weight[int(rng.integers(states))] = float(rng.uniform(0.3, 1.5))
    command = int(rng.integers(commands)) if rng.random() < 0.3 else None
    name = str(rng.choice(parameters)) if rng.random() < 0.4 else None

    def value(x: Any, u: Any, psi: Mapping[str, Any]) -> Any:
        total = sum((w * each for w, each in zip(weight, x, strict=True) if w), 0.0)
        total = total if command is None else total + u[command]
        return total if name is None else total * psi[name]

    return value


def _rate(rng: Rng, k: int, states: int, commands: int, parameters: Sequence[str], damping: float) -> Term:
    """A random rate of state `k`: products of a few functions of linear forms, a command, and damping."""
    terms = []
    for _ in range(int(rng.integers(1, 4))):
        factors = [
            (SHAPES[int(rng.integers(len(SHAPES)))], _linear(rng, states, commands, parameters))
            for _ in range(int(rng.integers(1, 3)))
        ]
        terms.append((float(rng.uniform(-1, 1)), factors))
    gain = rng.uniform(-1, 1, commands).tolist()

    def value(x: Any, u: Any, psi: Mapping[str, Any]) -> Any:
        total = -damping * x[k] + sum(g * each for g, each in zip(gain, u, strict=True))
        for coefficient, factors in terms:
            product = coefficient
            for shape, form in factors:
                product = product * shape(form(x, u, psi))
            total = total + product
        return total

    return value


def _named(base: type[OdeSystem], name: str, states: int, commands: int, parameters: Mapping[str, float]) -> OdeSystem:
    """A child of a system with so many states and commands."""
    fields = {
        "name": name,
        "states": tuple(f"x{k}" for k in range(states)),
        "positions": tuple(f"x{k}" for k in range(min(states, 3))),
        "controls": tuple(f"u{k}" for k in range(commands)),
        "control_units": ("1",) * commands,
        "input_bounds": ((-10.0, 10.0),) * commands,
        "parameters": dict(parameters),
    }
    system: OdeSystem = type(name, (base,), fields)()
    return system


def drawn(rng: Rng) -> Kind:
    """Random right-hand sides."""
    states, commands = int(rng.integers(1, 6)), int(rng.integers(1, 3))
    names = [f"p{k}" for k in range(int(rng.integers(1, 4)))]
    damping = float(rng.choice([0.0, 0.3, 1.0, 4.0]))
    rates = [_rate(rng, k, states, commands, names, damping) for k in range(states)]

    class Drawn(OdeSystem):
        def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
            return [rate(x, u, psi) for rate in rates]

    system = _named(Drawn, "drawn", states, commands, dict.fromkeys(names, 1.0))
    return Kind(
        system,
        tuple(rng.uniform(-1, 1, states).tolist()),
        dict.fromkeys(names, (0.5, 1.5)),
        (0.0,) * commands,
        1.0,
        2.0,
    )


class Robot(OdeSystem):
    """A unicycle by its equations."""

    name, states, positions = "robot", ("x", "y", "heading"), ("x", "y")
    controls, control_units, input_bounds = ("v", "omega"), ("m/s", "rad/s"), ((-10.0, 10.0), (-10.0, 10.0))
    parameters: ClassVar[Mapping[str, float]] = {"traction": 1.0, "turn": 1.0}  # type: ignore[misc]

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        speed = psi["traction"] * u[0]
        return [speed * cos(x[2]), speed * sin(x[2]), psi["turn"] * u[1]]


class Crane(OdeSystem):
    """A cart with a load that swings."""

    name, states, positions = "crane", ("x", "v", "angle", "rate"), ("x",)
    controls, control_units, input_bounds = ("force",), ("N",), ((-10.0, 10.0),)
    parameters: ClassVar[Mapping[str, float]] = {"load": 0.15, "length": 0.5}  # type: ignore[misc]

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        _, v, angle, rate = x
        s, c, load = sin(angle), cos(angle), psi["load"]
        a = (u[0] + load * s * (psi["length"] * rate**2 + 9.81 * c)) / (1.0 + load * s**2)
        return [v, a, rate, -(a * c + 9.81 * s) / psi["length"]]


class Oscillator(OdeSystem):
    """Van der Pol's, fast or slow, in a plane."""

    name, states, positions = "oscillator", ("x", "y"), ("x", "y")
    controls, control_units, input_bounds = ("u",), ("1",), ((-10.0, 10.0),)
    parameters: ClassVar[Mapping[str, float]] = {"speed": 5.0, "bend": 0.3}  # type: ignore[misc]

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        return [psi["speed"] * x[1], psi["bend"] * (1 - x[0] ** 2) * x[1] - psi["speed"] * x[0] + u[0]]


class Lorenz(OdeSystem):
    """Unstable: members part."""

    name, states, positions = "lorenz", ("x", "y", "z"), ("x", "y", "z")
    controls, control_units, input_bounds = ("u",), ("1",), ((-10.0, 10.0),)
    parameters: ClassVar[Mapping[str, float]] = {"rho": 28.0}  # type: ignore[misc]

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        a, b, c = x
        return [10 * (b - a) + u[0], a * (psi["rho"] - c) - b, a * b - 8 / 3 * c]


class Stable(OdeSystem):
    """Rates that differ by a factor of a hundred, and pull together."""

    name, states, positions = "stable", ("x", "y"), ("x", "y")
    controls, control_units, input_bounds = ("u",), ("1",), ((-10.0, 10.0),)
    parameters: ClassVar[Mapping[str, float]] = {"fast": 30.0}  # type: ignore[misc]

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        return [psi["fast"] * (sin(x[1]) - x[0]), -0.3 * x[1] + u[0] * cos(x[0])]


def quadrotor(_: Rng) -> Kind:
    """In space."""
    start = (0.0,) * 6 + (1.0,) + (0.0,) * 6
    return Kind(Quadrotor(), start, {"payload": (0.0, 0.6)}, (41.0, 0.0, 0.0, 0.0), 0.3, 0.8)


def planar(_: Rng) -> Kind:
    """In a vertical plane."""
    ranges = {"mass": (0.9, 1.1), "drag": (0.0, 0.3)}
    return Kind(PlanarQuadrotor(), (0.0, 1.0, 0.5, 0.0, 0.1, 0.0), ranges, (9.81, 0.0), 0.05, 2.0)


def point(rng: Rng) -> Kind:
    """A point mass, at times a million metres away."""
    far = float(rng.choice([0.0, 1e3, 1e6]))
    return Kind(DoubleIntegrator(), (far, -2 * far, 0.5, 0.1), {"mass": (0.5, 2.0)}, (0.0, 0.0), 1.0, 3.0)


def robot(_: Rng) -> Kind:
    """A unicycle."""
    ranges = {"traction": (0.7, 1.3), "turn": (0.8, 1.2)}
    return Kind(Robot(), (1.0, -1.0, 0.5), ranges, (1.0, 0.0), 1.5, 4.0)


def crane(_: Rng) -> Kind:
    """Swinging."""
    return Kind(Crane(), (0.0, 0.0, 0.3, 0.0), {"load": (0.1, 0.3), "length": (0.4, 0.6)}, (0.0,), 2.0, 2.0)


def oscillator(_: Rng) -> Kind:
    """Fast."""
    return Kind(Oscillator(), (1.0, 0.0), {"speed": (4.0, 6.0), "bend": (0.0, 0.8)}, (0.0,), 1.0, 2.0)


def lorenz(_: Rng) -> Kind:
    """Unstable."""
    return Kind(Lorenz(), (1.0, 1.0, 20.0), {"rho": (26.0, 29.0)}, (0.0,), 1.0, 0.8)


def stable(_: Rng) -> Kind:
    """Stiff."""
    return Kind(Stable(), (0.2, 0.5), {"fast": (20.0, 40.0)}, (0.0,), 1.0, 1.5)


KINDS: dict[str, Callable[[Rng], Kind]] = {
    "drawn": drawn,
    "robot": robot,
    "point": point,
    "planar": planar,
    "quadrotor": quadrotor,
    "crane": crane,
    "oscillator": oscillator,
    "lorenz": lorenz,
    "stable": stable,
}
"""All of them, by family."""
SHARES = {"drawn": 8, "robot": 2, "quadrotor": 1}
"""How often each is drawn, if not twice."""
