"""A loop and the simulated robot that it is tried on, as a problem file tells them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.receding.options import OnlineOptions
from ensemble_ctrl.receding.simulated import Factors, Fixed, Flaws, SimulatedRobot


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
    """

    factors: Factors | None = None
    flaws: Flaws | None = None
    seed: int = 0


@dataclass(frozen=True)
class OnlineSettings:
    """The section ``online`` of a problem file."""

    options: OnlineOptions = field(default_factory=OnlineOptions)
    robot: RobotSettings = field(default_factory=RobotSettings)

    def simulated(self, problem: Problem) -> SimulatedRobot:
        """The robot, at the start of a problem's fleet."""
        fleet, robot = problem.fleet, self.robot
        factors = robot.factors
        if factors is None:
            drive = fleet.drives(fleet.sample(1, robot.seed))[0]
            factors = Fixed(float(drive[0]), float(drive[1]))
        errors = self.options.errors
        flaws = robot.flaws or Flaws(errors.position, errors.heading, 0.1)
        heading = fleet.heading
        return SimulatedRobot(fleet.system, np.array(fleet.start), heading, problem.step, factors, flaws, robot.seed)

    def with_robot(self, traction: float | None = None, seed: int | None = None) -> OnlineSettings:
        """The same with another true traction, or another seed."""
        robot = self.robot
        if traction is not None:
            robot = replace(robot, factors=Fixed(traction, traction))
        if seed is not None:
            robot = replace(robot, seed=seed)
        return replace(self, robot=robot)
