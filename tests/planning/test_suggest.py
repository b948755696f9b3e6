"""Where there is no plan: what is said to help was tried, is proven, and can be repeated by the overrides named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import ensemble_ctrl as ec
from ensemble_ctrl.api.planning import with_suggestions
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.constraints.stl import ExactOps, StateSignals, member_robustness, parse
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config import dump, load_text
from ensemble_ctrl.ocp.solvers import Iteration
from ensemble_ctrl.planning.planner import Status
from ensemble_ctrl.planning.suggest import Suggestions, relaxations, suggest
from ensemble_ctrl.planning.suggest.relax import (
    longer_horizon,
    narrower,
    reversing,
    rounded_up,
    smaller_robots,
    stretched,
    turned,
    wider_bounds,
    without,
)
from ensemble_ctrl.planning.suggest.search import first_true
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.conflicts import Conflict
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.report import summary_lines
from tests.examples import examples

SLOW = """\
name: slow
fleet:
  model: unicycle
  start: {position: [0, 0], heading: 0 deg}
  input_bounds: {v: [-0.9, 0.9], omega: [-2, 2]}
  radius: 2 cm
horizon: {duration: 4 s, steps: 20}
regions: {goal: {box: [[1.5, 2.5], [-0.5, 0.5]]}}
obstacles: {block: {box: [[0.8, 1.2], [-1.4, 1.4]]}}
task: "F[3, 4] in(goal) and G avoid(block)"
"""
RIGHT_THROUGH = np.tile([0.5, 0.0], (20, 1))


def slow(*overrides: str) -> Problem:
    """The way round the block is too long for these robots in 4 s."""
    return load_text(SLOW, "slow", overrides)


def test_a_longer_horizon_that_was_planned_and_proven() -> None:
    problem = slow()
    found = ec.plan(problem, check=False)
    assert found.status == "infeasible"
    tried = found.suggest()
    assert tried.failed == ()
    longer, faster = tried.helps
    assert longer.change.startswith(f"a horizon of {longer.problem.duration:g} s in place of 4 s, and with it F[3.")
    assert 4 < longer.problem.duration <= 6
    assert faster.change.startswith("input bounds 1.")
    for help in (longer, faster):
        again = load_text(SLOW, "slow", help.overrides)
        assert dump(again) == dump(help.problem)
        assert certify(again, help.controls).proven == "yes"
        assert not replay(again, help.controls, members=2000, substeps=5).violating.any()
    assert faster.problem.duration == 4
    assert faster.problem.fleet.input_upper == pytest.approx(
        [0.9, 2] * np.full(2, longer.problem.duration / 4), rel=1e-3
    )


def test_a_spread_fleet_is_narrowed_first() -> None:
    problem = slow("fleet.input_bounds.v=[-2, 2]", "fleet.parameters.traction.range=[0.5, 1.5]")
    names = [way.name for way in relaxations(problem, (), spread=True)]
    assert names == ["range", "horizon", "radius", "margin"]
    assert [way.name for way in relaxations(problem, (), spread=False)][:2] == ["horizon", "range"]


def test_what_is_tried_depends_on_the_problem() -> None:
    hit = [Conflict("F[3,4] in(goal)", 1.0, {}, 4.0), Conflict("avoid(block)", 0.1, {}, 2.0)]
    moving = slow("motions.block.velocity=[0, 0.1]", "fleet.radius=0", "solve.margin=0")
    assert [way.name for way in relaxations(moving, hit, False)] == ["input bounds", "range", "obstacle"]
    equal = load_text(SLOW, "slow", ["fleet.parameters={}"])
    assert "range" not in [way.name for way in relaxations(equal, hit, False)]


CAR = SLOW.replace("model: unicycle", "model: bicycle\n  wheelbase: 0.3").replace(
    "v: [-0.9, 0.9], omega: [-2, 2]", "v: [0, 0.9], delta: [-30 deg, 30 deg]"
)


def test_a_car_may_reverse_and_start_in_other_headings_before_an_obstacle_goes() -> None:
    hit = [Conflict("avoid(block)", 0.1, {}, 2.0)]
    names = [way.name for way in relaxations(load_text(CAR), hit, False)]
    assert names == ["horizon", "range", "reversing", *3 * ["start heading"], "radius", "margin", "obstacle"]
    back = load_text(CAR, "car", ["fleet.input_bounds.v=[-0.1, 0.9]"])
    assert "reversing" not in [way.name for way in relaxations(back, hit, False)]


@pytest.mark.parametrize("axis", ["x", "y"])
def test_reversing_and_other_headings_say_the_same_as_their_overrides(axis: str) -> None:
    problem = load_text(CAR, "car", ["fleet.start.heading=20 deg", f"fleet.start.heading_from={axis}"])
    back = reversing(problem, 0.5)
    np.testing.assert_allclose(back.problem.fleet.input_lower, [-0.45, np.deg2rad(-30)])
    assert back.change == "reversing at up to 0.45 m/s in place of none"
    round_about = turned(problem, 180)
    assert np.cos(round_about.problem.fleet.heading - problem.fleet.heading) == pytest.approx(-1)
    for relaxed in (back, round_about):
        changed = load_text(dump(problem), "car", relaxed.overrides).fleet
        np.testing.assert_allclose(changed.input_lower, relaxed.problem.fleet.input_lower)
        assert changed.heading == pytest.approx(relaxed.problem.fleet.heading)


def test_an_obstacle_that_the_task_names_can_not_be_left_out() -> None:
    assert without(slow('task="F[3, 4] in(goal) and G avoid(obstacles)"'), "block").problem.obstacles == {}
    with pytest.raises(ProblemError):
        without(slow(), "block")
    tried = suggest(slow("fleet.radius=0", "solve.margin=0"), RIGHT_THROUGH, seconds=0.0)
    assert (tried.helps, tried.failed, tried.limited) == ((), (), True)


def test_words_and_overrides_say_the_same() -> None:
    problem = slow("fleet.parameters.traction={range: [0.8, 1.2], distribution: beta, a: 2, b: 3}")
    for relaxed in (
        longer_horizon(problem, 1.35),
        wider_bounds(problem, 1.5),
        narrower(problem, 0.5),
        smaller_robots(problem, 0.5),
    ):
        changed = load_text(
            SLOW, "slow", ["fleet.parameters.traction={distribution: beta, a: 2, b: 3}", *relaxed.overrides]
        )
        if "range" not in str(relaxed.overrides):
            changed = load_text(dump(problem), "slow", relaxed.overrides)
        assert dump(changed) == dump(relaxed.problem), relaxed.change
    assert narrower(problem, 0.5).change == "traction 0.9 to 1.1 in place of 0.8 to 1.2"
    assert smaller_robots(problem, 0.5).change == "a radius of 0.01 m in place of 0.02 m"


def test_a_steering_angle_keeps_its_bounds() -> None:
    car = ["fleet.model=bicycle", "fleet.input_bounds={v: [-1, 1], delta: [-0.5, 0.5]}"]
    relaxed = wider_bounds(slow(*car), 2.0)
    assert relaxed.problem.fleet.input_upper.tolist() == [2.0, 0.5]
    assert relaxed.overrides == ("fleet.input_bounds.v=[-2.0, 2.0]",)


@examples(30)
@given(st.floats(1.0, 3.0), st.integers(0, 10_000))
def test_in_a_longer_horizon_the_same_path_does_the_stretched_task(factor: float, seed: int) -> None:
    """Driving the path more slowly: states at the grid times are the same, and so is the robustness of the task."""
    problem = slow()
    controls = np.random.default_rng(seed).uniform(-0.8, 0.8, (20, 2))
    longer = longer_horizon(problem, factor).problem
    ratio = longer.duration / problem.duration
    assert factor - 1e-9 <= ratio <= factor * 1.1
    before, after = (
        replay(p, u, parameters=np.linspace(0.9, 1.1, 5)[:, None], substeps=3)
        for p, u in ((problem, controls), (longer, controls / ratio))
    )
    np.testing.assert_allclose(after.robustness, before.robustness, atol=1e-5)
    assert after.clearances[0].distance == pytest.approx(before.clearances[0].distance, abs=1e-6)
    assert after.clearances[0].time == pytest.approx(before.clearances[0].time * ratio, abs=1e-6)


@given(st.floats(1.0, 3.0))
def test_stretched_formulas_mean_the_same_at_another_pace(factor: float) -> None:
    formula = parse("F[1, 4] (x >= 1 and G[0, 1] y <= 2) or (x >= 0 U[0.5, 3] y >= 1) and G x <= 5")
    states = np.random.default_rng(1).normal(size=(1, 21, 2))
    slower = stretched(formula, factor, 10 * factor)
    values = [
        np.asarray(member_robustness(f, StateSignals(states, ("x", "y"), step), ExactOps()))[0, 0]
        for f, step in ((formula, 0.5), (slower, 0.5 * factor))
    ]
    assert values[0] == values[1]


@given(st.floats(1e-3, 1e6))
def test_rounding_up_is_little_and_up(value: float) -> None:
    assert value * (1 - 1e-9) <= rounded_up(value) <= value * 1.1
    assert len(f"{rounded_up(value):.2g}") <= len(f"{value:.12g}") + 4
    assert float(f"{rounded_up(value):.2g}") == pytest.approx(rounded_up(value), rel=1e-12)


@given(st.integers(1, 20), st.data())
def test_the_first_that_holds(count: int, data: st.DataObject) -> None:
    first = data.draw(st.integers(0, count))
    asked: list[int] = []

    def holds(k: int) -> bool:
        asked.append(k)
        return k >= first

    assert first_true(holds, count, lambda: False) == (first if first < count else None)
    assert len(asked) <= 2 + np.log2(count)
    if first < count:
        assert first_true(holds, count, lambda: True) == count - 1


@pytest.mark.parametrize(
    ("status", "spent", "looks"),
    [
        ("infeasible", 0.0, True),
        ("infeasible", 599.5, False),
        ("limit", 10.0, True),
        ("limit", 600.0, False),
        ("planned", 0.0, False),
        ("interrupted", 0.0, False),
    ],
)
def test_when_something_is_looked_for(
    monkeypatch: pytest.MonkeyPatch, status: Status, spent: float, looks: bool
) -> None:
    asked: list[float] = []

    def suggest(self: Plan, seconds: float, **_: object) -> Suggestions:
        asked.append(seconds)
        return Suggestions(failed=("equal members",))

    monkeypatch.setattr(Plan, "suggest", suggest)
    plan = Plan(slow(), RIGHT_THROUGH, status, {"seconds": {"solve": spent}})
    found = with_suggestions(plan)
    assert asked == ([30.0] if looks else [])
    assert found.details.get("suggestions", {}).get("failed") == (["equal members"] if looks else None)


def test_who_watches_can_stop_it() -> None:
    told: list[str] = []

    def stop(phase: str, iteration: Iteration | None) -> bool:
        told.append(phase)
        return True

    tried = suggest(slow(), RIGHT_THROUGH, progress=stop)
    assert (tried.helps, tried.failed, told, tried.limited) == ((), (), ["suggest"], False)


def test_the_summary_says_it() -> None:
    plan = Plan(slow(), RIGHT_THROUGH, "infeasible")
    assert any(line.startswith("  try        a longer horizon, ") for line in summary_lines(plan))
    helps = [
        {"change": "a horizon of 5 s in place of 4 s", "set": ["horizon.duration=5.0", "task=F in(goal)"]},
        {"change": "faster robots", "set": []},
    ]
    found = replace(plan, details={"suggestions": {"helps": helps, "failed": ["equal members"], "seconds": 1.0}})
    lines = summary_lines(found)
    at = next(i for i, line in enumerate(lines) if line.startswith("  it works"))
    assert lines[at : at + 4] == [
        "  it works   with a horizon of 5 s in place of 4 s: planned and proven",
        "             --set horizon.duration=5.0 --set 'task=F in(goal)'",
        "             or with faster robots: planned and proven",
        "             no plan was found even with equal members",
    ]
    assert isinstance(Suggestions().helps, tuple)
    late = replace(plan, details={"suggestions": {"failed": ["equal members"], "seconds": 30.0, "limited": True}})
    assert "             the 30 s for this were up: other changes were not tried" in summary_lines(late)
