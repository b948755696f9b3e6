"""Curved and perturbed guesses: driven as meant, free of obstacles, repeatable and quiet; and what they find."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.ocp.guesses import ompl_paths
from ensemble_ctrl.ocp.guesses.curved import Curves, curved, promising
from ensemble_ctrl.ocp.guesses.driven import driven, needed, reverses, tightest
from ensemble_ctrl.ocp.guesses.ompl_trees import Growth, Planner, State, tree
from ensemble_ctrl.ocp.guesses.perturbed import perturbed
from ensemble_ctrl.ocp.guesses.pivoting import PivotedGuesses, pivoted_trip
from ensemble_ctrl.ocp.guesses.registry import Request
from ensemble_ctrl.ocp.guesses.roadmap import Trip, trips
from ensemble_ctrl.ocp.guesses.routes import Route
from ensemble_ctrl.ocp.guesses.skeleton import Visit
from ensemble_ctrl.ocp.guesses.trees import grown
from ensemble_ctrl.ocp.truncation import positions
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.planning.planner.coarse_fine import narrowed
from ensemble_ctrl.planning.suggest import Suggestion, relaxations
from ensemble_ctrl.planning.suggest.search import _Search
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.report import summary_lines
from ensemble_ctrl.systems import Unicycle

Floats = NDArray[np.float64]
DEAD_END = """
name: dead_end
fleet:
  model: bicycle
  wheelbase: 0.4
  parameters: {traction: {range: [0.98, 1.02]}}
  start: {position: [0, 0], heading: 0 deg}
  input_bounds: {v: [-0.4, 0.6], delta: [-30 deg, 30 deg]}
  radius: 0.2
horizon: {duration: 20 s, steps: 40}
moments: {order: auto}
regions: {goal: {box: [[-2.4, -1.6], [1.6, 2.6]]}}
obstacles:
  up: {box: [[-1.2, 0.6], [0.35, 0.5]]}
  down: {box: [[-1.2, 0.6], [-0.5, -0.35]]}
  cap: {box: [[0.4, 0.6], [-0.5, 0.5]]}
task: "F[15,20] in(goal) and G avoid(obstacles)"
objective: {robustness: 1, effort: 0.1}
"""
"""A car whose only way out is backwards."""


def dead_end(**fleet: Any) -> Problem:
    problem = load_text(DEAD_END)
    return problem.with_(fleet=replace(problem.fleet, **fleet))


def there_and_back() -> Floats:
    """Poses along a left turn of radius 1.2 m forwards, and from its end a right turn backwards."""
    turn = np.linspace(0.0, 1.0, 200)
    ahead = np.stack([1.2 * np.sin(turn), 1.2 * (1 - np.cos(turn)), turn], axis=1)
    x, y, heading = ahead[-1]
    back = heading + 0.8 * turn  # backwards on a circle to the right, whose middle is at heading - 90 deg
    middle = np.array([x + 1.2 * np.sin(heading), y - 1.2 * np.cos(heading)])
    places = middle + 1.2 * np.stack([-np.sin(back), np.cos(back)], axis=1)
    return np.concatenate([ahead, np.column_stack([places, back])[1:]])


def unicycle(axis: Literal["x", "y"]) -> Problem:
    return dead_end(system=Unicycle(axis), input_lower=np.array([-0.4, -2.0]), input_upper=np.array([0.6, 2.0]))


@pytest.mark.parametrize("problem", [dead_end(), unicycle("x"), unicycle("y")], ids=["bicycle", "x", "y"])
def test_a_curve_with_a_cusp_is_driven(problem: Problem) -> None:
    poses = there_and_back()
    seconds = needed(problem, poses)
    assert seconds.min() > 0
    assert seconds.sum() == pytest.approx(1.2 / 0.6 + 0.8 * 1.2 / 0.4, rel=1e-3)
    times = np.concatenate([[0.0], np.cumsum(seconds)]) * problem.duration / seconds.sum()
    controls = driven(problem, poses, times, 400)
    path = positions(problem, controls, np.array([[1.0]]))[0]
    assert np.linalg.norm(path[-1] - poses[-1, :2]) < 0.02
    assert path[:, 0].max() == pytest.approx(poses[:, 0].max(), abs=0.02)
    assert (controls[:, 0] > 0).any()
    assert (controls[:, 0] < 0).any()


def test_a_curve_is_driven_by_few_commands() -> None:
    poses, problem = there_and_back(), unicycle("x")
    seconds = np.concatenate([[0.0], np.cumsum(needed(problem, poses))])
    times = seconds * problem.duration / seconds[-1]
    controls = driven(problem, poses, times, 13)  # the cusp is within a step
    path = positions(problem, controls, np.array([[1.0]]))[0]
    wanted = np.stack([np.interp(np.linspace(0, problem.duration, 14), times, poses[:, k]) for k in (0, 1)], axis=1)
    off = np.linalg.norm(path - wanted, axis=1)
    assert off.max() < 0.01
    assert off[-1] < 0.001


def test_a_trip_turns_on_the_spot_and_is_in_time() -> None:
    problem = unicycle("x").with_(duration=30.0)
    places = np.array([[0.0, 0.0], [-2.0, 0.5], [-2.0, 3.0], [1.0, 3.0]])
    region = ec.Polyhedron.box([[-1.0, 1.0], [-1.0, 1.0]])
    visits = [
        Visit(str(k), region, at, at, stay) for k, (at, stay) in enumerate([(11.0, 2.0), (21.0, 0.0), (29.0, 0.0)])
    ]
    legs = tuple(Route(np.stack(ends), float(np.linalg.norm(ends[1] - ends[0])), ()) for ends in pairwise(places))
    guess = pivoted_trip(problem, Trip(tuple(visits), legs), 30, "trip", "itinerary")
    path = positions(problem, guess.controls, np.array([[1.0]]))[0]
    for visit, place in zip(visits, places[1:], strict=True):
        for at in (visit.early, visit.early + visit.dwell):
            assert np.linalg.norm(path[round(at)] - place) < 0.2
    assert guess.controls[:, 0].min() < -0.1  # the first place is behind the robot, which may reverse
    assert np.linalg.norm(path[-1] - places[-1]) < 0.02
    line = shapely.LineString(places)
    assert shapely.distance(line, shapely.points(path)).max() < 0.2


def test_the_tightest_turn_and_whether_it_reverses() -> None:
    assert tightest(dead_end()) == pytest.approx(0.4 / np.tan(np.deg2rad(30)))
    one_sided = dead_end(input_lower=np.array([0.0, -0.1]), input_upper=np.array([1.0, 0.5]))
    assert tightest(one_sided) == pytest.approx(0.4 / np.tan(0.1))
    assert tightest(unicycle("y")) == pytest.approx(0.3 / 2.0)
    assert (reverses(dead_end()), reverses(one_sided)) == (True, False)


def test_perturbed_commands_differ_repeat_and_keep_the_bounds() -> None:
    problem, controls = dead_end(), np.zeros((40, 2))
    first, second = perturbed(problem, controls)
    again, _ = perturbed(problem, controls)
    np.testing.assert_array_equal(first.controls, again.controls)
    assert np.abs(first.controls - second.controls).max() > 0.01
    for seed in (first, second):
        assert np.abs(seed.controls).max() > 0.01
        assert (seed.controls >= problem.fleet.input_lower).all()
        assert (seed.controls <= problem.fleet.input_upper).all()


@pytest.mark.parametrize("reversing", [True, False])
def test_a_path_is_free_turns_no_tighter_and_repeats(reversing: bool) -> None:
    pytest.importorskip("ompl")
    blocked = shapely.box(1.0, -1.0, 1.5, 1.0)
    around = ompl_paths.Surroundings(blocked, np.array([-3.0, -4.0]), np.array([6.0, 4.0]))
    start, goals = np.array([0.0, 0.0, 0.0]), np.array([[3.0, 0.0, np.pi], [1.2, 0.0, 0.0]])
    paths = [ompl_paths.curve(around, 0.5, reversing, start, goals, 300, seed, lambda: False) for seed in (1, 1)]
    path, again = paths
    assert path is not None
    assert again is not None
    np.testing.assert_array_equal(path, again)
    assert not shapely.contains_xy(blocked, path[:, 0], path[:, 1]).any()
    np.testing.assert_allclose(path[[0, -1], :2], [[0.0, 0.0], [3.0, 0.0]], atol=0.03)
    step, turned = np.diff(path[:, :2], axis=0), (np.diff(path[:, 2]) + np.pi) % (2 * np.pi) - np.pi
    within = np.abs(turned) <= np.hypot(*step.T) / 0.5 * 1.01 + 1e-3
    assert (~within).sum() <= (10 if reversing else 0)  # a chord over a cusp is shorter than its arcs
    if not reversing:
        assert (step[:, 0] * np.cos(path[:-1, 2]) + step[:, 1] * np.sin(path[:-1, 2]) > -1e-9).all()


def test_there_is_no_path_from_inside_an_obstacle_nor_once_stopped() -> None:
    pytest.importorskip("ompl")
    around = ompl_paths.Surroundings(shapely.box(1.0, -1.0, 1.5, 1.0), np.full(2, -4.0), np.full(2, 4.0))
    out, inside = np.array([0.0, 0.0, 0.0]), np.array([1.2, 0.0, 0.0])
    assert ompl_paths.curve(around, 0.5, True, inside, out[None], 300, 1, lambda: False) is None
    assert ompl_paths.curve(around, 0.5, True, out, np.array([[3.0, 0.0, 0.0]]), 300, 1, lambda: True) is None
    narrow = replace(around, corridor=shapely.box(-1.0, -0.5, 4.0, 0.5))
    assert ompl_paths.curve(narrow, 0.5, True, out, np.array([[3.0, 0.0, 0.0]]), 300, 1, lambda: False) is None


def test_nothing_is_printed() -> None:
    pytest.importorskip("ompl")
    code = """
import numpy as np, shapely
from ensemble_ctrl.ocp.guesses.ompl_paths import Surroundings, curve
around = Surroundings(shapely.box(1, -1, 2, 1), np.full(2, -4.0), np.full(2, 4.0))
for goal in ([3.0, 0, 0], [3.9, 3.9, 0]):
    curve(around, 0.5, True, np.zeros(3), np.array([goal]), 300, 1, lambda: False)
from ensemble_ctrl.ocp.guesses.ompl_trees import Growth, tree
growth = Growth(lambda x, u, dt: [x[0] + u[0] * dt, x[1] + u[1] * dt, x[2] + dt], lambda x: x[2] < 2.0,
                around.low, around.high, np.array([[-1.0, 1.0], [-1.0, 1.0]]), 0.1)
assert tree(growth, [0.0, 0.0, 0.0], np.array([1.0, 0.0]), 0.1, 500, 1, lambda: False)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")


def test_ompl_is_not_loaded_where_a_route_is_enough() -> None:
    code = """
import sys, threading
import ensemble_ctrl as ec
problem = ec.load_text('''
fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
horizon: {duration: 4 s, steps: 10}
regions: {goal: {box: [[1, 2], [-0.5, 0.5]]}}
task: F[3, 4] in(goal)
''')
threading.active_count = lambda: 2  # no other processes
ec.plan(problem)
assert "ompl" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_car_in_a_dead_end_backs_out() -> None:
    pytest.importorskip("ompl")
    plan = ec.plan(dead_end())
    assert plan.verified
    assert plan.certificate is not None
    assert plan.certificate.proven == "yes"
    assert plan.controls[:10, 0].min() < -0.05
    kinds = [route["kind"] for route in plan.details["routes"]]
    assert kinds[:1] == ["route"]
    assert "curve" in kinds
    assert [route["kind"] for route in plan.details["routes"] if route["outcome"] == "kept"] == ["curve"]


GAP = """
name: gap
fleet:
  model: unicycle
  parameters: {traction: {range: [0.98, 1.02]}}
  start: {position: [0, 0], heading: 90 deg}
  input_bounds: {v: [0, 1], omega: [-1, 1]}
  radius: 0.1
horizon: {duration: 8 s, steps: 40}
regions: {goal: {box: [[3.5, 4.5], [-0.5, 0.5]]}}
obstacles:
  up: {box: [[1.9, 2.1], [0.22, 3.4]]}
  down: {box: [[1.9, 2.1], [-3.4, -0.22]]}
task: "F[7,8] in(goal) and G avoid(obstacles)"
"""
"""A wall with a gap, and a way around it that is too long."""


def test_narrow_trips_go_through_the_gap() -> None:
    problem = load_text(GAP)
    (wide, *_), (narrow, *_) = trips(problem, 2), trips(problem, 2, narrow=True)
    assert narrow.length < 4.2 < 7.5 < wide.length
    batch = (Curves(1.0, 0.05, corridor=True), Curves(0.5, 0.0, corridor=True))
    (pivots,) = PivotedGuesses().propose(Request(problem, 40))
    guesses = [*pivots, *(promising(Request(problem, 40), batch) if ompl_paths.available() else [])]
    walls = shapely.union_all([shapely.box(1.9, 0.22, 2.1, 3.4), shapely.box(1.9, -3.4, 2.1, -0.22)])
    through = [positions(problem, guess.controls, np.array([[1.0]]))[0] for guess in guesses]
    clear = [shapely.distance(walls, shapely.LineString(path)) > 0.1 for path in through if abs(path).max() < 4.5]
    assert sum(clear) >= (2 if ompl_paths.available() else 1)


def test_a_gap_is_passed_where_the_routes_with_room_are_too_long() -> None:
    found = solve(load_text(GAP))
    assert found.certificate is not None
    assert found.certificate.proven == "yes"
    (kept,) = (route.kind for route in found.routes if route.outcome == "kept")
    assert kept in ("middle", "pivot")


def test_other_ways_avoid_the_narrowest_place() -> None:
    pytest.importorskip("ompl")
    problem = load_text(GAP)
    (trip, *_) = trips(problem, 1, narrow=True)
    first, second = curved(problem, Curves(1.0, 0.05), trip, 40, lambda: False)
    assert abs(first.corners[:, 1]).max() < 2.0
    assert abs(second.corners[:, 1]).max() > 3.4


def test_a_car_in_a_dead_end_is_said_to_need_reversing() -> None:
    pytest.importorskip("ompl")
    stuck = load_text(DEAD_END, "dead_end", ["fleet.input_bounds.v=[0, 0.6]"])
    (way,) = (way for way in relaxations(stuck, [], False) if way.name == "reversing")
    found = _Search(time.perf_counter() + 60.0, 60.0, None).smallest(replace(way, strengths=(0.75,)))
    assert isinstance(found, Suggestion)
    assert found.change == "reversing at up to 0.45 m/s in place of none"
    assert found.certificate.proven == "yes"


def test_what_was_tried_and_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(ompl_paths, "available", lambda: False)
    short = dead_end().with_(solve=replace(dead_end().solve, max_iterations=5))
    tried = r"; tried: 2 routes, the nearest short by [\d.]+; 2 plans of the middle member, .*; 2 guesses with waves"
    with pytest.raises(ec.SolveError, match=tried) as raised:
        ec.plan(short)
    assert "OMPL is not installed" in str(raised.value)
    assert isinstance(raised.value.plan, ec.Plan)
    saved = ec.Plan.load(raised.value.plan.save(tmp_path / "plan"))
    assert "tried 2 routes" in " ".join(" ".join(summary_lines(saved)).split())
    assert solve(short, guess=np.zeros((40, 2))).missing == ()


def test_a_tree_leads_all_its_members_through_the_gap() -> None:
    pytest.importorskip("ompl")
    problem = load_text(GAP)
    (trip, *_) = trips(problem, 1, narrow=True)
    guess, again = (grown(problem, trip, 40, 3, 8000, 5, lambda: False) for _ in range(2))
    assert guess is not None
    assert again is not None
    np.testing.assert_array_equal(guess.controls, again.controls)
    assert (guess.controls >= problem.fleet.input_lower).all()
    assert (guess.controls <= problem.fleet.input_upper).all()
    walls = shapely.union_all([shapely.box(1.9, 0.22, 2.1, 3.4), shapely.box(1.9, -3.4, 2.1, -0.22)])
    assert shapely.distance(walls, shapely.LineString(guess.corners)) > 0.1
    assert np.linalg.norm(guess.corners[-1] - [4.0, 0.0]) < 0.5


@pytest.mark.parametrize("planner", ["RRT", "KPIECE1"])
def test_a_tree_checks_every_member_and_ends_in_time(planner: Planner) -> None:
    pytest.importorskip("ompl")

    def moved(state: State, command: State, seconds: float) -> list[float]:
        x, y, other, now = state
        return [x + command[0] * seconds, y + command[1] * seconds, other + 2 * command[1] * seconds, now + seconds]

    def free(state: State) -> bool:
        return state[3] <= 10.0 and abs(state[2]) < 1.0

    bounds = np.array([[-1.0, 1.0], [-1.0, 1.0]])
    growth = Growth(moved, free, np.full(2, -5.0), np.full(2, 5.0), bounds, 0.1)
    for goal, reached in (([3.0, 0.3], True), ([0.0, 3.0], False)):
        commands = tree(growth, [0.0, 0.0, 0.0, 0.0], np.array(goal), 0.3, 3000, 1, lambda: False, planner)
        assert commands is not None
        state: State = [0.0, 0.0, 0.0, 0.0]
        for command, steps in commands:
            for _ in range(steps):
                state = moved(state, command, 0.1)
                assert free(state)
        assert bool(np.hypot(state[0] - goal[0], state[1] - goal[1]) <= 0.3 + 1e-6) is reached
    assert tree(growth, [0.0, 0.0, 2.0, 0.0], np.array([3.0, 0.0]), 0.3, 10, 1, lambda: False) is None


def test_ranges_that_widen() -> None:
    fleet = dead_end().fleet
    half = narrowed(fleet, 0.5)
    np.testing.assert_allclose([half.lower, half.upper], [[0.99], [1.01]])
    np.testing.assert_allclose(half.center, fleet.center)


def test_tasks_without_a_place_to_go_have_no_curves_and_no_trees() -> None:
    nowhere = load_text(
        GAP, "nowhere", ["task=F[1,2] (x >= 50 and y >= 40) and G avoid(obstacles)", "horizon.steps=10"]
    )
    found = solve(nowhere)
    assert found.status == "infeasible"
    assert not {"curve", "tree"} & {route.kind for route in found.routes}
