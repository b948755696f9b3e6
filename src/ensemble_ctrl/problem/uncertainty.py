"""What a robot may do beside its model: bounds of disturbances, actuator errors, changing parameters and delays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyMapping
from ensemble_ctrl.core.values import number
from ensemble_ctrl.problem.arguments.readers import mapping_of, quantity_of
from ensemble_ctrl.systems import System

Floats = NDArray[np.float64]

POSITION = "position"
"""A disturbance of the position, of a length and in any direction."""
BY_NAME = ("disturbance", "actuators", "shares", "quantisation", "varies")
"""The fields that are bounds by name."""


@dataclass(frozen=True)
class Uncertainty:
    """Bounds of everything that moves a robot beside its model; zero where nothing is given.

    Parameters
    ----------
    disturbance : mapping of str to float
        Largest error of the rate of each state, in its unit per second; ``position`` bounds the length of the error of
        all rates of the position together, in any direction, m/s.
    actuators : mapping of str to float
        Largest error of each command, in its unit.
    shares : mapping of str to float
        Largest error of each command as a share of it, 0 to 1; added to that of `actuators`.
    quantisation : mapping of str to float
        Steps to which each command is rounded, in its unit: an error of half a step.
    varies : mapping of str to float
        How far a parameter strays from the member's own value on the way, as a share of that value, 0 to 1.
    delay : float
        Longest delay of the commands, seconds: each robot has its own, from zero to this, and waits for so long.
    jitter : float
        Seconds by which a step's commands, all of them together, may begin earlier or later than its (delayed) grid
        time; at most half a step.
    heading_hold : float or None
        Time constant in seconds of the robot's own loop on its heading, by which it turns back to that of its model;
        None if it has none.

    Raises
    ------
    ProblemError
        For bounds that are negative or not finite, and shares above 1.

    Notes
    -----
    *Guarantee*: what is proven holds for every measurable function of time within the bounds, adversarial ones
    included. Robots on arcs alone have a `delay`, a `jitter` and a `heading_hold`.

    Examples
    --------
    >>> Uncertainty({"position": 0.005}, varies={"traction": 0.01}, delay="100 ms").scaled(2.0).data()
    {'disturbance': {'position': 0.01}, 'varies': {'traction': 0.02}, 'delay': 0.2}
    """

    disturbance: Mapping[str, float] = field(default_factory=dict)
    actuators: Mapping[str, float] = field(default_factory=dict)
    shares: Mapping[str, float] = field(default_factory=dict)
    quantisation: Mapping[str, float] = field(default_factory=dict)
    varies: Mapping[str, float] = field(default_factory=dict)
    delay: float = 0.0
    jitter: float = 0.0
    heading_hold: float | None = None

    def __post_init__(self) -> None:
        for name in BY_NAME:
            given = mapping_of(f"uncertainty.{name}", getattr(self, name), object, "a bound")
            read = {key: _bound(f"uncertainty.{name}.{key}", value) for key, value in given.items()}
            if name in ("shares", "varies"):
                for key, share in read.items():
                    if share > 1:
                        raise ProblemError(f"uncertainty.{name}.{key}: expected a share up to 1, got {share:g}")
            object.__setattr__(self, name, ReadOnlyMapping(read))
        for name in ("delay", "jitter"):
            value = quantity_of(f"uncertainty.{name}", getattr(self, name), "time")
            object.__setattr__(self, name, _bound(f"uncertainty.{name}", value))
        if self.heading_hold is not None:
            hold = quantity_of("uncertainty.heading_hold", self.heading_hold, "time")
            if not 0 < hold < np.inf:
                raise ProblemError(f"uncertainty.heading_hold: expected a time constant above 0 s, got {hold:g}")
            object.__setattr__(self, "heading_hold", hold)

    def __bool__(self) -> bool:
        """Whether any bound is above zero."""
        return any(self.bounds())

    def bounds(self) -> Iterable[float]:
        """All bounds."""
        return [self.delay, self.jitter, *(value for name in BY_NAME for value in getattr(self, name).values())]

    def with_(self, **changes: Any) -> Self:
        """A copy with some bounds replaced."""
        return replace(self, **changes)

    def scaled(self, factor: float) -> Self:
        """Every bound times a factor; the loop on the heading stays."""
        each: dict[str, Any] = {
            name: {key: value * factor for key, value in getattr(self, name).items()} for name in BY_NAME
        }
        return replace(self, **each, delay=self.delay * factor, jitter=self.jitter * factor)

    def command_errors(self, controls: tuple[str, ...], values: Floats) -> Floats:
        """Largest error of each command at some values, both of shape (steps, n_u)."""
        absolute, share, grain = (
            np.array([getattr(self, name).get(control, 0.0) for control in controls])
            for name in ("actuators", "shares", "quantisation")
        )
        # |du| <= absolute + share |u| + half a step of rounding
        return np.asarray(absolute + share * np.abs(values) + grain / 2)

    def checked(self, system: System) -> Self:
        """Itself, if a system has all that it bounds.

        Raises
        ------
        ProblemError
            For unknown names, and for times and loops of systems that are not on arcs.
        """
        rates = [*system.states, POSITION] if POSITION not in system.states else list(system.states)
        known = {
            "disturbance": rates,
            "varies": list(system.parameters),
            **{key: list(system.controls) for key in ("actuators", "shares", "quantisation")},
        }
        for name, names in known.items():
            for key in getattr(self, name):
                if key not in names:
                    listed = ", ".join(names) or "none"
                    raise ProblemError(f"uncertainty.{name}: expected names among {listed}, got {key!r}")
        for name in ("delay", "jitter", "heading_hold"):
            if getattr(self, name) and not system.on_arcs:
                wanted = "expected none, since it is for robots on arcs"
                raise ProblemError(f"uncertainty.{name}: {wanted}, not for the {system.name}")
        return self

    def data(self) -> dict[str, Any]:
        """What is above zero, as plain data, names in order; nothing for robots that follow their model."""
        found: dict[str, Any] = {}
        for each in fields(self) if self else ():
            value = getattr(self, each.name)
            if each.name in BY_NAME:
                value = {name: value[name] for name in sorted(value) if value[name]}
            if value:
                found[each.name] = value
        return found


def _bound(name: str, value: Any) -> float:
    """A finite number that is not negative."""
    found = number(name, value)
    if not 0 <= found < np.inf:
        raise ProblemError(f"{name}: expected a bound of at least 0, got {found:g}")
    return found


NONE = Uncertainty()
"""Robots that follow their model."""
