"""Fleets of configs/fleets: planned, proven for all, and checked on a grid of parameters."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from ensemble_ctrl.api.widening import widest
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.core.errors import ConfigError
from ensemble_ctrl.files.config import dump, load, load_text, read
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.ocp.hyperplanes import separate
from ensemble_ctrl.ocp.truncation import points
from ensemble_ctrl.planning.planner import Solution, solve
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import replay
from tests.examples import quick
from tests.paths import CONFIGS

FILES = CONFIGS / "fleets"
COSTS = {
    "bicycle": 0.41,
    "cells": 4.10,
    "measured_pairs": 1.10,
    "two_tractions": 1.02,
    "uncertain_start": 1.62,
    "wide": 3.83,
}
every = pytest.mark.parametrize("name", sorted(COSTS))
fleets = pytest.mark.parametrize("name", quick(sorted(COSTS), "bicycle", "measured_pairs", "two_tractions"))


@cache
def problem(name: str) -> Problem:
    """The problem of a file."""
    return load(FILES / f"{name}.yaml")


@cache
def solution(name: str) -> Solution:
    """Its plan, made once."""
    return solve(problem(name))


def test_every_file_is_here() -> None:
    assert sorted(path.stem for path in FILES.glob("*.yaml")) == sorted(COSTS)


@fleets
def test_it_is_planned_and_proven_for_every_member(name: str) -> None:
    found = solution(name)
    assert read(FILES / f"{name}.yaml").warnings == ()
    assert found.status == "planned"
    assert found.certificate is not None
    assert found.certificate.proven == "yes"
    assert set(found.certificate.ranges) == set(problem(name).fleet.names)
    assert found.attempt.value.cost <= 1.05 * COSTS[name] + 0.05


@fleets
def test_no_member_of_a_grid_violates_it_between_the_grid_times_either(name: str) -> None:
    found, fleet = solution(name), problem(name).fleet
    assert found.certificate is not None
    run = replay(problem(name), found.controls, parameters=fleet.grid(3000), substeps=8)
    assert not run.violating.any()
    assert all(c.distance >= found.certificate.clearance - 1e-9 for c in run.clearances)
    assert run.worst[0] >= min(found.certificate.clearance, found.certificate.robustness) - 1e-9


@every
def test_its_problem_file_is_written_and_read_again(name: str) -> None:
    again = load_text(dump(problem(name)))
    assert again.fleet.parameters == problem(name).fleet.parameters
    assert again.fleet.system == problem(name).fleet.system
    np.testing.assert_array_equal(again.fleet.input_lower, problem(name).fleet.input_lower)


@pytest.mark.slow
def test_cells_do_what_no_single_line_can() -> None:
    """At some step of the plan no line has an obstacle on one side and the whole fleet on the other."""
    asked, found = problem("cells"), solution("cells")
    truncation = found.attempt.truncation
    curve = points(asked, found.controls, truncation)
    whole, own = (
        separate(curve, asked.specification.avoid, asked.duration, parts=parts) for parts in (None, truncation.parts)
    )
    assert len(truncation.parts) == 4
    assert whole.gap.min() < -0.05
    assert own.gap.min() > 0


@pytest.mark.slow
def test_a_wider_start_is_refuted_by_a_member_that_really_collides() -> None:
    asked, found = problem("uncertain_start"), solution("uncertain_start")
    wider = certify(asked, found.controls, {"start_x": Interval(-0.3, 0.3), "start_y": Interval(-0.3, 0.3)})
    assert wider.proven == "no"
    assert wider.counter_example is not None
    run = replay(asked, found.controls, parameters=[wider.counter_example.parameters], substeps=50)
    assert run.violating.all()
    assert run.worst[0] <= -wider.counter_example.amount + 1e-3


def test_one_of_two_parameters_can_be_widened() -> None:
    small = load_text(
        """
        fleet:
          model: unicycle
          parameters: {traction: {range: [0.95, 1.05]}, start_y: {range: [-0.1, 0.1]}}
          start: {position: [0, 0], heading: 0 deg}
        horizon: {duration: 4 s, steps: 16}
        regions: {goal: {box: [[2, 4], [-0.5, 0.5]]}}
        task: F[3, 4] in(goal)
        objective: {terminal: {target: [3, 0]}}
        """
    )
    answer = widest(small, tolerance=0.3, parameter="start_y")
    assert answer.interval is not None
    # members may be in the goal one after the other: it is 1 m high, and they drive at most 1 m in the window's second
    assert 0.35 < answer.interval.half_width <= 1.0
    assert answer.plan is not None
    assert answer.plan.problem.fleet.parameters["traction"] == Interval(0.95, 1.05)


MISTAKES = [
    ("parameters: {mass: {range: [1, 2]}}", "fleet.parameters.mass", "unknown field"),
    (
        "parameters: {linear_traction: {range: [0, 1]}}",
        "fleet.parameters.linear_traction.range",
        "expected a range above",
    ),
    ("parameters: {start_x: {range: [1, 0]}}", "fleet.parameters.start_x.range", "expected [low, high], got [1, 0]"),
    ("parameters: {start_x: {range: [1 deg, 2]}}", "fleet.parameters.start_x.range[0]", "expected a length"),
    (
        "parameters: {traction: {range: [1, 2]}, angular_traction: {range: [1, 2]}}",
        "fleet.parameters.angular_traction",
        "expected traction or angular_traction, got both",
    ),
    ("samples: {mass: [1, 2]}", "fleet.samples.mass", "expected columns among traction, linear_traction"),
    (
        "samples: {linear_traction: [1], angular_traction: [1, 2]}",
        "fleet.samples",
        "expected columns of one length",
    ),
    ("samples: {traction: [1, -2]}", "fleet.samples.traction[1]", "expected a number without a unit, above 0"),
    ("samples: nowhere.csv", "fleet.samples", "nowhere.csv: no such file"),
    ("input_bounds: {delta: [-0.1, 0.1]}", "fleet.input_bounds.delta", "expected bounds of v and omega, got 'delta'"),
    ("wheelbase: 1 m", "fleet.wheelbase", "expected a wheelbase for the bicycle only, got one for the unicycle"),
    ("model: bicycle, wheelbase: 0 m", "fleet.wheelbase", "expected a length in m, cm, mm or km, above 0"),
    (
        "model: bicycle, input_bounds: {delta: [-90 deg, 90 deg]}",
        "fleet.input_bounds.delta",
        "expected angles from -1.5",
    ),
]


@pytest.mark.parametrize(("given", "path", "message"), MISTAKES)
def test_a_mistake_in_the_fleet_is_named_with_its_place(given: str, path: str, message: str) -> None:
    model = "" if "model:" in given else "model: unicycle, "
    text = (
        f"fleet: {{{model}start: {{position: [0, 0], heading: 0}}, {given}}}\n"
        "horizon: {duration: 1 s}\nregions: {goal: {box: [[-1, 1], [-1, 1]]}}\ntask: F in(goal)\n"
    )
    with pytest.raises(ConfigError) as caught:
        load_text(text)
    (error,) = caught.value.diagnostics
    assert error.path == path
    assert error.message.startswith(message), error.message
    assert error.line == 1
