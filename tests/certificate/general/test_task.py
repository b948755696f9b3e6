"""Windows that begin and end on the grid of a system that an ODE defines, judged by its closed form."""

from __future__ import annotations

from collections.abc import Mapping
from math import exp

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.problem.fleet import Fleet


class Growing(ec.OdeSystem):
    """``x = exp(rate t)``."""

    name, states, positions = "growing", ("x",), ("x",)
    controls, control_units, input_bounds = ("none",), ("1",), ((-1.0, 1.0),)
    parameters: Mapping[str, float] = {"rate": 1.0}

    def xdot(self, x, u, psi):  # type: ignore[no-untyped-def]
        """The rate times the state."""
        return [psi["rate"] * x[0]]


@pytest.mark.parametrize("steps", [1, 3, 8])
@pytest.mark.parametrize(
    ("window", "latest"),
    [
        ("[T,T]", 3.0),
        ("[0,T]", 3.0),
        ("[0,1.5]", 1.5),
        ("[1.5,1.5]", 1.5),
        ("[0,1]", 1.0),
        ("[1,1]", 1.0),
        ("[0,0]", 0.0),
    ],
)
def test_a_window_ends_where_it_says(steps: int, window: str, latest: float) -> None:
    """The state is largest at the window's end: neither before nor after it."""
    fleet = Fleet(Growing(), {"rate": ec.Interval(0.8, 1.2)}, start={"x": 1.0}, input_lower=[-1.0], input_upper=[1.0])
    for task, truth in (
        (f"G{window} x <= 20", 20 - exp(1.2 * latest)),
        (f"F{window} x >= 3", exp(0.8 * latest) - 3),
    ):
        found = ec.certify(ec.Problem("w", fleet, 3.0, steps, ec.parse(task)), np.zeros((steps, 1)))
        assert found.robustness <= truth
        assert found.robustness >= truth - 1e-3
        assert found.proven == ("yes" if truth >= 0 else "no")
