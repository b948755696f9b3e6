"""What is drawn of a very long horizon is bounded by what a screen can show."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.problem.evaluation import conflicts, sampled
from ensemble_ctrl.report import series, tube
from ensemble_ctrl.report.kinds.controls import POINTS, draw_controls
from ensemble_ctrl.report.pagecharts import Axes, Curve, chart
from ensemble_ctrl.report.transform import telling

LONG = ec.load_text("""
name: long
fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}, parameters: {traction: {range: [0.9, 1.1]}}}
horizon: {duration: 500 s, steps: 50000}
regions: {goal: {box: [[1, 3], [-1, 1]]}}
obstacles: {post: {box: [[1, 2], [2, 3]]}}
task: G avoid(post) and F[400, 500] in(goal)
""")
CONTROLS = np.column_stack([np.full(LONG.steps, 0.004), np.zeros(LONG.steps)])


@pytest.mark.parametrize("steps", [True, False])
def test_a_curve_of_very_many_points_keeps_its_extremes(steps: bool) -> None:
    values = np.zeros(100_000)
    values[54_321], values[77_777] = 5.0, -3.0
    few = telling(values, 1000)
    assert len(few) <= 1000
    assert {0, 54_321, 77_777, len(values) - 1} <= set(few.tolist())
    x = np.arange(100_001.0 if steps else 100_000.0)
    page = chart(Axes("t [s]", "v [m/s]"), [Curve("", x, values, steps=steps, bold=(0.0, 1e5))], "v")
    assert len(page) < 100_000


def test_values_that_are_no_numbers_are_no_extremes() -> None:
    values = np.full(10_000, np.nan)
    values[4000] = 1.0
    assert 4000 in telling(values, 100)


def test_the_picture_of_the_commands_has_no_more_points_than_columns() -> None:
    ax = Figure().add_subplot()
    commands = CONTROLS.copy()
    commands[12_345, 0] = 0.9
    draw_controls(LONG, commands, ax)
    found: list[Any] = [p.get_data() for panel in ax.child_axes for p in panel.patches if isinstance(p, StepPatch)]
    assert [len(drawn.values) <= POINTS for drawn in found] == [True, True]
    assert found[0].values.max() == 0.9
    assert found[0].edges[-1] == LONG.duration


def test_what_is_looked_at_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[int] = []
    real = sampled.states

    def counting(problem: ec.Problem, controls: Any, members: Any, substeps: int = 1) -> NDArray[np.float64]:
        found = real(problem, controls, members, substeps)
        looked.append(found.shape[0] * (found.shape[1] - 1))
        return found

    for module in (sampled, conflicts):
        monkeypatch.setattr(module, "states", counting)
    conflicts.conflicts(LONG, CONTROLS)
    series.by_parameter(LONG, CONTROLS)
    assert looked
    assert sum(looked) <= 4 * sampled.MOST_STATES


def test_a_tube_of_very_many_steps_has_fewer_slices() -> None:
    (ribbons,) = tube.tubes(LONG, CONTROLS).values()
    assert len(ribbons) == tube.SLICE_STEPS // LONG.steps


def test_blocks_of_a_replay_are_made_when_they_are_needed() -> None:
    """A million blocks that wait would take gigabytes, and minutes to be dropped again."""
    made = 0

    def blocks() -> Iterator[NDArray[np.float64]]:
        nonlocal made
        for _ in range(10_000):
            made += 1
            yield np.zeros((3, 1))

    found = sampled._watched(blocks(), len, lambda done: done >= 30)
    assert found == [3] * 10
    assert made < 100
    assert sampled._watched(iter([np.zeros((k, 1)) for k in range(1, 60)]), len, None) == list(range(1, 60))


def test_a_replay_in_small_blocks_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    short = replace(LONG, steps=500)
    controls = CONTROLS[:500]
    whole = sampled.replay(short, controls, members=50)
    monkeypatch.setattr(sampled, "BLOCK", 20)
    parts = sampled.replay(short, controls, members=50)
    assert np.array_equal(parts.robustness, whole.robustness)
    ended = sampled.replay(short, controls, members=50, watch=lambda done: done >= 12)
    assert ended.members == 12
    assert np.array_equal(ended.robustness, whole.robustness[:12])
