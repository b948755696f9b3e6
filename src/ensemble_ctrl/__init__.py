"""Plan one broadcast control for a whole fleet of heterogeneous robots, through obstacles, to a temporal-logic task.

>>> import ensemble_ctrl as ec                                 # doctest: +SKIP
>>> problem = ec.load("configs/five_obstacles.yaml")           # doctest: +SKIP
>>> plan = ec.plan(problem)                                    # doctest: +SKIP
>>> plan.replay(members=100_000), plan.plot()                  # doctest: +SKIP
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from ensemble_ctrl.core.errors import (
    ConfigError,
    EnsembleError,
    ProblemError,
    RunawayError,
    SolveError,
    UnsupportedError,
)
from ensemble_ctrl.core.version import __version__

if TYPE_CHECKING:
    from ensemble_ctrl.api.channels import channels
    from ensemble_ctrl.api.comparison import compare
    from ensemble_ctrl.api.edit.notebook import edit
    from ensemble_ctrl.api.many import plan_many
    from ensemble_ctrl.api.planning import plan
    from ensemble_ctrl.api.plans import Plan
    from ensemble_ctrl.api.sweep import sweep
    from ensemble_ctrl.api.widening import widest
    from ensemble_ctrl.certificate import Certificate, certify
    from ensemble_ctrl.constraints import Disc, Obstacle, Polyhedron, Solid
    from ensemble_ctrl.constraints.stl import parse
    from ensemble_ctrl.files.config import load, load_text
    from ensemble_ctrl.files.examples import example, examples
    from ensemble_ctrl.moments import Beta, Interval, LegendreBasis, Mixture, Samples, TruncatedNormal
    from ensemble_ctrl.planning.baseline import unconstrained
    from ensemble_ctrl.planning.online.loop import Receding
    from ensemble_ctrl.problem import Objective, Problem, ReportOptions, SolveOptions, VerifyOptions
    from ensemble_ctrl.problem.evaluation.sampled import Replay, replay
    from ensemble_ctrl.problem.fleet import Fleet
    from ensemble_ctrl.problem.risk import Risk
    from ensemble_ctrl.problem.target import Formation, MomentTarget, Pose, SpreadTarget
    from ensemble_ctrl.problem.terrain import Patch
    from ensemble_ctrl.problem.uncertainty import Uncertainty
    from ensemble_ctrl.problem.zones import Zone
    from ensemble_ctrl.systems import (
        Bicycle,
        DifferentialDrive,
        DoubleIntegrator,
        Mecanum,
        OdeSystem,
        Quadrotor,
        SingleIntegrator,
        Trailer,
        Unicycle,
    )

_HOMES = {
    "Bicycle": "systems",
    "Certificate": "certificate",
    "DifferentialDrive": "systems",
    "Disc": "constraints",
    "DoubleIntegrator": "systems",
    "Mecanum": "systems",
    "OdeSystem": "systems",
    "Quadrotor": "systems",
    "SingleIntegrator": "systems",
    "Trailer": "systems",
    "Solid": "constraints",
    "Fleet": "problem.fleet",
    "Formation": "problem.target",
    "Beta": "moments",
    "Interval": "moments",
    "LegendreBasis": "moments",
    "Mixture": "moments",
    "MomentTarget": "problem.target",
    "Pose": "problem.target",
    "Objective": "problem",
    "Obstacle": "constraints",
    "Patch": "problem.terrain",
    "Plan": "api.plans",
    "Polyhedron": "constraints",
    "Problem": "problem",
    "Receding": "planning.online.loop",
    "Replay": "problem.evaluation.sampled",
    "ReportOptions": "problem",
    "Risk": "problem.risk",
    "Samples": "moments",
    "SolveOptions": "problem",
    "SpreadTarget": "problem.target",
    "TruncatedNormal": "moments",
    "Uncertainty": "problem.uncertainty",
    "Zone": "problem.zones",
    "Unicycle": "systems",
    "VerifyOptions": "problem",
    "certify": "certificate",
    "channels": "api.channels",
    "compare": "api.comparison",
    "edit": "api.edit.notebook",
    "example": "files.examples",
    "examples": "files.examples",
    "load": "files.config",
    "load_text": "files.config",
    "parse": "constraints.stl",
    "plan": "api.planning",
    "plan_many": "api.many",
    "sweep": "api.sweep",
    "unconstrained": "planning.baseline",
    "widest": "api.widening",
    "replay": "problem.evaluation.sampled",
}
"""Public names and the module that each is loaded from when it is first used."""

__all__ = [
    "Beta",
    "Bicycle",
    "Certificate",
    "ConfigError",
    "DifferentialDrive",
    "Disc",
    "DoubleIntegrator",
    "EnsembleError",
    "Fleet",
    "Formation",
    "Interval",
    "LegendreBasis",
    "Mecanum",
    "Mixture",
    "MomentTarget",
    "Objective",
    "Obstacle",
    "OdeSystem",
    "Patch",
    "Plan",
    "Polyhedron",
    "Pose",
    "Problem",
    "ProblemError",
    "Quadrotor",
    "Receding",
    "Replay",
    "ReportOptions",
    "Risk",
    "RunawayError",
    "Samples",
    "SingleIntegrator",
    "Solid",
    "SolveError",
    "SolveOptions",
    "SpreadTarget",
    "Trailer",
    "TruncatedNormal",
    "Uncertainty",
    "Unicycle",
    "UnsupportedError",
    "VerifyOptions",
    "Zone",
    "__version__",
    "certify",
    "channels",
    "compare",
    "edit",
    "example",
    "examples",
    "load",
    "load_text",
    "parse",
    "plan",
    "plan_many",
    "replay",
    "sweep",
    "unconstrained",
    "widest",
]


_RENAMED = ("OdeFleet", "OdeProblem")
"""Names of an earlier version (`ensemble_ctrl.problem.renamed`)."""


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name in _RENAMED:
        return import_module(f"{__name__}.problem.renamed").renamed(name)
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name, obj=sys.modules[__name__])
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
