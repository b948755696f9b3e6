"""The paper's rows on moments, each against its formula: which grid times, which orders, which bounds.

Every test moves the fleet at one grid time only, from where nothing is required of it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import logsumexp

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.solid import Solid
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.ocp.hyperplanes import separate
from ensemble_ctrl.ocp.layout import Layout
from ensemble_ctrl.ocp.moment_form import Read, moment_blocks
from ensemble_ctrl.ocp.program import Block, assemble
from ensemble_ctrl.ocp.task import SHARPNESS
from ensemble_ctrl.ocp.transcription import Avoiding, Iterate, transcribe
from ensemble_ctrl.ocp.truncation import Truncation
from ensemble_ctrl.problem import Objective, Problem, SolveOptions
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import Quadrotor

from .problems import FLEET

Floats = NDArray[np.float64]
ORDER, STEPS, STEP, MARGIN, RADIUS = 3, 12, 0.5, 0.01, 0.1
TRUNCATION = Truncation((ORDER,), (ORDER,), hull=False)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(ORDER + 1)
PHI = np.polynomial.legendre.legvander(NODES, ORDER) * np.sqrt((2 * np.arange(ORDER + 1) + 1) / 2)
AWAY = np.array([-1.0, -1.0])
BLOCK = Obstacle.polygon([[1, 0], [3, 0], [3, 2], [2, 3], [1, 2]])
ROOM = Polyhedron([[1, 0], [-1, 0], [0, 1], [-1, -1]], [-3, -4, -2, -5], [np.inf] * 4)
"""Two opposite sides, and two without an opposite one."""
M = 4 * 8.0
"""Four times the size of the map, whose furthest corner is the room's at (-3, 8)."""


def problem_of(task: str) -> Problem:
    """A block to avoid and a room to stay in."""
    fleet = FLEET.with_(position=AWAY, radius=RADIUS)
    problem = Problem("p", fleet, STEPS * STEP, STEPS, parse(task), {"room": ROOM}, {"block": (BLOCK,)})
    return problem.with_(solve=replace(problem.solve, guarantee="moment", margin=MARGIN))


def rows_of(problem: Problem) -> tuple[list[Block], Layout]:
    """The rows of the program."""
    layout = Layout(STEPS, TRUNCATION.count)
    return moment_blocks(problem, TRUNCATION, Read(layout.points, TRUNCATION.to_moments, TRUNCATION.mean)), layout


def broken(problem: Problem, at: int, robots: Floats) -> bool:
    """Whether some row is broken with the node robots at `robots`, shape (nodes, 2), at one grid time."""
    blocks, layout = rows_of(problem)
    curve = np.tile(AWAY, (STEPS + 1, ORDER + 1, 1))
    curve[at] = robots
    x = np.zeros(layout.size)
    x[layout.points] = np.concatenate([curve[..., 0], curve[..., 1]], axis=1)
    program = assemble(layout.size, blocks, [])
    g = np.array(program.functions["g"](x, program.parameters)).ravel()
    return bool(((g < program.lower) | (g > program.upper)).any())


def moments(robots: Floats) -> Floats:
    """Moments of the node robots by the Gauss rule, shape (orders, 2)."""
    return np.asarray((PHI * WEIGHTS[:, None]).T @ robots)


def robots_of(moments: Floats) -> Floats:
    """Node robots that have these moments."""
    return np.asarray(PHI @ moments)


@pytest.mark.parametrize(
    ("task", "times"),
    [
        ("G avoid(block)", range(1, 13)),
        ("G[2,4] avoid(block)", range(4, 9)),
        ("G[1.8,4.2] avoid(block)", range(3, 10)),
        ("G[0,3] avoid(block)", range(1, 7)),
    ],
)
def test_the_mean_keeps_out_at_both_ends_of_every_step_of_the_window(task: str, times: range) -> None:
    problem = problem_of(task)
    inside = np.tile([2.0, 1.0], (ORDER + 1, 1))
    assert [k for k in range(STEPS + 1) if broken(problem, k, inside)] == list(times)


def smooth_clearance(place: Floats) -> float:
    """``log(mean(exp(K c))) / K`` of the clearances c of the facets, never above the largest, metres."""
    clearance = -(BLOCK.A @ place - BLOCK.b) / np.linalg.norm(BLOCK.A, axis=1) - RADIUS
    return float(np.log(np.mean(np.exp(SHARPNESS * clearance))) / SHARPNESS)


def test_the_mean_may_be_as_near_as_the_smooth_or_allows_wherever_members_are() -> None:
    problem = problem_of("G avoid(block)")
    spread = 0.5 * moments(np.column_stack([NODES, -NODES]))
    for facet, normal in zip(np.array([[2, 0], [3, 1], [2.5, 2.5], [1.5, 2.5], [1, 1]]), -BLOCK.A, strict=True):
        found = []
        for away in np.linspace(-0.1, 0.5, 41):
            place = facet + away * normal / np.linalg.norm(normal)
            assert smooth_clearance(place) <= BLOCK.distance(place) - RADIUS + 1e-12
            spread[0] = np.sqrt(2) * place
            found.append(smooth_clearance(place) < MARGIN)
            assert broken(problem, 5, robots_of(spread)) == found[-1]
        assert len(set(found)) == 2


def test_the_rows_follow_an_obstacle_that_moves() -> None:
    problem = problem_of("G avoid(block)")
    moving = problem.with_(motions={"block": Motion.steady([2.0, 0.0], 6.0)})
    for k in range(1, STEPS + 1):
        there = np.tile([2.0 + k, 1.0], (ORDER + 1, 1))
        assert broken(moving, k, there)
        assert broken(problem, k, there) == (k == 1)


@pytest.mark.parametrize("order", range(1, ORDER + 1))
@pytest.mark.parametrize("axis", [[1.0, 0.0], [0.0, 1.0], [0.6, 0.8]])
def test_the_higher_moments_are_bounded_by_big_m(order: int, axis: list[float]) -> None:
    """``eq:setPolyObsArr``: orders 1..N have no binary, so the bounds are those of every facet."""
    problem, bounds = problem_of("G avoid(block)"), BLOCK.big_m_bounds(TRUNCATION.basis, M)
    length = np.linalg.norm(BLOCK.A, axis=1)
    low, high = bounds.lower[order] / length, bounds.upper[order] / length
    found = []
    for size in (*np.linspace(1, 60, 30), *-np.linspace(1, 60, 30)):
        m = np.zeros((ORDER + 1, 2))
        m[0], m[order] = np.sqrt(2) * AWAY, size * np.array(axis)
        along = BLOCK.A @ m[order] / length
        wanted = bool(((along < low) | (along > high)).any())
        assert broken(problem, 7, robots_of(m)) == wanted
        found.append(wanted)
    assert len(set(found)) == 2


def test_big_m_grows_with_the_way_of_an_obstacle_and_with_the_target() -> None:
    """A fleet spread as wide as the map is large breaks no row."""
    far = problem_of("G avoid(block)").with_(motions={"block": Motion.steady([0.0, 10.0], 6.0)})
    near = problem_of("G avoid(block)")
    aimed = near.with_(objective=Objective(1.0, np.array([60.0, 0.0]), 1.0, 0.1))
    wide = np.outer(NODES, [0.0, 60.0]) + AWAY
    assert [broken(problem, 7, wide) for problem in (near, far, aimed)] == [True, False, False]


@pytest.mark.parametrize("order", range(ORDER + 1))
@pytest.mark.parametrize(("task", "times"), [("G in(room)", range(1, 13)), ("G[2,4] in(room)", range(4, 9))])
def test_every_moment_of_a_fleet_in_a_region_is_bounded(order: int, task: str, times: range) -> None:
    """``eq:polyhedron_moment``."""
    problem = problem_of(task)
    low, high = ROOM.moment_bounds(TRUNCATION.basis)
    assert np.isfinite([low, high]).all()
    rng, found = np.random.default_rng(order), []
    for at in range(STEPS + 1):
        m = np.zeros((ORDER + 1, 2))
        m[0] = np.sqrt(2) * AWAY
        m[order] += rng.uniform(0, 8) * rng.normal(size=2)
        outside = bool((((m @ ROOM.A.T) < low) | ((m @ ROOM.A.T) > high)).any())
        assert broken(problem, at, robots_of(m)) == (outside and at in times)
        found.append(outside and at in times)
    assert len(set(found)) == 2


CUBE = [[0.5, 1.5], [-0.5, 0.5], [1.0, 2.0]]
HALL = Polyhedron.box([[-4, 4], [-3, 3], [0, 5]])


def test_rows_of_full_states_in_space() -> None:
    """Quadrotors whose node states are moved at one grid time: rows break where their moments break the formulas."""
    fleet = Fleet(Quadrotor(mass=6), {"payload": Interval(0, 0.5)}, position=[-1, -1, 3], radius=RADIUS)
    solve = SolveOptions(guarantee="moment", margin=MARGIN)
    task = parse("G avoid(cube) and G in(hall)")
    problem = Problem("p", fleet, 0.2, 2, task, {"hall": HALL}, {"cube": (Solid.box(CUBE),)}, solve=solve)
    hover = np.tile(fleet.rest(fleet.center), (2, 1))
    model = transcribe(problem, TRUNCATION, Iterate(hover), nothing(ORDER + 1)).model
    blocks = moment_blocks(problem, TRUNCATION, Read.of(TRUNCATION, model))
    program = assemble(model.layout.size, blocks, [])
    (lower, upper), (low, high) = np.array(CUBE).T, HALL.moment_bounds(TRUNCATION.basis)
    rng, found = np.random.default_rng(0), []
    for _ in range(200):
        curve = model.curve.copy()
        apart = np.outer(NODES, rng.normal(size=3) * rng.choice([0.1, 2.0]))
        curve[2, :, :3] = [1, 0, 1.5] + 0.6 * rng.normal(size=3) + apart
        x = np.zeros(model.layout.size)
        x[model.layout.points] = curve.transpose(0, 2, 1).reshape(len(curve), -1)
        g = np.array(program.functions["g"](x, program.parameters)).ravel()
        m = moments(curve[2, :, :3])
        away = np.concatenate([m[0] / np.sqrt(2) - upper, lower - m[0] / np.sqrt(2)]) - RADIUS
        inside = logsumexp(SHARPNESS * away, b=1 / 6) / SHARPNESS < MARGIN
        outside = bool((((m @ HALL.A.T) < low) | ((m @ HALL.A.T) > high)).any())
        assert bool(((g < program.lower - 1e-9) | (g > program.upper + 1e-9)).any()) == (inside or outside)
        found.append((bool(inside), outside))
    assert len(set(found)) >= 3


def nothing(points: int) -> Avoiding:
    """No hyperplanes."""
    planes = separate(np.zeros((3, points, 3)), (), 0.2)
    return Avoiding(planes, planes.active)
