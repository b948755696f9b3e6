"""A whole fleet under one broadcast, of which only mean and covariance are seen.

Which robot is where is not known, so no robot's parameters are learnt, but their distribution is: a range whose uniform
distribution moves the mean and spreads the places as was measured.  Plans under way are made for that range.  What is
*proven* is always the whole sequence of commands, those sent and those planned, for the range that was assumed at the
start: every robot that follows the model does the task, whatever was learnt.
"""

from __future__ import annotations

import math
import time

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.remaining import SetCertificate, certify_set
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.ocp.online import InitialCondition, OnlineProgram, Timer
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.remaining import of_one_robot, with_ranges
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.systems import ArcSystem

Floats = NDArray[np.float64]

NODES = 8
"""Points of the rule with which means over the distribution are taken."""
SPARE = 1.2
"""Factor on a learnt half width: a range is planned for that is a little wider than what was seen."""
ROUNDS = 12
"""Gauss-Newton steps of a fit, at most."""
LEAST_PROGRAMS = 3
"""Quadratic programs for each plan, at least: it is for a range that changes with what was learnt."""


@dataclass(frozen=True, eq=False)
class Aggregate:
    """What a camera far above sees of a swarm.

    Attributes
    ----------
    time : float
        Seconds since the plan began.
    mean : ndarray, shape (2,)
        Of the places, metres.
    covariance : ndarray, shape (2, 2)
        Of the places, square metres.
    """

    time: float
    mean: Floats
    covariance: Floats

    @property
    def numbers(self) -> Floats:
        """Mean, and the square roots of the variances, shape (4,), metres."""
        return np.concatenate([self.mean, np.sqrt(np.maximum(np.diag(self.covariance), 0.0))])


class Swarm:
    """Plans for a whole fleet again and again; `step` takes an aggregate and returns the next broadcast commands.

    Parameters
    ----------
    problem : Problem
        Its fleet has one parameter that bends trajectories.
    options : OnlineOptions, optional
        Of `errors`, none is used: robots are as the model, and an aggregate that can't be explained is reported.
    controls : ndarray, shape (steps, n_u), optional
        A plan to begin with; made here if not given.
    timer : callable
        Seconds, for the deadline.

    Attributes
    ----------
    sent : int
        Control steps whose commands have been returned.
    range : tuple of float
        What plans are made for: what is assumed until something has been learnt.
    misfit : float
        Root mean square difference, in metres, between what was seen and what the learnt distribution explains.
    certificate : SetCertificate
        Of all commands, sent and planned, for the assumed range.

    Raises
    ------
    ProblemError
        For a fleet with another number of such parameters, or with parameters of the start.
    """

    def __init__(
        self,
        problem: Problem,
        options: OnlineOptions | None = None,
        controls: Floats | None = None,
        timer: Timer = time.perf_counter,
    ) -> None:
        self.problem, self.options, self.timer = of_one_robot(problem), options or OnlineOptions(), timer
        names = problem.fleet.names
        if len(names) != 1 or names != self.problem.fleet.names:  # where a robot starts is not measured
            raise ProblemError(f"swarm: expected a fleet with one factor, got {', '.join(names)}")
        late = problem.fleet.uncertainty
        if late.delay or late.jitter or problem.terrain:
            raise ProblemError("swarm: expected a fleet without terrain, delay and jitter, which its sets do not count")
        self.plan = solve(self.problem).controls if controls is None else np.array(controls, dtype=float)
        self.program = OnlineProgram.of(self.problem, self.plan, self.options.order)
        self.assumed = float(self.problem.fleet.lower[0]), float(self.problem.fleet.upper[0])
        self.range, self.misfit, self.sent = self.assumed, 0.0, 0
        self.seen: list[Aggregate] = []
        self.certificate = self._certified(self.plan)

    @property
    def over(self) -> bool:
        """Whether all commands have been returned."""
        return self.sent >= self.problem.steps

    def observe(self, seen: Aggregate) -> None:
        """Learn from an aggregate; one that is not finite, or no later than the last, is left out."""
        numbers = np.array([seen.time, *seen.mean, *seen.covariance.ravel()])
        if not np.isfinite(numbers).all() or (self.seen and seen.time <= self.seen[-1].time):
            return
        self.seen.append(seen)
        if seen.time > 0:
            self._learn()

    def step(self) -> Floats:
        """Plan from what is known, and return the commands that follow those already returned.

        Returns
        -------
        ndarray, shape (applied_steps or fewer, n_u)
            Of a new plan if it came in time and the whole sequence is proven, of the last one otherwise.
        """
        began = self.timer()
        rounds = max(self.options.rounds, LEAST_PROGRAMS)
        found = self.program.solve(self._present(), 0.6 * self.options.deadline, rounds, self.timer)
        certificate = self._certified(found.controls)
        if certificate.proven and self.timer() - began <= self.options.deadline:
            self.plan, self.certificate = found.controls, certificate
        end = min(self.sent + self.options.applied_steps, self.problem.steps)
        controls = self.plan[self.sent : end]
        self.sent = end
        return controls

    def expected(self, bounds: tuple[float, float], times: Floats) -> Floats:
        """Mean and deviations at some times under a uniform distribution, shape (times, 4), metres."""
        # members at Gauss-Legendre nodes of the range; places between grid times are interpolated
        s, weights = np.polynomial.legendre.leggauss(NODES)
        members = (bounds[0] + bounds[1]) / 2 + (bounds[1] - bounds[0]) / 2 * s[:, None]
        fleet, step = self.problem.fleet, self.problem.step
        paths = fleet.arcs.paths(self.plan, fleet.coefficients(members), step)
        # step and share of it at each time
        at = np.clip(times / step, 0, self.problem.steps)
        low = np.minimum(at.astype(int), self.problem.steps - 1)
        places = paths[:, low] + (at - low)[:, None] * (paths[:, low + 1] - paths[:, low])
        # mean and deviation under the uniform distribution, whose weights sum to 2
        mean = np.einsum("m,mtd->td", weights / 2, places)
        spread = np.einsum("m,mtd->td", weights / 2, (places - mean) ** 2)
        return np.concatenate([mean, np.sqrt(spread)], axis=1)

    def _learn(self) -> None:
        """The middle and the half width that explain all aggregates best."""
        wanted = np.array([seen.numbers for seen in self.seen])
        times = np.array([seen.time for seen in self.seen])
        low, high = self.assumed
        guess = np.array([(self.range[0] + self.range[1]) / 2, (self.range[1] - self.range[0]) / 2 / SPARE])
        for _ in range(ROUNDS):
            # Gauss-Newton on (middle, half width): slopes by central differences
            off = (self._explained(guess, times) - wanted).ravel()
            slopes = [
                (self._explained(guess + h, times) - self._explained(guess - h, times)).ravel() / 2e-5
                for h in 1e-5 * np.eye(2)
            ]
            change = np.linalg.lstsq(np.stack(slopes, axis=1), -off, rcond=1e-9)[0]
            guess = np.array([np.clip(guess[0] + change[0], low, high), abs(guess[1] + change[1])])
            if np.abs(change).max() < 1e-7:
                break
        self.misfit = float(np.sqrt(((self._explained(guess, times) - wanted) ** 2).mean()))
        # the learnt range, SPARE times as wide, within the assumed one
        half = SPARE * guess[1]
        self.range = max(low, float(guess[0] - half)), min(high, float(guess[0] + half))

    def _explained(self, guess: Floats, times: Floats) -> Floats:
        """What a middle and a half width lead to."""
        return self.expected((float(guess[0] - guess[1]), float(guess[0] + guess[1])), times)

    def _certified(self, controls: Floats) -> SetCertificate:
        """What is proven of all commands for the assumed range."""
        return certify_set(self.problem, controls, 0.0, 0.0)

    def _present(self) -> InitialCondition:
        """The fleet at the start, with what has been sent fixed: it is carried along exactly."""
        fleet = with_ranges(self.problem.fleet, np.array([self.range]))
        coefficients = fleet.coefficients(fleet.dynamic_members(self.program.truncation.nodes))
        steps = self.problem.steps
        return InitialCondition(0, self.sent, coefficients, np.zeros((0, 1, 2)), np.zeros(steps + 1), self.plan)


class SimulatedSwarm:
    """Thousands of robots under one broadcast, and their camera.

    Parameters
    ----------
    system : ArcSystem
    coefficients : ndarray, shape (members, 5)
        The drive of every robot.
    step : float
        Seconds.
    noise : float
        Deviation of the camera's error of the mean and of the deviations, metres.
    seed : int
    """

    def __init__(self, system: ArcSystem, coefficients: Floats, step: float, noise: float = 0.0, seed: int = 0) -> None:
        self.system, self.coefficients, self.step, self.noise = (
            system,
            np.asarray(coefficients, dtype=float),
            step,
            noise,
        )
        self.controls = np.zeros((0, 2))
        self._random = np.random.default_rng(seed)

    @property
    def places(self) -> Floats:
        """Where everyone is, shape (members, 2), metres."""
        if not len(self.controls):
            return self.coefficients[:, 3:]
        return np.asarray(self.system.paths(self.controls, self.coefficients, self.step)[:, -1])

    def drive(self, controls: Floats) -> None:
        """Carry out one broadcast after the other."""
        self.controls = np.concatenate([self.controls, controls])

    def look(self) -> Aggregate:
        """Mean and covariance now, as the camera sees them."""
        places = self.places
        scale = 1.0 + self._random.normal() * self.noise / max(math.sqrt(float(places.var(axis=0).sum())), 0.05)
        mean = places.mean(axis=0) + self._random.normal(size=2) * self.noise
        return Aggregate(len(self.controls) * self.step, mean, np.cov(places.T) * scale**2)


def uniform_members(low: float, high: float, count: int) -> Floats:
    """Values of a parameter spread evenly over a range, shape (count, 1)."""
    return Interval(low, high).to_parameter(np.linspace(-1.0, 1.0, count))[:, None]
