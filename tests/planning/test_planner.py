"""From a problem file to controls that hold for every replayed member, and every other way a search can end."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import ensemble_ctrl as ec
import ensemble_ctrl.planning.planner as module
from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config import load, load_text
from ensemble_ctrl.ocp import parallel
from ensemble_ctrl.ocp.guesses.roadmap import roadmap_guesses
from ensemble_ctrl.ocp.rounds import Attempt, improve, start
from ensemble_ctrl.ocp.solvers import Iteration
from ensemble_ctrl.ocp.truncation import Truncation, coarse
from ensemble_ctrl.planning.planner import Solution, coarse_fine, coarse_steps, positions, search, solve
from ensemble_ctrl.planning.planner.coarse_fine import FINALISTS
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.conflicts import conflicts
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.systems import Unicycle
from tests.examples import quick
from tests.paths import CONFIGS
from tests.processes import children

Floats = NDArray[np.float64]
CONFIG = CONFIGS / "five_obstacles.yaml"
SMALL = """
name: small
fleet:
  model: unicycle
  parameters: {traction: {range: [0.9, 1.1]}}
  start: {position: [0, 0], heading: 0 deg}
horizon: {duration: 8 s, steps: 40}
moments: {order: auto}
regions:
  goal: {box: [[3, 4], [-0.5, 0.5]]}
  zone: {box: [[1.4, 2], [-1, 0.3]]}
obstacles:
  post: {box: [[1.4, 2], [-1, 0.3]]}
task: F[6, 8] in(goal) and G avoid(post)
objective: {terminal: {target: [3.5, 0]}}
"""


@cache
def five() -> Problem:
    return load(CONFIG)


@cache
def small() -> Problem:
    return load_text(SMALL)


@cache
def planned() -> Solution:
    """The plan of the example, made once."""
    return solve(five())


def options(problem: Problem, **changes: Any) -> Problem:
    """The problem with other solve options."""
    return problem.with_(solve=replace(problem.solve, **changes))


def check_good(solution: Solution, members: int = 1000) -> None:
    """Planned, within the input bounds, and no replayed member violates, also between the grid times."""
    problem = solution.problem
    assert solution.status == "planned"
    assert solution.controls.shape == (problem.steps, 2)
    assert (solution.controls >= problem.fleet.input_lower).all()
    assert (solution.controls <= problem.fleet.input_upper).all()
    run = replay(problem, solution.controls, members=members, substeps=10)
    assert not run.violating.any(), run
    assert min((c.distance for c in run.clearances), default=np.inf) >= 0
    assert run.worst[0] >= 0


def test_five_obstacles() -> None:
    """The acceptance test: 20,000 members, ten times in each step."""
    solution = planned()
    check_good(solution, members=20_000)
    value = solution.attempt.value
    assert value.cost <= 0.75
    assert value.gap >= 0
    assert value.robustness >= 0.3
    assert value.cost == pytest.approx(cost_by_hand(solution), abs=1e-3)
    assert len(solution.routes) == 2
    assert all(route.feasible for route in solution.routes)
    assert solution.routes[0].length < solution.routes[1].length
    assert [route.outcome for route in solution.routes] == ["kept", "coarse"]
    assert solution.routes[0].fine_cost == value.cost
    assert (solution.attempt.truncation.orders, solution.attempt.truncation.hull) == ((8,), True)
    assert solution.iterations > 0
    assert solution.solve_seconds > 0


def cost_by_hand(solution: Solution) -> float:
    """``-robustness of the visit + 10 |m(T) - m_F|^2 + 0.1 integral v^2 + omega^2``, members spread evenly."""
    problem, controls = solution.problem, solution.controls
    coefficients = np.array([[p, p, np.pi / 4, 1.0, 1.0] for p in np.linspace(0.9, 1.1, 401)])
    paths = problem.fleet.arcs.paths(controls, coefficients, 0.1)
    margin = problem.regions["goal"].margin(paths[:, 140:]).max(axis=1).min()
    off = ((paths[:, -1] - [6.5, 5.5]) ** 2).sum(axis=1)
    return float(-margin + 10 * 2 * off.mean() + 0.1 * 0.1 * (controls**2).sum())


@pytest.mark.parametrize(
    ("order", "guarantee"), [(None, "hull"), (8, "nodes"), pytest.param(None, "nodes", marks=pytest.mark.slow)]
)
def test_five_obstacles_with_other_orders_and_guarantees(order: int | None, guarantee: str) -> None:
    solution = solve(options(five(), guarantee=guarantee).with_(order=order))
    truncation = solution.attempt.truncation
    assert solution.status == "planned"
    assert solution.attempt.value.cost <= 0.75
    assert truncation.hull is (guarantee == "hull")
    assert truncation.orders == (truncation.degrees if order is None else (order,))
    if guarantee == "hull":
        check_good(solution)
        assert 2 <= truncation.orders[0] <= 5
    else:
        at_nodes = five().fleet.dynamic_members(truncation.nodes)
        run = replay(five(), solution.controls, parameters=at_nodes)
        assert not run.violating.any(), run


def test_the_other_heading_convention_is_as_good() -> None:
    fleet = replace(five().fleet, system=Unicycle("y" if five().fleet.arcs.heading_from == "x" else "x"))
    mirrored = solve(five().with_(fleet=fleet))
    check_good(mirrored)
    assert mirrored.attempt.value.cost == pytest.approx(planned().attempt.value.cost, abs=0.01)
    np.testing.assert_allclose(mirrored.controls, planned().controls * [1, -1], atol=0.02)


def test_a_robot_with_a_radius_keeps_its_edge_clear() -> None:
    solution = solve(small().with_(fleet=replace(small().fleet, radius=0.5)))
    check_good(solution)
    run, without = (
        replay(problem, solution.controls, members=500, substeps=10) for problem in (solution.problem, small())
    )
    assert without.clearances[0].distance == pytest.approx(run.clearances[0].distance + 0.5, abs=1e-9)


@pytest.mark.parametrize("task", ["G avoid(zone)", "G not in(zone)", "G[0,8] (avoid(zone) and avoid(post))"])
def test_a_region_can_be_kept_out_of(task: str) -> None:
    way_through = solve(small().with_(task=parse("F[6,8] in(goal)"), obstacles={}))
    check_good(way_through, members=101)
    zone = Obstacle.polygon(small().regions["zone"].vertices)
    assert path_distance(way_through, zone) < -0.1
    around = solve(small().with_(task=parse(f"F[6,8] in(goal) and {task}")))
    check_good(around, members=101)
    assert path_distance(around, zone) >= 0


def path_distance(solution: Solution, piece: Obstacle) -> float:
    """Smallest distance of some members from a piece."""
    fleet, problem = solution.problem.fleet, solution.problem
    paths = fleet.arcs.paths(solution.controls, fleet.coefficients(fleet.grid(21)), problem.step)
    return float(piece.distance(paths).min())


def test_a_task_without_a_robustness_only_keeps_clear() -> None:
    check_good(solve(small().with_(task=parse("G avoid(post)"))), members=101)


def walled() -> Problem:
    # walls that only touch, which is no proof that there is no plan
    ring = np.array([[[2.6, 4.4], [-2, -1]], [[2.6, 4.4], [1, 2]], [[2, 2.6], [-2, 2]], [[4.4, 5], [-2, 2]]])
    return small().with_(
        obstacles={"wall": tuple(Obstacle.box(box) for box in ring)},
        task=parse("F[6,8] in(goal) and G avoid(wall)"),
    )


@pytest.mark.slow
def test_without_a_plan_the_limit_of_iterations_is_named_as_a_limit() -> None:
    assert solve(options(walled(), max_iterations=1)).status == "limit"
    assert solve(options(small(), max_iterations=1)).status in ("planned", "limit")


def test_a_walled_in_goal_is_infeasible_and_the_wall_is_named() -> None:
    solution = solve(walled())
    assert solution.status == "infeasible"
    found = conflicts(walled(), solution.controls)
    assert "wall" in {c.what.removeprefix("avoid(").removesuffix(")") for c in found}
    for conflict in found:
        assert 0.05 < conflict.amount < 5
        assert 0.9 <= conflict.parameters["traction"] <= 1.1
        assert 0 <= conflict.time <= 8


def test_the_time_limit_returns_the_best_so_far() -> None:
    solution = solve(options(five(), time_limit=0.05))
    assert solution.status == "limit"
    assert solution.controls.shape == (160, 2)
    assert np.isfinite(solution.controls).all()
    assert (np.abs(solution.controls) <= 2).all()


@pytest.mark.parametrize("stop_at", [("guess", None), ("coarse solve 1/2", 2), ("solve", 1)])
def test_progress_can_interrupt(stop_at: tuple[str, int | None]) -> None:
    seen: list[tuple[str, int | None]] = []

    def progress(phase: str, iteration: Iteration | None) -> bool:
        seen.append((phase, None if iteration is None else iteration.count))
        return seen[-1] == stop_at

    solution = solve(small(), progress=progress)
    assert solution.status == "interrupted"
    assert np.isfinite(solution.controls).all()
    assert solution.controls.shape == (40, 2)
    first = seen.index(stop_at)
    assert all(count is None for _, count in seen[first + 1 :]), "no iterations after the stop"


def test_progress_sees_the_phases_in_order() -> None:
    phases: dict[str, None] = {}

    def progress(phase: str, _: Iteration | None) -> bool:
        phases.setdefault(phase)
        return False

    assert solve(small(), progress=progress).status == "planned"
    assert list(phases)[:2] == ["guess", "solve"]
    assert {"coarse solve 1/2", "coarse solve 2/2"} < set(phases)


def test_a_guess_is_used_instead_of_routes(monkeypatch: pytest.MonkeyPatch) -> None:
    cold = solve(small())

    def no_guesses(*_: object) -> list[object]:
        raise AssertionError("looked for routes although a guess was given")

    monkeypatch.setattr(positions, "first_guesses", no_guesses)
    for guess in (cold.controls, cold.controls[::5]):
        warm = solve(small(), guess=guess)
        check_good(warm, members=101)
        assert warm.attempt.value.cost <= cold.attempt.value.cost + 0.02
        assert len(warm.routes) == 1


def test_a_guess_is_checked_clipped_and_refined() -> None:
    wild = solve(small(), guess=np.full((3, 2), 50.0), progress=lambda *_: True)
    assert wild.status == "interrupted"
    np.testing.assert_array_equal(wild.controls, np.tile(small().fleet.input_upper, (40, 1)))
    narrow = small().with_(task=parse("F[6.4, 6.8] in(goal) and G avoid(post)"))
    assert np.isfinite(solve(narrow, guess=np.zeros((2, 2)), progress=lambda *_: True).controls).all()
    for guess in (np.zeros(40), np.zeros((0, 2)), np.zeros((40, 3)), np.full((40, 2), np.nan)):
        with pytest.raises(ProblemError, match=r"^guess: expected finite controls of shape \(steps, 2\)"):
            solve(small(), guess=guess)


@pytest.mark.parametrize(("rates", "status"), [(None, "planned"), ([0.01, 0.01], "infeasible")])
def test_a_proven_guess_is_the_plan_where_nothing_better_is_found(
    monkeypatch: pytest.MonkeyPatch, rates: list[float] | None, status: str
) -> None:
    proven = solve(small()).controls

    def astray(problem: Problem, controls: Floats, truncation: Truncation, *_: object, **__: object) -> Attempt:
        return start(problem, 0 * controls, truncation)

    monkeypatch.setattr(coarse_fine, "improve", astray)
    fleet = replace(small().fleet, rate_bounds=None if rates is None else np.array(rates))
    kept = solve(small().with_(fleet=fleet), guess=proven)
    assert kept.certificate is not None
    assert (kept.status, kept.certificate.proven == "yes") == (status, status == "planned")
    np.testing.assert_array_equal(kept.controls, proven if status == "planned" else 0 * proven)


@pytest.mark.parametrize(
    ("task", "steps", "wanted"),
    [
        ("F[14,16] in(goal)", 160, 32),
        ("F[7,7.5] in(goal)", 160, 80),
        ("F[7,7.1] in(goal)", 160, 160),
        ("F[7,7] in(goal)", 160, 160),
        ("F in(goal)", 160, 32),
        ("F[2,T] in(goal)", 160, 32),
        ("F[0,9] G[0,0.5] in(goal)", 160, 80),
        ("F[14,16] in(goal)", 161, 161),
        ("F[14,16] in(goal)", 7, 7),
        ("F[14,16] in(goal)", 96, 32),
    ],
)
def test_the_coarse_grid_divides_the_fine_one_and_resolves_every_window(task: str, steps: int, wanted: int) -> None:
    problem = five().with_(task=parse(task), steps=steps)
    assert coarse_steps(problem) == wanted
    assert steps % wanted == 0


def test_a_narrow_window_is_met() -> None:
    check_good(solve(small().with_(task=parse("F[6.4, 6.8] in(goal) and G avoid(post)"))), members=101)


def test_bounds_without_standing_still_are_kept() -> None:
    """A forward-only robot that can't stop; guesses have to be inside the bounds too."""
    fleet = replace(small().fleet, input_lower=np.array([0.3, -1.0]), input_upper=np.array([1.0, 1.0]))
    solution = solve(small().with_(fleet=fleet))
    check_good(solution, members=101)
    assert solution.controls[:, 0].min() >= 0.3


def with_workers(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    """Solve candidates in so many processes, whatever the machine has."""
    monkeypatch.setattr(parallel, "workers", lambda count: min(number, count))


def facts(solution: Solution) -> list[tuple[str, float, float, str]]:
    """What was found of each route, without times."""
    return [(route.name, route.length, route.cost, route.outcome) for route in solution.routes]


@pytest.mark.parametrize("routes", quick([2, "all"], 2))
def test_the_plan_does_not_depend_on_the_number_of_processes(
    monkeypatch: pytest.MonkeyPatch, routes: int | str
) -> None:
    found = []
    for number in (0, 1, 2, 3):
        with_workers(monkeypatch, number)
        found.append(solve(options(small(), routes=routes)))
    for other in found[1:]:
        np.testing.assert_array_equal(other.controls, found[0].controls)
        assert facts(other) == facts(found[0])
        assert other.iterations == found[0].iterations
    assert [route.outcome for route in found[0].routes].count("kept") == 1


@pytest.mark.parametrize("problem", [small, pytest.param(five, marks=pytest.mark.slow)])
def test_all_routes_are_never_worse_than_one(problem: Callable[[], Problem]) -> None:
    every, one = (solve(options(problem(), routes=routes)) for routes in ("all", 1))
    assert min(r.cost for r in every.routes if r.feasible) <= one.routes[0].cost
    check_good(every)
    assert every.certificate is not None
    assert every.certificate.proven == "yes"
    assert every.attempt.value.cost <= solve(problem()).attempt.value.cost
    outcomes = [route.outcome for route in every.routes]
    assert (outcomes.count("kept"), outcomes.count("refined")) == (1, min(FINALISTS, len(every.routes)) - 1)
    kept = every.routes[outcomes.index("kept")]
    assert kept.fine_cost == every.attempt.value.cost == min(r.fine_cost for r in every.routes if r.fine_cost)
    refined = sorted(r.cost for r in every.routes if r.fine_cost)
    assert refined == sorted(r.cost for r in every.routes if r.feasible)[:FINALISTS]


def test_only_the_best_route_goes_through_all_coarse_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    with_workers(monkeypatch, 0)
    solved: list[tuple[int, int, bool]] = []

    def counting(
        problem: Problem, controls: Floats, truncation: Truncation, rounds: int, *rest: Any, **more: Any
    ) -> Any:
        found = improve(problem, controls, truncation, rounds, *rest, **more)
        solved.append((len(controls), rounds, found.pending))
        return found

    monkeypatch.setattr(coarse_fine, "improve", counting)
    alike = solve(small())
    check_good(alike, members=101)
    assert [rounds for _, rounds, _ in solved] == [2, 2, 1, 1, 1]  # both routes all three, and the fine solve
    solved.clear()
    solution = solve(load(CONFIG))
    assert [rounds for _, rounds, _ in solved] == [2, 2, 1, 1]  # both routes, the rest of the best, and the fine solve
    assert [pending for _, _, pending in solved] == [True, True, False, False]
    assert not solution.attempt.pending


def test_a_process_that_dies_is_a_route_that_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    with_workers(monkeypatch, 2)
    whole = solve(small())
    best = [route.outcome for route in whole.routes].index("kept")
    parent, begun = os.getpid(), [seed.controls for seed in roadmap_guesses(small(), coarse_steps(small()), 2)]

    def dying(problem: Problem, controls: Floats, *rest: Any, **more: Any) -> Any:
        if os.getpid() != parent and np.array_equal(controls, begun[best]):
            os.kill(os.getpid(), signal.SIGKILL)
        return improve(problem, controls, *rest, **more)

    monkeypatch.setattr(coarse_fine, "improve", dying)
    solution = solve(small())
    check_good(solution, members=101)
    assert solution.routes[best].outcome == "failed"
    assert solution.routes[1 - best].outcome == "kept"
    assert solution.routes[1 - best].cost >= whole.routes[1 - best].cost  # alone, it is refined before its third round


def test_a_stop_leaves_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    before = children()
    with_workers(monkeypatch, 2)
    solution = solve(options(five(), routes=6), progress=lambda _, iteration: iteration is not None)
    assert solution.status == "interrupted"
    assert [route.outcome for route in solution.routes].count("failed") >= 4
    assert children() <= before


def test_the_logs_of_all_candidates_are_in_one_file_in_order(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    logs = []
    for number in (0, 2):
        with_workers(monkeypatch, number)
        log = tmp_path / f"{number}.log"
        log.write_text("before\n")
        solution = solve(small(), log=log)
        text = log.read_text()
        assert text.startswith("before\n")
        assert text.count("EXIT: Optimal Solution Found") >= len(solution.routes) + 1
        logs.append([line for line in text.splitlines() if line.startswith("Number of Iterations")])
    assert logs[0] == logs[1]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.log", "2.log"]


def test_a_program_that_nothing_could_end_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a notebook, where other threads run: nothing interrupts CasADi while it builds a program."""
    monkeypatch.setattr(parallel, "endable", lambda: False)
    with pytest.raises(ProblemError, match=r"expected fewer beside other threads.* about 50 min to build"):
        solve(small().with_(steps=100_000))


def test_a_program_that_takes_too_long_to_build_is_left_at_the_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    before = children()
    with_workers(monkeypatch, 2)
    monkeypatch.setattr(parallel, "GRACE", 0.2)
    monkeypatch.setattr(coarse_fine, "choose", lambda *_: time.sleep(600))
    solution = solve(options(small(), time_limit=4.0))
    assert solution.attempt.truncation.orders == coarse(small()).orders
    assert sum(solution.seconds.values()) < 60
    assert children() <= before


def test_a_proof_and_a_replay_end_with_the_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each gets what is left, and a little more; a proof that is ended claims nothing, a replay is of fewer members."""

    def endless(*_: object) -> None:
        time.sleep(60)

    monkeypatch.setattr(search, "certify", endless)
    for part in (module, search):
        monkeypatch.setattr(part, "AFTERWARDS", 0.2)
    monkeypatch.setattr(parallel, "GRACE", 0.1)
    monkeypatch.setattr(parallel, "endable", lambda: True)
    monkeypatch.setattr("ensemble_ctrl.problem.evaluation.sampled.BLOCK", 1)
    problem = load_text(SMALL)
    late = problem.with_(
        solve=replace(problem.solve, time_limit=3.0, routes=1), verify=replace(problem.verify, members=40_000)
    )
    found = ec.plan(late, check=False)
    assert found.certificate is not None
    assert (found.certificate.proven, found.certificate.reason) == ("undecided", "the time limit ended the proof")
    assert found.certificate.parts == ()
    assert found.replayed is not None
    assert 0 < found.replayed.members < 40_000
    assert found.status == "limit"
    assert not found.verified


def test_an_interruption_ends_a_proof(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "certify", lambda *_: time.sleep(60))
    monkeypatch.setattr(parallel, "GRACE", 0.1)
    monkeypatch.setattr(parallel, "SILENCE", 0.1)
    monkeypatch.setattr(parallel, "endable", lambda: True)
    problem = load_text(SMALL)
    found = solve(
        problem.with_(solve=replace(problem.solve, routes=1)),
        progress=lambda phase, it: phase == "certify" and it is not None,
    )
    assert found.status == "interrupted"
    assert found.certificate is not None
    assert found.certificate.reason == "an interruption ended the proof"
