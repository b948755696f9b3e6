"""What a simulated robot on arcs does beside its model: errors within bounds, new in each control step."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.terrain import Patch
from ensemble_ctrl.problem.uncertainty import POSITION

Floats = NDArray[np.float64]
ErrorKind = Literal["random", "bang-bang", "constant", "none"]
"""How errors go: uniform in each step; at the bounds with changes of sign; at the bounds for good; not at all."""
RATE, COMMAND, FACTOR, GROUND = "rate", "command", "factor", "ground"
"""What an error is of, beside the position in any direction."""
NO_TERRAIN: Mapping[str, Patch] = MappingProxyType({})
"""Robots that are the same everywhere."""
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
    terrain : mapping of str to Patch, optional
        Patches in which parameters may differ.

    Attributes
    ----------
    delay : float
        By how much all of its commands are late, seconds.

    Raises
    ------
    ProblemError
        For another kind.
    """

    def __init__(
        self,
        fleet: Fleet,
        step: float,
        kind: ErrorKind = "random",
        seed: int = 0,
        terrain: Mapping[str, Patch] = NO_TERRAIN,
    ) -> None:
        if kind not in get_args(ErrorKind):
            raise ProblemError(f"robot.errors: expected {', '.join(get_args(ErrorKind))}, got {kind!r}")
        self.fleet, self.step, self.kind, self.terrain = fleet, step, kind, terrain
        self._random = np.random.default_rng([seed, 1])
        arcs = fleet.arcs
        names = {RATE: arcs.states, POSITION: fleet.places, COMMAND: arcs.controls, FACTOR: arcs.parameters}
        names |= {GROUND: arcs.factors} if terrain else {}
        self._channels = [(what, name) for what, each in names.items() for name in each]
        self._settings = self._random.choice([-1.0, 1.0], len(self._channels)) * (kind != "none")
        self._turned = 0.0
        # times are drawn apart: commands begin before their steps do
        self._times = np.random.default_rng([seed, 2])
        late = {"none": 0.0, "random": self._times.random()}.get(kind, float(self._times.integers(0, 2)))
        self.delay, self._shifts = late * fleet.uncertainty.delay, list[float]()

    def shift(self, n: int) -> float:
        """Seconds by which the commands of a step begin late beside the delay; early ones begin before."""
        if n < 0:
            return 0.0
        while len(self._shifts) <= n:
            last = self._shifts[-1] if self._shifts else float(self._times.choice([-1.0, 1.0]))
            turned = -last if self._times.random() < 0.5 else last
            drawn = {"random": float(self._times.uniform(-1.0, 1.0)), "bang-bang": turned, "none": 0.0}
            self._shifts.append(drawn.get(self.kind, last))
        return self._shifts[n] * self.fleet.uncertainty.jitter

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

    def grounds(self, place: Floats, way: float, own: tuple[float, float]) -> tuple[float, float]:
        """What multiplies the factors on speed and turn rate for where a robot is.

        Parameters
        ----------
        place : ndarray, shape (2,)
        way : float
            Metres that it may drive meanwhile: a patch counts if it stays inside.
        own : tuple of float
            Its factors elsewhere.
        """
        inside = [patch for patch in self.terrain.values() if float(patch.distance(place)) <= -way]
        found = list(own)
        for name in self.fleet.arcs.factors if inside else ():
            ends = [patch.parameters[name] for patch in inside if name in patch.parameters]
            places = np.flatnonzero(self.fleet.arcs.directions[name]).tolist()
            if ends:
                # a parameter of the fleet is the factor; another one multiplies it
                value = own[places[0]] if name in self.fleet.names else 1.0
                low, high = min(value, *(low for low, _ in ends)), max(value, *(high for _, high in ends))
                drawn = low + (self._setting(GROUND, name) + 1) / 2 * (high - low)
                for k in places:
                    found[k] *= drawn / value
        return found[0] / own[0], found[1] / own[1]

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

    def stands(self, model: float, span: float) -> None:
        """The robot stands for some seconds in which its model turns."""
        if self.fleet.uncertainty.heading_hold is not None:
            self._turned -= model * span

    def _setting(self, kind: str, name: str) -> float:
        """The share of its bound that an error of a kind has now, -1 to 1."""
        return float(self._settings[self._channels.index((kind, name))])
