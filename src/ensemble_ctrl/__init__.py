"""Plan one broadcast control for a whole fleet of heterogeneous robots, through obstacles, to a temporal-logic task.

>>> import ensemble_ctrl as ec                                 # doctest: +SKIP
>>> problem = ec.load("configs/five_obstacles.yaml")           # doctest: +SKIP
>>> plan = ec.plan(problem)                                    # doctest: +SKIP
>>> plan.replay(members=100_000), plan.plot()                  # doctest: +SKIP
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from ensemble_ctrl._version import __version__
from ensemble_ctrl.errors import (
    ConfigError,
    EnsembleError,
    ProblemError,
    RunawayError,
    SolveError,
    UnsupportedError,
)

if TYPE_CHECKING:
    from ensemble_ctrl.api import Plan, plan
    from ensemble_ctrl.certificate import Certificate, certify
    from ensemble_ctrl.comparison import compare
    from ensemble_ctrl.config import load, load_text
    from ensemble_ctrl.constraints import Obstacle, Polyhedron, Solid
    from ensemble_ctrl.constraints.stl import parse
    from ensemble_ctrl.example_files import example, examples
    from ensemble_ctrl.fleet import Fleet
    from ensemble_ctrl.moments import Beta, Interval, LegendreBasis, Mixture, Samples, TruncatedNormal
    from ensemble_ctrl.ode_fleet import OdeFleet
    from ensemble_ctrl.problem import Objective, OdeProblem, Problem, ReportOptions, SolveOptions, VerifyOptions
    from ensemble_ctrl.receding.loop import Receding
    from ensemble_ctrl.replay import Replay, replay
    from ensemble_ctrl.risk import Risk
    from ensemble_ctrl.systems import Bicycle, DoubleIntegrator, OdeSystem, Quadrotor, Unicycle
    from ensemble_ctrl.target import Formation, MomentTarget, SpreadTarget
    from ensemble_ctrl.twin import unconstrained
    from ensemble_ctrl.widening import widest

_HOMES = {
    "Bicycle": "systems",
    "Certificate": "certificate",
    "DoubleIntegrator": "systems",
    "OdeFleet": "ode_fleet",
    "OdeProblem": "problem",
    "OdeSystem": "systems",
    "Quadrotor": "systems",
    "Solid": "constraints",
    "Fleet": "fleet",
    "Formation": "target",
    "Beta": "moments",
    "Interval": "moments",
    "LegendreBasis": "moments",
    "Mixture": "moments",
    "MomentTarget": "target",
    "Objective": "problem",
    "Obstacle": "constraints",
    "Plan": "api",
    "Polyhedron": "constraints",
    "Problem": "problem",
    "Receding": "receding.loop",
    "Replay": "replay",
    "ReportOptions": "problem",
    "Risk": "risk",
    "Samples": "moments",
    "SolveOptions": "problem",
    "SpreadTarget": "target",
    "TruncatedNormal": "moments",
    "Unicycle": "systems",
    "VerifyOptions": "problem",
    "certify": "certificate",
    "compare": "comparison",
    "example": "example_files",
    "examples": "example_files",
    "load": "config",
    "load_text": "config",
    "parse": "constraints.stl",
    "plan": "api",
    "unconstrained": "twin",
    "widest": "widening",
}
"""Public names and the module that each is loaded from when it is first used."""

__all__ = [
    "Beta",
    "Bicycle",
    "Certificate",
    "ConfigError",
    "DoubleIntegrator",
    "EnsembleError",
    "Fleet",
    "Formation",
    "Interval",
    "LegendreBasis",
    "Mixture",
    "MomentTarget",
    "Objective",
    "Obstacle",
    "OdeFleet",
    "OdeProblem",
    "OdeSystem",
    "Plan",
    "Polyhedron",
    "Problem",
    "ProblemError",
    "Quadrotor",
    "Receding",
    "Replay",
    "ReportOptions",
    "Risk",
    "RunawayError",
    "Samples",
    "Solid",
    "SolveError",
    "SolveOptions",
    "SpreadTarget",
    "TruncatedNormal",
    "Unicycle",
    "UnsupportedError",
    "VerifyOptions",
    "__version__",
    "certify",
    "compare",
    "example",
    "examples",
    "load",
    "load_text",
    "parse",
    "plan",
    "replay",
    "unconstrained",
    "widest",
]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name == "replay":  # a module that can be called: once it is loaded, it bears its name here
        return import_module(f"{__name__}.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name, obj=sys.modules[__name__])
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
