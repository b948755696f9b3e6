r"""Which parameters and poses are consistent with what was commanded and what was measured, errors being bounded.

Between two measurements j and k of one robot, with :math:`W(b) = \int v\, e^{i b \Omega}\, dt` over the time between,

.. math::

    \theta_k - \theta_j = b\, \Delta\Omega \pm e_\theta, \qquad
    \lvert p_k - p_j \rvert = a\, \lvert W(b) \rvert \pm e_p, \qquad
    p_k - p_j = a\, e^{i(\theta_k - b\,\Omega_k)} W(b) \pm e_p

The first bounds the factor b on the turn rate, the second, which no heading enters, the factor a on the speed, and all
of them the pose at k.  Every pair of the newest measurement with an older one is used: the bounds are intersected, so
the set of consistent values only shrinks, but for what a parameter may drift.

A robot that may be late (`ensemble_ctrl.planning.online.lateness`) is known by its undelayed self, times of which these
are: a measurement is of such a time, with the larger errors of the pose that follow from not knowing it.

The errors hold the measurements' own, and what drift and actuators may add on the way
(`ensemble_ctrl.planning.online.propagation`, which also gives the poses).  *Guarantee*: as long as all of these are
within their bounds, the true values are never excluded; an empty set therefore shows that some assumption is wrong.

F. C. Schweppe, Recursive state estimation: unknown but bounded errors and system inputs, 1968.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.planning.online.lateness import behind
from ensemble_ctrl.planning.online.propagation import (
    Commands,
    Errors,
    Factors,
    PoseSet,
    departure,
    propagated,
    wrapped,
)
from ensemble_ctrl.planning.online.slips import UP
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]

ROUNDS = 2
"""How often the bounds of both factors and of the pose are intersected, one after the other, for a measurement."""


class Membership:
    """The sets of parameters and poses of one robot.

    Parameters
    ----------
    fleet : Fleet
        The ranges that are assumed; parameters of the start are ignored.
    errors : Errors
    """

    def __init__(self, fleet: Fleet, errors: Errors) -> None:
        self.fleet, self.errors = fleet, errors
        rows = [(k, name) for k, name in enumerate(fleet.names) if name in fleet.system.parameters]
        self.names = tuple(name for _, name in rows)
        self.directions = np.array([fleet.arcs.directions[name] for name in self.names]).reshape(-1, 2)
        self.assumed = np.array([[fleet.lower[k], fleet.upper[k]] for k, _ in rows]).reshape(-1, 2)
        self.ranges = self.assumed.copy()
        self.restart(self.ranges)

    def restart(self, ranges: Floats) -> None:
        """Forget all measurements, and assume `ranges`, shape (parameters, 2)."""
        self.assumed, self.ranges = np.array(ranges, dtype=float), np.array(ranges, dtype=float)
        self.times, self.places, self.headings = np.zeros(0), np.zeros(0, dtype=complex), np.zeros(0)
        self.turns, self.aways = np.zeros(0), np.zeros(0)  # by how much measurements are off for an unknown delay

    @property
    def factors(self) -> tuple[Floats, Floats]:
        """Ranges of the factors on speed and on turn rate, each shape (2,)."""
        linear, angular = (self._factor(self.ranges, place) for place in (0, 1))
        return linear, angular

    def observe(self, commands: Commands, time: float, position: Floats, heading: float) -> bool:
        """Take a measurement, later than all before, into account; returns False if nothing is consistent any more.

        Parameters
        ----------
        commands : Commands
            What was sent, at least up to `time`.
        time : float
            When the pose was this, seconds.
        position, heading
            Metres and radians, from +x counter-clockwise.
        """
        time, turn, away = behind(commands, self.fleet.uncertainty.delay, self.known.most, time)
        if len(self.times):
            # factors drift by at most d per second: the ranges widen, never beyond the assumed ones
            spread = self.errors.drift * (time - self.times[-1])
            self.ranges = self.ranges + spread * np.array([-1.0, 1.0])
            self.ranges = np.stack(
                [np.maximum(self.ranges[:, 0], self.assumed[:, 0]), np.minimum(self.ranges[:, 1], self.assumed[:, 1])],
                axis=1,
            )
        self.times = np.append(self.times, time)
        self.places = np.append(self.places, complex(*position))
        self.headings = np.append(self.headings, heading)
        self.turns, self.aways = np.append(self.turns, turn), np.append(self.aways, away)
        for _ in range(ROUNDS):
            if not (self._turns(commands) and self._ways(commands)):
                return False
        return self.pose(commands, time) is not None

    def pose(self, commands: Commands, time: float) -> PoseSet | None:
        """The set of poses at a time, by all measurements before and after it; None if it is empty.

        Of a robot that may be late, it is of its undelayed self.
        """
        more = self.turns, self.aways
        return propagated(commands, self.errors, self.known, self.times, self.places, self.headings, time, more)

    def present(self, commands: Commands, time: float) -> PoseSet | None:
        """The set of poses of the robot itself at a time; None if it is empty."""
        own, turn, away = behind(commands, self.fleet.uncertainty.delay, self.known.most, time)
        found = self.pose(commands, own)
        return found if found is None else found.widened(turn, away)

    @property
    def known(self) -> Factors:
        """The factors at the last measurement."""
        return self.of_ranges(self.ranges)

    def of_ranges(self, ranges: Floats) -> Factors:
        """The factors at the last measurement of a robot with parameters in some ranges, shape (parameters, 2)."""
        linear, angular = (self._factor(ranges, place) for place in (0, 1))
        most = [float(np.abs(self._factor(self.assumed, place)).max()) for place in (0, 1)]
        return Factors(float(self.times[-1]) if len(self.times) else 0.0, linear, angular, (most[0], most[1]))

    def pieces(self, width: float, most: int) -> list[Floats]:
        """The ranges, cut along the parameter of the speed into pieces of about some width."""
        column = np.flatnonzero(self.directions[:, 0])
        if not len(column):
            return [self.ranges]
        low, high = self.ranges[column[0]].tolist()
        ends = np.linspace(low, high, min(max(int(np.ceil((high - low) / width)), 1), most) + 1)
        found = np.tile(self.ranges, (len(ends) - 1, 1, 1))
        found[:, column[0]] = np.stack([ends[:-1], ends[1:]], axis=1)
        return list(found)

    def _turns(self, commands: Commands) -> bool:
        """Intersect the range of the factor on the turn rate; False if it becomes empty."""
        b0, b1 = self.factors[1]
        b = (b0 + b1) / 2
        here = commands.turns(self.times)
        # theta_k - theta_j = b Omega_jk + error, |error| <= 2 e_theta + slip: intervals of b for each older j
        turned, slip = here[-1] - here[:-1], self._departed(commands)[0]
        seen = wrapped(self.headings[-1] - self.headings[:-1] - b * turned) + b * turned
        error = 2 * self.errors.heading + self.turns[-1] + self.turns[:-1] + slip + UP
        # only pairs where the angle is unique modulo 2 pi
        sure = ((b1 - b0) / 2 * np.abs(turned) + error < np.pi) & (np.abs(turned) > 1e-6)
        seen, turned, error = seen[sure], turned[sure], error[sure]
        ends = np.sort(np.stack([(seen - error) / turned, (seen + error) / turned]), axis=0)
        return self._intersect(1, ends[0].max(initial=-np.inf), ends[1].min(initial=np.inf))

    def _ways(self, commands: Commands) -> bool:
        """Intersect the range of the factor on the speed; False if it becomes empty."""
        (b0, b1), time = self.factors[1], float(self.times[-1])
        b, db = (b0 + b1) / 2, (b1 - b0) / 2
        # |p_k - p_j| = a |W_k - W_j| + error, W(t) = int v exp(i b Omega); b varies, which swings the chord
        here, W = commands.at(self.times, b)
        reach = np.abs(W[-1] - W[:-1])
        swing = commands.swing(self.times[:-1], time, float(here[-1]))
        seen = np.abs(self.places[-1] - self.places[:-1])
        late = self.aways[-1] + self.aways[:-1]
        error = 2 * np.sqrt(2.0) * self.errors.position + late + self._departed(commands)[1] + UP
        longest, shortest = reach + db * swing + UP, reach - db * swing - UP
        # intersect over j: a >= (seen - error) / longest and a <= (seen + error) / shortest
        low = ((seen - error) / longest).max(initial=-np.inf)
        sure = shortest > 1e-6
        high = ((seen + error)[sure] / shortest[sure]).min(initial=np.inf)
        return self._intersect(0, low, high)

    def _departed(self, commands: Commands) -> tuple[Floats, Floats]:
        """What drift and actuators may have added from each older measurement to the newest: heading and place."""
        older = self.times[:-1]
        return departure(commands, self.errors, self.known, older, np.full(len(older), self.times[-1]))

    def _factor(self, ranges: Floats, place: int) -> Floats:
        """The range of one factor under ranges of the parameters; 1 where it depends on no parameter."""
        # a factor is linear in the parameters, with one at most that it depends on
        slope = self.directions[:, place]
        return np.asarray(slope @ ranges) if slope.any() else np.ones(2)

    def _intersect(self, place: int, low: float, high: float) -> bool:
        """Intersect the range of the parameter that a factor depends on; False if nothing is left."""
        column = np.flatnonzero(self.directions[:, place])
        low, high = low - UP * abs(low), high + UP * abs(high)
        if not len(column):
            return bool(low <= 1.0 <= high)
        k = int(column[0])
        self.ranges[k] = max(self.ranges[k, 0], low), min(self.ranges[k, 1], high)
        return bool(self.ranges[k, 0] <= self.ranges[k, 1])
