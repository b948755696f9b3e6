"""What every solver is given and returns, and the registry of solvers."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import field
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.ocp.program import Program

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Status = Literal["solved", "infeasible", "limit", "interrupted", "failed"]


@dataclass(frozen=True)
class Iteration:
    """What a watcher sees of a solve that goes on.

    Attributes
    ----------
    count : int
        Iterations of IPOPT, or nodes of Bonmin.
    cost : float
        As minimised; of Bonmin's best solution, infinite without one, and while the program is being built.
    violation : float
        Largest violation of a constraint.
    bound : float or None
        Bonmin's bound, minus infinity without one; None for IPOPT.
    """

    count: int
    cost: float
    violation: float
    bound: float | None = None


BUILDING = Iteration(0, math.inf, math.inf)
"""Before the first iteration, while the program is being built."""
AT_WORK = Iteration(-1, math.inf, math.inf)
"""Of work without iterations, as a proof or a replay."""
Watch = Callable[[Iteration], bool]
"""Called after each iteration; returning True stops the solve at the last iterate."""


@dataclass(frozen=True)
class SolverOptions:
    """The few options that differ between solves; a solver reads those that it knows.

    Parameters
    ----------
    max_iterations : int
    time_limit : float
        Seconds of wall clock.
    tolerance : float
        Of the optimality conditions.
    barrier : float
        To start an interior-point method from: small for a start that is close to a solution.
    log : Path, optional
        File that the solver's own output is appended to.
    solver : str
        Which one, by its name in the registry.
    cutoff : float
        Only solutions that cost less are of use.
    memory : int
        Bytes of address space that a process of its own may use, where the system can tell.
    """

    max_iterations: int = 300
    time_limit: float = 600.0
    tolerance: float = 1e-4
    barrier: float = 1e-3
    log: Path | None = None
    solver: str = "ipopt"
    cutoff: float = math.inf
    memory: int = 4 * 2**30
    began: float = field(default_factory=time.perf_counter)

    @property
    def left(self) -> float:
        """Seconds of the time limit that are left, counted from when the options were made."""
        return self.time_limit - (time.perf_counter() - self.began)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a solver returns: `status` and the last iterate `x`, whatever happened.

    Attributes
    ----------
    status : {"solved", "infeasible", "limit", "interrupted", "failed"}
    x : ndarray, shape (variables,)
        The guess, where a solver has nothing better.
    cost : float
        At `x`; infinite where a solver that looks for whole numbers has found none.
    iterations : int
        Or nodes of a branch and bound.
    message : str
        The solver's own word.
    bound : float
        Below which no solution costs; minus infinity without one.
    """

    status: Status
    x: Floats
    cost: float
    iterations: int
    message: str
    bound: float = -math.inf


@dataclass(frozen=True, eq=False)
class Nlp:
    """A program with bounds of its variables and a start.

    Attributes
    ----------
    program : Program
    guess, lower, upper : ndarray, shape (variables,)
    dependent : ndarray of int
        Variables that the equations determine once the others are given: as many as there are equations.
    slacks : ndarray of int
        Variables that only say by how much rows fall short; their weight is in the cost.
    discrete : ndarray of int
        Variables that are whole numbers.
    """

    program: Program
    guess: Floats
    lower: Floats
    upper: Floats
    dependent: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    slacks: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    discrete: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


class Solver(Protocol):
    """A method that solves programs."""

    @property
    def statuses(self) -> Mapping[str, Status]:
        """The solver's own words to ours; any other word means `failed`."""

    def solve(self, nlp: Nlp, options: SolverOptions, watch: Watch | None = None) -> Outcome:
        """Improve the guess; a failed solve is a value with a status."""


SOLVERS: dict[str, Solver] = {}
"""By name: ``ipopt``, ``sqp``, ``bonmin``, and what others add."""


def named(name: str) -> Solver:
    """The solver of that name.

    Raises
    ------
    ProblemError
        If there is none.
    """
    if name not in SOLVERS:
        raise ProblemError(f"solve.solver: expected one of {', '.join(SOLVERS)}, got {name}")
    return SOLVERS[name]


def solve(nlp: Nlp, options: SolverOptions, watch: Watch | None = None) -> Outcome:
    """Solve with the solver that the options name."""
    return named(options.solver).solve(nlp, options, watch)
