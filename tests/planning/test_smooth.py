"""Smooth commands, bounded rates, and what a replay says of the whole fleet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binomtest

from ensemble_ctrl.core.errors import ConfigError, ProblemError
from ensemble_ctrl.files.config import dump, load_text
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import replay

Floats = NDArray[np.float64]
TEXT = """
fleet:
  model: unicycle
  start: {position: [0, 0], heading: 0}
  rate_bounds: {v: 0.3, omega: 0.5}
horizon: {duration: 6 s, steps: 30}
regions: {goal: {box: [[2, 3.5], [-0.6, 0.6]]}}
obstacles: {post: {box: [[1.2, 1.6], [-0.4, 0.2]]}}
task: F[5, 6] in(goal) and G avoid(post)
objective: {terminal: {target: [2.75, 0]}, smoothness: 0.01}
"""


def unbound(problem: Problem, smoothness: float) -> Problem:
    """The same without rate bounds."""
    objective = replace(problem.objective, smoothness=smoothness)
    return problem.with_(fleet=replace(problem.fleet, rate_bounds=None), objective=objective)


def fastest_change(problem: Problem, controls: Floats) -> Floats:
    """Largest change of each command per second."""
    return np.asarray(np.abs(np.diff(controls, axis=0)).max(axis=0) / problem.step)


def test_rates_are_kept_and_bind() -> None:
    problem = load_text(TEXT)
    found = solve(problem)
    free = solve(unbound(problem, 0.0))
    assert (found.status, free.status) == ("planned", "planned")
    assert (fastest_change(problem, found.controls) <= [0.3, 0.5]).all()
    assert (fastest_change(problem, free.controls) > [0.3, 0.5]).any(), "the bounds would not bind"
    assert found.certificate is not None
    assert found.certificate.proven == "yes"


def test_smoothness_makes_commands_smoother() -> None:
    problem = load_text(TEXT)
    plans = [solve(unbound(problem, weight)) for weight in (0.0, 0.5)]
    rough, smooth = (float((np.diff(p.controls, axis=0) ** 2).sum()) for p in plans)
    assert smooth < 0.5 * rough


def test_they_are_written_and_read_again() -> None:
    again = load_text(dump(load_text(TEXT)))
    np.testing.assert_array_equal(again.fleet.rate_bounds, [0.3, 0.5])
    assert again.objective.smoothness == 0.01
    one = load_text(TEXT.replace("{v: 0.3, omega: 0.5}", "{v: 0.3}"))
    np.testing.assert_array_equal(one.fleet.rate_bounds, [0.3, np.inf])


@pytest.mark.parametrize(
    ("written", "place", "message"),
    [
        ("{v: 0, omega: 1}", "fleet.rate_bounds.v", "expected a number without a unit, above 0"),
        ("{delta: 1}", "fleet.rate_bounds.delta", "expected rates of v and omega, got 'delta'"),
    ],
)
def test_wrong_rates_are_named(written: str, place: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_text(TEXT.replace("{v: 0.3, omega: 0.5}", written))
    (error,) = caught.value.diagnostics
    assert (error.path, error.message[: len(message)]) == (place, message)
    with pytest.raises(ProblemError, match=r"^fleet.rate_bounds: expected numbers above 0"):
        replace(load_text(TEXT).fleet, rate_bounds=np.array([1.0, -1.0]))


def test_the_share_of_the_whole_fleet_is_wilsons() -> None:
    problem = load_text(TEXT)
    run = replay(problem, np.tile([[0.46, 0.0]], (30, 1)), members=402)
    bad = int(run.violating[2:].sum())
    assert run.corners == 2
    wanted = binomtest(400 - bad, 400).proportion_ci(0.95, method="wilson")
    assert run.share() == pytest.approx((wanted.low, wanted.high), abs=1e-4)
    given = replay(problem, np.tile([[0.46, 0.0]], (30, 1)), parameters=[0.9, 1.0])
    assert given.share() == (0.0, 1.0)
