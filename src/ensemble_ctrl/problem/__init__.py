"""The problem as frozen data, its fleet, its task, the checks that it passes, and what sampled members do."""

from ensemble_ctrl.problem.problem import (
    Coordinates,
    Guarantee,
    Integrator,
    Method,
    Objective,
    Problem,
    ReportOptions,
    Routes,
    SolveOptions,
    VerifyOptions,
)

__all__ = [
    "Coordinates",
    "Guarantee",
    "Integrator",
    "Method",
    "Objective",
    "Problem",
    "ReportOptions",
    "Routes",
    "SolveOptions",
    "VerifyOptions",
]
