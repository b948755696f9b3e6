"""Expressions of a system are compared with its numbers before they are planned with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from ensemble_ctrl import DoubleIntegrator, Fleet, Interval, ProblemError, Quadrotor
from ensemble_ctrl.ocp.traced import require_traceable


class Numpy(DoubleIntegrator):
    """Written with NumPy's own functions."""

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        return [x[2], x[3], np.tanh(u[0]) / psi["mass"], np.sin(u[1]) * np.sqrt(1 + x[0] ** 2) / psi["mass"]]


class Rounded(DoubleIntegrator):
    """Does something that expressions don't know."""

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        return [x[2], x[3], np.asarray(u[0]).round() / psi["mass"], u[1] / psi["mass"]]


@pytest.mark.parametrize("system", [DoubleIntegrator(), Numpy()])
def test_arithmetic_and_numpys_functions_are_the_same(system: DoubleIntegrator) -> None:
    require_traceable(Fleet(system, {"mass": Interval(0.5, 2.0)}))


def test_so_is_the_quadrotor() -> None:
    require_traceable(Fleet(Quadrotor(), {"payload": Interval(0.0, 0.5), "start_x": Interval(-1, 1)}))


def test_what_expressions_do_not_know_is_refused() -> None:
    with pytest.raises(ProblemError, match=r"Rounded.xdot: expected arithmetic"):
        require_traceable(Fleet(Rounded(), {"mass": Interval(0.5, 2.0)}))
