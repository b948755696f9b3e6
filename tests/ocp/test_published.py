"""The paper's program row by row: each equation alone, against its formula by SciPy's quadrature.

Moments are given at random; a row with a wrong sign, order, time or coefficient has another value than its formula.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.special import eval_legendre, logsumexp

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import UnsupportedError
from ensemble_ctrl.moments import LegendreBasis
from ensemble_ctrl.ocp.published import Equations, PublishedProgram, PublishedTask, published_program
from ensemble_ctrl.ocp.solvers import SolverOptions, solve
from ensemble_ctrl.problem import Objective, Problem

from .problems import FLEET

Floats = NDArray[np.float64]
NOTHING = Equations(*[False] * 6)
ORDER, STEPS, DURATION, RADIUS, K, M = 3, 8, 4.0, 0.1, 20.0, 36.0
"""M is four times the furthest corner of the map, 9."""
ROOM = Polyhedron([[1, 0], [0, 1], [1, 1]], [-3, -4, -9], [8, 9, 12])
GOAL = Polyhedron([[3, 1], [0, 2]], [3, 1], [12, 4])
BLOCK = Obstacle.polygon([[1, 0], [3, 0], [3, 2], [2, 3], [1, 2]])
TASK = "G[0,3] in(room) and F[2,3.2] in(goal) and G[0.5,2.5] avoid(block)"


def problem_of(task: str = TASK, order: int = ORDER, coordinates: str = "modal") -> Problem:
    """A room to stay in, a place to visit and a block to avoid."""
    fleet = FLEET.with_(position=[0.0, -1.0], radius=RADIUS)
    aim = Objective(1.7, np.array([2.0, 1.0]), 3.0, 0.4)
    regions, obstacles = {"room": ROOM, "goal": GOAL}, {"block": (BLOCK,)}
    problem = Problem("p", fleet, DURATION, STEPS, parse(task), regions, obstacles, objective=aim, order=order)
    return problem.with_(coordinates=coordinates, solve=replace(problem.solve, guarantee="moment"))


def signed(k: int) -> tuple[float, float]:
    """Integrals of the positive and the negative part of phi_k, by adaptive quadrature."""
    edges = np.concatenate([[-1.0], np.polynomial.legendre.leggauss(k)[0] if k else [], [1.0]])
    phi = [quad(lambda s: np.sqrt(k + 0.5) * eval_legendre(k, s), a, b)[0] for a, b in pairwise(edges)]
    return sum(p for p in phi if p > 0), -sum(p for p in phi if p < 0)


PLUS, MINUS = (np.array(part) for part in zip(*(signed(k) for k in range(ORDER + 1)), strict=True))


class At:
    """A program at random moments, with the values and bounds of its rows by name."""

    def __init__(self, equations: Equations, problem: Problem | None = None, seed: int = 0) -> None:
        self.program = published_program(problem or problem_of(), np.tile([0.5, 0.3], (STEPS, 1)), equations)
        rng, layout = np.random.default_rng(seed), self.program.model.layout
        self.x = rng.normal(0.0, 1.0, len(self.program.nlp.guess))
        self.moments = self.x[layout.points].reshape(STEPS + 1, 4, -1)[:, :2].transpose(0, 2, 1)
        program = self.program.nlp.program
        self.g = np.array(program.functions["g"](self.x, program.parameters)).ravel()

    def rows(self, name: str) -> tuple[Floats, Floats, Floats]:
        """Value, lower and upper bound of all rows of that name."""
        program = self.program.nlp.program
        parts = [slice(first, last) for word, first, last in program.rows if word.startswith(name)]
        return tuple(np.concatenate([a[p] for p in parts]) for a in (self.g, program.lower, program.upper))  # type: ignore[return-value]

    @property
    def cost(self) -> float:
        """The objective."""
        program = self.program.nlp.program
        return float(program.functions["grad_f"](self.x, program.parameters)[0])


def names(program: PublishedProgram) -> set[str]:
    """Kinds of rows."""
    return {name for name, _, _ in program.nlp.program.rows}


@pytest.mark.parametrize(
    ("equation", "rows"),
    [
        ("polyhedron", {"staying in (moments)"}),
        ("obstacles", {"avoiding (eq:setPolyObsArr)"}),
        ("robustness", {"visiting (eqVisitWP)"}),
        ("terminal", set()),
        ("effort", set()),
    ],
)
def test_each_equation_can_be_seen_alone(equation: str, rows: set[str]) -> None:
    at = At(replace(NOTHING, **{equation: True}))
    assert names(at.program) == rows | {"moments"}
    assert (at.cost != 0.0) == (equation in {"robustness", "terminal", "effort"})
    assert len(at.program.nlp.discrete) == (5 * 5 if equation == "obstacles" else 0)


def test_all_of_them_are_there_unless_switched_off() -> None:
    everything = published_program(problem_of(), np.zeros((STEPS, 2)))
    assert names(everything) == {
        "moments",
        "staying in (moments)",
        "avoiding (eq:setPolyObsArr)",
        "choosing",
        "visiting (eqVisitWP)",
    }
    assert At(NOTHING).cost == 0.0


def test_polyhedron_rows_hold_the_moments_of_every_order_face_and_time() -> None:
    at = At(replace(NOTHING, polyhedron=True))
    got, lower, upper = at.rows("staying in")
    # grid times to 3 s but for the start are 1..6; b m+ - c m- <= a m_k <= c m+ - b m-
    length = np.linalg.norm(ROOM.A, axis=1)
    A, b, c = ROOM.A / length[:, None], ROOM.lower / length, ROOM.upper / length
    wanted = {}
    for t in range(1, 7):
        for j in range(3):
            for k in range(ORDER + 1):
                value = A[j] @ at.moments[t, k]
                wanted[round(value, 9)] = (b[j] * PLUS[k] - c[j] * MINUS[k], c[j] * PLUS[k] - b[j] * MINUS[k])
    assert sorted(round(v, 9) for v in got) == sorted(wanted)
    for value, low, high in zip(got, lower, upper, strict=True):
        np.testing.assert_allclose((low, high), wanted[round(value, 9)], atol=1e-9)


@pytest.mark.parametrize("coordinates", ["modal", "nodal"])
def test_obstacle_rows_are_those_of_every_facet_order_and_time(coordinates: str) -> None:
    at = At(replace(NOTHING, obstacles=True), problem_of(coordinates=coordinates))
    got, lower, upper = (part.reshape(5, 5, ORDER + 1) for part in at.rows("avoiding"))
    (facets,) = at.program.facets
    assert facets.times.tolist() == [1, 2, 3, 4, 5]
    length = np.linalg.norm(BLOCK.A, axis=1)
    moments = at.moments
    if coordinates == "nodal":
        nodes, weights = np.polynomial.legendre.leggauss(ORDER + 1)
        phi = np.stack([np.sqrt(k + 0.5) * eval_legendre(k, nodes) for k in range(ORDER + 1)])
        points = at.x[at.program.model.layout.points].reshape(STEPS + 1, 2, ORDER + 1)
        moments = np.einsum("kj,tdj->tkd", phi * weights, points)
    for i, t in enumerate(facets.times):
        for f in range(5):
            a, level = BLOCK.A[f] / length[f], BLOCK.b[f] / length[f] - RADIUS
            z = at.x[facets.binaries[i, f]]
            # -M m+ - xi m- <= a m_k + M (m+ - m-) z <= xi m+ + M m-
            np.testing.assert_allclose(got[i, f], moments[t] @ a + M * (PLUS - MINUS) * z, atol=1e-8)
            np.testing.assert_allclose(lower[i, f], -M * PLUS - (level + M) * MINUS, atol=1e-9)
            np.testing.assert_allclose(upper[i, f], (level + M) * PLUS + M * MINUS, atol=1e-9)


def test_the_numbers_of_example_2() -> None:
    box = Obstacle.box([[2, 6], [1, 3]])
    problem = problem_of("G avoid(block)").with_(obstacles={"block": (box,)}, fleet=FLEET.with_(position=[0.0, 0.0]))
    at = At(replace(NOTHING, obstacles=True), problem.with_(regions={}, objective=Objective()))
    got, lower, upper = (part.reshape(STEPS, 4, ORDER + 1) for part in at.rows("avoiding"))
    scale = 24.0 / 20.0
    bounds = box.big_m_bounds(LegendreBasis(ORDER), 24.0)
    np.testing.assert_allclose(lower[0, :, 0], -28.2842712 * scale, atol=1e-6)
    printed = [31.1126984, 24.0416306, 19.7989899, 29.6984848]
    np.testing.assert_allclose(upper[0, :, 0] - 4 * np.sqrt(2), printed, atol=1e-6)
    np.testing.assert_allclose(upper[0], bounds.upper.T, atol=1e-12)
    np.testing.assert_allclose(lower[0], bounds.lower.T, atol=1e-12)
    (facets,) = at.program.facets
    wanted = box.A @ at.moments[1, 0] + bounds.switch[0] * at.x[facets.binaries[0]]
    np.testing.assert_allclose(got[0, :, 0], wanted, atol=1e-9)


def test_one_facet_at_least_is_chosen_at_every_time() -> None:
    at = At(replace(NOTHING, obstacles=True, disjunction=True))
    got, lower, upper = at.rows("choosing")
    (facets,) = at.program.facets
    np.testing.assert_allclose(got, at.x[facets.binaries].sum(axis=1), atol=1e-12)
    assert (lower == 1).all()
    assert (upper >= 5).all()


def margins(moments: Floats) -> Floats:
    """How far both bounds of every order and face of the goal are kept at its window's times, shape (times, rows)."""
    length = np.linalg.norm(GOAL.A, axis=1)
    A, b, c = GOAL.A / length[:, None], GOAL.lower / length, GOAL.upper / length
    rows = []
    for k in range(ORDER + 1):
        low, high = b * PLUS[k] - c * MINUS[k], c * PLUS[k] - b * MINUS[k]
        rows += [moments[4:7, k] @ A.T - low, high - moments[4:7, k] @ A.T]
    return np.concatenate(rows, axis=1)


def test_visits_are_the_smooth_minimum_of_smooth_maxima_over_all_orders() -> None:
    at = At(replace(NOTHING, robustness=True))
    got, lower, upper = at.rows("visiting")
    largest = logsumexp(K * margins(at.moments), axis=0) / K
    index = at.program.model.layout._more
    assert len(got) == len(largest) == len(index) == 2 * 2 * (ORDER + 1)
    # each row is a smooth maximum over the window less its level
    columns = np.array([at.x[i] for i in index])
    program = at.program.nlp.program
    jacobian = program.functions["jac_g"](at.x, program.parameters)[1].sparse()
    levels = [i for row in _rows(at, "visiting") for i in index if jacobian[row, i]]
    found = np.sort(got + at.x[levels])
    np.testing.assert_allclose(found, np.sort(largest), atol=1e-9)
    assert (lower == 0).all()
    assert np.isinf(upper).all()
    # the reward is the weight times the smooth minimum over all levels
    assert at.cost == pytest.approx(-1.7 * -logsumexp(-K * columns) / K, abs=1e-12)


def _rows(at: At, name: str) -> list[int]:
    """Numbers of the rows of that name."""
    return [i for word, a, b in at.program.nlp.program.rows if word.startswith(name) for i in range(a, b)]


def test_levels_start_at_the_smooth_maxima_of_the_guess() -> None:
    program = published_program(problem_of(), np.tile([0.5, 0.3], (STEPS, 1)), replace(NOTHING, robustness=True))
    nlp, index = program.nlp, program.model.layout._more
    x = nlp.guess
    moments = x[program.model.layout.points].reshape(STEPS + 1, 4, -1)[:, :2].transpose(0, 2, 1)
    np.testing.assert_allclose(np.sort(x[index]), np.sort(logsumexp(K * margins(moments), axis=0) / K), atol=1e-9)
    g = np.array(nlp.program.functions["g"](x, nlp.program.parameters)).ravel()
    assert np.abs(g).max() < 1e-9


def test_the_penalties_are_the_terminal_moments_and_the_energy() -> None:
    at = At(replace(NOTHING, terminal=True))
    wanted = np.zeros((ORDER + 1, 2))
    wanted[0] = np.sqrt(2) * np.array([2.0, 1.0])
    assert at.cost == pytest.approx(3.0 * np.sum((at.moments[-1] - wanted) ** 2), rel=1e-12)
    at = At(replace(NOTHING, effort=True))
    assert at.cost == pytest.approx(0.4 * 0.5 * np.sum(at.x[at.program.model.layout.controls] ** 2), rel=1e-12)


# --- as a program


def test_a_path_through_the_block_satisfies_no_facet_and_one_around_it_does() -> None:
    at = At(replace(NOTHING, obstacles=True, disjunction=True))
    (facets,) = at.program.facets
    program, layout = at.program.nlp.program, at.program.model.layout
    for place, free in (([2.0, 1.0], False), ([3.05, 1.0], False), ([3.15, 1.0], True), ([0.8, 1.0], True)):
        x = np.zeros_like(at.x)
        n = layout.count
        x[layout.points[:, 0]], x[layout.points[:, n]] = np.sqrt(2) * np.array(place)
        x[facets.binaries] = facets.best(np.tile(place, (STEPS + 1, 1)))
        assert x[facets.binaries].sum() == 5
        g = np.array(program.functions["g"](x, program.parameters)).ravel()
        rows = _rows(at, "avoiding") + _rows(at, "choosing")
        kept = (g[rows] >= program.lower[rows] - 1e-9) & (g[rows] <= program.upper[rows] + 1e-9)
        assert kept.all() == free


def test_bonmin_chooses_facets_that_the_mean_keeps_behind() -> None:
    wall = Obstacle.box([[0.8, 1.6], [-0.6, 2.0]])
    problem = Problem(
        "wall",
        FLEET.with_(position=[0.0, 0.0], heading=0.0),
        4.0,
        6,
        parse("F[3.3,4] in(far) and G avoid(wall)"),
        {"far": Polyhedron.box([[2.5, 3.5], [-0.5, 0.5]])},
        {"wall": (wall,)},
        objective=Objective(1.0, np.array([3.0, 0.0]), 10.0, 0.1),
        order=1,
    )
    problem = problem.with_(coordinates="modal", integrator="rk4", solve=replace(problem.solve, guarantee="moment"))
    program = published_program(problem, np.tile([0.8, 0.0], (6, 1)))
    found = solve(program.nlp, SolverOptions(solver="bonmin", time_limit=60.0))
    assert found.status == "solved"
    (z,) = program.chosen(found.x)
    np.testing.assert_allclose(z, np.round(z), atol=1e-6)
    assert (z.sum(axis=1) > 1 - 1e-6).all()
    layout = program.model.layout
    mean = found.x[layout.points[:, [0, layout.count]]] / np.sqrt(2)
    outside = wall.distance(mean)
    assert (outside >= -1e-4).all()
    # the same facets given: IPOPT finds the same cost, and the relaxed program costs no more
    fixed = solve(program.fixed([np.round(z)]), SolverOptions(tolerance=1e-6))
    assert fixed.cost == pytest.approx(found.cost, rel=1e-3, abs=1e-3)
    relaxed = solve(replace(program.nlp, discrete=np.zeros(0, dtype=np.int64)), SolverOptions(tolerance=1e-6))
    assert relaxed.cost <= fixed.cost + 1e-4


@pytest.mark.parametrize("task", ["x >= 1", "F in(goal) or G in(room)", "F not in(goal)"])
def test_tasks_without_an_equation_are_refused(task: str) -> None:
    with pytest.raises(UnsupportedError, match="the paper has equations for"):
        PublishedTask.of(problem_of(task))


def test_moving_obstacles_have_no_equation() -> None:
    problem = problem_of().with_(motions={"block": Motion(np.array([0.0, 4.0]), np.array([[0.0, 0.0], [1.0, 0.0]]))})
    with pytest.raises(UnsupportedError, match="stand still, got block"):
        PublishedTask.of(problem)
