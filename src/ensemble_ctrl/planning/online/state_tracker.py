"""Where one robot of any system is and has been, and what is known of its parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.errors import Unenclosed
from ensemble_ctrl.certificate.general.enclosure import Enclosure
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.planning.online.measurement import StateMeasurement
from ensemble_ctrl.planning.online.remaining import BoxElement, Progress
from ensemble_ctrl.planning.online.state_sets import Box, StateSets, at_beginning, at_end, during
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

NEAR = 1e-6
"""Share of a step by which a time may miss a grid time."""
EVERY = 5
"""Steps after which a measurement is compared with an older one besides the last."""
MEMORY = 10
"""Control steps to the older of the two measurements with which a new one is compared."""


@dataclass(frozen=True, eq=False)
class StateSet:
    """Where the robot was at a grid time.

    Attributes
    ----------
    position : ndarray, shape (d,)
        The middle of its places, metres.
    away : float
        Half the diagonal of the box of places, metres.
    turn : float
        Zero: directions are states like any other.
    """

    position: Floats
    away: float
    turn: float = 0.0

    @classmethod
    def of(cls, problem: Problem, box: Box) -> StateSet:
        """The places in a box of states."""
        columns = problem.fleet.place_columns
        return cls(box.middle[columns], float(np.linalg.norm(box.half[columns])))


class StateTracker:
    """The robot's past: commands, measurements, and the sets that follow from them.

    Parameters
    ----------
    problem : Problem
        Of one robot.
    errors : ndarray, shape (states,)
        Largest errors of a measurement.
    learn : bool
        Whether parameters are learnt; without it their assumed ranges stand.

    Attributes
    ----------
    sets : StateSets
    sent : ndarray, shape (steps so far, n_u)
        Commands since time 0.
    past : list of StateSet
        At the grid times up to the last measurement.
    progress : Progress
        Along the measured past.
    last : StateMeasurement or None
        The newest that was used.
    holds : bool
        False once measurements contradicted what was assumed; it stays so.
    """

    def __init__(self, problem: Problem, errors: Floats, learn: bool) -> None:
        self.problem, self.errors, self.learn = problem, errors, learn
        self.sets, self.progress = StateSets(problem.fleet), Progress(problem)
        self.sent = np.zeros((0, len(problem.fleet.system.controls)))
        self.past: list[StateSet] = []
        self.last: StateMeasurement | None = None
        self.holds = True
        self._boxes: list[tuple[int, Box]] = []

    @property
    def time(self) -> float:
        """Of the newest measurement, seconds."""
        return 0.0 if self.last is None else self.last.time

    @property
    def at(self) -> int:
        """The grid time of the newest measurement."""
        return self._boxes[-1][0] if self._boxes else 0

    @property
    def box(self) -> Box:
        """The states then; there has to be a measurement."""
        return self._boxes[-1][1]

    def observe(self, measurement: StateMeasurement) -> list[str]:
        """Learn from a measurement; returns what was out of the ordinary."""
        refused = self._refused(measurement)
        if refused is not None:
            return [refused] if refused else []
        k = round(measurement.time / self.problem.step)
        seen = Box.about(np.array(measurement.states, dtype=float), self.errors)
        self.last = measurement
        if not self._boxes:
            self._take(k, seen)
            return []
        found = self._consistent(k, seen)
        self._pass(k)
        if found is None:
            self.holds = False
            self.sets.ranges = self.sets.assumed.copy()
            self._boxes.clear()
            self._take(k, seen)
            return ["no states and parameters in the assumed ranges fit what was measured: known anew from here"]
        self._take(k, found)
        return []

    def _take(self, k: int, box: Box) -> None:
        """Remember a set."""
        self._boxes.append((k, box))
        self.past.append(StateSet.of(self.problem, box))

    def _refused(self, measurement: StateMeasurement) -> str | None:
        """Why a measurement can't be used; empty for one that was seen before."""
        states, step = self.problem.fleet.system.states, self.problem.step
        if not measurement.finite or len(measurement.states) != len(states):
            return f"measurement ignored: expected finite numbers for {', '.join(states)}"
        k = round(measurement.time / step)
        if self.last is not None and k <= self.at:
            return "" if measurement == self.last else f"measurement ignored: {measurement.time:g} s is not new"
        if abs(measurement.time / step - k) > NEAR or not 0 <= k <= len(self.sent):
            return f"measurement ignored: {measurement.time:g} s is not the end of a step that was commanded"
        return None if self._boxes or k == 0 else f"measurement ignored: {measurement.time:g} s, and none at 0 s"

    def _consistent(self, k: int, seen: Box) -> Box | None:
        """The states within `seen` that the newest sets allow, parameters narrowed; None if there are none."""
        found: Box | None = seen
        before = [entry for entry in self._boxes if entry[0] <= k - MEMORY and k % EVERY == 0]
        for j, box in dict([*before[-1:], self._boxes[-1]]).items():
            try:
                enclosure = self.sets.reach(box, self.sent[j:k], self.problem.step)
            except Unenclosed:
                continue  # nothing is known of how the states got here
            assert found is not None
            found = self.sets.contract(enclosure, k - j, found)
            if found is None:
                return None
        if not self.learn:
            self.sets.ranges = self.sets.assumed.copy()
        return found

    def _pass(self, k: int) -> None:
        """The time from the newest set to a grid time is past."""
        j, box = self._boxes[-1]
        try:
            enclosure = self.sets.reach(box, self.sent[j:k], self.problem.step)
        except Unenclosed:
            nothing = np.full(len(box.low), np.inf)
            for _ in range(j, k):
                self.progress.take(self._element(box), self._element(Box(-nothing, nothing)))
            self.past += [StateSet.of(self.problem, box)] * (k - j - 1)
            return
        taken(self.progress, self.problem, enclosure, k - j)
        self.past += [StateSet.of(self.problem, at_beginning(enclosure, n)) for n in range(1, k - j)]

    def _element(self, box: Box) -> BoxElement:
        """For the progress of the task."""
        return BoxElement(self.problem.fleet.states, box.low, box.high, self.problem.step / 2)

    def send(self, controls: Floats) -> None:
        """Some more commands were given out."""
        self.sent = np.concatenate([self.sent, controls])

    def recall(self, begin: int) -> None:
        """Commands from step `begin` on, which is not past, will not be carried out."""
        self.sent = self.sent[:begin]

    def judged(self) -> float:
        """Robustness of the task along the past, a lower bound; minus infinity while some of it is not decided."""
        later = self.progress.copied()
        if self._boxes and later.at >= self.problem.steps:
            later.take(self._element(self.box), self._element(self.box))
        return later.value

    def ahead(self, until: int) -> tuple[Box, Progress]:
        """The states at a grid time that is to come, and what is left of the task then, under what was sent.

        Raises
        ------
        Unenclosed
            If there is no enclosure.
        """
        later, steps = self.progress.copied(), until - self.at
        if not steps:
            return self.box, later
        enclosure = self.sets.reach(self.box, self.sent[self.at : until], self.problem.step)
        taken(later, self.problem, enclosure, steps)
        return at_end(enclosure, steps), later


def taken(progress: Progress, problem: Problem, enclosure: Enclosure, steps: int) -> None:
    """Take the progress of a task through an enclosure."""
    names, half = problem.fleet.states, problem.step / 2
    for n in range(steps):
        here, between = at_beginning(enclosure, n), during(enclosure, n)
        progress.take(BoxElement(names, here.low, here.high, half), BoxElement(names, between.low, between.high, half))
