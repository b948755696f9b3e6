"""The interior-point method, against SciPy's on the same program with its shortfalls written out."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import LinearConstraint, minimize

from ensemble_ctrl.ocp.solvers.quadratic import Quadratic, solve_quadratic
from tests.examples import examples


def random_program(seed: int, n: int, m: int) -> Quadratic:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n)) * (rng.random(n) < 0.8)
    low = -rng.uniform(0.1, 2, n)
    return Quadratic(
        root @ root.T + 1e-3 * np.eye(n), rng.normal(size=n), rng.normal(size=(m, n)), rng.normal(size=m),
        10.0, low, low + rng.uniform(0.2, 3, n),
    )  # fmt: skip


def cost(program: Quadratic, z: np.ndarray) -> float:
    short = np.maximum(program.b - program.A @ z, 0.0).sum()
    return float(0.5 * z @ program.H @ z + program.g @ z + program.penalty * short)


@examples(25)
@given(st.integers(0, 10_000), st.integers(1, 8), st.integers(0, 12))
def test_no_other_solver_finds_a_lower_cost(seed: int, n: int, m: int) -> None:
    q = random_program(seed, n, m)
    z, count = solve_quadratic(q, 1e-8, 60)
    assert count < 60
    assert (z >= q.lower).all()
    assert (z <= q.upper).all()

    def smooth(x: np.ndarray) -> float:
        return float(0.5 * x[:n] @ q.H @ x[:n] + q.g @ x[:n] + q.penalty * x[n:].sum())

    start = np.concatenate([z, np.maximum(q.b - q.A @ z, 0.0) + 1e-3])
    rows = [LinearConstraint(np.hstack([q.A, np.eye(m)]), q.b, np.inf)] if m else []
    bounds = [*zip(q.lower, q.upper, strict=True), *[(0, None)] * m]
    other = minimize(smooth, start, method="SLSQP", bounds=bounds, constraints=rows, options={"ftol": 1e-12})
    assert cost(q, z) <= cost(q, np.clip(other.x[:n], q.lower, q.upper)) + 1e-5


def test_a_row_that_can_not_be_kept_falls_short_by_as_little_as_possible() -> None:
    q = Quadratic(np.eye(1), np.zeros(1), np.ones((1, 1)), np.array([5.0]), 10.0, np.array([-1.0]), np.array([2.0]))
    z, _ = solve_quadratic(q, 1e-9)
    assert z[0] == pytest.approx(2.0, abs=1e-6)


def test_a_row_is_given_up_where_it_costs_more_than_its_price() -> None:
    """Minimise 50 z^2 with z >= 1 at 10 a unit: z = 0.1."""
    one = np.ones(1)
    q = Quadratic(100 * np.eye(1), np.zeros(1), np.ones((1, 1)), one, 10.0, -one, one)
    assert solve_quadratic(q, 1e-9)[0][0] == pytest.approx(0.1, abs=1e-6)


def test_time_runs_out_within_the_bounds() -> None:
    q = random_program(1, 30, 60)
    z, count = solve_quadratic(q, 1e-12, 2)
    assert count == 2
    assert ((z >= q.lower) & (z <= q.upper)).all()
