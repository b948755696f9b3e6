"""A system as expressions of the program, and the check that they say what the system says of numbers."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import System
from ensemble_ctrl.systems.integration import rk4

Floats = NDArray[np.float64]

POINTS = 40
"""States at which expressions are compared with numbers."""
CLOSE = 1e-9
"""Relative difference allowed."""


def moved(system: System, before: ca.SX, u: list[ca.SX], psi: dict[str, ca.SX], step: float, substeps: int) -> ca.SX:
    """The state after a step of a constant command, as an expression."""

    def build() -> Any:
        if system.has_exact:
            return ca.vertcat(*(system.exact(ca.vertsplit(before), u, psi, step) or []))
        return rk4(lambda x: ca.vertcat(*system.xdot(ca.vertsplit(x), u, psi)), before, step, substeps)

    return _traced(system, build)


def require_traceable(fleet: Fleet) -> None:
    """Refuse a system whose expressions differ from its numbers: one with an ``if`` or `numpy.where` on a state.

    Raises
    ------
    ProblemError
        If `xdot` can't be evaluated on expressions, or is something else there, at some of `POINTS` states.
    """
    system, n_x = fleet.system, len(fleet.states)
    names = list(system.parameters)
    x, u, p = ca.SX.sym("x", n_x), ca.SX.sym("u", len(system.controls)), ca.SX.sym("p", len(names))
    psi = dict(zip(names, ca.vertsplit(p) if names else [], strict=True))
    rates = _traced(system, lambda: ca.vertcat(*system.xdot(ca.vertsplit(x), ca.vertsplit(u), psi)))
    function = ca.Function("xdot", [x, u, p], [rates])
    # random members, states of sizes 0.1 to 30 around the start, and commands within their bounds
    generator = np.random.default_rng(0)
    members = fleet.sample(POINTS, seed=0)
    scale = 10.0 ** generator.uniform(-1.0, 1.5, (1, POINTS))
    states = fleet.start_states(members) + scale * generator.standard_normal((n_x, POINTS))
    low, high = np.asarray(fleet.input_lower), np.asarray(fleet.input_upper)
    commands = low[:, None] + generator.random((len(low), POINTS)) * (high - low)[:, None]
    own = fleet.psi(members)
    with np.errstate(all="ignore"):
        one_by_one = (
            system.derivatives(states[:, [k]], list(commands[:, [k]]), {name: own[name][[k]] for name in names})
            for k in range(POINTS)
        )
        expected = np.hstack(list(one_by_one))
    found = np.array(function(states, commands, np.array([own[name] for name in names]).reshape(len(names), POINTS)))
    # compare where the numbers are finite: |f_expr - f_num| <= 1e-9 (1 + |f_num|)
    same = np.abs(found - expected) <= CLOSE * (1.0 + np.abs(expected))
    wrong = np.argwhere(np.isfinite(expected) & ~same)
    if len(wrong):
        raise _refusal(system, f"the rate of {fleet.states[wrong[0][0]]} is another one there")


def _traced(system: System, build: Callable[[], Any]) -> ca.SX:
    """An expression, or why there is none."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # NumPy functions of a user's on CasADi expressions
            return ca.SX(build())
    except Exception as error:
        raise _refusal(system, str(error).partition("\n")[0] or type(error).__name__) from error


def _refusal(system: System, reason: str) -> ProblemError:
    """Why a system can't be planned for."""
    wanted = "arithmetic and the functions of ensemble_ctrl.systems.arrays, without choices on states"
    return ProblemError(
        f"{type(system).__name__}.xdot: expected {wanted}, got what can't be evaluated on expressions ({reason})"
    )
