"""The certificate against brute force: no sampled value may ever lie below a proven bound."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.certificate.certify import SPLITS
from ensemble_ctrl.certificate.clearance import Prover, separation
from ensemble_ctrl.certificate.enclosure import Flow, Track
from ensemble_ctrl.certificate.instants import Spans
from ensemble_ctrl.certificate.task import bound_task
from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import (
    ExactOps,
    StateSignals,
    ground,
    member_robustness,
    parse,
    reads_fleet,
)
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import Unicycle
from tests.examples import examples
from tests.paths import CONFIGS

Floats = NDArray[np.float64]
CONFIG = CONFIGS / "five_obstacles.yaml"
SLOW = examples(1000, suppress_health_check=[HealthCheck.too_slow])
MANY = examples(1000)

seeds = st.integers(0, 2**31)
widths = st.sampled_from([0.0, 1e-3, 0.1, 0.4])
KINDS: dict[str, dict[str, float]] = {
    "one": {"traction": 1.0},
    "two": {"linear_traction": 1.0, "angular_traction": 0.5},
    "start": {"traction": 1.0, "start_x": 0.5, "start_y": 0.2},
    "pose": {"start_heading": 0.3, "start_x": 0.2},
    "all": {"linear_traction": 0.3, "angular_traction": 0.2, "start_heading": 0.1, "start_x": 0.1, "start_y": 0.1},
}
"""Names of parameters with how wide each is for a fleet of width 1."""
kinds = st.sampled_from(list(KINDS))


def problem_of(
    steps: int,
    width: float,
    heading_from: str,
    obstacles: Mapping[str, tuple[Obstacle, ...]],
    task: str,
    kind: str = "one",
) -> Problem:
    """A fleet at the origin with obstacles far enough for a legal start."""
    middle = {name: 0.0 if name.startswith("start") else 1.0 for name in KINDS[kind]}
    fleet = Fleet(
        Unicycle("y" if heading_from == "y" else "x"),
        {n: Interval(middle[n] - share * width, middle[n] + share * width) for n, share in KINDS[kind].items()},
        np.zeros(2),
        0.3,
        np.array([-20.0, -2.0]),
        np.array([20.0, 2.0]),
    )
    regions = {"home": Polyhedron.box([[-1.0, 1.0], [-1.0, 1.0]]), "there": Polyhedron.box([[0.5, 2.0], [-1.0, 2.0]])}
    return Problem("test", fleet, 0.25 * steps, steps, parse(task), regions, obstacles)


def random_controls(rng: np.random.Generator, steps: int) -> Floats:
    """Commands within the bounds, some of them exactly zero."""
    controls = rng.uniform(-2, 2, (steps, 2)) * (rng.random((steps, 2)) < 0.8)
    return np.asarray(controls)


def random_polygon(rng: np.random.Generator) -> Obstacle:
    """A convex polygon some way from the origin."""
    angles = np.sort(rng.uniform(0, 2 * np.pi, 5))
    angles = np.linspace(0, 2 * np.pi, 5, endpoint=False) + 0.5 * (angles - angles.mean()) / 5
    centre = rng.uniform(1.2, 2.5) * np.array([np.cos(t := rng.uniform(0, 2 * np.pi)), np.sin(t)])
    return Obstacle.polygon(centre + rng.uniform(0.2, 0.9) * np.stack([np.cos(angles), np.sin(angles)], axis=1))


@SLOW
@given(seeds, st.integers(1, 16), widths, st.sampled_from("xy"), kinds)
def test_no_member_is_ever_closer_than_proven(
    seed: int, steps: int, width: float, heading_from: str, kind: str
) -> None:
    rng = np.random.default_rng(seed)
    piece = random_polygon(rng)
    width = min(width, 0.1) if kind == "all" else width
    problem = problem_of(steps, width, heading_from, {"o": (piece,)}, "G avoid(o)", kind)
    controls = random_controls(rng, steps)
    (bound,) = certify(problem, controls).clearances
    members = np.concatenate([problem.fleet.grid(100), problem.fleet.corners, problem.fleet.sample(50, seed)])
    seen = piece.distance(trajectories(problem, controls, members, 20)).min()
    assert bound.proven <= seen + 1e-12
    assert bound.proven <= bound.sampled
    if len(problem.fleet.dynamic) < 3 and (bound.sampled > 0 or not problem.fleet.shift.any()):
        assert bound.sampled - bound.proven < 2e-3
    witness = trajectories(problem, controls, problem.fleet.members([bound.parameters]), 1024)
    assert piece.distance(witness).min() <= bound.sampled + 1e-3


@examples(400, suppress_health_check=[HealthCheck.too_slow])
@given(seeds, st.integers(2, 12), widths, kinds)
def test_task_bound_holds_for_every_member(seed: int, steps: int, width: float, kind: str) -> None:
    rng = np.random.default_rng(seed)
    half = steps // 2 * 0.25
    texts = [
        f"F[0,{half}] in(there)",
        f"G[0,{half}] in(home)",
        "F in(there) or G in(home)",
        f"F[0,{half}] (x >= 0.4 and G[0,0.25] y <= 0.5)",
        "not in(there) U in(home)",
        "(x <= 0.7) U (y >= 0.2 or y <= -0.2)",
        "G (in(home) or in(there))",
        "F G[0,0.25] in(home)",
        "mean(F in(there))",
        "share(0.5, G in(home))",
    ]
    text = texts[int(rng.integers(len(texts)))]
    width = min(width, 0.1) if kind == "all" else width
    problem = problem_of(steps, width, "x", {}, text, kind)
    controls = random_controls(rng, steps)
    (bound,) = certify(problem, controls).parts
    members = _middles(problem.fleet, 100)
    if not reads_fleet(problem.task):
        members = np.concatenate([members, problem.fleet.corners])
    substeps = SPLITS[-1]
    fine = trajectories(problem, controls, members, substeps)
    formula = problem.specification.parts[0].formula
    dense = member_robustness(formula, StateSignals(fine, ("x", "y"), problem.step / substeps), ExactOps())
    assert bound.covered
    # a fleet of finitely many members has a mean and shares of its own
    assert bound.proven <= dense.min() + (5e-2 * width * steps if reads_fleet(problem.task) else 1e-6)


def _middles(fleet: Fleet, count: int) -> Floats:
    """The middles of an even partition of the box of parameters into about `count` cells."""
    each = max(2, round(count ** (1 / len(fleet.names))))
    axes = [np.linspace(a, b, 2 * each + 1)[1::2] for a, b in zip(fleet.lower, fleet.upper, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


@MANY
@given(seeds, st.integers(1, 200), st.sampled_from("xy"))
def test_rounding_error_is_below_its_bound(seed: int, steps: int, heading_from: str) -> None:
    rng = np.random.default_rng(seed)
    problem = problem_of(steps, 0.1, heading_from, {}, "F in(home)")
    controls = random_controls(rng, steps)
    flow = Flow.of(problem, controls)
    centre = rng.uniform(0.9, 1.1)
    exact = _long_double_path(problem, controls, centre)
    error = np.abs(Track.of(flow, np.array([[centre]])).position[0] - exact).max()
    assert float(error) <= flow.rounding()


def _long_double_path(problem: Problem, controls: Floats, parameter: float) -> NDArray[np.longdouble]:
    """The same arcs in extended precision."""
    wide = np.longdouble
    v, w = controls.astype(wide).T
    step, c = wide(problem.duration) / wide(len(v)), wide(parameter)
    turned = np.concatenate([[wide(0)], np.cumsum(w * step)[:-1]])
    half = c * w * step / 2
    ratio = np.where(half == 0, wide(1), np.sin(half) / np.where(half == 0, wide(1), half))
    angle = wide(problem.fleet.own_heading) + c * turned + half
    parts = [np.cos(angle), np.sin(angle)]
    parts = parts if problem.fleet.arcs.heading_from == "x" else parts[::-1]
    moves = np.stack([c * v * step * ratio * part for part in parts], axis=1)
    return np.concatenate([np.zeros((1, 2), wide), np.cumsum(moves, axis=0)])


@MANY
@given(seeds, st.sampled_from("xy"))
def test_derivatives_by_the_parameters(seed: int, heading_from: str) -> None:
    rng = np.random.default_rng(seed)
    problem = problem_of(12, 0.1, heading_from, {}, "F in(home)", "all")
    flow, h = Flow.of(problem, random_controls(rng, 12)), 1e-5
    centre = rng.uniform(-0.2, 0.2, 5) + np.array([1.0, 1.0, 0.0, 0.0, 0.0])
    slope = Track.of(flow, centre[None]).slope[0]
    for k, unit in enumerate(np.eye(5)):
        low, high = (Track.of(flow, (centre + way * h * unit)[None]).position[0] for way in (-1, 1))
        assert np.abs((high - low) / (2 * h) - slope[:, k]).max() < 1e-6


@MANY
@given(seeds, st.sampled_from([2, 4, 16]))
def test_separation_is_never_above_the_distance(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    piece, corners = random_polygon(rng), rng.normal(size=(1, count, 2)) * rng.uniform(0.01, 2)
    weights = rng.dirichlet(np.ones(count), 500)
    sides = np.diff(corners, axis=1)
    assert separation(corners, sides, piece.vertices)[0] <= piece.distance(weights @ corners[0]).min() + 1e-12


@examples(300)
@given(seeds)
def test_an_obstacle_grown_by_the_starts_is_as_close_as_the_closest_start(seed: int) -> None:
    rng = np.random.default_rng(seed)
    piece, shift, point = random_polygon(rng), rng.uniform(0.0, 0.5, 2), rng.uniform(-3, 3, 2)
    axes = [np.linspace(-h, h, 81) for h in shift]
    offsets = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    wanted = float(piece.distance(point + offsets).min())
    got = float(piece.widened(shift).distance(point))
    assert got <= wanted + 1e-12
    if wanted > 0:
        assert got >= wanted - 1e-2


def _five() -> tuple[Problem, Floats]:
    """The five-obstacle problem with its certified controls."""
    plan = ec.plan(ec.load(CONFIG, ["verify.members=100", "moments.order=auto"]))
    return plan.problem, plan.controls


@pytest.fixture(scope="module")
def five() -> tuple[Problem, Floats]:
    return _five()


def test_five_obstacles_within_a_millimetre_of_the_sampled_minimum(five: tuple[Problem, Floats]) -> None:
    problem, controls = five
    certificate = certify(problem, controls, each=True)
    assert certificate.proven == "yes"
    paths = trajectories(problem, controls, problem.fleet.grid(2001), 20)
    for bound, pieces in zip(certificate.clearances, problem.obstacles.values(), strict=True):
        seen = min(piece.distance(paths).min() for piece in pieces)
        assert seen - 1e-3 <= bound.proven <= seen


@pytest.mark.parametrize("grow", [0.0, 0.2])
def test_far_obstacles_are_not_refined_unless_each_is_wanted(five: tuple[Problem, Floats], grow: float) -> None:
    problem, controls = five
    rng = np.random.default_rng(3)
    low = rng.uniform([-4, -3], [9, 8], (60, 2))
    low = low[np.linalg.norm(low + 0.1 - problem.fleet.position, axis=1) > 0.8]
    extra = {f"p{k}": (Obstacle.box(np.column_stack([x, x + 0.2]).tolist()),) for k, x in enumerate(low)}
    fleet = replace(problem.fleet, radius=grow)
    wide = problem.with_(obstacles={**problem.obstacles, **extra}, fleet=fleet)
    quick, whole = certify(wide, controls), certify(wide, controls, each=True)
    assert (quick.clearance, quick.proven) == (whole.clearance, whole.proven)
    assert (quick.enough, whole.enough) == (0.5, None)
    far = 0
    for one, other in zip(quick.clearances, whole.clearances, strict=True):
        if other.sampled < 0.5:
            assert one == other
            continue
        assert 0.5 <= one.proven <= other.sampled <= other.proven + 1e-3
        assert one.sampled >= other.proven
        far += one.proven < other.proven - 0.1
    assert far > 5
    assert quick.boxes < whole.boxes / 2


def test_a_plan_made_unsafe_by_a_millimetre_is_rejected(five: tuple[Problem, Floats]) -> None:
    problem, controls = five
    certificate = certify(problem, controls)
    closest = min(certificate.clearances, key=lambda b: b.sampled)
    larger = problem.with_(fleet=replace(problem.fleet, radius=closest.sampled + 1e-3))
    refused = certify(larger, controls)
    assert refused.proven == "no"
    found = refused.counter_example
    assert found is not None
    assert closest.obstacle in found.what
    member = trajectories(larger, controls, larger.fleet.members([found.parameters]), 64)
    (piece,) = problem.obstacles[closest.obstacle]
    assert piece.distance(member).min() < larger.fleet.radius


def test_a_corner_cut_between_grid_times_is_found() -> None:
    # two steps of 1.5 m past a thin wall: clear at every grid time, through it in between
    wall = {"wall": (Obstacle.box([[0.7, 0.8], [-1.0, 1.0]]),)}
    problem = problem_of(2, 0.0, "x", wall, "G avoid(wall)").with_(duration=2.0)
    problem = problem.with_(fleet=problem.fleet.with_(heading=0.0))
    controls = np.array([[1.5, 0.0], [1.5, 0.0]])
    assert all(problem.obstacles["wall"][0].distance(trajectories(problem, controls, np.ones((1, 1)))[0]) > 0)
    certificate = certify(problem, controls)
    assert certificate.proven == "no"
    assert certificate.counter_example is not None
    assert certificate.counter_example.time == pytest.approx(0.5, abs=0.05)


def test_touching_counts_as_clear_only_up_to_rounding() -> None:
    wall = {"wall": (Obstacle.box([[1.0, 2.0], [-1.0, 1.0]]),)}
    problem = problem_of(1, 0.0, "x", wall, "G avoid(wall)").with_(duration=1.0)
    problem = problem.with_(fleet=problem.fleet.with_(heading=0.0))
    certificate = certify(problem, np.array([[1.0, 0.0]]))
    assert certificate.proven == "undecided"
    assert abs(certificate.clearance) < 2e-3


@pytest.mark.parametrize("controls", [[[0.0, 0.0]], [[0.0, 2.0]], [[2.0, 0.0]], [[1.0, 1e-9]]])
def test_degenerate_commands(controls: list[list[float]]) -> None:
    wall = {"wall": (Obstacle.box([[3.0, 4.0], [-1.0, 1.0]]),)}
    certificate = certify(problem_of(1, 0.1, "x", wall, "G avoid(wall)"), np.array(controls))
    assert certificate.proven == "yes"


def test_another_range_is_another_question(five: tuple[Problem, Floats]) -> None:
    problem, controls = five
    assert certify(problem, controls, {"traction": Interval(0.95, 1.05)}).proven == "yes"
    assert certify(problem, controls, {"traction": Interval(0.7, 1.3)}).proven == "no"


def test_inputs_hash_changes_with_anything_claimed(five: tuple[Problem, Floats]) -> None:
    problem, controls = five
    original = certify(problem, controls).inputs
    assert certify(problem, controls).inputs == original
    nudged = np.array(controls)
    nudged[3, 0] = np.nextafter(nudged[3, 0], 9.0)
    assert certify(problem, nudged).inputs != original
    assert certify(problem.with_(fleet=replace(problem.fleet, radius=1e-6)), controls).inputs != original


def test_prover_is_bounded_in_boxes() -> None:
    problem = problem_of(30, 0.4, "x", {"o": (Obstacle.box([[1.5, 2.0], [1.5, 2.0]]),)}, "G avoid(o)")
    flow = Flow.of(problem, random_controls(np.random.default_rng(3), 30))
    prover = Prover(flow, problem.fleet.names, limit=600)
    bound = prover.bound("o", problem.obstacles["o"][0], Spans.whole(np.arange(30)), 0.0)
    assert prover.boxes <= 4 * 600
    assert bound.proven <= bound.sampled


def test_nested_formula_against_dense_sampling() -> None:
    regions = {"a": Polyhedron.box([[0.3, 1.5], [-1.0, 1.0]])}
    problem = problem_of(20, 0.1, "x", {}, "F in(there)")
    formula = ground(parse("F[0,3] G[0,1] (in(a) or y >= 0.2)"), regions, {})
    controls = np.tile([[0.5, 0.1]], (20, 1))
    bound = bound_task(problem, controls, problem.fleet.parameters, formula, problem.fleet)
    fine = trajectories(problem, controls, problem.fleet.grid(51), 8)
    dense = member_robustness(formula, StateSignals(fine, ("x", "y"), problem.step / 8), ExactOps()).min()
    assert dense - 3e-2 <= bound.proven <= dense + 1e-9


@MANY
@given(seeds, st.sampled_from([0.02, 0.2, 0.4]), kinds)
def test_taylor_remainder_and_bulge_bound_the_truth(seed: int, half: float, kind: str) -> None:
    rng = np.random.default_rng(seed)
    steps = int(rng.integers(1, 12))
    problem = problem_of(steps, 0.45, "x", {}, "F in(home)", kind)
    turning = 2.0 if rng.random() < 0.5 else -2.0
    controls = np.column_stack([rng.uniform(-2, 2, steps), np.full(steps, turning)])
    flow = Flow.of(problem, controls)
    centre = problem.fleet.center[None]
    track = Track.of(flow, centre)
    offset = rng.uniform(-half, half, centre.shape) * list(KINDS[kind].values())
    truth = Track.of(flow, centre + offset).position[0]
    remainder = np.linalg.norm(truth - track.position[0] - offset[0] @ track.slope[0], axis=1)
    assert (remainder <= flow.remainder(np.abs(offset))[0] + 1e-12).all()
    n, share = np.arange(steps), rng.random(steps)
    coefficients = np.repeat(flow.coefficients(centre), steps, axis=0)
    inside, slope = flow.moved(n, share, coefficients)
    ends, slope_end = flow.moved(n, np.ones(steps), coefficients)
    reach = np.repeat(np.abs(offset), steps, axis=0)
    bulge = flow.growth(n, np.full(steps, flow.step), coefficients, reach)
    chord = share[:, None] * (ends + (offset[:, None] @ slope_end)[:, 0])
    assert (np.linalg.norm(inside + (offset[:, None] @ slope)[:, 0] - chord, axis=1) <= bulge + 1e-12).all()


def test_a_share_is_never_refuted_by_its_cells() -> None:
    problem = ec.load_text(
        """
        fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
        horizon: {duration: 2 s, steps: 10}
        task: share(0.95, F x >= 1.816)
        """
    )
    certificate = certify(problem, np.tile([[1.0, 0.0]], (10, 1)))
    assert certificate.proven != "no"
    assert certificate.counter_example is None


@pytest.mark.parametrize("at", [0.0, 4.2e6])
def test_the_rounding_of_coordinates_does_not_grow_with_the_steps(at: float) -> None:
    """Ten thousand steps in a national grid: a coordinate is in one sum for each position, not in one for each step."""
    problem = problem_of(10_000, 0.1, "x", {}, "G x >= -1e9")
    problem = problem.with_(fleet=problem.fleet.with_(position=np.array([at, at + 1e6])))
    controls = random_controls(np.random.default_rng(3), 10_000)
    flow = Flow.of(problem, controls)
    exact = _long_double_path(problem, controls, 1.03) + problem.fleet.position.astype(np.longdouble)
    error = np.abs(Track.of(flow, np.array([[1.03]])).position[0] - exact).max()
    assert float(error) <= flow.rounding() < 2e-6


def test_rounding_grows_with_the_map() -> None:
    near, far = (
        problem_of(4, 0.1, "x", {"o": (Obstacle.box([[at, at + 1.0], [-1.0, 1.0]]),)}, "G avoid(o)")
        for at in (3.0, 3e6)
    )
    controls = np.ones((4, 2))
    errors = [Flow.of(p, controls).rounding() for p in (near, far)]
    assert errors[0] < 1e-11
    assert errors[1] > 1e-8


@pytest.mark.parametrize("share", ["0.999", "1"])
def test_a_share_near_a_corner_is_judged_by_the_distance(share: str) -> None:
    """Also if it is the whole fleet: robots stand 0.113 m from a corner, with a radius of 0.1 m."""
    problem = ec.load_text(f"""version: 1
fleet:
  model: unicycle
  parameters: {{traction: {{range: [0.9, 1.1]}}}}
  start: {{position: [-0.08, -0.08], heading: 0 deg}}
  input_bounds: {{v: [-1, 1], omega: [-1, 1]}}
  radius: 0.1
horizon: {{duration: 2 s, steps: 4}}
obstacles: {{o: {{box: [[0, 1], [0, 1]]}}}}
task: "share({share}, G avoid(obstacles))"
""")
    found = certify(problem, np.zeros((4, 2)))
    assert found.proven == "yes"
    assert 0.013 < found.robustness < np.hypot(0.08, 0.08) - 0.1
