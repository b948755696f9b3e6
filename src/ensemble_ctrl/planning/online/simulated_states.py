"""A robot of any system that is not quite the middle of its fleet: other parameters, noise, delays and losses.

Time is simulated: the robot is its own clock, and moves when it is waited for.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.planning.online.measurement import StateMeasurement
from ensemble_ctrl.planning.online.simulated import FINE
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]

SUBSTEPS = 4
"""Steps of integration in each of the `FINE` parts of a control step."""


@dataclass(eq=False)
class SimulatedStates:
    """One robot, and its clock.

    Parameters
    ----------
    fleet : Fleet
        Whose system it is, and where it starts.
    step : float
        Length of a control step, seconds.
    parameters : mapping of str to float
        Its true parameters; the middle of the range for others.
    errors : ndarray, shape (states,)
        Largest errors of a measurement, uniform.
    delay : float
        Seconds that a measurement takes to arrive.
    lost : float
        Share of the measurements that are lost, 0 to 1.
    seed : int
        Of noise and losses.

    Attributes
    ----------
    track : list of ndarray
        True states so far, `FINE` for each control step, the start first.
    """

    fleet: Fleet
    step: float
    parameters: Mapping[str, float]
    errors: Floats
    delay: float = 0.0
    lost: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(self.seed)
        names = self.fleet.names
        self.member = np.array([self.parameters.get(n, c) for n, c in zip(names, self.fleet.center, strict=True)])
        self.states: Floats = self.fleet.start_states(self.member[None])[:, 0]
        self.track: list[Floats] = [self.states.copy()]
        self._rest = self.fleet.rest(self.member)
        self._commands: dict[int, Floats] = {}
        self._first: int | None = None
        self._parts = 0
        self._post: deque[tuple[float, StateMeasurement]] = deque()
        self._measure()

    def now(self) -> float:
        """Simulated seconds."""
        return self._parts * self.step / FINE

    def wait(self, until: float) -> None:
        """Let the robot move until a time; until its first command is due it is held where it is."""
        while self.now() < until - 1e-9:
            if self._commands and self._first is not None and self._parts // FINE >= self._first:
                command = self._commands.get(self._parts // FINE, self._rest)
                self.states = self.moved(self.states, command, self.step / FINE)
            self._parts += 1
            self.track.append(self.states.copy())
            if self._parts % FINE == 0:
                self._measure()

    def moved(self, states: Floats, command: Floats, seconds: float) -> Floats:
        """The states after some seconds of a constant command."""
        psi = self.fleet.psi(self.member[None])
        return self.fleet.system.flow(states[:, None], command.tolist(), psi, seconds, SUBSTEPS)[:, 0]

    def read(self) -> StateMeasurement | None:
        """The newest measurement that has arrived, each once."""
        newest = None
        while self._post and self._post[0][0] <= self.now() + 1e-9:
            newest = self._post.popleft()[1]
        return newest

    def send(self, begin: float, controls: Floats) -> None:
        """Take commands."""
        first = round(begin / self.step)
        self._first = first if self._first is None else self._first
        self._commands = {k: u for k, u in self._commands.items() if k < first}
        self._commands |= {first + i: np.array(u, dtype=float) for i, u in enumerate(controls)}

    def stop(self) -> None:
        """Forget all commands."""
        self._commands = {}

    def _measure(self) -> None:
        """Send the present states off."""
        noise, lost = self._random.uniform(-1.0, 1.0, len(self.errors)), self._random.random() < self.lost
        now = round(self.now(), 9)
        if not lost:
            seen = tuple((self.states + noise * self.errors).tolist())
            self._post.append((now + self.delay if now else 0.0, StateMeasurement(now, seen)))
