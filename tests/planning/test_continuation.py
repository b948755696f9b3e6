"""From a plan to one of a nearby problem, with a bounded effort."""

from __future__ import annotations

from functools import cache

import numpy as np

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.files.config import load
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.planner import Solution, continued, solve
from ensemble_ctrl.planning.planner.continuation import ITERATIONS
from ensemble_ctrl.planning.planner.proving import is_proven
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import replay
from tests.paths import CONFIGS


@cache
def problem() -> Problem:
    """Five obstacles, traction 0.9 to 1.1."""
    return load(CONFIGS / "five_obstacles.yaml")


@cache
def plan() -> Solution:
    """Its plan."""
    return solve(problem())


def wider(half: float) -> Problem:
    """The same problem of a fleet with another range."""
    fleet = problem().fleet
    return problem().with_(fleet=fleet.with_distributions({"traction": Interval(1 - half, 1 + half)}))


def test_a_plan_for_a_wider_range_is_found_from_that_for_a_narrower_one_and_proven() -> None:
    asked = wider(0.2)
    assert certify(asked, plan().controls).proven != "yes"
    found = continued(asked, plan().controls)
    assert found.status == "planned"
    assert found.controls.shape == plan().controls.shape
    assert certify(asked, found.controls).proven == "yes"
    run = replay(asked, found.controls, parameters=np.linspace(0.8, 1.2, 401), substeps=4)
    assert not run.violating.any()


def test_controls_that_are_a_plan_already_stay_as_they_are() -> None:
    found = continued(wider(0.05), plan().controls)
    assert is_proven(found.certificate)
    assert np.array_equal(found.controls, plan().controls)
    assert found.iterations == 0


def test_a_range_far_too_wide_is_given_up_after_one_choice_of_hyperplanes() -> None:
    found = continued(wider(0.75), plan().controls)
    assert found.status != "planned"
    assert not is_proven(found.certificate)
    assert 0 < found.iterations <= 4 * ITERATIONS  # a choice of hyperplanes is solved four times at most
