"""From a validated problem file to a `Problem`."""

from __future__ import annotations

from typing import Any

import numpy as np

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config.errors import FieldError
from ensemble_ctrl.files.config.poses import with_poses
from ensemble_ctrl.files.config.schema import ObjectiveSection, ProblemFile
from ensemble_ctrl.files.config.uncertainty_section import UncertaintySection
from ensemble_ctrl.problem import Objective, Problem, ReportOptions, SolveOptions, VerifyOptions
from ensemble_ctrl.problem.checks import Finding
from ensemble_ctrl.problem.risk import Risk
from ensemble_ctrl.problem.target import Pose
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.systems import System

STEP = 0.1
"""Length of a control step in seconds, unless the file gives a number of steps."""


def build(file: ProblemFile, name: str) -> Problem:
    """The problem that a file describes.

    Raises
    ------
    ProblemError
        If parts of it don't fit together.
    """
    fleet = file.fleet.fleet()
    return Problem(fleet=fleet, **_rest(file, name, fleet.system))


def _rest(file: ProblemFile, name: str, system: System) -> dict[str, Any]:
    """Everything but the fleet, which has this system."""
    horizon = file.horizon
    duration, least = horizon.bounds
    return dict(
        name=file.name or name,
        duration=duration,
        steps=horizon.steps or max(1, round(duration / STEP)),
        task=with_poses(file, system),
        regions={name: shape.area for name, shape in file.regions.items()},
        obstacles={
            name: tuple(piece for shape in shapes for piece in shape.pieces) for name, shapes in file.obstacles.items()
        },
        motions={name: section.motion(duration) for name, section in file.motions.items()},
        zones={name: shape.zone for name, shape in file.zones.items()},
        terrain={name: section.patch() for name, section in file.terrain.items()},
        objective=_objective(file.objective, system),
        order=file.moments.order,
        coordinates=file.moments.coordinates,
        integrator=file.moments.integrator,
        solve=SolveOptions(**file.solve.model_dump()),
        verify=VerifyOptions(**file.verify.model_dump()),
        report=ReportOptions(**file.report.model_dump()),
        least_duration=least,
        online=None if file.online is None else file.online.settings(system, duration),
        ignore=tuple(file.ignore),
    )


def _objective(section: ObjectiveSection, system: System) -> Objective:
    """What the plan trades off."""
    terminal, controls = section.terminal, system.controls
    weights: dict[str, Any] = {
        name: getattr(section, name) for name in ("robustness", "effort", "smoothness", "earliest")
    }
    if isinstance(section.effort, dict):
        for name in sorted(set(section.effort) - set(controls)):
            message = f"expected weights of {' and '.join(controls)}, got {name!r}"
            wrong = ProblemError(f"objective.effort: {message}")
            wrong.findings = (Finding(("objective", "effort", name), message, on_key=True),)
            raise wrong
        weights["effort"] = np.array([section.effort.get(name, 0.0) for name in controls])
    if section.cvar is not None:
        weights["cvar"] = Risk(section.cvar.of, section.cvar.level, section.cvar.weight)
    if section.tolerance is not None:
        weights["tolerance"] = _tolerance(section.tolerance, system)
    if terminal is None:
        return Objective(**weights)
    target = terminal.target.position if isinstance(terminal.target, Pose) else terminal.target
    target = np.array(target) if isinstance(target, tuple) else target
    return Objective(target=target, terminal=terminal.weight, **weights)


def _tolerance(section: UncertaintySection, system: System) -> Uncertainty:
    """Errors of the model, of which much is to be tolerated."""
    try:
        return section.bounds(system)
    except FieldError as error:
        wrong = ProblemError(f"objective.tolerance: {error.message}")
        wrong.findings = (Finding(("objective", "tolerance", *error.path), error.message, error.hint),)
        raise wrong from None
