"""From a validated problem file to a `Problem`."""

from __future__ import annotations

import math

import numpy as np

from ensemble_ctrl.config.laws import law_of
from ensemble_ctrl.config.schema import FleetSection, ObjectiveSection, ProblemFile
from ensemble_ctrl.problem import Fleet, Objective, Problem, ReportOptions, SolveOptions, VerifyOptions
from ensemble_ctrl.systems import SYSTEMS

STEP = 0.1
"""Length of a control step in seconds, unless the file gives a number of steps."""


def build(file: ProblemFile, name: str) -> Problem:
    """The problem that a file describes.

    Raises
    ------
    ProblemError
        If parts of it don't fit together.
    """
    horizon = file.horizon
    return Problem(
        name=file.name or name,
        fleet=_fleet(file.fleet),
        duration=horizon.duration,
        steps=horizon.steps or max(1, round(horizon.duration / STEP)),
        task=file.task,
        regions={name: shape.area for name, shape in file.regions.items()},
        obstacles={
            name: tuple(piece for shape in shapes for piece in shape.pieces) for name, shapes in file.obstacles.items()
        },
        objective=_objective(file.objective),
        order=file.moments.order,
        solve=SolveOptions(**file.solve.model_dump()),
        verify=VerifyOptions(**file.verify.model_dump()),
        report=ReportOptions(**file.report.model_dump()),
    )


def _fleet(section: FleetSection) -> Fleet:
    """Who moves."""
    start, bounds = section.start, section.input_bounds
    (v_low, v_high), (omega_low, omega_high) = bounds.v, bounds.omega
    return Fleet(
        system=SYSTEMS[section.model](heading_from=start.heading_from),
        parameter=law_of(section.parameters.traction, "traction"),
        position=np.array(start.position),
        heading=start.heading if start.heading_from == "x" else math.pi / 2 - start.heading,
        input_lower=np.array([v_low, omega_low]),
        input_upper=np.array([v_high, omega_high]),
        radius=section.radius,
        parameter_name="traction",
    )


def _objective(section: ObjectiveSection) -> Objective:
    """What the plan trades off."""
    terminal = section.terminal
    if terminal is None:
        return Objective(robustness=section.robustness, effort=section.effort)
    return Objective(section.robustness, np.array(terminal.target), terminal.weight, section.effort)
