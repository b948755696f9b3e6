"""How a loop runs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.planning.online.propagation import Errors
from ensemble_ctrl.problem import Problem

Horizon = Literal["shrinking", "receding"]
STATE_ERROR = 0.01
"""Largest error of a measured state, in its unit, unless another is given."""
MAX_ORDER = 6
"""Largest truncation order of a loop."""


@dataclass(frozen=True)
class OnlineOptions:
    """How a loop runs.

    Parameters
    ----------
    applied_steps : int
        Steps that are applied of every plan before the next one takes over.
    deadline : float
        Seconds that planning again may take; a later plan is not used.
    errors : Errors
        Bounds of what differs from the model.
    learn : bool
        Whether to learn the parameters; without it their assumed ranges stand.
    horizon : {"shrinking", "receding"}
        ``shrinking``: the task's windows are absolute, and the loop ends with the horizon. ``receding``: the task is
        read anew from every present on, over the whole horizon.
    run_for : float or None
        With ``receding``, how long the loop runs, seconds.
    order : int
        Truncation order of the plans under way.
    rounds : int
        Quadratic programs for each plan, at most; each plan starts from the last one, so one is usually enough.
    silence : float
        Seconds without a valid measurement after which the robot is stopped.
    recovery : float
        Seconds that a standing robot may take to plan anew.
    attempts : int
        How often it may do so.
    states : mapping of str to float
        For a system that an ODE defines: the largest error of each state's measurement, in its unit; `STATE_ERROR` for
        those that are not named.
    """

    applied_steps: int = 10
    deadline: float = 0.2
    errors: Errors = field(default_factory=Errors)
    learn: bool = True
    horizon: Horizon = "shrinking"
    run_for: float | None = None
    order: int = 3
    rounds: int = 1
    silence: float = 2.0
    recovery: float = 3.0
    attempts: int = 3
    states: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("applied_steps", "rounds"):
            if getattr(self, name) < 1:
                raise ProblemError(f"online.{name}: expected 1 or more, got {getattr(self, name)}")
        if not 1 <= self.order <= MAX_ORDER:
            raise ProblemError(f"online.order: expected 1 to {MAX_ORDER}, got {self.order}")
        for name in ("deadline", "silence", "recovery"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ProblemError(f"online.{name}: expected a finite time above 0 s, got {value!r}")
        for name, value in self.states.items():
            if not (math.isfinite(value) and value >= 0):
                raise ProblemError(f"online.states.{name}: expected a finite number >= 0, got {value!r}")
        if self.horizon not in ("shrinking", "receding"):
            raise ProblemError(f"online.horizon: expected 'shrinking' or 'receding', got {self.horizon!r}")
        if (self.horizon == "receding") != (self.run_for is not None):
            raise ProblemError("online.run_for: expected a time with `horizon: receding`, and only with it")

    def errors_of(self, problem: Problem) -> NDArray[np.float64]:
        """Largest error of each state's measurement, shape (states,).

        Raises
        ------
        ProblemError
            For a name that is none of the system's states.
        """
        states = problem.fleet.system.states
        if strange := [name for name in self.states if name not in states]:
            raise ProblemError(f"online.states: expected names among {', '.join(states)}, got {strange[0]!r}")
        return np.array([self.states.get(name, STATE_ERROR) for name in states])

    def lead(self, step: float) -> int:
        """Steps before a plan takes over at which the robot is measured for it."""
        return max(1, math.ceil(self.deadline / step - 1e-9))
