"""A loop and the simulated robots that it is tried on, as a problem file gives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace

import numpy as np

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.simulated import Factors, Fixed, Flaws, SimulatedFleet, SimulatedRobot, Terrain
from ensemble_ctrl.planning.online.simulated_errors import ErrorKind, SimulatedErrors
from ensemble_ctrl.planning.online.simulated_obstacles import ObstacleSettings
from ensemble_ctrl.planning.online.simulated_states import SimulatedStates
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.starts import by_start
from ensemble_ctrl.problem.uncertainty import Uncertainty


@dataclass(frozen=True)
class RobotSettings:
    """A simulated robot.

    Parameters
    ----------
    factors : Factors or None
        Its true factors; None draws them from the ranges of the fleet.
    flaws : Flaws or None
        What is wrong with it; None for measurements as wrong as is assumed, 0.1 s late.
    seed : int
        Of all that is drawn.
    errors : {"random", "bang-bang", "constant", "none"}
        How what it does beside its model goes within its bounds.
    uncertainty : Uncertainty or None
        These bounds; None for those of the fleet.
    parameters : mapping of str to float
        For a system that an ODE defines: its true parameters; those that are not named are drawn.
    """

    factors: Factors | None = None
    flaws: Flaws | None = None
    seed: int = 0
    errors: ErrorKind = "random"
    uncertainty: Uncertainty | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class OnlineSettings:
    """The section ``online`` of a problem file.

    Parameters
    ----------
    options : OnlineOptions
    robots : mapping of str to RobotSettings
        The robots that hear the commands, by name.
    obstacles : mapping of str to ObstacleSettings
        What comes and goes while the loop runs.
    """

    options: OnlineOptions = field(default_factory=OnlineOptions)
    robots: Mapping[str, RobotSettings] = field(default_factory=lambda: {"robot": RobotSettings()})
    obstacles: Mapping[str, ObstacleSettings] = field(default_factory=dict)

    def simulated(self, problem: Problem) -> SimulatedFleet:
        """The robots, at the start of a problem's fleet."""
        made = self._simulated if problem.fleet.system.on_arcs else self._by_states
        each = by_start(problem) if problem.fleet.starts else dict.fromkeys(self.robots, problem)
        return SimulatedFleet({name: made(each[name], robot) for name, robot in self.robots.items()})

    def _by_states(self, problem: Problem, robot: RobotSettings) -> SimulatedStates:
        """One of a system that an ODE defines."""
        fleet, flaws = problem.fleet, robot.flaws or Flaws()
        if robot.factors is not None:
            wanted = f"its parameters by name for the {fleet.system.name}"
            raise ProblemError(f"online.robot: expected {wanted}, got factors on speed and turn rate")
        if strange := [name for name in robot.parameters if name not in fleet.names]:
            known = ", ".join(fleet.names) or "none"
            raise ProblemError(f"online.robot.parameters: expected names among {known}, got {strange[0]!r}")
        drawn = {**fleet.named(fleet.sample(1, robot.seed)[0]), **robot.parameters}
        errors = self.options.errors_of(problem)
        return SimulatedStates(fleet, problem.step, drawn, errors, flaws.delay, flaws.lost_measurements, robot.seed)

    def _simulated(self, problem: Problem, robot: RobotSettings) -> SimulatedRobot:
        """One of them."""
        fleet = problem.fleet
        factors = robot.factors
        if factors is None:
            coefficients = fleet.coefficients(fleet.sample(1, robot.seed))[0]
            factors = Fixed(float(coefficients[0]), float(coefficients[1]))
        errors = self.options.errors
        flaws = robot.flaws or Flaws(errors.position, errors.heading, 0.1)
        bounds = fleet.uncertainty if robot.uncertainty is None else robot.uncertainty
        # patches of its own are in its factors
        terrain = {} if isinstance(factors, Terrain) else problem.terrain
        off = SimulatedErrors(fleet.with_(uncertainty=bounds), problem.step, robot.errors, robot.seed, terrain)
        start = np.array(fleet.start_place), fleet.heading
        return SimulatedRobot(
            fleet.arcs, *start, problem.step, factors, flaws, robot.seed, off if bounds or terrain else None
        )

    def with_robots(self, traction: float | None = None, seed: int | None = None) -> OnlineSettings:
        """The same with another true traction of all robots, or another seed of the first, from which others count."""
        robots = dict(self.robots)
        for k, name in enumerate(robots):
            if traction is not None:
                robots[name] = replace(robots[name], factors=Fixed(traction, traction))
            if seed is not None:
                robots[name] = replace(robots[name], seed=seed + k)
        return replace(self, robots=robots)
