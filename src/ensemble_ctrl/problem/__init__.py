"""The problem as frozen data, its fleet, its task, the checks that it passes, and what sampled members do."""

from importlib import import_module
from typing import Any

from ensemble_ctrl.problem.problem import (
    Coordinates,
    Grid,
    Guarantee,
    Integrator,
    Method,
    Objective,
    Offered,
    Problem,
    ReportOptions,
    Routes,
    SolveOptions,
    VerifyOptions,
)

__all__ = [
    "Coordinates",
    "Grid",
    "Guarantee",
    "Integrator",
    "Method",
    "Objective",
    "Offered",
    "Problem",
    "ReportOptions",
    "Routes",
    "SolveOptions",
    "VerifyOptions",
]


def __getattr__(name: str) -> Any:
    """Names of an earlier version (`ensemble_ctrl.problem.renamed`)."""
    if name not in ("OdeFleet", "OdeProblem"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module(f"{__name__}.renamed").renamed(name, __name__)
