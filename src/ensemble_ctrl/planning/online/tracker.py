"""Where one robot is and has been, and what is known of its parameters."""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.planning.online.ground import Ground
from ensemble_ctrl.planning.online.lateness import lags
from ensemble_ctrl.planning.online.measurement import Measurement
from ensemble_ctrl.planning.online.membership import Membership
from ensemble_ctrl.planning.online.propagation import Commands, Errors, Factors, PoseSet, departure
from ensemble_ctrl.planning.online.slips import fastest
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.uncertainty import Uncertainty

Floats = NDArray[np.float64]

WIDER = 1.5
"""Factor by which ranges grow when no parameters in them fit the measurements."""
SLOWEST = 0.05
"""Smallest factor that ranges may grow to."""
PIECE, PIECES = 0.01, 16
"""Width of the pieces of a range for which contact with patches of terrain is decided, and the most of them."""
NEAR = 1e-6
"""Share of a step by which a time may miss a grid time."""


class Tracker:
    """The robot's past: commands, measurements, and the sets that follow from them.

    Parameters
    ----------
    problem : Problem
        Of one robot.
    errors : Errors
    learn : bool
        Whether parameters are learnt; without it their assumed ranges stand.

    Attributes
    ----------
    sets : Membership
    sent : ndarray, shape (steps so far, n_u)
        Commands since time 0.
    past : list of PoseSet
        The sets of poses at the grid times up to the last measurement: each is reached from the measurements before it
        and narrowed by the first one after it.
    last : Measurement or None
        The newest that was used.
    holds : bool
        False once measurements contradicted what was assumed; it stays so.
    widened : int
        How often ranges had to grow.
    kept_out : frozenset of str
        Patches of terrain that the program keeps out of.
    """

    def __init__(self, problem: Problem, errors: Errors, learn: bool) -> None:
        self.problem, self.errors, self.learn = problem, errors, learn
        self.sets = Membership(problem.fleet, errors)
        self.sent = np.zeros((0, len(problem.fleet.system.controls)))
        self.past: list[PoseSet] = []
        self.last: Measurement | None = None
        self.holds, self.widened = True, 0
        self.kept_out: frozenset[str] = frozenset()
        self._ground = Ground(problem)
        self._marks = self._ground.nowhere(0)
        self._commands = Commands(problem.fleet, self.sent, problem.step)

    @property
    def ranges(self) -> Floats:
        """What is known of the parameters, shape (parameters, 2)."""
        return self.sets.ranges

    @property
    def time(self) -> float:
        """Of the newest measurement, seconds."""
        return 0.0 if self.last is None else self.last.time

    def send(self, controls: Floats) -> None:
        """Some more commands were given out."""
        self.sent = np.concatenate([self.sent, controls])
        self._marks = np.concatenate([self._marks, ~self._ground.nowhere(len(controls))], axis=1)
        self._look_ahead()

    def recall(self, begin: int) -> None:
        """Commands from step `begin` on, which is not past, will not be carried out."""
        self.sent, self._marks = self.sent[:begin], self._marks[:, :begin]
        self._look_ahead()

    def observe(self, measurement: Measurement) -> list[str]:
        """Learn from a measurement; returns what was out of the ordinary."""
        refused = self._refused(measurement)
        if refused is not None:
            return [refused] if refused else []
        events = []
        before = copy(self.sets)
        gap = self._past(self.sets, measurement.time) if self._seen(measurement) else None
        if gap is None:
            self.holds = False
            # it may have been anywhere in the step in which it was seen again
            self._marks[:, int(max(measurement.time - self.delay, 0.0) / self.problem.step) :] = True
            self.past += self._past(before, measurement.time - NEAR * self.problem.step) or []
            events.append(self._contradicted(before, measurement))
            self._seen(measurement)
            gap = self._past(self.sets, measurement.time) or []
        if not self.learn:
            self.sets.ranges = self.sets.assumed.copy()
        self.past += gap
        self.last = measurement
        if self._ground:
            self._look_ahead()
        return events

    def pose(self, time: float) -> PoseSet | None:
        """The set of poses at a time; None before the first measurement."""
        return self._present(self.sets, time) if len(self.sets.times) else None

    def onset(self, k: int) -> PoseSet | None:
        """The set of poses from which commands lead on at a grid time: of the robot, or of its undelayed self."""
        if not self.delay and k < len(self.past):
            return self.past[k]
        return self.sets.pose(self._commands, k * self.problem.step) if len(self.sets.times) else None

    @property
    def delay(self) -> float:
        """By how much the robot may be late, seconds."""
        return self.problem.fleet.uncertainty.delay

    @property
    def at(self) -> int:
        """The first grid time from the newest measurement on."""
        return min(int(np.ceil(self.time / self.problem.step - NEAR)), len(self.sent))

    def departures(
        self, controls: Floats, begin: int, pose: PoseSet, beyond: bool = True, planned: bool = False
    ) -> Floats:
        """Metres by which the robot may be led away in each step of `controls`, from the grid time `begin` on.

        They count from that time, at which it, or its undelayed self, is in `pose`, and drift from the last
        measurement, at which the factors are known. What terrain and a delay may add is in them. What a certificate
        with the errors of `onwards` counts is left out, unless it is not `beyond` that. For what is `planned`, patches
        that the program keeps out of do not count.
        """
        ground = Ground(self.problem, self.kept_out) if planned else self._ground
        step, sets, n = self.problem.step, self.sets, len(controls)
        # with the commands before, by which a heading that is held may be off by now
        whole = np.concatenate([self.sent[:begin], controls])
        before = ground.nowhere(begin) if planned else self._marks[:, :begin]
        unmarked = np.concatenate([before, ground.nowhere(n)], axis=1)
        since: Floats = np.full(n, begin * step)
        until: Floats = np.asarray(step * np.arange(begin + 1, begin + n + 1), dtype=float)
        found, met = np.zeros(n), unmarked
        for ranges in sets.pieces(PIECE, PIECES) if ground else [sets.ranges]:
            known, own = sets.of_ranges(ranges), self._own(ranges)
            marks = ground.marked(whole, unmarked, own, (self.errors, known), pose, begin * step)
            ahead = ground.commands(whole, marks, own)
            led = departure(ahead, self.errors, known, since, until, beyond)[1]
            found, met = np.maximum(found, led), met | marks
        if not self.delay:
            return found
        driven = ground.commands(whole, met, self._own(sets.ranges))
        return found + lags(driven, self.delay, sets.known.most, begin, n)

    @property
    def onwards(self) -> Uncertainty:
        """Bounds for a robot of which the pose is known, but not how far a loop has let its heading go.

        From then on the heading departs by ``e(t) - e(0)``, whose rate is that of ``e`` and at most ``|e(0)| / tau``
        more. They are of an undelayed self: what a delay adds is in `departures`.
        """
        bounds = self.problem.fleet.uncertainty.with_(delay=0.0)
        if bounds.heading_hold is None:
            return bounds
        worst = self._commands.slips.let_go(self.sets.known.most[1])
        heading = bounds.disturbance.get("heading", 0.0) + worst
        return bounds.with_(disturbance={**bounds.disturbance, "heading": heading})

    def bulge(self, k: int) -> float:
        """Metres by which the robot may leave the segment between the places at grid times `k` and ``k + 1``."""
        step, commands, (a, b) = self.problem.step, self._commands, self.sets.known.most
        since = max(k * step - self.delay, 0.0)
        n, last = (min(i, len(commands.v) - 1) for i in (int(since / step + NEAR), k))
        v, omega = commands.v[n : last + 1], commands.omega[n : last + 1]
        # sagitta of the arc, h^2/8 a b |v omega|, and a departure from both ends of the segment
        arc = step**2 / 8 * a * b * abs(v[-1] * omega[-1])
        if self.delay:
            # of commands that may change on the way: h/4 times what the velocity changes by, also from standing
            v = np.append(v, 0.0) if k * step < self.delay else v
            turned = min(b * step * float(np.abs(omega).max()), 2.0)
            arc = step / 4 * a * (float(np.ptp(v)) + float(np.abs(v).max()) * turned)
        here = Factors(k * step, np.array([-a, a]), np.array([-b, b]), (a, b))
        ends = np.array([since]), np.array([(k + 1) * step])
        return float(arc + 2 * departure(commands, self.errors, here, *ends)[1][0])

    def _present(self, sets: Membership, time: float) -> PoseSet | None:
        """The set of poses at a time, by some sets; commands that are not sent yet may begin early."""
        found, jitter = sets.present(self._commands, time), self.problem.fleet.uncertainty.jitter
        if found is None or time + jitter < (len(self.sent) - NEAR) * self.problem.step:
            return found
        # J times the fastest rates, with their errors, that a command can ask for
        v, omega = fastest(self.problem.fleet)
        a, b = sets.known.most
        return found.widened(jitter * b * omega, jitter * a * v)

    def _own(self, ranges: Floats) -> dict[str, tuple[float, float]]:
        """Ranges of the robot's own parameters at all times, by those of the last measurement."""
        ends = self.sets.assumed if self.errors.drift else ranges
        return {name: (float(low), float(high)) for name, (low, high) in zip(self.sets.names, ends, strict=True)}

    def _look_ahead(self) -> None:
        """Decide anew in which steps from the last measurement on the robot may be in patches of terrain."""
        own, sets = self._own(self.ranges), self.sets
        self._commands = self._ground.commands(self.sent, self._marks, own)
        if not self._ground or not len(sets.times):
            return
        time = float(sets.times[-1])
        if (pose := sets.pose(self._commands, time)) is not None:
            self._marks = self._ground.marked(self.sent, self._marks, own, (self.errors, sets.known), pose, time)
            self._commands = self._ground.commands(self.sent, self._marks, own)

    def _refused(self, measurement: Measurement) -> str | None:
        """Why a measurement can't be used; empty for one that was seen before."""
        if not measurement.finite:
            return "measurement ignored: it is not finite"
        if self.last is not None and measurement.time <= self.last.time + 1e-9:
            stale = f"measurement ignored: {measurement.time:.2f} s is not after the last one's {self.last.time:.2f} s"
            return "" if measurement == self.last else stale
        latest = len(self.sent) * self.problem.step
        if not -1e-9 <= measurement.time <= latest + NEAR:
            return f"measurement ignored: {measurement.time:.2f} s is not within the {latest:.2f} s commanded so far"
        return None

    def _seen(self, measurement: Measurement) -> bool:
        """Let the sets learn; False if nothing is consistent."""
        place = np.array([measurement.x, measurement.y])
        return self.sets.observe(self._commands, measurement.time, place, measurement.heading)

    def _past(self, sets: Membership, until: float) -> list[PoseSet] | None:
        """The sets at the grid times up to a time that are not remembered yet; None if one is empty."""
        step, first = self.problem.step, len(self.past)
        count = max(int(np.floor(until / step + NEAR)) + 1 - first, 0)
        # sets at grid times from measurements on both sides of them
        found = [self._present(sets, k * step) for k in range(first, first + count)] if len(sets.times) else []
        poses = [pose for pose in found if pose is not None]
        return poses if len(poses) == len(found) else None

    def _contradicted(self, before: Membership, measurement: Measurement) -> str:
        """No parameters fit: start again, with the same ranges after a jump and with wider ones otherwise."""
        expected = self._present(before, measurement.time) if len(before.times) else None
        if expected is not None and self._jumped(expected, measurement):
            self.sets.restart(self.sets.assumed)
            return "the robot is where it can't have driven to: it was moved, or measured wrongly"
        self.widened += 1
        # ranges WIDER times as wide about their middle, and above SLOWEST
        middle, half = self.sets.assumed.mean(axis=1), np.maximum(np.ptp(self.sets.assumed, axis=1) / 2, 0.01)
        wider = np.stack([np.maximum(middle - WIDER * half, SLOWEST), middle + WIDER * half], axis=1)
        self.sets.restart(wider)
        given = ", ".join(f"{name} {a:.3g} to {b:.3g}" for name, (a, b) in zip(self.sets.names, wider, strict=True))
        return f"no parameters in the assumed ranges fit what was measured: now {given or 'nothing can be varied'}"

    def _jumped(self, before: PoseSet, measurement: Measurement) -> bool:
        """Whether a place is further from where the robot must be than twice its top speed explains."""
        fleet, since = self.problem.fleet, measurement.time - self.time
        # further than the set's reach, twice the measurement error and twice the top speed since: moved, not driven
        fastest = 2 * float(self.sets.factors[0][1]) * max(abs(fleet.input_lower[0]), abs(fleet.input_upper[0]))
        distance = float(np.hypot(measurement.x - before.position[0], measurement.y - before.position[1]))
        return bool(distance > before.away + 2 * self.errors.position + fastest * since)
