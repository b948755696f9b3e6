"""The steps in which a robot of a loop may be in patches of terrain, and what these may change its factors by.

From where the robot was measured last, its pose after some commands departs from a model's by an amount that follows
from the steps up to then alone. Marks of (patch, step) begin with none from there on; a step is marked where the model
is no further from the patch than it may depart, which adds to later departures, until no mark is new. At the first
instant at which a robot was in a patch without a mark, its departure would be one that the marks before it bound, and
it is further away than that.
"""

from __future__ import annotations

from collections.abc import Collection
from math import ceil

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.planning.online.propagation import Commands, Errors, Factors, PoseSet, departure, swung
from ensemble_ctrl.planning.online.slips import UP
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

ON_GRID = 1e-6
"""Share of a step by which a time may miss a grid time."""


class Ground:
    """The terrain of a problem.

    Parameters
    ----------
    problem : Problem
        Of one robot on arcs.
    but : collection of str
        Patches that do not count.
    """

    def __init__(self, problem: Problem, but: Collection[str] = ()) -> None:
        self.problem = problem
        self.patches = [patch for name, patch in problem.terrain.items() if name not in but]

    def __bool__(self) -> bool:
        """Whether there is any."""
        return bool(self.patches)

    def nowhere(self, steps: int) -> Bools:
        """No marks, shape (patches, steps)."""
        return np.zeros((len(self.patches), steps), dtype=bool)

    def commands(self, controls: Floats, marks: Bools, own: dict[str, tuple[float, float]]) -> Commands:
        """Commands with what patches may do in the marked steps to a robot with its own parameters in some ranges."""
        fleet, step = self.problem.fleet, self.problem.step
        return Commands(fleet, controls, step, self._strays(marks, own) if self else None)

    def marked(
        self,
        controls: Floats,
        marks: Bools,
        own: dict[str, tuple[float, float]],
        known: tuple[Errors, Factors],
        pose: PoseSet,
        time: float,
    ) -> Bools:
        """The marks, shape (patches, steps), with those of the steps that begin from a time on decided anew.

        Parameters
        ----------
        controls : ndarray, shape (steps, 2)
        marks : ndarray, shape (patches, steps)
            Those of the steps before count.
        own : dict of str to (float, float)
            Ranges of the robot's own parameters.
        known : Errors and Factors
        pose : PoseSet
            Where the robot, or its undelayed self, is at that time.
        time : float
            Seconds, on the clock of the commands.
        """
        first, step = ceil(time / self.problem.step - ON_GRID), self.problem.step
        found = marks.copy()
        found[:, first:] = False
        if not self or first >= len(controls):
            return found
        begins: Floats = np.asarray(step * np.arange(first, len(controls)), dtype=float)
        while True:
            middles, radius = _spread(self.commands(controls, found, own), *known, pose, time, begins)
            gaps = np.stack([patch.distance(middles) for patch in self.patches])
            # what is no number is no distance
            more = ~(gaps > radius + UP * (1 + np.abs(middles).max(axis=1)))
            if not (more & ~found[:, first:]).any():
                return found
            found[:, first:] |= more

    def _strays(self, marks: Bools, own: dict[str, tuple[float, float]]) -> Floats:
        """By how much the factors may be off in each step, shape (2, steps)."""
        arcs = self.problem.fleet.arcs
        ends = np.array([own.get(name, (1.0, 1.0)) for name in arcs.factors])
        size, change = np.abs(ends).max(axis=1), np.zeros((len(self.patches), len(ends)))
        for i, patch in enumerate(self.patches):
            for k, name in enumerate(arcs.factors):
                if name in patch.parameters:
                    least, most = patch.parameters[name]
                    change[i, k] = max(most - ends[k, 0], ends[k, 1] - least, 0.0)
        # prod (m + r) - prod m over the parameters of each factor, with the largest r of the patches of a step
        largest = np.where(marks[..., None], change[:, None], 0.0).max(axis=0)
        parts = [np.array([arcs.directions[name][k] != 0 for name in arcs.factors]) for k in (0, 1)]
        off = [np.prod((size + largest)[:, part], axis=1) - np.prod(size[part]) for part in parts]
        return np.stack([np.where(each > 0, each * (1 + UP) + UP, 0.0) for each in off])


def _spread(
    commands: Commands, errors: Errors, factors: Factors, pose: PoseSet, time: float, begins: Floats
) -> tuple[Floats, Floats]:
    """Where a model is in the middle of some steps, shape (n, 2), and how far the robot may be from there in each."""
    (a0, a1), (b0, b1) = factors.speed, factors.turn_rate
    a, da, b, db = (a0 + a1) / 2, (a1 - a0) / 2, (b0 + b1) / 2, (b1 - b0) / 2
    middles, ends = begins + commands.step / 2, begins + commands.step
    turned, W = commands.at(np.append(middles, time), b)
    reach = a * np.exp(1j * (pose.heading - b * turned[-1])) * (W[:-1] - W[-1])
    since = np.full(len(ends), time)
    way, _ = commands.driven(since, ends)
    here, _ = commands.driven(begins, ends)
    # half of the step's way, the start's errors, those of the factors, and the departure by the end of the step
    swing = commands.swing(ends, time, float(turned[-1]))
    kept = pose.away + (swung(pose.turn) + UP) * max(abs(a0), abs(a1)) * way
    factor = da * way + max(abs(a0), abs(a1)) * db * swing
    radius = abs(a) * here / 2 + kept + factor + departure(commands, errors, factors, since, ends)[1]
    place = pose.position + np.stack([reach.real, reach.imag], axis=1)
    return place, radius
