"""From a validated problem file to a `Problem`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.config.laws import law_of
from ensemble_ctrl.config.ode_section import OdeProblemFile
from ensemble_ctrl.config.schema import FleetSection, ObjectiveSection, ProblemFile
from ensemble_ctrl.fleet import Fleet
from ensemble_ctrl.moments import Law, Samples
from ensemble_ctrl.problem import Objective, OdeProblem, Problem, ReportOptions, SolveOptions, VerifyOptions
from ensemble_ctrl.systems import SYSTEMS, ArcSystem, Bicycle

STEP = 0.1
"""Length of a control step in seconds, unless the file gives a number of steps."""


def build(file: ProblemFile, name: str) -> Problem:
    """The problem that a file describes.

    Raises
    ------
    ProblemError
        If parts of it don't fit together.
    """
    if isinstance(file, OdeProblemFile):
        return OdeProblem(fleet=file.fleet.fleet(), **_rest(file, name))
    return Problem(fleet=_fleet(file.fleet), **_rest(file, name))


def _rest(file: ProblemFile, name: str) -> dict[str, Any]:
    """Everything but the fleet."""
    horizon = file.horizon
    return dict(
        name=file.name or name,
        duration=horizon.duration,
        steps=horizon.steps or max(1, round(horizon.duration / STEP)),
        task=file.task,
        regions={name: shape.area for name, shape in file.regions.items()},
        obstacles={
            name: tuple(piece for shape in shapes for piece in shape.pieces) for name, shapes in file.obstacles.items()
        },
        motions={name: section.motion(horizon.duration) for name, section in file.motions.items()},
        objective=_objective(file.objective),
        order=file.moments.order,
        solve=SolveOptions(**file.solve.model_dump()),
        verify=VerifyOptions(**file.verify.model_dump()),
        report=ReportOptions(**file.report.model_dump()),
    )


def _fleet(section: FleetSection) -> Fleet:
    """Who moves."""
    start, system = section.start, _system(section)
    bounds = np.array(
        [
            default if (given := getattr(section.input_bounds, name)) is None else given
            for name, default in zip(system.controls, system.input_bounds, strict=True)
        ]
    )
    return Fleet(
        system=system,
        parameters=_laws(section),
        rate_bounds=_rates(section, system),
        cloud={name: np.array(column) for name, column in section.robots.items()} or None,
        position=np.array(start.position),
        heading=start.heading if start.heading_from == "x" else math.pi / 2 - start.heading,
        input_lower=bounds[:, 0],
        input_upper=bounds[:, 1],
        radius=section.radius,
    )


def _rates(section: FleetSection, system: ArcSystem) -> NDArray[np.float64] | None:
    """The rate bounds in the order of the commands."""
    if section.rate_bounds is None:
        return None
    given = [getattr(section.rate_bounds, name) for name in system.controls]
    return np.array([math.inf if rate is None else rate for rate in given])


def _laws(section: FleetSection) -> dict[str, Law]:
    """The law of each parameter; the default one only where nothing else is said."""
    given = section.parameters if section.cloud is None or "parameters" in section.model_fields_set else ()
    laws = {name: law_of(law, name) for name, law in given if law is not None}
    return laws | {name: Samples(column) for name, column in section.robots.items()}


def _system(section: FleetSection) -> ArcSystem:
    """The dynamics."""
    if section.model == Bicycle.name:
        longer = {} if section.wheelbase is None else {"wheelbase": section.wheelbase}
        return Bicycle(heading_from=section.start.heading_from, **longer)
    return SYSTEMS[section.model](heading_from=section.start.heading_from)


def _objective(section: ObjectiveSection) -> Objective:
    """What the plan trades off."""
    terminal = section.terminal
    if terminal is None:
        return Objective(robustness=section.robustness, effort=section.effort, smoothness=section.smoothness)
    target = np.array(terminal.target) if isinstance(terminal.target, tuple) else terminal.target
    return Objective(section.robustness, target, terminal.weight, section.effort, section.smoothness)
