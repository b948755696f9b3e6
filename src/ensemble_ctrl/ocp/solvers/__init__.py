"""Solvers of the program, by protocol, in one registry; each keeps its options and status words to itself."""

from ensemble_ctrl.ocp.solvers.base import (
    AT_WORK,
    BUILDING,
    SOLVERS,
    Iteration,
    Nlp,
    Outcome,
    Solver,
    SolverOptions,
    Status,
    Watch,
    named,
    solve,
)
from ensemble_ctrl.ocp.solvers.bonmin import Bonmin
from ensemble_ctrl.ocp.solvers.ipopt import Ipopt, preload, reserve
from ensemble_ctrl.ocp.solvers.sqp import Sqp

SOLVERS.update({"ipopt": Ipopt(), "sqp": Sqp(), "bonmin": Bonmin()})

__all__ = [
    "AT_WORK",
    "BUILDING",
    "SOLVERS",
    "Bonmin",
    "Ipopt",
    "Iteration",
    "Nlp",
    "Outcome",
    "Solver",
    "SolverOptions",
    "Sqp",
    "Status",
    "Watch",
    "named",
    "preload",
    "reserve",
    "solve",
]
