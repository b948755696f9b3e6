"""Bodies: distances against shapely, proofs against members and instants near the bound."""

from itertools import product

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.certificate.bodies import Body
from ensemble_ctrl.certificate.enclosure import Flow
from ensemble_ctrl.constraints import Disc, Obstacle
from ensemble_ctrl.constraints.footprint import Footprint
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import replay
from tests.examples import examples

Array = NDArray[np.float64]

CAR = """
version: 1
name: car
fleet:
  model: bicycle
  wheelbase: 2.7 m
  parameters: {PARAMETERS}
  start: {position: [0, 0], heading: 20 deg, heading_from: x}
  input_bounds: {v: [-2, 2], delta: [-40 deg, 40 deg]}
  radius: 0.05 m
  footprint: {length: 4.6 m, width: 1.9 m, rear_overhang: 1 m}
horizon: {duration: 6, steps: 12}
obstacles:
  wall: {box: [[-9, 12], [-6.5, -6]]}
  post: {disc: {center: [7, 5.5], radius: 30 cm}}
  van: {polygon: [[4, -3.5], [8, -4.5], [8.4, -3], [4.4, -2]]}
  cart: {box: [[-4, -3.2], [2, 3]]}
motions: {cart: {velocity: [0.4, 0.3]}}
task: "G avoid(obstacles)"
"""
SETS = (
    "{traction: {range: [0.95, 1.05]}}",
    "{linear_traction: {range: [0.95, 1.03]}, angular_traction: {range: [0.9, 1.1]}}",
    "{}",
    "{traction: {range: [0.98, 1.02]}, start_heading: {range: [-4 deg, 3 deg]}, start_y: {range: [-0.1, 0.2]}}",
)


def _problem(parameters: str, text: str = CAR) -> Problem:
    return load_text(text.replace("{PARAMETERS}", parameters))


def _controls(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    sign = np.where(rng.random(12) < 0.3, -1.0, 1.0)
    return np.column_stack([sign * rng.uniform(0.5, 2.0, 12), rng.uniform(-0.65, 0.65, 12)])


def _shapes(problem: Problem, controls: Array, members: Array, substeps: int) -> tuple[Array, Array]:
    """Bodies as polygons of shapely, from a rotation matrix of this test's own, with times."""
    fleet, fine = problem.fleet, np.repeat(controls, substeps, axis=0)
    states = fleet.full_states(fine, members, problem.duration / len(fine))
    places, angles = states[..., :2], states[..., 2]
    turn = np.exp(1j * angles)[..., None]
    assert fleet.footprint is not None
    corners = (places @ [1, 1j])[..., None] + turn * (fleet.footprint.corners @ [1, 1j])
    rings = np.stack([corners.real, corners.imag], axis=-1)
    return shapely.polygons(rings), np.linspace(0.0, problem.duration, len(fine) + 1)


def _distances(problem: Problem, controls: Array, members: Array, substeps: int) -> dict[str, Array]:
    """Distances by shapely of members at times from every obstacle, less the radius; zero of what overlaps."""
    bodies, times = _shapes(problem, controls, members, substeps)
    found = {}
    for name, (piece,) in problem.obstacles.items():
        motion = problem.motions.get(name)
        offsets = np.zeros((len(times), 2)) if motion is None else motion.at(times)
        core = piece.core + offsets[:, None]
        shape = shapely.polygons(core) if len(piece.core) > 2 else shapely.points(core[:, 0])
        found[name] = shapely.distance(bodies, shape[None]) - piece.rounding - problem.fleet.radius
    return found


@examples(60)
@given(st.integers(0, 10**6), st.sampled_from(["box", "triangle", "disc"]), st.floats(-7, 7), st.floats(0.2, 3.0))
def test_distances_are_those_of_shapely(seed: int, kind: str, heading: float, size: float) -> None:
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 5)) + np.arange(5) * 1e-3
    body = Footprint(np.stack([np.cos(angles) * 2 * size, np.sin(angles)], axis=1)) if _fat(angles) else Footprint(BOX)
    piece: Obstacle = {
        "box": Obstacle.box([[-size, size], [-0.3, 0.4]]),
        "triangle": Obstacle.polygon(np.array([[0, 0], [size, 0.2], [0.3, 1.0]])),
        "disc": Disc([0.1, 0.2], size / 2),
    }[kind]
    places = rng.uniform(-5, 5, (30, 2))
    seen = body.distance(piece, places, np.full(30, heading))
    shapes = shapely.polygons(body.at(places, np.full(30, heading)))
    core = shapely.polygons(piece.core) if kind != "disc" else shapely.points(piece.core[0])
    apart = shapely.distance(shapes, core)
    np.testing.assert_allclose(seen[apart > 0], apart[apart > 0] - piece.rounding, atol=1e-9)
    assert (seen[apart == 0] <= -piece.rounding + 1e-9).all()
    # the depth: moved by it in the best of many directions, they no longer overlap; by less, in none
    for place, depth in list(zip(places[apart == 0], seen[apart == 0] + piece.rounding, strict=True))[:3]:
        around = np.linspace(0, 2 * np.pi, 721)
        away = np.stack([np.cos(around), np.sin(around)], axis=1)
        moved = [shapely.polygons(body.at(place - s * depth * away, np.full(721, heading))) for s in (0.98, 1.02)]
        assert (shapely.distance(moved[0], core) == 0).all()
        assert depth > -1e-6 or (shapely.distance(moved[1], core) > 0).any()


BOX = np.array([[-1.0, -0.5], [2.0, -0.5], [2.0, 0.5], [-1.0, 0.5]])


def _fat(angles: Array) -> bool:
    return bool(np.diff(np.append(angles, angles[0] + 2 * np.pi)).max() < 3.0)


@pytest.mark.parametrize("parameters", SETS)
@pytest.mark.parametrize("seed", range(2))
def test_no_member_is_closer_than_proven_and_the_bound_is_tight(parameters: str, seed: int) -> None:
    problem, controls = _problem(parameters), _controls(seed)
    found = {one.obstacle: one for one in certify(problem, controls, each=True).clearances}
    rng = np.random.default_rng(7)
    ranges = [(one.lower, one.upper) for one in problem.fleet.parameters.values()]
    members = np.array([[rng.uniform(low, high) for low, high in ranges] for _ in range(30)]).reshape(30, len(ranges))
    members = np.concatenate([members, np.array(list(product(*ranges))).reshape(2 ** len(ranges), len(ranges))])
    seen = _distances(problem, controls, members, 40)
    for name, bound in found.items():
        # members around the one that was seen closest, at every instant
        worst = np.array([bound.parameters[k] for k in problem.fleet.names])
        wide = np.array([high - low for low, high in ranges])
        near = np.clip(worst + rng.normal(0, 0.02, (30, len(ranges))) * wide, *np.array(ranges).reshape(-1, 2).T)
        close = _distances(problem, controls, np.concatenate([near, worst[None]]), 40)[name]
        least = min(float(close.min()), float(seen[name].min()))
        if least > -problem.fleet.radius + 1e-9:
            assert bound.proven <= least + 1e-9
            assert bound.proven >= least - 0.01, name
            assert bound.sampled == pytest.approx(least, abs=0.01)
        else:
            assert bound.proven < 0


@pytest.mark.parametrize("heading_from", ["x", "y"])
def test_headings_from_either_axis_are_the_same_question(heading_from: str) -> None:
    text = CAR.replace("heading: 20 deg, heading_from: x", "heading: 70 deg, heading_from: y")
    problem = _problem(SETS[-1], CAR if heading_from == "x" else text)
    controls = _controls(0) * ([1, 1] if heading_from == "x" else [1, -1])
    ranges = [(one.lower, one.upper) for one in problem.fleet.parameters.values()]
    members = np.array(list(product(*ranges)))
    seen = _distances(problem, controls, members, 30)
    for bound in certify(problem, controls, each=True).clearances:
        assert bound.proven <= max(float(seen[bound.obstacle].min()), -problem.fleet.radius) + 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_every_corner_is_within_its_enclosure(seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem, controls = _problem(SETS[1]), _controls(seed)
    flow = Flow.of(problem, controls)
    body = Body(flow, problem.fleet.footprint)
    assert problem.fleet.footprint is not None
    half = (flow.upper - flow.lower) / 2 * rng.uniform(0.2, 1, 2)
    centre = rng.uniform(flow.lower + half, flow.upper - half)
    n = np.arange(flow.steps)
    coeffs = np.tile(flow.coefficients(centre), (flow.steps, 1))
    begin, end = 0.25, 0.75
    (at, slope), (there, slope_there) = (body.corners(n, np.full(len(n), s), coeffs) for s in (begin, end))
    wide = np.tile(half, (len(n), 1))
    room = body.remainder(wide, n) + body.growth(n, (end - begin) * flow.step, coeffs, wide) + body.rounding()
    for _ in range(200):
        apart, share = rng.uniform(-1, 1, 2) * half, rng.uniform(begin, end)
        member = flow.coefficients(centre + apart)
        turned = flow.turned + share * flow.step * flow.omega
        true = problem.fleet.footprint.at(np.zeros((len(n), 2)), member[2] + member[1] * turned)
        mix = (share - begin) / (end - begin)
        first, last = at + np.einsum("p,ncpd->ncd", apart, slope), there + np.einsum("p,ncpd->ncd", apart, slope_there)
        off = np.linalg.norm(true - (1 - mix) * first - mix * last, axis=2).max(axis=1)
        assert (off <= room).all()


def test_replay_sees_what_shapely_sees() -> None:
    problem, controls = _problem(SETS[-1]), _controls(1)
    members = problem.fleet.sample(300, seed=3)
    run = replay(problem, controls, parameters=members, substeps=10)
    seen = _distances(problem, controls, members, 10)
    for one in run.clearances:
        least = float(seen[one.obstacle].min())
        if least > -problem.fleet.radius:
            assert one.distance == pytest.approx(least, abs=1e-9)
            assert one.inside == int((seen[one.obstacle].min(axis=1) < 0).sum())
        else:
            assert one.distance <= -problem.fleet.radius


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Footprint.rectangle(0.0, 1.0), "length"),
        (lambda: Footprint.rectangle(4.0, -1.0), "width"),
        (lambda: Footprint.rectangle(4.0, 1.0, 5.0), "rear_overhang: expected 0 to 4 m"),
        (lambda: Footprint(np.array([[0, 0], [2, 0], [1, 0.2], [0, 2]])), "convex"),
        (lambda: Footprint(np.array([[0, 0], [2000, 0], [0, 2]])), "within 1000 m"),
        (lambda: Footprint(np.array([[np.cos(t), np.sin(t)] for t in np.arange(20) / 3.2])), "at most 16"),
    ],
)
def test_bad_footprints_are_refused(make: object, said: str) -> None:
    with pytest.raises(ProblemError, match=said):
        make()  # type: ignore[operator]
