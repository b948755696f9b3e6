"""Discs: exact distances, polygons on the safe side, and proofs against sampled members."""

import numpy as np
import pytest
from numpy.typing import NDArray
from shapely import MultiPoint, Point

import ensemble_ctrl as ec
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.certificate.fingerprint import fingerprint
from ensemble_ctrl.constraints import Disc, DiscRegion, Obstacle, Polyhedron
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import ExactOps, StateSignals, ground, parse
from ensemble_ctrl.constraints.stl.robustness import member_robustness
from ensemble_ctrl.core.errors import ConfigError, ProblemError
from ensemble_ctrl.files.config import dump, load_text
from ensemble_ctrl.files.config.dump import to_data
from ensemble_ctrl.ocp.hyperplanes import separate
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.problem.plain import problem_of, proven_part

Array = NDArray[np.float64]

CONFIG = """
version: 1
name: round
fleet:
  model: unicycle
  parameters: {linear_traction: {range: [0.9, 1.1]}, angular_traction: {range: [0.95, 1.05]}}
  start: {position: [0, 0], heading: 0}
  input_bounds: {v: [-1, 1], omega: [-2, 2]}
  radius: 0.1
horizon: {duration: 6, steps: 12}
regions: {goal: {disc: {center: [3, 1], radius: 1 m}}}
obstacles: {tree: {disc: {center: [1.5, -0.8], radius: 50 cm}}, ball: {disc: {center: [2, 2.5], radius: 0.3}}}
motions: {ball: {velocity: [0.1, -0.2]}}
task: "F[4,6] in(goal) and G avoid(obstacles)"
"""


def _circle(disc: Disc, count: int = 1000) -> Array:
    angle = np.linspace(0.0, 2 * np.pi, count)
    return disc.center + disc.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize(
    ("center", "radius"), [([0, 0], 1.0), ([3.3, -7.1], 0.02), ([4e5, -5e6], 2.5), ([1e-3, 9], 80)]
)
def test_polygons_lie_on_the_safe_side_of_the_circle(center: list[float], radius: float) -> None:
    disc = Disc(center, radius)
    points = _circle(disc)
    for rows, inside in ((disc.outer_rows(), True), (DiscRegion(disc).outer_rows(), True), (disc.inner_rows(), False)):
        excess = points @ rows[0].T - rows[1]
        slack = 1e-15 * np.abs(points).max()
        assert (excess.max(axis=1) <= slack).all() if inside else (excess.max(axis=1) >= -slack).all()
    assert np.abs(disc.vertices - disc.center).max() <= 1.006 * radius + 1e-9
    corners = DiscRegion(disc).vertices
    assert (disc.distance(corners) <= 0).all()
    assert (disc.distance(corners) > -0.01 * radius).all()


def test_distances_are_those_from_the_centre() -> None:
    disc, points = Disc([1.0, 2.0], 0.7), np.random.default_rng(0).uniform(-3, 3, (500, 2))
    wanted = np.hypot(*(points - [1.0, 2.0]).T) - 0.7
    np.testing.assert_allclose(disc.distance(points), wanted, atol=1e-15)
    np.testing.assert_allclose(disc.distance_along(points.T), wanted, atol=1e-15)


@pytest.mark.parametrize("shift", [[0.3, 0.0], [0.2, 0.5]])
def test_a_widened_disc_is_as_close_as_the_closest_of_its_shifts(shift: list[float]) -> None:
    disc, rng = Disc([1.0, 0.0], 0.5), np.random.default_rng(1)
    wide = disc.widened(np.array(shift))
    axes = [np.linspace(-s, s, 201) for s in shift]
    shifts = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    for point in rng.uniform(-2, 4, (20, 2)):
        true = float(disc.distance(point + shifts).min())
        got = float(wide.distance(point))
        assert got <= true + 1e-12 if true > 0 else got < 1e-12
        assert true <= 0 or got == pytest.approx(true, abs=2e-2)
    for ring in (_circle(disc) + shift, _circle(disc) - shift):
        assert (wide.distance(ring) <= 1e-12).all()
        assert (ring @ wide.outer_rows()[0].T <= wide.outer_rows()[1] + 1e-15).all()


@pytest.mark.parametrize("task", ["in(d)", "not in(d)", "avoid(o)", "not avoid(o)", "not (not in(d) or avoid(o))"])
def test_a_grounded_place_never_holds_where_the_disc_does_not(task: str) -> None:
    disc = Disc([0.0, 0.0], 1.0)
    points = np.concatenate([s * _circle(disc, 400) for s in (0.99, 0.997, 0.9999, 1.0001, 1.003, 1.01)])
    formula = ground(parse(task), {"d": DiscRegion(disc)}, {"o": disc})
    states = StateSignals(points[:, None, :], ("x", "y"), 1.0)
    seen = np.asarray(member_robustness(formula, states, ExactOps()))[:, 0]
    inside = disc.distance(points)
    wanted = inside if task in ("not in(d)", "avoid(o)") else -inside
    assert (seen[wanted >= 0] <= wanted[wanted >= 0] + 1e-12).all()
    assert (seen[wanted < 0] < 0).all()
    assert (seen >= wanted - 0.011).all()


def test_separating_lines_are_tangents() -> None:
    rng = np.random.default_rng(3)
    problem = load_text(CONFIG).with_(task="G avoid(obstacles)")
    points = np.cumsum(rng.normal(0, 0.2, (13, 5, 2)), axis=0) + np.array([4.0, 0.0])
    planes = separate(points, problem.specification.avoid, problem.duration)
    for side, avoid in enumerate(problem.specification.avoid):
        shift = avoid.offsets(np.linspace(0.0, 6.0, 13))
        for step in range(12):
            ends = [points[k] - shift[k] for k in (step, step + 1)]
            hull = MultiPoint(np.concatenate(ends)).convex_hull
            disc = avoid.pieces[0]
            assert isinstance(disc, Disc)
            true = hull.distance(Point(disc.center)) - disc.radius - 0.1
            if true > 0:
                assert planes.gap[side, step] == pytest.approx(true, abs=2e-3)
                assert planes.gap[side, step] <= true + 1e-9


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("starts", [False, True])
def test_proven_clearance_is_below_every_member_and_tight(seed: int, starts: bool) -> None:
    rng = np.random.default_rng(seed)
    text = (
        CONFIG.replace("angular_traction: {range: [0.95, 1.05]}", "start_y: {range: [-0.1, 0.15]}")
        if starts
        else CONFIG
    )
    problem = load_text(text)
    controls = np.column_stack([rng.uniform(0.3, 1, 12), rng.uniform(-1, 1, 12)])
    found, least = certify(problem, controls), np.inf
    members = np.array(
        [dist.lower + (dist.upper - dist.lower) * rng.random(3000) for dist in problem.fleet.parameters.values()]
    ).T
    members[:4] = problem.fleet.corners
    fine, fleet = np.repeat(controls, 40, axis=0), problem.fleet
    states = fleet.trajectories(fine, members, 6.0 / len(fine))
    times = np.linspace(0.0, 6.0, len(fine) + 1)
    for name, center, radius, velocity in (("tree", [1.5, -0.8], 0.5, [0, 0]), ("ball", [2, 2.5], 0.3, [0.1, -0.2])):
        seen = np.hypot(*(states[:, :, :2] - (np.array(center) + times[:, None] * velocity)).T).min() - radius - 0.1
        bound = next(one for one in found.clearances if one.obstacle == name)
        assert bound.proven <= seen + 1e-9
        least = min(least, seen)
        run = next(
            one for one in replay(problem, controls, parameters=members, substeps=40).clearances if one.obstacle == name
        )
        assert run.distance == pytest.approx(seen, abs=1e-9)
    if least > 0:
        assert min(one.proven for one in found.clearances) == pytest.approx(least, abs=5e-3)


def test_a_disc_and_the_polygon_around_it_are_two_questions() -> None:
    problem = load_text(CONFIG)
    disc = problem.obstacles["tree"][0]
    other = problem.with_(obstacles={**problem.obstacles, "tree": Obstacle._of(disc.A, disc.b, disc.vertices)})
    region = problem.regions["goal"]
    third = problem.with_(regions={"goal": Polyhedron(region.A, region.lower, region.upper)})
    controls = np.zeros((12, 2))
    assert len({fingerprint(one, controls, problem.fleet.parameters) for one in (problem, other, third)}) == 3


def test_discs_survive_writing_and_the_checker_reads_them() -> None:
    problem = load_text(CONFIG)
    again, plain = load_text(dump(problem)), problem_of(proven_part(to_data(problem)))
    controls = np.zeros((12, 2))
    prints = {fingerprint(one, controls, one.fleet.parameters) for one in (problem, again, plain)}
    assert len(prints) == 1
    assert "center: [3.0, 1.0]" in dump(problem)


def test_discs_from_python_stand_for_regions_and_obstacles() -> None:
    problem = load_text(CONFIG).with_(
        regions={"goal": Disc([3, 1], 1)}, obstacles={"tree": Disc([1.5, -0.8], 0.5)}, motions={}
    )
    assert isinstance(problem.regions["goal"], DiscRegion)
    assert ec.Disc is Disc
    kept = problem.with_(task="G not in(goal)").specification.avoid[0].pieces[0]
    assert isinstance(kept, Disc)


def test_planar_odes_keep_out_of_discs() -> None:
    text = """
version: 1
name: ball
fleet:
  model: double_integrator
  parameters: {mass: {range: [0.9, 1.1]}}
  start: {x: 0, y: 0, vx: 0, vy: 0}
  input_bounds: {fx: [-1, 1], fy: [-1, 1]}
horizon: {duration: 4, steps: 8}
regions: {goal: {disc: {center: [3, 0], radius: 1}}}
obstacles: {tree: {disc: {center: [1, -1], radius: 0.4}}, ball: {disc: {center: [0, 2], radius: 0.4}}}
motions: {ball: {velocity: [0.2, -0.1]}}
task: "G avoid(obstacles)"
"""
    problem = load_text(text)
    controls = np.tile([[0.3, 0.02]], (8, 1))
    members = np.linspace(0.9, 1.1, 41)[:, None]
    states = problem.fleet.trajectories(np.repeat(controls, 50, axis=0), members, 0.01)
    path = states[:, :, problem.fleet.place_columns]
    times = np.linspace(0.0, 4.0, path.shape[1])
    found = {one.obstacle: one for one in certify(problem, controls).clearances}
    for name, centre in (("tree", np.array([[1.0, -1.0]])), ("ball", [0, 2] + times[:, None] * [0.2, -0.1])):
        seen = np.hypot(*(path - centre).T).min() - 0.4
        assert found[name].proven <= seen + 1e-9
        assert found[name].proven == pytest.approx(seen, abs=2e-3 if name == "tree" else 2e-2)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("{center: [2, 2], radius: 0}", "obstacles.tree.disc.radius"),
        ("{center: [2, 2, 1], radius: 1}", "obstacles.tree.disc.center"),
        ("{centre: [2, 2], radius: 1}", "center"),
        ("{center: [2, 2], radius: 3 kg}", "obstacles.tree.disc.radius"),
    ],
)
def test_bad_discs_are_refused_at_their_line(given: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said.replace(".", r"\.")):
        load_text(CONFIG.replace("{center: [1.5, -0.8], radius: 50 cm}", given))


def test_bad_discs_from_python_are_refused() -> None:
    for center, radius in (([1, 2, 3], 1.0), ([1, np.nan], 1.0), ([1, 2], -1.0), ([1, 2], np.inf), ([1e9, 0], 1.0)):
        with pytest.raises(ProblemError, match=r"Disc\.(center|radius)"):
            Disc(center, radius)


def test_a_start_in_the_corner_of_the_surrounding_polygon_is_no_error() -> None:
    angle = 2 * np.pi * 24.5 / 32
    start = np.array([2, 2.5]) + np.array([np.cos(angle), np.sin(angle)])
    near = CONFIG.replace("position: [0, 0]", f"position: {start.tolist()}")
    load_text(near.replace("radius: 0.3}", "radius: 0.899}"))
    with pytest.raises(ConfigError, match="deep inside obstacle 'ball'"):
        load_text(near.replace("radius: 0.3}", "radius: 0.901}"))


def test_a_moving_disc_is_where_its_motion_says() -> None:
    motion = Motion.steady([0.5, 0.0], 4.0)
    assert float(Disc([0, 0], 1).distance(np.array([4.0, 0.0]) - motion.at(4.0))) == pytest.approx(1.0)
