"""``ensemble-plan paper``: rows that say what the plans do, and the files that it writes."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

from ensemble_ctrl.api.paper import (
    EXPERIMENTS,
    ROBOTS,
    STEERING,
    Reproduced,
    Robot,
    as_data,
    as_published,
    experiment,
    reproduce,
    table,
)
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.systems import Bicycle


@cache
def box() -> dict[tuple[Robot, str], Reproduced]:
    """The box with both robots, in both forms."""
    rows = reproduce(["box"], members=500, bonmin_limit=1.0)
    return {(row.robot, row.form): row for row in rows}


def test_a_row_is_what_replay_and_certificate_say() -> None:
    assert list(box()) == [(r, f) for r in ("unicycle", "bicycle") for f in ("published", "ours")]
    for (robot, _), row in box().items():
        problem = experiment("box", robot)
        judged = replay(problem, row.controls, members=500, substeps=10)
        assert (row.members, row.violating) == (judged.members, int(judged.violating.sum()))
        assert row.depth == pytest.approx(max(0.0, -judged.worst[0]), abs=1e-9)
        assert row.proven == certify(problem, row.controls).proven
        assert (row.violating == 0) or row.proven == "no"


def test_ours_is_proven_and_costs_no_more_than_the_published_form() -> None:
    for robot in ROBOTS:
        assert box()[robot, "ours"].proven == "yes"
        assert box()[robot, "ours"].violating == 0
        assert box()[robot, "ours"].cost <= box()[robot, "published"].cost + 1e-3


def test_published_bicycles_leave_the_box() -> None:
    """They spread: every moment keeps its bounds, and truncation is not the reason."""
    row = box()["bicycle", "published"]
    assert row.truncation < 0.05
    assert row.violating > 0
    assert row.depth > 0.1


def test_the_published_form_is_the_papers() -> None:
    problem = as_published(experiment("five_obstacles"))
    assert (problem.coordinates, problem.integrator, problem.order) == ("modal", "rk4", 8)
    assert problem.solve.as_published


def test_bicycles_have_the_unicycles_speeds() -> None:
    fleet = experiment("box", "bicycle").fleet
    assert isinstance(fleet.system, Bicycle)
    np.testing.assert_array_equal(fleet.input_upper, [10.0, STEERING])
    np.testing.assert_array_equal(fleet.input_lower, [-10.0, -STEERING])


def test_unknown_names_are_refused() -> None:
    with pytest.raises(ProblemError, match=r"experiment: expected one of box, polyhedron, .*, got 'boxes'"):
        experiment("boxes")
    with pytest.raises(ProblemError, match="robot: expected one of unicycle, bicycle, got 'car'"):
        experiment("box", "car")  # type: ignore[arg-type]
    assert len(EXPERIMENTS) == 9


def test_rows_as_data_and_as_text() -> None:
    row = box()["unicycle", "ours"]
    data = as_data(row)
    assert "controls" not in data
    assert json.loads(json.dumps(data))["violating"] == 0
    assert "box              unicycle  ours" in table([row])[1]
