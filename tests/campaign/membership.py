"""Sets of on-line membership against robots of which everything is known: ``python -m tests.campaign.membership``.

Factors drift as fast as they may, actuators and measurements are off by all that they may, and headings are measured a
whole turn off. The pose comes from Gauss's rule in each step, nothing that the package computes with.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.membership import Membership
from ensemble_ctrl.planning.online.propagation import Commands, Errors
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.systems import ArcSystem, Bicycle, Unicycle

from .model import Floats

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
NAMES = (("traction",), ("linear_traction",), ("angular_traction",), ("linear_traction", "angular_traction"))
ROUNDING = 1e-12
"""Relative rounding of the robots here."""


@dataclass(frozen=True, eq=False)
class Robot:
    """One robot, and what it is told.

    Attributes
    ----------
    names : tuple of str
        Its parameters.
    values, drift : ndarray, shape (parameters,)
        Their values at time 0 and how fast they rise.
    controls, slips : ndarray, shape (steps, 2)
        Commands, and what the actuators add to speed and turn rate.
    """

    system: str
    swapped: bool
    step: float
    names: tuple[str, ...]
    values: Floats
    drift: Floats
    controls: Floats
    slips: Floats
    errors: Errors
    assumed: Floats
    start: complex
    heading: float

    def parameters(self, time: float) -> Floats:
        """Their values at a time."""
        return self.values + self.drift * time

    def factors(self, times: Floats) -> tuple[Floats, Floats]:
        """Those on speed and turn rate."""
        a, b = np.ones(times.shape), np.ones(times.shape)
        for name, value, drift in zip(self.names, self.values, self.drift, strict=True):
            told = value + drift * times
            a = told if name != "angular_traction" else a
            b = told if name != "linear_traction" else b
        return a, b

    def pose(self, time: float) -> tuple[complex, float]:
        """Place and heading at a time: Gauss's rule in parts of each step."""
        v, turn = self.controls.T
        turn = turn if self.system == "unicycle" else v * np.tan(turn) / 0.3
        v, turn = v + self.slips[:, 0], (-turn if self.swapped else turn) + self.slips[:, 1]
        edges = np.minimum(self.step * np.arange(len(v) + 1), time)
        turned = self._turned(turn, edges[:-1], edges[1:])
        heading = self.heading + np.concatenate([[0.0], np.cumsum(turned)])
        share = ((np.arange(PARTS)[:, None] + (NODES + 1) / 2) / PARTS).ravel()
        span = np.diff(edges)[:, None]
        at = edges[:-1, None] + span * share
        angle = heading[:-1, None] + self._turned(turn[:, None], edges[:-1, None], at)
        rate = self.factors(at)[0] * v[:, None] * np.exp(1j * angle)
        return self.start + complex((span * rate * np.tile(WEIGHTS / 2 / PARTS, PARTS)).sum()), float(heading[-1])

    def _turned(self, turn: Floats, begin: Floats, end: Floats) -> Floats:
        """What is turned between two times of a step: the factor rises evenly, so its mean is that in the middle."""
        return np.asarray(turn * (end - begin) * self.factors((begin + end) / 2)[1])


PARTS = 4
"""Parts of a step for Gauss's rule."""


def make(seed: int, index: int) -> Robot:
    """The robot with this index."""
    rng = np.random.default_rng([seed, index])
    steps, step = int(rng.integers(1, 40)), float(rng.choice([0.05, 0.1, 0.5, 1.0]))
    names = NAMES[int(rng.integers(len(NAMES)))]
    system = "bicycle" if rng.random() < 0.25 else "unicycle"
    assumed = np.array([[0.8, 1.2]] * len(names))
    values = rng.choice([0.8, 0.9, 1.0, 1.2], len(names))
    drift = float(rng.choice([0.0, 0.0, 1e-3, 0.02]))
    rises = drift * rng.choice([-1.0, 1.0], len(names))
    rises = np.where((values + rises * steps * step > 1.2) | (values + rises * steps * step < 0.8), 0.0, rises)
    turn = float(rng.choice([0.3, 2.0, 8.0])) if system == "unicycle" else 1.2
    every = int(rng.integers(1, 9))
    pieces = rng.uniform([-1.5, -turn], [1.5, turn], (steps, 2)) * (rng.random((steps, 2)) < 0.85)
    controls = np.repeat(pieces, every, axis=0)
    slip = float(rng.choice([0.0, 0.0, 0.03]))
    slips = slip * rng.choice([-1.0, 1.0], (steps, 2))
    errors = Errors(float(rng.choice([0.0, 1e-3, 0.05])), float(rng.choice([0.0, 0.02, 0.5, 3.0, 4.0])), drift)
    start = complex(*(rng.uniform(-1, 1, 2) * float(rng.choice([1.0, 1e3, 1e6]))))
    heading = float(rng.uniform(-np.pi, np.pi))
    swapped = bool(rng.random() < 0.3)
    return Robot(system, swapped, step, names, values, rises, controls[:steps], slips, errors, assumed, start, heading)


def excluded(seed: int, index: int) -> Iterator[str]:
    """What is said to be impossible, and is true."""
    robot, rng = make(seed, index), np.random.default_rng([seed, index, 1])
    axis = "y" if robot.swapped else "x"
    system: ArcSystem = Unicycle("y" if axis == "y" else "x")
    if robot.system == "bicycle":
        system = Bicycle("y" if axis == "y" else "x", 0.3)
    distributions = {name: Interval(*ends) for name, ends in zip(robot.names, robot.assumed.tolist(), strict=True)}
    most = np.array([9.0, 9.0 if robot.system == "unicycle" else 1.3])
    fleet = Fleet(system, distributions, np.zeros(2), 0.0, -most, most, uncertainty=_bounds(robot))
    sets, commands = Membership(fleet, robot.errors), Commands(fleet, robot.controls, robot.step)
    end = len(robot.controls) * robot.step
    times = np.sort(rng.uniform(0, end, int(rng.integers(1, 12))))
    if rng.random() < 0.5:
        times = np.unique(np.round(times / robot.step)) * robot.step
    for time in times.tolist():
        place, heading = robot.pose(time)
        noise = robot.errors.position * rng.choice([-1.0, 1.0], 2)
        off = robot.errors.heading * float(rng.choice([-1.0, 1.0])) + 2 * np.pi * int(rng.integers(-1, 2))
        seen = np.array([place.real, place.imag]) + noise
        if not sets.observe(commands, time, seen, heading + off):
            yield f"{seed}:{index} at {time:g} s: nothing is left"
            return
        yield from (f"{seed}:{index} at {time:g} s: {what}" for what in _missing(robot, sets, commands, time))


def _bounds(robot: Robot) -> Uncertainty:
    """What is said of its slips; what moves the steering of a bicycle is not what moves its turn rate."""
    slip = float(np.abs(robot.slips).max())
    if robot.system == "unicycle":
        return Uncertainty(actuators={"v": slip, "omega": slip})
    return Uncertainty({"heading": slip * float(robot.assumed.max())}, {"v": slip})


def _missing(robot: Robot, sets: Membership, commands: Commands, time: float) -> Iterator[str]:
    """Parameters and poses, then and at other times, that are not in their sets."""
    told = robot.parameters(time)
    if not ((sets.ranges[:, 0] <= told) & (told <= sets.ranges[:, 1])).all():
        yield f"parameters {told.tolist()} not in {sets.ranges.tolist()}"
    end = len(robot.controls) * robot.step
    for when in (0.5 * time, time, 0.5 * (time + end), end):
        found = sets.pose(commands, when)
        if found is None:
            yield f"no pose at {when:g} s"
            continue
        place, heading = robot.pose(when)
        away = np.abs(np.array([place.real, place.imag]) - found.position) - found.half
        turned = abs((heading - found.heading + np.pi) % (2 * np.pi) - np.pi) - found.turn
        if away.max() > ROUNDING * (1 + abs(place)) or turned > ROUNDING:
            yield f"pose at {when:g} s is {away.max():.3g} m and {turned:.3g} rad outside"


def main() -> int:
    """The command; its exit code is 1 if the truth was excluded."""
    parser = argparse.ArgumentParser(description="Judge sets of membership by robots of which everything is known.")
    parser.add_argument("--robots", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    found = [what for index in range(args.robots) for what in excluded(args.seed, index)]
    print(*found[:50], f"{args.robots} robots, {len(found)} times the truth was excluded", sep="\n")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
