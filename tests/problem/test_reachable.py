"""Targets that no control can reach: the bounds against random controls, and what is said of each."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ConfigError
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.checks import findings
from ensemble_ctrl.problem.checks.spread import apart, furthest, widest
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import Bicycle, Unicycle
from tests.examples import examples

TEXT = """
fleet:
  model: unicycle
  parameters: {traction: {range: [0.9, 1.1]}}
  start: {position: [0, 0], heading: 0 deg}
horizon: {duration: 4 s, steps: 8}
regions: {goal: {box: [[1, 2], [-1, 1]]}}
obstacles: {o: {box: [[3, 4], [3, 4]]}}
task: "F in(goal) and G avoid(o)"
objective: {terminal: {target: [1, 0], weight: 1}}
"""

SPREAD = "[0.9, 1.1]}, start_x: {range: [0, 3.5]}, start_y: {range: [0, 3.2]}}"


@given(st.integers(0, 2**31), st.booleans())
@examples(60)
def test_no_control_brings_members_further(seed: int, bicycle: bool) -> None:
    rng = np.random.default_rng(seed)
    distributions = {
        "linear_traction": Interval(*np.sort(rng.uniform(0.2, 1.5, 2))),
        "angular_traction": Interval(*np.sort(rng.uniform(0.2, 1.5, 2))),
        "start_heading": Interval(-0.1, 0.3),
    }
    low, high = np.array([-1.0, -0.7]), np.array([2.0, 1.2])
    fleet = Fleet(Bicycle() if bicycle else Unicycle(), distributions, np.zeros(2), 0.4, low, high)
    problem = Problem("any", fleet, 1.5, 6, parse("F x >= -9"))
    ends = np.where(
        rng.random((6, 2)) < 0.7, np.where(rng.random((6, 2)) < 0.5, low, high), rng.uniform(low, high, (6, 2))
    )
    members = np.concatenate([fleet.sample(20, seed % 1000), fleet.corners, fleet.center[None]])
    final = trajectories(problem, ends, members)[:, -1]
    assert np.linalg.norm(final, axis=1).max() <= furthest(problem) + 1e-9
    assert np.linalg.norm(final - final[-1], axis=1).max() <= widest(problem) + 1e-9
    for i, j in rng.integers(0, len(members), (20, 2)):
        assert np.linalg.norm(final[i] - final[j]) <= apart(problem, members[i], members[j]) + 1e-9


@pytest.mark.parametrize(
    ("target", "wanted"),
    [
        (
            "{traction: [[0.9, [-5, 0]], [1.1, [5, 0]]]}",
            "should end 10 m apart, 2.64 m more than one",
        ),
        ("{traction: [[0.9, [99, 0]], [1.1, [1, 0]]]}", "(99, 0) is 99 m from the start, but at top speed a member"),
        (
            "{traction: [[0.95, [1, 0]], [1.1, [1, 0]]]}",
            "for 0.9 to 1.1, got them for 0.95 to 1.1 only",
        ),
        (
            "{mean: [20, 0], covariance: [[0.1, 0], [0, 0.1]]}",
            "target.mean: no control can reach it: the mean",
        ),
        ("{mean: [2, 0], covariance: [[50, 0], [0, 50]]}", "the deviation sqrt(trace) should be 10 m, 6 m more than"),
        ("{mean: [2, 0], covariance: [[1, 2], [2, 1]]}", "without negative eigenvalues"),
        (
            "{moments: [[90, 0]]}",
            "should end 63.6 m from the start, 54.8 m more than any member can",
        ),
        (
            "{moments: [[2, 0], [9, 0]]}",
            "target.moments[1]: no control can reach it: moment 1 should have",
        ),
    ],
)
def test_targets_out_of_reach_are_refused(target: str, wanted: str) -> None:
    with pytest.raises(ConfigError) as error:
        load_text(TEXT.replace("[1, 0]", target))
    assert wanted in str(error.value)


def test_a_place_out_of_reach_is_a_warning() -> None:
    (found,) = findings(load_text(TEXT.replace("[1, 0]", "[20, 0]")))
    assert found.severity == "warning"
    assert found.message == "the target is 20 m from the start, 11.2 m more than any member can drive"
    assert findings(load_text(TEXT)) == ()


@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        ("{o: {box: [[3, 4], [3, 4]]}}", "{o: {box: [[-0.1, 0.1], [-1, 1]]}}", "the start (0, 0) is 0.1 m deep inside"),
        (
            "[0.9, 1.1]}}",
            "[0.9, 1.1]}, start_x: {range: [0, 3.5]}, start_y: {range: [0, 3.2]}}",
            "some members start inside",
        ),
        (
            "task:",
            "motions: {o: {path: [[0, [0, 0]], [2, [1, 1]]]}}\ntask:",
            "expected times from 0 to 4 s, got 0 to 2 s",
        ),
        ("task:", "motions: {o: {path: [[0, [-3.5, -3.5]], [4, [1, 1]]]}}\ntask:", "deep inside obstacle 'o'"),
    ],
)
def test_obstacles_on_robots_and_without_times_are_refused(old: str, new: str, wanted: str) -> None:
    with pytest.raises(ConfigError) as error:
        load_text(TEXT.replace(old, new))
    assert wanted in str(error.value)


def test_some_may_start_inside_where_a_share_is_enough() -> None:
    text = TEXT.replace("[0.9, 1.1]}}", SPREAD)
    problem = load_text(text.replace("F in(goal) and G avoid(o)", "share(0.9, F in(goal) and G avoid(o))"))
    assert findings(problem) == ()
