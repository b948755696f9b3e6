"""From a validated problem file to a `Problem`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config.laws import law_of
from ensemble_ctrl.files.config.ode_section import OdeProblemFile
from ensemble_ctrl.files.config.schema import FleetSection, ObjectiveSection, ProblemFile
from ensemble_ctrl.moments import Law, Samples
from ensemble_ctrl.problem import Objective, OdeProblem, Problem, ReportOptions, SolveOptions, VerifyOptions
from ensemble_ctrl.problem.checks import Finding
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.risk import Risk
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
        robots = file.fleet.fleet()
        return OdeProblem(fleet=robots, **_rest(file, name, robots.system.controls))
    fleet = _fleet(file.fleet)
    return Problem(fleet=fleet, **_rest(file, name, fleet.system.controls))


def _rest(file: ProblemFile, name: str, controls: tuple[str, ...]) -> dict[str, Any]:
    """Everything but the fleet, which has these commands."""
    horizon = file.horizon
    duration, least = horizon.bounds
    return dict(
        name=file.name or name,
        duration=duration,
        steps=horizon.steps or max(1, round(duration / STEP)),
        task=file.task,
        regions={name: shape.area for name, shape in file.regions.items()},
        obstacles={
            name: tuple(piece for shape in shapes for piece in shape.pieces) for name, shapes in file.obstacles.items()
        },
        motions={name: section.motion(duration) for name, section in file.motions.items()},
        objective=_objective(file.objective, controls),
        order=file.moments.order,
        solve=SolveOptions(**file.solve.model_dump()),
        verify=VerifyOptions(**file.verify.model_dump()),
        report=ReportOptions(**file.report.model_dump()),
        least_duration=least,
        online=None if file.online is None else file.online.settings(),
        ignore=tuple(file.ignore),
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


def _objective(section: ObjectiveSection, controls: tuple[str, ...]) -> Objective:
    """What the plan trades off."""
    terminal = section.terminal
    weights = {name: getattr(section, name) for name in ("robustness", "effort", "smoothness", "earliest")}
    if isinstance(section.effort, dict):
        for name in sorted(set(section.effort) - set(controls)):
            message = f"expected weights of {' and '.join(controls)}, got {name!r}"
            wrong = ProblemError(f"objective.effort: {message}")
            wrong.findings = (Finding(("objective", "effort", name), message, on_key=True),)
            raise wrong
        weights["effort"] = np.array([section.effort.get(name, 0.0) for name in controls])
    if section.cvar is not None:
        weights["cvar"] = Risk(section.cvar.of, section.cvar.level, section.cvar.weight)
    if terminal is None:
        return Objective(**weights)
    target = np.array(terminal.target) if isinstance(terminal.target, tuple) else terminal.target
    return Objective(target=target, terminal=terminal.weight, **weights)
