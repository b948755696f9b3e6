"""The study of truncation orders, against a linear program, dense members, and replay."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from ensemble_ctrl.api.paper_study import STEPS, reach, studied, study, study_data, truncation_errors
from ensemble_ctrl.moments import Interval, LegendreBasis
from ensemble_ctrl.problem.evaluation.sampled import replay


def test_moments_within_bounds_allow_22_at_order_8() -> None:
    assert reach(8) == pytest.approx(22.1, abs=0.05)
    assert reach(0) == pytest.approx(1.0)


@pytest.mark.parametrize("order", [1, 3, 6])
def test_the_reach_is_the_maximum_of_a_linear_program_at_each_parameter(order: int) -> None:
    basis = LegendreBasis(order)
    bound = np.sum(basis.signed_moments(), axis=0)
    values = [
        -linprog(-basis.evaluate(np.array([s]))[0], bounds=np.column_stack([-bound, bound]).tolist()).fun  # type: ignore[operator]
        for s in np.linspace(-1, 1, 41)
    ]
    assert max(values) == pytest.approx(reach(order), rel=1e-9)


def test_truncation_errors_are_distances_of_members_from_their_polynomial() -> None:
    problem = studied(4)
    controls = np.tile([0.6, 0.4], (STEPS, 1))
    for half, order, error in truncation_errors(problem, controls, (2, 5)):
        fleet = problem.fleet.with_(parameters={"traction": Interval(1 - half, 1 + half)})
        s = np.cos(np.linspace(0, np.pi, 41))
        nodes = np.polynomial.legendre.leggauss(order + 1)[0]
        through, dense = (
            fleet.trajectories(controls, fleet.dynamic_members(at[:, None]), problem.step) for at in (nodes, s)
        )
        # the polynomial through the robots at the Gauss nodes, by NumPy
        curve = np.polynomial.Polynomial.fit
        off = [
            dense[:, t, d] - curve(nodes, through[:, t, d], order, domain=[-1, 1])(s)
            for t in range(0, STEPS + 1, 8)
            for d in (0, 1)
        ]
        assert np.abs(off).max() <= error + 1e-9
        assert np.abs(off).max() >= error / 2 - 1e-9


def test_the_study_plans_both_forms_and_says_what_replay_says() -> None:
    found = study(orders=(2,), members=200)
    assert found.orders == (2, 2)
    for row in found.planned:
        judged = replay(studied(2), row.controls, members=200, substeps=10)
        assert row.violating == int(judged.violating.sum())
    assert found.planned[1].proven == "yes"
    rows = study_data(found)
    assert [row["kind"] for row in rows].count("plan") == 2
    assert {row["order"] for row in rows} == {2}
    assert "controls" not in rows[0]
