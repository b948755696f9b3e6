"""Solvers: their options, their status words and how they are watched, in one place."""

from __future__ import annotations

import math
import mmap
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.interrupts import Kept, kept_interrupts
from ensemble_ctrl.ocp.program import Program

Floats = NDArray[np.float64]
Status = Literal["solved", "infeasible", "limit", "interrupted", "failed"]

STATUS: dict[str, Status] = {
    "Solve_Succeeded": "solved",
    "Solved_To_Acceptable_Level": "solved",
    "Feasible_Point_Found": "solved",
    "Search_Direction_Becomes_Too_Small": "solved",
    "Infeasible_Problem_Detected": "infeasible",
    "Maximum_Iterations_Exceeded": "limit",
    "Maximum_CpuTime_Exceeded": "limit",
    "Maximum_WallTime_Exceeded": "limit",
    "User_Requested_Stop": "interrupted",
}
"""IPOPT's words to ours; any other word means `failed`."""


WORK_SPACE = 180_000_000
"""Bytes of address space that IPOPT takes with its libraries when it is first used, 128 MiB of them for OpenBLAS."""
_reserved: set[int] = set()
"""Processes that have taken it: this one, and those that it was forked from."""


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
class IpoptOptions:
    """The few options that differ between solves."""

    max_iterations: int = 300
    time_limit: float = 600.0
    tolerance: float = 1e-4
    barrier: float = 1e-3
    log: Path | None = None
    began: float = field(default_factory=time.perf_counter)

    @property
    def left(self) -> float:
        """Seconds of the time limit that are left, counted from when the options were made."""
        return self.time_limit - (time.perf_counter() - self.began)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a solver returns: `status` and the last iterate `x`, whatever happened."""

    status: Status
    x: Floats
    cost: float
    iterations: int
    message: str


def reserve() -> None:
    """Let OpenBLAS take its work space, once in a process, while it is known to be there.

    Raises
    ------
    MemoryError
        If it is not: it would be asked for again and again, for ever.
    """
    if os.getpid() in _reserved:
        return
    try:
        mmap.mmap(-1, WORK_SPACE).close()
    except OSError:
        raise MemoryError(f"the solver needs {WORK_SPACE // 1_000_000} MB more of address space") from None
    ca.Linsol("reserve", "lapacklu", ca.Sparsity.dense(2, 2)).solve(ca.DM([[2, 1], [1, 2]]), ca.DM.ones(2))
    _reserved.add(os.getpid())


def ipopt(
    program: Program,
    guess: Floats,
    lower: Floats,
    upper: Floats,
    options: IpoptOptions,
    watch: Watch | None = None,
) -> Outcome:
    """Solve `program` with IPOPT from `guess` between the variables' bounds.

    What a signal's handler raises stops the solve after the iteration, and is raised.
    """
    reserve()
    settings: Any = _settings(options) | {name: program.functions[name] for name in ("grad_f", "jac_g", "hess_lag")}
    nlp: Any = program.nlp
    with kept_interrupts() as kept:
        watcher = settings["iteration_callback"] = _Watcher(program, watch, kept)
        solver = ca.nlpsol("solver", "ipopt", nlp, settings)
        result = solver(x0=guess, p=program.parameters, lbx=lower, ubx=upper, lbg=program.lower, ubg=program.upper)
    if watcher.error:
        raise watcher.error
    stats = solver.stats()
    word = str(stats["return_status"])
    return Outcome(
        status=STATUS.get(word, "failed"),
        x=np.array(result["x"]).ravel(),
        cost=float(result["f"]),
        iterations=int(stats["iter_count"]),
        message=word.replace("_", " ").lower(),
    )


def _settings(options: IpoptOptions) -> dict[str, object]:
    """The nlpsol options of one solve."""
    inner: dict[str, object] = {
        "print_level": 0,
        "sb": "yes",
        "max_iter": options.max_iterations,
        "max_wall_time": max(options.left, 1e-3),
        "tol": options.tolerance,
        "mu_init": options.barrier,
    }
    if options.log:
        inner |= {"output_file": str(options.log), "file_print_level": 5, "file_append": "yes"}
    quiet = {"print_time": False, "show_eval_warnings": False}  # a state that runs away is told in IPOPT's own log
    return {**quiet, "calc_lam_p": False, "no_nlp_grad": True, "ipopt": inner}


class _Watcher(ca.Callback):
    """IPOPT's iteration callback: reports, stops on request, and keeps an exception for after the solve."""

    def __init__(self, program: Program, watch: Watch | None, kept: Kept) -> None:
        ca.Callback.__init__(self)
        self.watch, self.kept = watch, kept
        self.count = 0
        self.error: BaseException | None = None
        self.sizes = {
            "x": program.nlp["x"].numel(),
            "f": 1,
            "g": program.lower.size,
            "p": program.parameters.size,
        }
        self.lower, self.upper = program.lower, program.upper
        self.construct("watcher", {})

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return str(ca.nlpsol_out(i))

    def get_name_out(self, i: int) -> str:
        return "stop"

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        name = ca.nlpsol_out(i).removeprefix("lam_")
        return ca.Sparsity.dense(self.sizes[name])

    def eval(self, arg: Sequence[ca.DM]) -> list[ca.DM]:
        if self.watch is None or self.kept.error is not None:
            return [ca.DM(float(self.kept.error is not None))]
        try:
            g = np.array(arg[2]).ravel()
            violation = float(np.maximum(self.lower - g, g - self.upper).max(initial=0.0))
            self.count += 1
            return [ca.DM(self.watch(Iteration(self.count - 1, float(arg[1]), violation)))]
        except BaseException as error:  # an exception must not cross into the solver
            self.error = error
            return [ca.DM(1.0)]
