"""Checks of a whole problem, for problems that are made in Python."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem, SolveOptions, VerifyOptions
from ensemble_ctrl.problem.checks import Finding, findings, path_text, require_sound
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import Unicycle
from tests.examples import examples

FLEET = Fleet(
    system=Unicycle(),
    parameters={"traction": Interval(0.5, 2.0)},
    position=np.array([0.0, 0.0]),
    heading=0.0,
    input_lower=np.array([-3.0, -1.0]),
    input_upper=np.array([2.0, 1.0]),
)
GOAL = Polyhedron.box([[8.0, 9.0], [6.0, 7.0]])


def problem(task: str = "F in(goal) and G avoid(obstacles)", **changes: Any) -> Problem:
    """A sound problem with some fields replaced; the goal is 10 m away and the slowest drives 1.5 m/s."""
    fields: dict[str, Any] = {
        "name": "checked",
        "fleet": FLEET,
        "duration": 10.0,
        "steps": 100,
        "task": parse(task),
        "regions": {"goal": GOAL},
        "obstacles": {"wall": (Obstacle.box([[3.0, 4.0], [-1.0, 1.0]]),)},
    }
    return Problem(**{**fields, **changes})


def errors(task: str = "F in(goal) and G avoid(obstacles)", **changes: Any) -> tuple[Finding, ...]:
    """What makes a problem refused."""
    with pytest.raises(ProblemError) as refusal:
        problem(task, **changes)
    found = refusal.value.findings
    assert str(refusal.value) == "\n".join(map(str, found))
    return tuple(found)


def only(task: str = "F in(goal) and G avoid(obstacles)", **changes: Any) -> Finding:
    """The one thing that makes a problem refused."""
    (error,) = errors(task, **changes)
    return error


def test_a_sound_problem_has_no_findings() -> None:
    assert findings(problem()) == ()
    require_sound(problem())


def test_a_path_is_written_as_in_a_message() -> None:
    assert path_text(("regions", "goal", "box", 0, 1)) == "regions.goal.box[0][1]"
    assert str(Finding(("a",), "wrong", "do this")) == "a: wrong; do this"


NUMBERS: list[tuple[dict[str, Any], str, str]] = [
    ({"duration": 0.0}, "horizon.duration", "got 0 s"),
    ({"duration": math.nan}, "horizon.duration", "got nan s"),
    ({"duration": math.inf}, "horizon.duration", "got inf s"),
    ({"steps": 0}, "horizon.steps", "whole number from 1 to 100000, got 0"),
    ({"steps": 2.5}, "horizon.steps", "got 2.5"),
    ({"steps": True}, "horizon.steps", "got True"),
    ({"order": 0}, "moments.order", "whole number from 1 to 50 (or auto), got 0"),
    ({"order": 60}, "moments.order", "got 60"),
    (
        {"fleet": replace(FLEET, parameters={"traction": Interval(0.0, 1.0)})},
        "fleet.parameters.traction.range",
        "got [0, 1]",
    ),
    ({"solve": SolveOptions(time_limit=0.0)}, "solve.time_limit", "above 0, got 0 s"),
    ({"solve": SolveOptions(margin=-0.1)}, "solve.margin", "at least 0, got -0.1 m"),
    ({"solve": SolveOptions(margin=math.nan)}, "solve.margin", "got nan m"),
    ({"solve": SolveOptions(seed=-1)}, "solve.seed", "got -1"),
    ({"solve": SolveOptions(routes=0)}, "solve.routes", "whole number from 1 to 1000 (or all), got 0"),
    ({"solve": SolveOptions(routes="some")}, "solve.routes", "got 'some'"),  # type: ignore[arg-type]
    ({"solve": SolveOptions(max_iterations=0)}, "solve.max_iterations", "got 0"),
    ({"solve": SolveOptions(method="magic")}, "solve.method", "expected one of nlp, minlp, got 'magic'"),  # type: ignore[arg-type]
    ({"solve": SolveOptions(guarantee="mean")}, "solve.guarantee", "expected one of moment, nodes, hull, got 'mean'"),  # type: ignore[arg-type]
    ({"verify": VerifyOptions(members=0)}, "verify.members", "got 0"),
    ({"verify": VerifyOptions(substeps=0)}, "verify.substeps", "got 0"),
    ({"regions": {"G": GOAL}}, "regions.G", "is a word of the task language"),
    ({"obstacles": {"goal": ()}}, "obstacles.goal", "is a region's name too"),
]


@pytest.mark.parametrize(("changes", "path", "message"), NUMBERS)
def test_numbers_and_names(changes: dict[str, Any], path: str, message: str) -> None:
    error = only(**changes)
    assert path_text(error.path) == path
    assert message in error.message


def test_what_takes_very_long_is_said_before_it_begins() -> None:
    large = problem(steps=100_000, verify=VerifyOptions(members=10_000_000, substeps=100))
    assert [str(found).partition(";")[0] for found in findings(large) if found.path[0] != "obstacles"] == [
        "horizon.steps: 100000 steps take about 50 min to build, more than the time limit of 600 s",
        "verify.members: 10000000 members sampled 100 times in each of 100000 steps take about 278 h",
    ]
    assert findings(problem(steps=5_000, verify=VerifyOptions(members=10_000_000, substeps=2))) != ()
    assert findings(problem(steps=5_000)) == ()
    assert findings(problem(steps=160, verify=VerifyOptions(members=10_000_000))) == ()


def test_a_replay_that_the_time_limit_ends_is_said_before_it_begins() -> None:
    hurried = problem(verify=VerifyOptions(members=10_000_000), solve=SolveOptions(time_limit=10.0), steps=160)
    (found,) = findings(hurried)
    assert "10000000 members sampled 1 times in each of 160 steps take about 16 s; fewer of them" in str(found)
    assert "ends with those run by the time limit of 10 s" in str(found)


def test_members_that_do_not_fit_into_memory_are_refused_with_how_many_do() -> None:
    """A task that reads the fleet as a whole holds all members at once."""
    task = "F mean(in(goal))"
    error = only(task, verify=VerifyOptions(members=10_000_000), steps=160)
    assert path_text(error.path) == "verify.members"
    assert "expected at most 1250000 for a task that speaks of the fleet as a whole" in error.message
    assert "64 GB of memory" in error.message
    assert not [
        f for f in findings(problem(task, verify=VerifyOptions(members=1_000_000), steps=160)) if f.severity == "error"
    ]


def test_a_task_that_is_still_text() -> None:
    read = replace(problem(), task="F in(goal)")  # type: ignore[arg-type]
    assert read.task == parse("F in(goal)")


def test_all_errors_are_reported_together() -> None:
    found = errors(duration=-1.0, steps=0, order=60)
    assert [error.path[-1] for error in found] == ["duration", "steps", "order"]


def test_names_in_the_task() -> None:
    found = errors("F in(gaol) and G avoid(wal) and F z >= 1")
    assert [(error.path, error.offset) for error in found] == [
        (("task",), 5),
        (("task",), 23),
        (("task",), 34),
    ]
    assert "did you mean 'goal'?" in found[0].message
    assert "did you mean 'wall'?" in found[1].message


def test_windows() -> None:
    assert only("F[0, 11] in(goal)").offset == 0
    assert "10 s" in only("F[0, 11] in(goal)").message
    assert "11 s" in only("G[0, 5] F[0, 6] x >= -99").message
    assert only("F[11, T] in(goal)").path == ("task",)


def test_a_start_inside_an_obstacle() -> None:
    error = only(fleet=FLEET.with_(position=np.array([3.25, 0.0])))
    assert error.path == ("fleet", "start", "position")
    assert "0.25 m deep inside obstacle 'wall'" in error.message


def test_a_start_within_the_radius_of_an_obstacle() -> None:
    assert findings(problem(fleet=replace(FLEET, radius=3.0))) == ()
    error = only(fleet=replace(FLEET, radius=3.1))
    assert "0.1 m deep inside obstacle 'wall', grown by the radius 3.1 m" in error.message


@pytest.mark.parametrize(
    ("task", "offset"),
    [
        ("F[0, 6] in(goal)", 11),
        ("x >= -1 and F[0, 6] in(goal)", 23),
        ("F[0, 3] F[0, 3] in(goal)", 19),
        ("F[0, 6] (in(goal) and x >= 8)", 12),
        ("G[6, 8] in(goal)", 11),
        ("x >= -9 U[0, 6] in(goal)", 19),
    ],
)
def test_a_goal_out_of_reach(task: str, offset: int) -> None:
    error = only(task)
    assert (error.path, error.offset) == (("task",), offset)
    assert "region 'goal' is 10 m from the start" in error.message
    assert "(traction 0.5) drives 9 m by 6 s" in error.message
    assert "it needs 6.67 s at 1.5 m/s" in error.hint


@pytest.mark.parametrize(
    "task",
    [
        "F[0, 6.67] in(goal)",
        "F[0, 6] in(goal) or x >= 0",
        "not F[0, 6] in(goal)",
        "F in(goal)",
        "G F in(goal)",
    ],
)
def test_a_goal_that_may_be_reached_is_left_alone(task: str) -> None:
    assert [f for f in findings(problem(task)) if f.severity == "error"] == []


@examples(40)
@given(st.floats(0.1, 10.0), st.floats(-math.pi, math.pi))
def test_what_a_straight_drive_reaches_is_never_refused(deadline: float, angle: float) -> None:
    reached = 1.5 * deadline * np.array([math.cos(angle), math.sin(angle)])
    there = Polyhedron.box(np.column_stack([reached - 1e-6, reached + 1e-6]))
    problem(f"F[0, {deadline!r}] in(there)", regions={"there": there}, obstacles={})


def test_no_speed_at_all() -> None:
    still = replace(FLEET, input_lower=np.zeros(2), input_upper=np.zeros(2))
    assert only("F in(goal)", fleet=still).hint == "raise fleet.input_bounds.v"


@pytest.mark.parametrize("task", ["G in(goal)", "in(goal)", "G[0, 5] (x >= 0 and in(goal))"])
def test_a_start_outside_where_all_must_stay(task: str) -> None:
    error = only(task)
    assert "members have to be in 'goal' from the start, but (0, 0) is 10 m outside" in error.message
    assert error.offset == task.index("goal")


def test_a_start_inside_where_all_must_stay() -> None:
    home = {"home": Polyhedron.box([[-1.0, 1.0], [0.0, 1.0]])}
    assert findings(problem("G in(home)", regions=home, obstacles={})) == ()


def test_a_covered_goal() -> None:
    left, right = Obstacle.box([[7.0, 8.6], [5.0, 8.0]]), Obstacle.box([[8.5, 10.0], [5.0, 8.0]])
    error = only(obstacles={"left": (left,), "right": (right,)})
    assert error.path == ("regions", "goal")
    assert error.message == "obstacles cover the whole region: left, right"
    assert findings(problem(obstacles={"left": (left,)})) == ()


def test_a_goal_covered_by_the_radius() -> None:
    near = {"near": (Obstacle.box([[8.2, 8.8], [6.2, 6.8]]),)}
    assert findings(problem(obstacles=near, fleet=replace(FLEET, radius=0.2))) == ()
    assert "grown by the radius 0.5 m" in only(obstacles=near, fleet=replace(FLEET, radius=0.5)).message


def test_a_covered_goal_that_is_one_of_two_is_odd_but_allowed() -> None:
    over = {"over": (Obstacle.box([[7.0, 10.0], [5.0, 8.0]]),)}
    (odd,) = findings(problem("(F in(goal) or F x >= 3) and G avoid(obstacles)", obstacles=over))
    assert (odd.severity, odd.path) == ("warning", ("regions", "goal"))


def test_empty_and_unbounded_regions() -> None:
    empty = Polyhedron([[1.0, 0.0], [1.0, 0.0]], [3.0, -np.inf], [np.inf, 2.0])
    assert "empty" in only(regions={"goal": empty}).message
    half = Polyhedron([[1.0, 0.0]], [3.0], [np.inf])
    (odd,) = findings(problem(regions={"goal": half}))
    assert (odd.severity, odd.message) == ("warning", "this region is unbounded")
    assert "2 dimensions (x, y), got 3" in only(regions={"goal": Polyhedron.box([[0, 1]] * 3)}).message


def test_a_flat_region_is_no_crash() -> None:
    assert findings(problem(regions={"goal": Polyhedron.box([[8.0, 8.0], [6.0, 7.0]])})) == ()


def test_what_the_task_leaves_out() -> None:
    far = {"goal": GOAL, "spare": Polyhedron.box([[-5, -4], [0, 1]])}
    spare = {"goal": GOAL, "spare": Polyhedron.box([[0, 1], [0, 1]])}
    (odd,) = findings(problem(regions=spare))
    assert (odd.severity, odd.path) == ("warning", ("regions", "spare"))
    assert findings(problem("F in(goal) and G avoid(obstacles) and G avoid(spare)", regions=far)) == ()
    (odd,) = findings(problem("F in(goal)"))
    assert (odd.severity, odd.path) == ("warning", ("obstacles",))
    two = {"a": (Obstacle.box([[3, 4], [0, 1]]),), "b": (Obstacle.box([[5, 6], [0, 1]]),)}
    (odd,) = findings(problem("F in(goal) and G avoid(b)", obstacles=two))
    assert (odd.severity, odd.path) == ("warning", ("obstacles", "a"))
