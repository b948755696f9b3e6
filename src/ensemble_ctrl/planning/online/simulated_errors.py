"""What a simulated robot on arcs does beside its model: errors within bounds, new in each control step."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.uncertainty import POSITION

Floats = NDArray[np.float64]
ErrorKind = Literal["random", "bang-bang", "constant", "none"]
"""How errors go: uniform in each step; at the bounds with changes of sign; at the bounds for good; not at all."""
RATE, COMMAND, FACTOR = "rate", "command", "factor"
"""What an error is of, beside the position in any direction."""
BETWEEN = 3.0
"""Seconds between changes of sign of an error at its bounds, on average."""


class SimulatedErrors:
    """Errors of one robot.

    Parameters
    ----------
    fleet : Fleet
        Whose `uncertainty` bounds them.
    step : float
        Length of a control step, seconds.
    kind : {"random", "bang-bang", "constant", "none"}
    seed : int

    Raises
    ------
    ProblemError
        For another kind.
    """

    def __init__(self, fleet: Fleet, step: float, kind: ErrorKind = "random", seed: int = 0) -> None:
        if kind not in get_args(ErrorKind):
            raise ProblemError(f"robot.errors: expected {', '.join(get_args(ErrorKind))}, got {kind!r}")
        self.fleet, self.step, self.kind = fleet, step, kind
        self._random = np.random.default_rng([seed, 1])
        arcs = fleet.arcs
        names = {RATE: arcs.states, POSITION: fleet.places, COMMAND: arcs.controls, FACTOR: arcs.parameters}
        self._channels = [(what, name) for what, each in names.items() for name in each]
        self._settings = self._random.choice([-1.0, 1.0], len(self._channels)) * (kind != "none")
        self._turned = 0.0

    def advance(self) -> None:
        """Another control step."""
        if self.kind == "random":
            self._settings = self._random.uniform(-1.0, 1.0, len(self._channels))
        if self.kind == "bang-bang":
            changes = self._random.random(len(self._channels)) < min(0.5, self.step / BETWEEN)
            self._settings = np.where(changes, -self._settings, self._settings)

    def command(self, command: Floats) -> Floats:
        """A command as it is carried out."""
        fleet = self.fleet
        bounds = fleet.uncertainty.command_errors(fleet.system.controls, command[None])[0]
        return np.asarray(command + bounds * [self._setting(COMMAND, name) for name in fleet.system.controls])

    def strays(self) -> tuple[float, float]:
        """What multiplies the factors on speed and turn rate."""
        found = [1.0, 1.0]
        for name, share in self.fleet.uncertainty.varies.items():
            for place in np.flatnonzero(self.fleet.arcs.directions[name]).tolist():
                found[place] *= 1 + share * self._setting(FACTOR, name)
        return found[0], found[1]

    def pushes(self) -> Floats:
        """Errors of the rates of x, y, and the heading, counted as the system does, shape (3,)."""
        given, (x, y, heading) = self.fleet.uncertainty.disturbance, self.fleet.arcs.states
        own = np.array([given.get(name, 0.0) * self._setting(RATE, name) for name in (x, y, heading)])
        along = np.array([self._setting(POSITION, name) for name in self.fleet.places])
        # settings of the position are moved into the ball of that radius
        own[:2] += given.get(POSITION, 0.0) * along / max(1.0, float(np.linalg.norm(along)))
        return own

    def turn(self, model: float, extra: float, span: float) -> float:
        """What a robot turns in `span` seconds in which its model does at a rate, with another rate on top, radians.

        A loop on the heading takes back what is not the model's.
        """
        hold = self.fleet.uncertainty.heading_hold
        if hold is None:
            return (model + extra) * span
        # constant, with e' + e / tau = extra at the end, and no more than the bound at the beginning
        gained = span * (extra - self._turned / hold) / (1 + span / hold)
        self._turned += gained
        return model * span + gained

    def _setting(self, kind: str, name: str) -> float:
        """The share of its bound that an error of a kind has now, -1 to 1."""
        return float(self._settings[self._channels.index((kind, name))])
