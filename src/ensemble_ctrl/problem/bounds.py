"""Whether commands keep to a fleet's input and rate bounds."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem.problem import Problem

Floats = NDArray[np.float64]

ALLOWED = 1e-6
"""How far beyond a bound counts as the solver's rounding: a share of it, or of 1 in its unit where it is smaller."""


@dataclass(frozen=True)
class Beyond:
    """The first command beyond its bounds.

    Attributes
    ----------
    control : str
        Which command.
    bounds : {"input", "rate"}
        Whether the command itself is too large or small, or its change from one step to the next.
    time : float
        When, seconds: the beginning of the step.
    value : float
        The command, or its change by the step's duration, in its unit (or its unit per second).
    lower, upper : float
        What is allowed.
    """

    control: str
    bounds: Literal["input", "rate"]
    time: float
    value: float
    lower: float
    upper: float

    def __str__(self) -> str:
        what, unit = (self.control, "") if self.bounds == "input" else (f"the change of {self.control}", "/s")
        return (
            f"{what} is {self.value:.6g}{unit} at t = {self.time:g} s, "
            f"{self.bounds} bounds {self.lower:.6g} to {self.upper:.6g}"
        )


def beyond_bounds(problem: Problem, controls: Floats) -> Beyond | None:
    """The first command beyond the input or rate bounds, if any; one that is not a number is.

    Parameters
    ----------
    problem : Problem
    controls : ndarray, shape (steps, n_u)

    Notes
    -----
    Beyond by more than `ALLOWED` of the bound (of 1 in its unit where the bound is smaller), which is how far a solver
    may leave it by rounding.
    """
    fleet, u = problem.fleet, np.asarray(controls, dtype=float)
    lower, upper = np.asarray(fleet.input_lower), np.asarray(fleet.input_upper)
    found = _first(problem, u, lower, upper, "input", 0)
    if fleet.rate_bounds is not None:
        most = np.asarray(fleet.rate_bounds, dtype=float)
        # |u_{n+1} - u_n| / dt <= rate bound
        late = _first(problem, np.diff(u, axis=0) / problem.step, -most, most, "rate", 1)
        found = min((one for one in (found, late) if one is not None), key=lambda one: one.time, default=None)
    return found


def _first(
    problem: Problem, values: Floats, lower: Floats, upper: Floats, bounds: Literal["input", "rate"], delay: int
) -> Beyond | None:
    """The first of some values that is not within its bounds; row k belongs to step k + `delay`."""
    unit = problem.step if bounds == "rate" else 1.0  # a rate is kept to within the rounding of a command
    low, high = (end - side * ALLOWED * np.maximum(1.0 / unit, np.abs(end)) for end, side in ((lower, 1), (upper, -1)))
    # NaN fails both comparisons and counts as beyond
    rows, columns = np.nonzero(~((values >= low) & (values <= high)))
    if not len(rows):
        return None
    n, k = int(rows[0]), int(columns[0])
    name = problem.fleet.system.controls[k]
    time = (n + delay) * problem.step
    return Beyond(name, bounds, time, float(values[n, k]), float(lower[k]), float(upper[k]))
