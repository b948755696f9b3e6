"""Obstacles that move: against brute force, in the program, and in problem files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ConfigError, ProblemError
from ensemble_ctrl.files.config import dump, load, load_text, read
from ensemble_ctrl.files.config.dump import to_data
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.ocp.hyperplanes import separate
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import replay, trajectories
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.plain import problem_of, proven_part
from ensemble_ctrl.systems import Unicycle
from tests.examples import examples
from tests.paths import CONFIGS

Floats = NDArray[np.float64]
CONFIG = CONFIGS / "moving" / "crossing.yaml"
seeds = st.integers(0, 2**31)
MANY = examples(300, suppress_health_check=[HealthCheck.too_slow])


def random_motion(rng: np.random.Generator, duration: float) -> Motion:
    """A path with times off the grid."""
    inner = np.sort(rng.uniform(0.0, duration, int(rng.integers(0, 4))))
    times = np.unique(np.concatenate([[0.0], inner, [duration]]))
    return Motion(times, rng.uniform(-1.5, 1.5, (len(times), 2)))


def random_problem(rng: np.random.Generator, width: float) -> tuple[Problem, Floats]:
    """A block that moves, and random commands; the block is away from the start at first."""
    steps = int(rng.integers(1, 12))
    parameters = {"traction": Interval(1 - width, 1 + width), "start_x": Interval(-width / 4, width / 4)}
    fleet = Fleet(Unicycle(), parameters, np.zeros(2), 0.3, np.full(2, -2.0), np.full(2, 2.0))
    middle = rng.uniform(0.8, 2.0) * np.array([np.cos(t := rng.uniform(0, 2 * np.pi)), np.sin(t)])
    block = Obstacle.box(np.column_stack([middle - 0.3, middle + 0.3]))
    motion = random_motion(rng, 0.3 * steps)
    motion = Motion(motion.times, motion.offsets - motion.offsets[0])
    problem = Problem(
        "moving",
        fleet,
        0.3 * steps,
        steps,
        parse("G avoid(block)"),
        obstacles={"block": (block,)},
        motions={"block": motion},
    )
    return problem, np.asarray(rng.uniform(-2, 2, (steps, 2)))


def brute_force(problem: Problem, controls: Floats, members: Floats, substeps: int) -> float:
    """Smallest distance of members from the block, each looked at where the block is at that time."""
    paths = trajectories(problem, controls, members, substeps)
    moved = problem.motions["block"].at(np.linspace(0.0, problem.duration, paths.shape[1]))
    (piece,) = problem.obstacles["block"]
    return float(piece.distance(paths - moved).min())


def test_moving_the_block_is_moving_the_members_the_other_way() -> None:
    problem, controls = random_problem(np.random.default_rng(3), 0.1)
    paths = trajectories(problem, controls, problem.fleet.grid(4), 8)
    moved = problem.motions["block"].at(np.linspace(0.0, problem.duration, paths.shape[1]))
    corners = problem.obstacles["block"][0].vertices
    wanted = min(float(Obstacle.polygon(corners + m).distance(paths[:, k]).min()) for k, m in enumerate(moved))
    assert brute_force(problem, controls, problem.fleet.grid(4), 8) == pytest.approx(wanted, abs=1e-12)


@MANY
@given(seeds, st.sampled_from([0.0, 0.1, 0.3]))
def test_no_member_is_ever_closer_than_proven(seed: int, width: float) -> None:
    problem, controls = random_problem(np.random.default_rng(seed), width)
    (bound,) = certify(problem, controls).clearances
    seen = brute_force(problem, controls, problem.fleet.grid(25), 25)
    assert bound.proven <= seen + 1e-12
    assert bound.sampled - bound.proven < 2e-3 or bound.sampled < 0
    witness = brute_force(problem, controls, problem.fleet.members([bound.parameters]), 512)
    motion = problem.motions["block"]
    speed = 2.5 + float((np.linalg.norm(np.diff(motion.offsets, axis=0), axis=1) / np.diff(motion.times)).max())
    assert witness <= bound.sampled + speed * problem.step / 512


@MANY
@given(seeds)
def test_replay_looks_at_the_obstacle_where_it_is(seed: int) -> None:
    problem, controls = random_problem(np.random.default_rng(seed), 0.2)
    members = problem.fleet.grid(9)
    run = replay(problem, controls, parameters=members, substeps=3)
    assert run.clearances[0].distance == pytest.approx(brute_force(problem, controls, members, 3), abs=1e-12)


@MANY
@given(seeds)
def test_lines_keep_clear_of_it_through_the_step(seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem, _ = random_problem(rng, 0.1)
    points = rng.uniform(-3, 3, (problem.steps + 1, 3, 2))
    hyperplanes = separate(points, problem.specification.avoid, problem.duration)
    (piece,), motion = problem.obstacles["block"], problem.motions["block"]
    for k in range(problem.steps):
        for share in np.linspace(0, 1, 9):
            chord = (1 - share) * points[k] + share * points[k + 1]
            moved = motion.at((k + share) * problem.step)
            assert hyperplanes.gap[0, k] <= piece.distance(chord - moved).min() + 1e-9


@MANY
@given(seeds)
def test_a_bend_is_the_largest_way_from_the_chord(seed: int) -> None:
    rng = np.random.default_rng(seed)
    motion = random_motion(rng, 2.0)
    begin, end = np.sort(rng.uniform(0, 2, 2))
    share = np.linspace(0, 1, 400)[:, None]
    chord = (1 - share) * motion.at(begin) + share * motion.at(end)
    away = np.linalg.norm(motion.at(begin + share[:, 0] * (end - begin)) - chord, axis=1).max()
    assert away <= float(motion.bend(begin, end)) + 1e-12
    assert float(motion.bend(begin, end)) <= away + 0.05


def test_the_config_is_planned_and_proven() -> None:
    problem = load(CONFIG)
    assert read(CONFIG).warnings == ()
    found = solve(problem)
    assert found.certificate is not None
    assert (found.status, found.certificate.proven) == ("planned", "yes")
    run = replay(problem, found.controls, members=2000, substeps=10)
    assert not run.violating.any()
    still = problem.with_(motions={})
    assert (
        replay(still, found.controls, members=50, substeps=10).violating.any()
        or certify(still, found.controls).inputs != found.certificate.inputs
    )


def test_it_is_written_and_read_again() -> None:
    again = load_text(dump(load(CONFIG))).motions
    for name, motion in load(CONFIG).motions.items():
        np.testing.assert_array_equal(again[name].times, motion.times)
        np.testing.assert_array_equal(again[name].offsets, motion.offsets)


@MANY
@given(seeds, st.floats(0.0, 0.1), st.floats(0.0, 0.1))
def test_no_member_is_closer_to_where_the_block_may_be_than_proven(seed: int, start: float, growth: float) -> None:
    problem, controls = random_problem(np.random.default_rng(seed), 0.1)
    motion = replace(problem.motions["block"], uncertainty=start, growth=growth, since=0.1)
    problem = problem.with_(motions={"block": motion})
    proven = min(bound.proven for bound in certify(problem, controls).clearances)
    paths = trajectories(problem, controls, problem.fleet.grid(9), 25)
    times = np.linspace(0.0, problem.duration, paths.shape[1])
    (piece,) = problem.obstacles["block"]
    loose = start + growth * np.maximum(times - 0.1, 0.0)
    seen = (piece.distance(paths - motion.at(times)) - loose).min()
    assert proven <= seen + 1e-12
    # the block may come nearer and go again between two of these times
    fastest = (np.linalg.norm(np.diff(motion.offsets, axis=0), axis=1) / np.diff(motion.times)).max()
    assert seen - proven < 0.1 + fastest * times[1] or seen < 0
    run = replay(problem, controls, parameters=problem.fleet.grid(9), substeps=25)
    assert min(each.distance for each in run.clearances) <= seen + 1e-12


def test_what_is_not_known_of_a_motion_is_part_of_what_is_proven() -> None:
    text = """
fleet: {model: unicycle, start: {position: [0, 0], heading: 0}}
horizon: {duration: 2 s}
obstacles: {cart: {box: [[2.5, 3.5], [-0.5, 0.5]]}}
motions: {cart: {velocity: [0.1, 0], uncertainty: {position: 5 cm, speed: 2 cm/s, since: 0.5 s}}}
task: G avoid(cart)
"""
    problem, controls = load_text(text), np.zeros((20, 2))
    known = problem.with_(motions={"cart": Motion.steady([0.1, 0.0], 2.0)})
    again, plain = load_text(dump(problem)), problem_of(proven_part(to_data(problem)))
    for same in (again, plain):
        motion = same.motions["cart"]
        assert (motion.uncertainty, motion.growth, motion.since) == (0.05, 0.02, 0.5)
        assert certify(same, controls).inputs == certify(problem, controls).inputs
    assert certify(known, controls).inputs != certify(problem, controls).inputs
    assert certify(problem, controls).clearance == pytest.approx(2.5 - 0.05, abs=0.04)
    shorter = {**proven_part(to_data(problem))}
    shorter["motions"] = {"cart": {**shorter["motions"]["cart"], "uncertainty": {"speed": 0.02, "fast": 1.0}}}
    with pytest.raises(ProblemError, match="expected the keys position, speed, since, got 'fast'"):
        problem_of(shorter)


MISTAKES = [
    (
        "motions: {cart: {velocity: [1, 0], uncertainty: {position: -1 cm}}}",
        "motions.cart.uncertainty.position",
        "expected a length in m",
    ),
    (
        "motions: {cart: {velocity: [1, 0], uncertainty: {speed: 2 cm}}}",
        "motions.cart.uncertainty.speed",
        "expected a speed",
    ),
    ("motions: {cat: {velocity: [1, 0]}}", "motions.cat", "expected the name of an obstacle (cart), got 'cat'"),
    ("motions: {cart: {}}", "motions.cart", "expected exactly one of velocity, path, got none"),
    ("motions: {cart: {path: [[0, [0, 0]]]}}", "motions.cart.path", "expected two or more [time, [x, y]]"),
    ("motions: {cart: {path: [[0, [0, 0]], [1, 2]]}}", "motions.cart.path[1]", "expected [time, [x, y]], got [1, 2]"),
    (
        "motions: {cart: {path: [[0, [0, 0]], [0, [1, 2]]]}}",
        "motions.cart.path",
        "expected finite numbers at increasing",
    ),
    (
        "motions: {cart: {path: [[0, [0, 0]], [1, [1, 2]]]}}",
        "motions.cart",
        "expected times from 0 to 2 s, got 0 to 1 s",
    ),
    ("motions: {cart: {path: [[0, [-3, 0]], [2, [1, 2]]]}}", "fleet.start.position", "the start (0, 0) is 0.5 m deep"),
    (
        "motions: {cart: {velocity: [1, 0]}}\nsolve: {method: minlp}",
        "solve.method",
        "minlp is for obstacles that stand",
    ),
]


@pytest.mark.parametrize(("written", "place", "message"), MISTAKES)
def test_a_wrong_motion_is_named_with_its_place(written: str, place: str, message: str) -> None:
    text = f"""
fleet: {{model: unicycle, start: {{position: [0, 0], heading: 0}}}}
horizon: {{duration: 2 s}}
regions: {{goal: {{box: [[-1, 1], [-1, 1]]}}}}
obstacles: {{cart: {{box: [[2.5, 3.5], [-0.5, 0.5]]}}}}
task: F in(goal) and G avoid(cart)
{written}
"""
    with pytest.raises(ConfigError) as caught:
        load_text(text)
    (error,) = caught.value.diagnostics
    assert (error.path, error.message[: len(message)]) == (place, message)


def test_what_moves_can_only_be_avoided_throughout() -> None:
    text = """
fleet: {model: unicycle, start: {position: [0, 0], heading: 0}}
horizon: {duration: 2 s}
obstacles: {cart: {box: [[2.5, 3.5], [-0.5, 0.5]]}}
motions: {cart: {velocity: [0.1, 0]}}
task: F G[0,1] avoid(cart)
"""
    with pytest.raises(ConfigError, match="and a moving obstacle can only be avoided throughout a window"):
        load_text(text)


def test_wrong_motions_are_refused_in_python() -> None:
    with pytest.raises(ProblemError, match=r"^motion: expected two or more times"):
        Motion(np.zeros(1), np.zeros((1, 2)))
    with pytest.raises(ProblemError, match=r"^motion: expected finite numbers at increasing times"):
        Motion(np.array([0.0, 1.0, 1.0]), np.zeros((3, 2)))
