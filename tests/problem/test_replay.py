"""Replay against an integrator and against brute force on all members and times."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from functools import cache
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import ensemble_ctrl.problem.evaluation.judge as judging
import ensemble_ctrl.problem.evaluation.sampled as module
from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config import load, load_text
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.judge import Judge
from ensemble_ctrl.problem.evaluation.sampled import replay, trajectories
from ensemble_ctrl.systems import Unicycle
from tests.paths import CONFIGS

Floats = NDArray[np.float64]
CONFIG = CONFIGS / "five_obstacles.yaml"


@cache
def five() -> Problem:
    return load(CONFIG)


def random_controls(seed: int = 0, steps: int = 160) -> Floats:
    """Commands that drift about the map: a random walk with pauses and straight parts."""
    rng = np.random.default_rng(seed)
    controls = np.column_stack([rng.uniform(-0.3, 1.5, steps), rng.uniform(-1.5, 1.5, steps)])
    controls[::7, 1] = 0.0
    controls[3::11, 0] = 0.0
    return controls


@pytest.mark.parametrize("heading_from", ["x", "y"])
def test_trajectories_are_the_integral_of_the_dynamics(heading_from: Literal["x", "y"]) -> None:
    problem = five().with_(fleet=replace(five().fleet, system=Unicycle(heading_from)))
    controls, traction = random_controls()[:20], np.array([0.9, 1.0, 1.1])
    short = problem.with_(duration=2.0, steps=20, task=parse("F[1,2] x >= 0"))
    paths = trajectories(short, controls, traction, substeps=3)
    assert paths.shape == (3, 61, 2)
    for psi, path in zip(traction, paths, strict=True):
        turn = 1.0 if heading_from == "x" else -1.0  # counted from +y, a positive omega turns clockwise
        pose = np.array([1.0, 1.0, np.pi / 4])
        for n, (v, omega) in enumerate(controls):

            def rate(_: float, z: Floats, v: float = v, w: float = turn * omega, psi: float = psi) -> list[float]:
                return [psi * v * np.cos(z[2]), psi * v * np.sin(z[2]), psi * w]

            thirds = np.array([0.1 / 3, 0.2 / 3, 0.1])
            run = solve_ivp(rate, (0, 0.1), pose, "DOP853", thirds, rtol=1e-12, atol=1e-13)
            np.testing.assert_allclose(path[3 * n + 1 : 3 * n + 4], run.y[:2].T, atol=1e-10)
            pose = run.y[:, -1]


def brute_force(
    problem: Problem, controls: Floats, parameters: Floats, substeps: int
) -> dict[str, tuple[float, NDArray[np.bool_]]]:
    """Smallest distance and who is inside, looking at every member at every time."""
    paths = trajectories(problem, controls, parameters, substeps)
    found = {}
    for name, pieces in problem.obstacles.items():
        distance = np.min([piece.distance(paths) for piece in pieces], axis=0) - problem.fleet.radius
        found[name] = (float(distance.min()), (distance < 0).any(axis=1))
    return found


@pytest.mark.parametrize("radius", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(6))
def test_pruning_changes_nothing(seed: int, radius: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """In several blocks, with an obstacle of two pieces, inside and outside."""
    monkeypatch.setattr(module, "BLOCK", 40)
    pieces = (Obstacle.box([[2.0, 3.0], [1.5, 3.0]]), Obstacle.polygon([[2.5, 2.5], [4.0, 2.5], [3.0, 4.0]]))
    problem = five().with_(obstacles={**five().obstacles, "o1": pieces}, fleet=replace(five().fleet, radius=radius))
    controls, parameters = random_controls(seed), np.linspace(0.9, 1.1, 101)
    run = replay(problem, controls, parameters=parameters, substeps=2)
    wanted = brute_force(problem, controls, parameters, 2)
    assert [c.obstacle for c in run.clearances] == list(wanted)
    for c in run.clearances:
        distance, inside = wanted[c.obstacle]
        assert c.distance == pytest.approx(distance, abs=1e-12)
        assert c.inside == inside.sum()
    entered = np.any([inside for _, inside in wanted.values()], axis=0)
    np.testing.assert_array_equal(run.violating, entered | (run.robustness < 0))


@pytest.mark.parametrize("group", [3_000, 200_000])
@pytest.mark.parametrize("seed", range(6))
def test_each_member_has_its_own_smallest_distance(seed: int, group: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a wide fleet that only avoids, so that every distance may be the one that counts, in groups of any width."""
    monkeypatch.setattr(judging, "GROUP", group)
    fleet = five().fleet.with_(
        parameters={"traction": Interval(0.6, 1.4), "start_heading": Interval(-0.3, 0.3)}, radius=0.02
    )
    problem = five().with_(fleet=fleet, task=parse("G[0.5, 15] avoid(obstacles)"))
    controls, members = np.clip(random_controls(seed), -0.2, 0.8), fleet.sample(400, seed)
    run = replay(problem, controls, parameters=members, substeps=2)
    paths = trajectories(problem, controls, members, 2)[:, 10:301]
    each = np.stack([piece.distance(paths).min(axis=1) for _, piece in problem.pieces]) - 0.02
    np.testing.assert_allclose(run.robustness, each.min(axis=0), atol=1e-11)
    np.testing.assert_allclose([c.distance for c in run.clearances], each.min(axis=1), atol=1e-11)
    assert [c.inside for c in run.clearances] == (each < 0).sum(axis=1).tolist()


def test_brute_force_meets_members_inside_and_outside() -> None:
    """The cases above hold both kinds of clearances, or they would show little."""
    distances = [replay(five(), random_controls(seed), parameters=np.array([0.9, 1.1])).clearances for seed in range(6)]
    signs = {c.distance < 0 for clearances in distances for c in clearances}
    assert signs == {True, False}


def test_a_clearance_says_when_and_for_whom() -> None:
    problem, controls, parameters = five(), random_controls(4), np.linspace(0.9, 1.1, 21)
    run = replay(problem, controls, parameters=parameters, substeps=5)
    paths = trajectories(problem, controls, parameters, 5)
    for c in run.clearances:
        member = int(np.flatnonzero(parameters == c.parameters["traction"])[0])
        at = round(c.time / (problem.step / 5))
        assert at * problem.step / 5 == pytest.approx(c.time)
        (piece,) = problem.obstacles[c.obstacle]
        assert float(piece.distance(paths[member, at])) == pytest.approx(c.distance, abs=1e-12)


def test_substeps_see_what_happens_between_the_grid_times() -> None:
    problem = five().with_(obstacles={"post": (Obstacle.box([[1.05, 1.08], [0.0, 3.0]]),)})
    dash = np.zeros((160, 2))
    dash[0] = 2.0, 0.0
    coarse, fine = (replay(problem, dash, members=5, substeps=n) for n in (1, 10))
    assert coarse.clearances[0].inside == 0
    assert fine.clearances[0].inside == 5
    assert fine.violating.all()


@pytest.mark.parametrize(
    "task",
    ["F[14, 16] in(goal) and G[0, 16] avoid(obstacles)", "G[3,9] x >= 1 or F[2,5] (y <= 3 and x <= 2)"],
)
def test_robustness_equals_a_direct_computation(task: str) -> None:
    problem, controls = five().with_(task=parse(task)), random_controls(2)
    run = replay(problem, controls, members=300)
    np.testing.assert_allclose(run.robustness, direct(problem, controls, run.parameters, task), atol=1e-12)
    worst, parameter = run.worst
    assert worst == run.robustness.min()
    assert list(parameter.values()) == run.parameters[run.robustness.argmin()].tolist()


def test_a_robot_with_a_radius_may_cut_a_corner_as_close_as_its_radius() -> None:
    """A corner's facets grown by the radius meet further out than the radius itself reaches."""
    corner = {"corner": (Obstacle.box([[0.0, 1.9], [2.1, 4.0]]),)}
    problem = five().with_(
        obstacles=corner,
        task=parse("G avoid(corner)"),
        fleet=five().fleet.with_(radius=0.13, heading=np.pi / 4),
    )
    forward = np.zeros((160, 2))
    forward[:, 0] = 0.2  # passes the corner (1.9, 2.1) at a distance of 0.2 / sqrt(2) = 0.1414
    run = replay(problem, forward, members=50, substeps=4)
    assert run.clearances[0].distance == pytest.approx(0.2 / np.sqrt(2) - 0.13, abs=1e-4)
    assert not run.violating.any()
    assert run.robustness.min() == run.clearances[0].distance


def direct(problem: Problem, controls: Floats, parameters: Floats, task: str) -> Floats:
    """The two tasks' robustness, written out on the trajectories."""
    paths = trajectories(problem, controls, parameters)
    x, y = paths[..., 0], paths[..., 1]
    if "goal" in task:
        margin = np.minimum.reduce([x - 6, 7 - x, y - 5, 6 - y])
        clear = [piece.distance(paths).min(axis=1) for _, piece in problem.pieces]
        return np.asarray(np.minimum(margin[:, 140:161].max(axis=1), np.min(clear, axis=0)))
    stay, visit = x[:, 30:91].min(axis=1) - 1, np.minimum(3 - y, 2 - x)[:, 20:51].max(axis=1)
    return np.asarray(np.maximum(stay, visit))


def test_satisfied_is_the_share_of_members_that_do_not_violate() -> None:
    problem = five().with_(task=parse("F[14,16] x >= 3"), obstacles={})
    forward = np.zeros((160, 2))
    forward[:30, 0] = np.sqrt(2) * 2 / 3  # the nominal robot ends at x = 3
    run = replay(problem, forward, parameters=np.linspace(0.9, 1.1, 200))
    assert run.violating.sum() == 100
    assert run.satisfied == 0.5
    assert "50 % satisfy" in repr(run)


def test_the_draw_is_reproducible_and_has_the_ends_first() -> None:
    problem, controls = five(), random_controls()
    first, again, other = (replay(problem, controls, members=50, seed=s).parameters for s in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert (first[2:] != other[2:]).all()
    np.testing.assert_array_equal(first[:2, 0], [0.9, 1.1])
    assert ((first >= 0.9) & (first <= 1.1)).all()
    by_default = replay(problem, controls, members=50)
    np.testing.assert_array_equal(by_default.parameters, replay(problem, controls, members=50, seed=0).parameters)
    assert replay(problem, controls).members == problem.verify.members == 10_000
    assert replay(problem, controls, members=1).parameters.tolist() == [[0.9]]


def test_any_number_of_blocks_gives_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    controls = random_controls(5)
    whole = replay(five(), controls, members=100)
    monkeypatch.setattr(module, "BLOCK", 7)
    parts = replay(five(), controls, members=100)
    np.testing.assert_allclose(whole.robustness, parts.robustness, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(whole.violating, parts.violating)
    np.testing.assert_allclose(
        [c.distance for c in whole.clearances], [c.distance for c in parts.clearances], rtol=0, atol=1e-12
    )


def test_memory_is_bounded() -> None:
    tracemalloc.start()
    try:
        run = replay(five(), random_controls(), members=50_000)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert run.members == 50_000
    assert peak < 200e6, f"{peak / 1e6:.0f} MB; all trajectories together are {50_000 * 161 * 16 / 1e6:.0f} MB"


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"members": 0}, "members"),
        ({"substeps": 0}, "substeps"),
        ({"parameters": np.array([])}, "parameters"),
        ({"parameters": np.array([1.0, np.nan])}, "parameters"),
        ({"parameters": np.ones((2, 2))}, "parameters"),
        ({"controls": np.full((160, 2), np.nan)}, "controls"),
        ({"controls": np.zeros((160, 3))}, "controls"),
        ({"controls": np.zeros((0, 2))}, "controls"),
        ({"seed": -1}, "seed"),
    ],
)
def test_bad_arguments_are_named(change: dict[str, Any], name: str) -> None:
    """Also: no NaN may pass for a member that satisfies, because no comparison fails on it."""
    arguments = {"controls": np.zeros((160, 2)), **change}
    with pytest.raises(ProblemError, match=rf"^{name}: expected"):
        replay(five(), **arguments)


def test_an_open_map_has_no_clearances() -> None:
    problem = five().with_(obstacles={}, task=parse("F x >= 0"))
    run = replay(problem, random_controls(), members=5)
    assert run.clearances == ()
    assert "no obstacle is to be avoided" in repr(run)


def test_a_share_is_of_the_whole_fleet_and_not_of_a_block() -> None:
    problem = load_text(
        """
        fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
        horizon: {duration: 4 s, steps: 20}
        regions: {goal: {box: [[1.95, 9], [-1, 1]]}}
        task: share(0.5, F[3, 4] in(goal))
        """
    )
    straight = np.tile([[0.5, 0.0]], (20, 1))
    slow_first = np.linspace(0.9, 1.1, 40_000)
    run = replay(problem, straight, parameters=slow_first)
    assert run.satisfied == 1.0
    assert np.ptp(run.robustness) == 0.0


def test_a_replay_that_is_ended_is_of_the_members_that_were_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "BLOCK", 10)
    problem, controls, seen = five(), random_controls(), []

    def watch(members: int) -> bool:
        seen.append(members)
        return len(seen) == 3

    cut, whole = replay(problem, controls, members=1000, watch=watch), replay(problem, controls, members=1000)
    assert seen[:3] == sorted(seen[:3])
    assert seen[2] <= cut.members < whole.members == 1000
    np.testing.assert_array_equal(cut.parameters, whole.parameters[: cut.members])
    np.testing.assert_array_equal(cut.robustness, whole.robustness[: cut.members])


def test_what_a_watcher_raises_ends_a_replay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "BLOCK", 1)
    ran = []

    def run(*given: Any) -> Any:
        ran.append(1)
        return before(*given)

    before = Judge.judge
    monkeypatch.setattr(Judge, "judge", run)

    def interrupted(_: int) -> bool:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        replay(five(), random_controls(), members=2000, watch=interrupted)
    assert len(ran) < 2000
