"""Multiple shooting: planes, ways, and a program whose solutions are trajectories."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

from ensemble_ctrl import (
    DoubleIntegrator,
    Fleet,
    Interval,
    Objective,
    Obstacle,
    Polyhedron,
    Problem,
    ProblemError,
    Solid,
    SolveOptions,
)
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.ocp.evaluate_sampled import evaluate
from ensemble_ctrl.ocp.guesses.state_guesses import guesses
from ensemble_ctrl.ocp.guesses.ways import resampled, way, ways
from ensemble_ctrl.ocp.hyperplanes import separate
from ensemble_ctrl.ocp.state_rounds import Stage, whole
from ensemble_ctrl.ocp.transcription import Avoiding, transcribe
from ensemble_ctrl.ocp.truncation import nominal
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.problem.specification import AvoidConstraint

Floats = NDArray[np.float64]
BLOCK = Obstacle.box([[1.5, 2.5], [-1.0, 0.4]])


def problem(task: str = "G avoid(obstacles) and F[5, 6] in(goal)") -> Problem:
    """Point masses of 0.8 to 1.2 kg around a block."""
    fleet = Fleet(DoubleIntegrator(), {"mass": Interval(0.8, 1.2)}, radius=0.1)
    regions = {"goal": Polyhedron.box([[3.5, 5.5], [-0.8, 0.8]])}
    return Problem("masses", fleet, 6.0, 20, parse(task), regions, {"block": (BLOCK,)})


def separable(points: Floats, corners: Floats) -> bool:
    """Whether a plane separates two sets of points, by linear programming."""
    rows = np.vstack(
        [np.column_stack([-points, -np.ones(len(points))]), np.column_stack([corners, np.ones(len(corners))])]
    )
    found = linprog(np.zeros(rows.shape[1]), A_ub=rows, b_ub=-np.ones(len(rows)), bounds=[(None, None)] * rows.shape[1])
    return bool(found.status == 0)


@pytest.mark.parametrize("d", [2, 3])
def test_planes_separate_whatever_can_be_separated(d: int) -> None:
    generator = np.random.default_rng(d)
    piece = Obstacle.box([[-1, 1]] * 2) if d == 2 else Solid.hull(generator.standard_normal((10, 3)))
    middles = np.cumsum(0.5 * generator.standard_normal((60, 1, d)), axis=0)
    points = middles + 0.3 * generator.standard_normal((60, 5, d))
    planes = separate(points, [AvoidConstraint("o", (piece,), 0.1, 0.0, 4.0)], 4.0)
    both = np.concatenate([points[:-1], points[1:]], axis=1)
    seen = set()
    for k, group in enumerate(both):
        gap = planes.gap[0, k] + 0.1
        near = float((group @ planes.normal[0, k]).min()) - planes.support[0, k]
        assert gap == pytest.approx(near, abs=1e-9)
        assert gap <= float(piece.distance(group).min()) + 1e-9
        apart = separable(group, piece.vertices)
        seen.add(apart)
        assert (gap > 0) == apart or abs(gap) < 0.02
    assert seen == {True, False}


def test_the_plane_of_one_point_is_at_its_distance() -> None:
    solid = Solid.hull(np.random.default_rng(3).standard_normal((10, 3)))
    points = 4 * np.random.default_rng(4).standard_normal((30, 1, 3))
    planes = separate(np.repeat(points, 2, axis=0), [AvoidConstraint("o", (solid,), 0.0, 0.0, 1.0)], 1.0)
    np.testing.assert_allclose(planes.gap[0, ::2], solid.distance(points[:, 0]), atol=2e-2)


@pytest.mark.parametrize("d", [2, 3])
def test_a_way_keeps_clear(d: int) -> None:
    start, end = np.zeros(d), np.array([4.0, 0.0, 0.0][:d])
    bounds = [[1.5, 2.5], [-1.0, 1.2], [-1.0, 1.0]][:d]
    piece = BLOCK if d == 2 else Solid.box(bounds)
    corners = way(start, end, [piece], 0.1)
    points = resampled(corners, np.linspace(0, 1, 300))
    assert (piece.distance(points) > 0.05).all()
    np.testing.assert_allclose(corners[[0, -1]], [start, end])
    assert np.linalg.norm(np.diff(corners, axis=0), axis=1).sum() < 7.0


def test_a_way_without_obstacles_is_straight_and_one_that_is_walled_in_too() -> None:
    assert len(way(np.zeros(2), np.ones(2), [], 0.1)) == 2
    sides: list[list[list[float]]] = [[[-1, 1], [1, 1.2]], [[-1, 1], [-1.2, -1]]]
    sides += [[[1, 1.2], [-1.2, 1.2]], [[-1.2, -1], [-1.2, 1.2]]]
    walls = [Obstacle.box(side) for side in sides]
    assert len(way(np.zeros(2), np.array([3.0, 0.0]), walls, 0.1)) == 2


def test_other_ways_pass_the_obstacle_on_another_side() -> None:
    above, below = sorted(ways(np.zeros(2), np.array([4.0, 0.0]), [BLOCK], 0.1, 2), key=lambda c: -c[:, 1].max())
    middle = [float(np.interp(2.0, corners[:, 0], corners[:, 1])) for corners in (above, below)]
    assert middle[0] > 0.4
    assert middle[1] < -1.0
    assert len(ways(np.zeros(2), np.ones(2), [], 0.1, 3)) == 1
    names = [guess.name for guess in guesses(problem().with_(solve=SolveOptions(routes=2)), 20)]
    assert names == ["goal", "goal 2"]


def test_the_guess_goes_round_the_block_and_has_its_velocity() -> None:
    guess = guesses(problem(), 20)[0]
    states = guess.iterate.states[..., 0]
    assert (BLOCK.distance(states[:, :2]) > 0.1).all()
    np.testing.assert_allclose(np.gradient(states[:, 0], 0.3)[2:-2], states[2:-2, 2], atol=1e-9)
    assert guess.name == "goal"


@pytest.mark.parametrize("guarantee", ["nodes", "hull"])
def test_simulated_states_keep_the_programs_dynamics(guarantee: str) -> None:
    """The defects of a simulation vanish, and those of another state do not."""
    given = problem().with_(solve=SolveOptions(guarantee=guarantee))  # type: ignore[arg-type]
    controls = np.random.default_rng(0).uniform(-1, 1, (20, 2))
    stage = Stage(given, whole(given), 1)
    iterate = stage.simulated(controls)
    positions = iterate.states[:, :2].transpose(0, 2, 1)
    points = np.einsum("ij,tjd->tid", stage.truncation.to_points, positions)
    planes = separate(points, [AvoidConstraint("block", (BLOCK,), 0.1, 0.0, 6.0)], 6.0)
    shooting = transcribe(given, stage.truncation, iterate, Avoiding(planes, planes.active))
    g = np.array(shooting.program.functions["g"](shooting.guess, shooting.program.parameters)).ravel()
    rows = {name: slice(a, b) for name, a, b in shooting.program.rows}
    np.testing.assert_allclose(g[rows["moving"]], 0.0, atol=1e-12)
    again = shooting.iterate(shooting.guess)
    np.testing.assert_allclose(again.controls, controls, atol=1e-12)
    np.testing.assert_allclose(again.states, iterate.states, atol=1e-12)
    moved = shooting.guess.copy()
    moved[shooting.layout.points[3, 0]] += 0.1
    g = np.array(shooting.program.functions["g"](moved, shooting.program.parameters)).ravel()
    assert np.abs(g[rows["moving"]]).max() > 0.09


def test_what_controls_are_worth_is_what_a_replay_finds() -> None:
    given = problem("G avoid(obstacles) and F[5, 6] in(goal) and G vx <= 1.2")
    controls = np.random.default_rng(1).uniform(-0.5, 1, (20, 2))
    value = evaluate(given, controls)
    run = replay(given, controls, parameters=given.fleet.grid(101))
    assert value.gap == pytest.approx(min(c.distance for c in run.clearances), abs=0.02)
    assert min(value.gap, value.robustness) == pytest.approx(run.worst[0], abs=0.02)


def test_one_node_for_the_middle_and_four_for_the_fleet() -> None:
    assert nominal(problem()).to_points.tolist() == [[1.0]]
    assert whole(problem()).to_points.shape == (4, 4)
    assert whole(problem().with_(order=6)).to_points.shape == (7, 7)


def test_tasks_of_unknown_states_do_not_reach_the_program() -> None:
    with pytest.raises(ProblemError, match="the name of a state"):
        problem("F height >= 1")


@pytest.mark.parametrize("task", ["G avoid(obstacles)", "G avoid(obstacles) and G[2, 5] x + 2*y <= 100"])
def test_the_program_costs_what_the_plan_is_worth(task: str) -> None:
    """Effort, rates, terminal term and robustness at the same commands, without slack."""
    objective = Objective(0.7, np.array([4.0, 0.5]), 3.0, 0.2, smoothness=0.3)
    some = problem(task).with_(objective=objective, order=6)
    stage = Stage(some, whole(some), 1)
    controls = np.random.default_rng(0).uniform(-0.2, 0.2, (some.steps, 2))
    iterate = stage.simulated(controls)
    places = np.einsum("ij,tdj->tid", stage.truncation.to_points, iterate.states[:, some.fleet.place_columns])
    planes = separate(places, some.specification.avoid, some.duration)
    program = transcribe(some, stage.truncation, iterate, Avoiding(planes, planes.active))
    x = program.guess.copy()
    x[program.layout.slacks] = 0.0
    value, _ = program.program.functions["grad_f"](x, program.program.parameters)
    worth = evaluate(some, controls)
    assert min(worth.terminal, worth.effort) > 0.1
    assert float(value) == pytest.approx(worth.cost, rel=1e-6)
