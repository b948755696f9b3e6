"""IPOPT: its options, its status words and how it is watched, in one place."""

from __future__ import annotations

import mmap
import os
from collections.abc import Sequence
from functools import cache
from typing import Any, cast

import casadi as ca
import numpy as np

from ensemble_ctrl.ocp.program import Program
from ensemble_ctrl.ocp.solvers.base import Iteration, Nlp, Outcome, SolverOptions, Status, Watch
from ensemble_ctrl.ocp.solvers.evaluation_warnings import kept_warnings
from ensemble_ctrl.ocp.solvers.interrupts import Kept, kept_interrupts

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
LINEAR: dict[str, object] = {
    "mumps_pivot_order": 0,
    "mumps_permuting_scaling": 0,
    "mumps_scaling": 0,
    "min_refinement_steps": 0,
}
"""How MUMPS factorises: ordered by approximate minimum degree, neither permuted nor scaled by values (IPOPT scales the
rows), and refined only where the residual is too large. The iterates are those of the defaults, up to rounding."""
_reserved: set[int] = set()
"""Processes that have taken it: this one, and those that it was forked from."""


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


@cache
def preload() -> None:
    """Load IPOPT with its libraries, so that processes that are forked afterwards find them in memory."""
    reserve()
    x, settings = ca.SX.sym("x"), cast(Any, _settings(SolverOptions()))
    ca.nlpsol("preload", "ipopt", {"x": x, "f": x**2}, settings)(x0=1.0)


class Ipopt:
    """An interior-point method (A. Waechter and L. T. Biegler, On the implementation of an interior-point filter
    line-search algorithm for large-scale nonlinear programming, 2006).
    """

    statuses = STATUS

    def solve(self, nlp: Nlp, options: SolverOptions, watch: Watch | None = None) -> Outcome:
        """Solve from the guess between the variables' bounds.

        What a signal's handler raises stops the solve after the iteration, and is raised.
        """
        reserve()
        program = nlp.program
        settings: Any = _settings(options) | {name: program.functions[name] for name in ("grad_f", "jac_g", "hess_lag")}
        functions: Any = program.nlp
        bounds = {"lbx": nlp.lower, "ubx": nlp.upper, "lbg": program.lower, "ubg": program.upper}
        with kept_interrupts() as kept, kept_warnings(options.log):
            watcher = settings["iteration_callback"] = _Watcher(program, watch, kept)
            solver = ca.nlpsol("solver", "ipopt", functions, settings)
            result = solver(x0=nlp.guess, p=program.parameters, **bounds)
            # read within: NumPy turns what a signal raises while it reads a matrix of CasADi into a SystemError
            x, cost = np.array(result["x"]).ravel(), float(result["f"])
        if watcher.error:
            raise watcher.error
        stats = solver.stats()
        word = str(stats["return_status"])
        return Outcome(
            status=self.statuses.get(word, "failed"),
            x=x,
            cost=cost,
            iterations=int(stats["iter_count"]),
            message=word.replace("_", " ").lower(),
        )


def _settings(options: SolverOptions) -> dict[str, object]:
    """The nlpsol options of one solve."""
    inner: dict[str, object] = {
        "print_level": 0,
        "sb": "yes",
        "max_iter": options.max_iterations,
        "max_wall_time": max(options.left, 1e-3),
        "tol": options.tolerance,
        "mu_init": options.barrier,
        **LINEAR,
    }
    if options.log:
        inner |= {"output_file": str(options.log), "file_print_level": 5, "file_append": "yes"}
    return {"print_time": False, "calc_lam_p": False, "no_nlp_grad": True, "ipopt": inner}


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
