"""The unconstrained baseline: what it leaves out and what it keeps."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ensemble_ctrl import Plan, Problem, load_text, unconstrained
from ensemble_ctrl.api.planning import with_baseline
from ensemble_ctrl.problem.evaluation.sampled import replay

MAP = """\
name: small
fleet: {model: unicycle, start: {position: [1, 1], heading: 0 deg}, input_bounds: {v: [-3, 2]}}
horizon: {duration: 10 s}
regions:
  goal: {box: [[6, 7], [5, 6]]}
  room: {box: [[0, 4.5], [0, 8]]}
  hall: {box: [[3.5, 8], [0, 8]]}
obstacles: {rock: {box: [[2, 3], [3, 4]]}}
objective: {robustness: 2.0, terminal: {target: [6.5, 5.5]}}
report: {baseline: true}
task: """
TASK = "F[8, 10] in(goal) and G avoid(rock)"


def problem(task: str) -> Problem:
    """A small map with a task."""
    return load_text(MAP + task)


@pytest.mark.parametrize(
    ("task", "rest"),
    [
        ("F[8, 10] in(goal) and G avoid(obstacles)", "F[8,10] in(goal)"),
        ("F[8, 10] in(goal) and G[2, 3] avoid(rock)", "F[8,10] in(goal)"),
        ("F[8, 10] in(goal) and G (in(room) or in(hall))", "F[8,10] in(goal)"),
        ("F[8, 10] in(hall) and G[0, T] (in(room) and avoid(rock))", "F[8,10] in(hall)"),
        ("G not in(goal) and F in(room) and F in(hall)", "F in(room) and F in(hall)"),
    ],
)
def test_what_holds_the_fleet_back_goes(task: str, rest: str) -> None:
    assert str(unconstrained(problem(task)).task) == rest


@pytest.mark.parametrize(
    "task",
    [
        "F[8, 10] in(goal)",
        "G[8, 10] in(goal)",
        "F G[0, 2] in(goal)",
        "G (x >= 0) and F in(goal)",
        "not in(hall) U in(goal)",
    ],
)
def test_what_is_to_be_done_stays(task: str) -> None:
    assert unconstrained(problem(task)).task == problem(task).task


@pytest.mark.parametrize("task", ["G in(room)", "G avoid(rock)", "G in(room) and G avoid(rock)"])
def test_where_nothing_is_left_the_whole_plane_is_the_task(task: str) -> None:
    baseline = unconstrained(problem(task))
    assert str(baseline.task) == "G in(anywhere)"
    (lower, upper), start = (
        (baseline.regions["anywhere"].lower, baseline.regions["anywhere"].upper),
        baseline.fleet.position,
    )
    assert (np.abs([lower - start, upper - start]) > 3 * 1.1 * 10).all()
    assert baseline.objective.robustness == 0.0
    assert baseline.objective.target is not None


def test_the_rest_of_the_problem_is_the_same() -> None:
    one = problem(TASK)
    baseline = unconstrained(one)
    assert (baseline.fleet, baseline.objective, baseline.solve) == (one.fleet, one.objective, one.solve)
    assert (one.verify.certificate, baseline.verify.certificate) == (True, False)
    assert (one.report.baseline, baseline.report.baseline) == (True, False)
    assert list(baseline.obstacles) == ["rock"]


def test_a_figure_shows_the_baseline_dashed_and_its_whole_way() -> None:
    from ensemble_ctrl.report.figures import draw_trajectories

    one = problem(TASK)
    still, straight = np.zeros((100, 2)), np.tile([2.0, 0.0], (100, 1))
    ax = Figure().subplots()
    assert not dashed(draw_trajectories(one, still, ax))
    lines = dashed(draw_trajectories(one, still, ax, straight))
    assert len(lines) > 3
    assert max(np.max(line.get_xdata()) for line in lines) == pytest.approx(1 + 2 * 1.1 * 10)
    assert ax.get_legend_handles_labels()[1] == ["unconstrained"]


def dashed(ax: Axes) -> list[Line2D]:
    """The dashed lines on some axes."""
    return [line for line in ax.lines if line.get_linestyle() == "--"]


def test_a_baseline_that_can_not_be_planned_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    one = problem(TASK)
    plan = Plan(one, np.zeros((100, 2)), "planned")
    assert with_baseline(plan, lambda phase, iteration: True).baseline is None


def test_the_baseline_of_a_plan_is_planned_without_the_obstacle() -> None:
    ahead = MAP.replace("{position: [1, 1], heading: 0", "{position: [2.5, 1], heading: 90")
    one = load_text(ahead + TASK)
    baseline = with_baseline(Plan(one, np.zeros((100, 2)), "planned")).baseline
    assert baseline is not None
    assert replay(one, baseline, members=100).violating.any()
