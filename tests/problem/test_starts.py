"""Members start where their parameters say, not at the position that these are offsets from."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.constraints.stl import Always, Inside
from ensemble_ctrl.core.errors import ConfigError
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.planning.baseline import unconstrained
from ensemble_ctrl.planning.minimum_time.goals import bound, goal_of
from ensemble_ctrl.report.figures import draw_map

TEXT = """
fleet:
  model: unicycle
  parameters: {start_x: {range: [0.9, 1.1]}}
  start: {position: [0, 0], heading: 0 deg, heading_from: x}
  input_bounds: {v: [-2, 2]}
horizon: {duration: 5 s, steps: 50}
regions: {goal: {box: [[0.5, 1.5], [-0.5, 0.5]]}}
task: G in(goal)
"""
MASS = """
fleet:
  model: double_integrator
  parameters: {start_x: {range: [2, 3]}}
  start: {x: 0, y: 0}
horizon: {duration: 5 s}
regions: {goal: {box: [[4, 5], [-0.5, 0.5]]}}
obstacles: {o: {box: [[2.6, 3.2], [-0.1, 0.1]]}}
task: F in(goal)
"""


def test_who_starts_inside_may_stay() -> None:
    assert certify(load_text(TEXT), np.zeros((50, 2))).proven == "yes"


def test_one_start_outside_is_named() -> None:
    with pytest.raises(ConfigError, match=r"from the start, but \(1.7, 0\) is 0.2 m outside"):
        load_text(TEXT.replace("[0.9, 1.1]", "[0.9, 1.7]"))


@pytest.mark.parametrize(("goal", "seconds"), [("[2, 3]", 0.55), ("[-3, -2]", 1.55)])
def test_the_bound_on_the_time_is_of_the_start_that_is_furthest(goal: str, seconds: float) -> None:
    text = TEXT.replace("[0.5, 1.5]", goal).replace("G in", "F in").replace("duration: 5 s", "duration: {at_most: 5 s}")
    shortest = goal_of(load_text(text))
    assert shortest is not None
    assert bound(shortest) == pytest.approx(seconds, rel=1e-5)


def test_a_baseline_without_bounds_holds_every_start() -> None:
    far = load_text(TEXT.replace("[0.9, 1.1]", "[500.9, 501.1]").replace("[0.5, 1.5]", "[500, 502]"))
    bare = unconstrained(far)
    assert bare.task == Always(Inside("anywhere"))
    assert bare.regions["anywhere"].margin([[500.9, 0.0], [501.1, 0.0]]).min() >= 20.0


def test_the_map_shows_where_members_start() -> None:
    axes = draw_map(load_text(TEXT), Figure().subplots())
    (marker,) = [line for line in axes.lines if line.get_marker() not in ("None", "", None)]
    assert marker.get_xydata().tolist() == [[1.0, 0.0]]  # type: ignore[union-attr]


def test_a_start_of_a_corner_of_the_ranges_is_not_in_an_obstacle() -> None:
    load_text(MASS.replace("[2.6, 3.2]", "[3.1, 3.2]"))
    with pytest.raises(ConfigError, match=r"the start \(3, 0\) is 0.1 m deep inside obstacle 'o'"):
        load_text(MASS)
