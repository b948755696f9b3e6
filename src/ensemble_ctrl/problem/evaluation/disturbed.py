"""Robots that differ from their model within the fleet's bounds, run exactly (on arcs) or accurately (by an ODE).

What disturbs them is constant in each step of control and given by *settings*, numbers from -1 to 1 that are shares of
the bounds: one for each robot, channel and step.  Every run is one that the bounds allow: nothing is rounded outwards;
borders of patches of terrain are found by bisection.
"""

from __future__ import annotations

from functools import cached_property
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem.evaluation.ground import Ground, parameters
from ensemble_ctrl.problem.integrated import needed
from ensemble_ctrl.problem.uncertainty import POSITION
from ensemble_ctrl.systems.integration import extrapolated

if TYPE_CHECKING:
    from ensemble_ctrl.problem.fleet import Fleet
    from ensemble_ctrl.problem.problem import Problem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

KINDS = ("random", "bang-bang", "constant")
"""How settings are drawn: uniform in each step; at the bounds with a few changes of sign; at the bounds for good."""
SWITCHES = 3
"""Changes of sign of a bang-bang setting, on average."""
MOST_TICKS = 32
"""Parts of a step into which times of commands are rounded towards the model's."""
DRIVE, STRAYS, WAITS, SHIFTS, GROUND = "command", "varies", "delay", "jitter", "terrain"


@dataclass(frozen=True)
class Channel:
    """One thing that is off: its kind, and the state, command or parameter that it is of."""

    kind: str
    name: str


def channels(problem: Problem) -> tuple[Channel, ...]:
    """Everything that the fleet's bounds and the terrain allow to be off."""
    fleet, bounds = problem.fleet, problem.fleet.uncertainty
    found = [Channel("disturbance", name) for name in bounds.disturbance if name != POSITION]
    if bounds.disturbance.get(POSITION):
        found += [Channel(POSITION, name) for name in fleet.places]
    given = {*bounds.actuators, *bounds.shares, *bounds.quantisation}
    found += [Channel(DRIVE, name) for name in fleet.system.controls if name in given]
    found += [Channel(STRAYS, name) for name in bounds.varies]
    found += [Channel(kind, "") for kind in (WAITS, SHIFTS) if getattr(bounds, kind)]
    return tuple(found + [Channel(GROUND, name) for name in parameters(problem.terrain, fleet)])


def drawn(problem: Problem, robots: int, steps: int, seed: int | list[int]) -> Floats:
    """Settings of each of `KINDS` for robots in turn, shape (robots, channels, steps)."""
    rng, shape = np.random.default_rng(seed), (robots, len(channels(problem)), steps)
    random = rng.uniform(-1.0, 1.0, shape)
    signs = np.where(rng.random((*shape[:2], 1)) < 0.5, -1.0, 1.0)
    # a sign changes with the same chance in every step
    changes = rng.random(shape) < min(0.5, SWITCHES / steps)
    bang = signs * np.where(np.cumsum(changes, axis=2) % 2, -1.0, 1.0)
    kind = np.arange(robots)[:, None, None] % len(KINDS)
    return np.where(kind == 0, random, np.where(kind == 1, bang, signs))


def disturbed(
    problem: Problem, controls: Floats, members: Floats, settings: Floats, substeps: int = 1, last: int | None = None
) -> Floats:
    """States of disturbed robots, with the signals that the task reads (`ensemble_ctrl.problem.signals.columns`).

    Parameters
    ----------
    problem : Problem
    controls : ndarray, shape (steps, n_u)
    members : ndarray, shape (robots, parameters)
    settings : ndarray, shape (robots, channels, steps)
        -1 to 1, in the order of `channels`; those of a delay count from the shortest to the longest, those of terrain
        from the smallest to the largest value of a parameter in the patches where the robot is.
    substeps : int
        Samples per step.
    last : int, optional
        Steps to run; all of them if not given.

    Returns
    -------
    ndarray, shape (robots, steps * substeps + 1, columns)
    """
    run = _OnArcs if problem.fleet.system.on_arcs else _ByRule
    controls = np.asarray(controls, dtype=float)
    return run(problem, controls, members, settings, substeps, len(controls) if last is None else last).states()


@dataclass(frozen=True, eq=False)
class _Run:
    """What both kinds of robots have in common."""

    problem: Problem
    controls: Floats
    members: Floats
    settings: Floats
    substeps: int
    last: int

    @property
    def fleet(self) -> Fleet:
        """The fleet."""
        return self.problem.fleet

    @cached_property
    def step(self) -> float:
        """Seconds of a step of control."""
        return self.problem.duration / len(self.controls)

    @cached_property
    def _index(self) -> dict[Channel, int]:
        """The place of each channel."""
        return {channel: k for k, channel in enumerate(channels(self.problem))}

    def setting(self, kind: str, name: str = "") -> Floats:
        """The settings of one channel, shape (robots, steps); zero where there is none."""
        k = self._index.get(Channel(kind, name))
        return np.zeros((len(self.members), len(self.controls))) if k is None else self.settings[:, k]

    def pushes(self, name: str) -> Floats:
        """Errors of a state's rate, shape (robots, steps)."""
        given, places = self.fleet.uncertainty.disturbance, self.fleet.places
        found = given.get(name, 0.0) * self.setting("disturbance", name)
        if name in places and given.get(POSITION):
            # settings of the position are moved into the ball of that radius
            along = np.stack([self.setting(POSITION, place) for place in places])
            length = np.maximum(1.0, np.linalg.norm(along, axis=0))
            found = found + given[POSITION] * along[places.index(name)] / length
        return np.asarray(found)

    def commands(self, which: Ints, n: int) -> Floats:
        """The commands with these numbers as they are carried out in step `n`, shape (n_u, robots)."""
        values = self.controls[which]
        errors = self.fleet.uncertainty.command_errors(self.fleet.system.controls, values)
        share = np.stack([self.setting(DRIVE, name)[:, n] for name in self.fleet.system.controls], axis=1)
        return np.asarray((values + errors * share).T)

    def factor(self, name: str, n: int) -> Floats:
        """What multiplies a parameter in step `n`, shape (robots,)."""
        return np.asarray(1 + self.fleet.uncertainty.varies.get(name, 0.0) * self.setting(STRAYS, name)[:, n])


class _OnArcs(_Run):
    """Robots on arcs: in each tick, a part of a step, their rates are constant, and they move on an exact arc."""

    @cached_property
    def ticks(self) -> int:
        """Of each step."""
        bounds, wanted = self.fleet.uncertainty, 1
        for time in (bounds.delay, bounds.jitter):
            wanted = max(wanted, min(MOST_TICKS, ceil(4 * self.step / time)) if time else 1)
        return self.substeps * ceil(max(wanted, 4 if bounds.heading_hold else 1) / self.substeps)

    @cached_property
    def begins(self) -> tuple[Ints, Ints]:
        """The ticks by which robots are late, and those at which each command begins, (robots,) and (robots, steps)."""
        bounds, tick = self.fleet.uncertainty, self.step / self.ticks
        late = np.floor((self.setting(WAITS)[:, 0] + 1) / 2 * bounds.delay / tick).astype(np.int64)
        shift = np.trunc(self.setting(SHIFTS) * bounds.jitter / tick).astype(np.int64)
        return late, late[:, None] + np.arange(len(self.controls)) * self.ticks + shift

    def states(self) -> Floats:
        """Positions and signals, shape (robots, steps * substeps + 1, columns)."""
        arcs, tick = self.fleet.arcs, self.step / self.ticks
        linear, angular, heading, x, y = self.fleet.coefficients(self.members).T
        # place, heading, and the heading's error
        at, (late, begins) = np.stack([x, y, heading, 0 * x]), self.begins
        ground = Ground(self.problem.terrain, self.fleet, self.members) if self.problem.terrain else None
        grounds = np.array([self.setting(GROUND, name) for name in parameters(self.problem.terrain, self.fleet)])
        # a command that does not come ends each row, so that the last one stays
        begins = np.concatenate([begins, np.full((len(begins), 1), np.iinfo(np.int64).max)], axis=1)
        pushes = [self.pushes(name) for name in arcs.states]
        turning = pushes[2] if arcs.heading_from == "x" else -pushes[2]
        rows, now = np.arange(len(begins)), np.full(len(begins), -1)
        names = self.problem.specification.signals
        found = np.empty((self.last * self.substeps + 1, 2 + len(names), len(rows)))
        found[0, :2], every = at[:2], self.ticks // self.substeps
        for i in range(self.last * self.ticks):
            n = i // self.ticks
            now = now + (begins[rows, now + 1] <= i)
            v, omega = self._rates(now, n)
            here = _Tick(
                tick,
                linear * self._factors(0, n) * v,
                angular * self._factors(1, n) * omega,
                angular * self._model_turn(i - late),
                turning[:, n],
                np.stack([pushes[0][:, n], pushes[1][:, n]]),
                arcs.heading_from == "y",
                self.fleet.uncertainty.heading_hold,
            )
            same = np.ones((2, len(rows)))
            if names and i % every == 0:  # at a sample the rates of the tick that begins
                ratios = same if ground is None else ground.ratios(rows, ground.inside(at[:2]), grounds[:, :, n])
                found[i // every, 2:] = self._read(now, n, *here.rates(rows, at, ratios), at[2])
            if ground is None:
                at = here.moved(rows, at, np.full(len(rows), tick), same)
            else:
                at = ground.crossed(at, grounds[:, :, n], tick, here.reach, here.moved)
            if (i + 1) % every == 0:
                found[(i + 1) // every, :2] = at[:2]
        if names:  # at the end those of the last one
            ratios = same if ground is None else ground.ratios(rows, ground.inside(at[:2]), grounds[:, :, n])
            found[-1, 2:] = self._read(now, n, *here.rates(rows, at, ratios), at[2])
        return found.transpose(2, 0, 1)

    def _read(self, now: Ints, n: int, speed: Floats, rate: Floats, own: Floats) -> list[Floats]:
        """The signals that the task reads, from a speed, a turn rate and a heading in the system's own convention."""
        arcs = self.fleet.arcs
        commands = dict(zip(arcs.controls, self.commands(np.maximum(now, 0), n), strict=True))
        turn = rate if arcs.heading_from == "x" else -rate
        values = commands | {"v": speed, "omega": turn, "heading": arcs.own_heading(own)}
        return [values[name] for name in self.problem.specification.signals]

    def _rates(self, now: Ints, n: int) -> tuple[Floats, Floats]:
        """Speed and turn rate of the commands that are carried out; none before the first."""
        v, omega = self.fleet.arcs.rates(*self.commands(np.maximum(now, 0), n))
        moving = now >= 0
        return np.where(moving, v, 0.0), np.where(moving, omega, 0.0)

    def _model_turn(self, tick: Ints) -> Floats:
        """The model's turn rate at some ticks of its own time, shape (robots,)."""
        _, omega = self.fleet.arcs.rates(*self.controls.T)
        which = np.clip(tick // self.ticks, 0, len(self.controls) - 1)
        return np.where(tick >= 0, omega[which], 0.0)

    def _factors(self, place: int, n: int) -> Floats:
        """What strays multiply the factor on the speed (0) or on the turn rate (1) with."""
        names = [name for name in self.fleet.uncertainty.varies if self.fleet.arcs.directions[name][place]]
        return np.asarray(np.prod([np.ones(len(self.members)), *(self.factor(name, n) for name in names)], axis=0))


@dataclass(frozen=True, eq=False)
class _Tick:
    """Robots whose commands are constant for a time.

    `speed` and `turn` are their rates with their own factors, `model` the turn rate of their model, `push` and `drift`
    the errors of rates; `hold` is the time constant of the loop on the heading.
    """

    tick: float
    speed: Floats
    turn: Floats
    model: Floats
    push: Floats
    drift: Floats
    swapped: bool
    hold: float | None

    @property
    def reach(self) -> Floats:
        """Metres that they move at most, with their own factors."""
        return np.asarray(self.tick * (np.abs(self.speed) + np.abs(self.drift).sum(axis=0)))

    def rates(self, some: Ints, at: Floats, ratios: Floats) -> tuple[Floats, Floats]:
        """Speed and turn rate of some robots, with ratios of their factors."""
        # the error of the heading: its rate is what is not the model's, less what a loop takes back
        extra = ratios[1] * self.turn[some] - self.model[some] + self.push[some]
        # constant in a tick with e' + e / tau = extra at its end, and no more than the bound at its beginning
        gained = extra if self.hold is None else (extra - at[3] / self.hold) / (1 + self.tick / self.hold)
        return ratios[0] * self.speed[some], self.model[some] + gained

    def moved(self, some: Ints, at: Floats, seconds: Floats, ratios: Floats) -> Floats:
        """Places, headings and their errors of some robots after some seconds, shape (4, robots)."""
        x, y, heading, off = at
        speed, rate = self.rates(some, at, ratios)
        along = heading + rate * seconds / 2
        chord = speed * seconds * np.sinc(rate * seconds / 2 / np.pi)
        first, second = chord * np.cos(along), chord * np.sin(along)
        dx, dy = (second, first) if self.swapped else (first, second)
        drift = self.drift[:, some] * seconds
        return np.stack(
            [x + dx + drift[0], y + dy + drift[1], heading + rate * seconds, off + (rate - self.model[some]) * seconds]
        )


class _ByRule(_Run):
    """Robots that an ODE defines, by the rule of the replay with as many steps as the model needs, and twice."""

    def states(self) -> Floats:
        """States at the samples."""
        fleet, system = self.fleet, self.fleet.system
        count = max(2, ceil(needed(fleet, self.controls, self.step) / self.substeps))
        x, psi = fleet.start_states(self.members), fleet.psi(self.members)
        found = np.empty((self.last * self.substeps + 1, *x.shape))
        found[0] = x
        for n in range(self.last):
            u = self.commands(np.full(len(self.members), n), n)
            own = {name: value * self.factor(name, n) for name, value in psi.items()}
            push = np.stack([self.pushes(name)[:, n] for name in system.states])

            def rates(at: Floats, u: Any = u, own: Any = own, push: Floats = push) -> Floats:
                return np.asarray(system.derivatives(at, u, own) + push)

            with np.errstate(all="ignore"):
                for k in range(self.substeps):
                    x = extrapolated(rates, x, self.step / self.substeps, count)
                    found[n * self.substeps + k + 1] = x
        return found.transpose(2, 0, 1)
