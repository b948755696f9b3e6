"""The assembled derivatives against CasADi's own, and the layout of the decision vector."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from ensemble_ctrl.ocp.layout import Layout
from ensemble_ctrl.ocp.program import Block, Program, assemble

Floats = NDArray[np.float64]
SIZE = 7


def curved(z: ca.SX, d: ca.SX) -> ca.SX:
    """Two rows, each with curvature, one without its second variable."""
    return ca.vertcat(d[0] * z[0] * ca.sin(z[1]) + z[2] ** 3, ca.exp(z[0] * d[1]) - z[2])


def straight(z: ca.SX, d: ca.SX) -> ca.SX:
    """One row without curvature and without data."""
    return 3 * z[0] - z[1] + 0.5


def valley(z: ca.SX, d: ca.SX) -> ca.SX:
    """A term that couples its variables."""
    return d[0] * (z[0] * z[1] - 1) ** 2


def spread(z: ca.SX, d: ca.SX) -> ca.SX:
    """A term of one variable."""
    return ca.cosh(z[0])


def block(name: str, build: object, columns: list[list[int]], data: object, rows: int) -> Block:
    """A block with bounds that tell its rows apart."""
    n = len(columns)
    numbers = np.asarray(data, dtype=float).reshape(n, -1)
    low = np.arange(n * rows, dtype=float).reshape(n, rows)
    return Block(name, build, np.array(columns), numbers, low, low + 10)  # type: ignore[arg-type]


# Places repeat: within a block, between blocks and terms, and with the order of the columns turned round.
BLOCKS = [
    block("curved", curved, [[0, 1, 2], [2, 1, 0], [4, 3, 1]], [[1.0, 2.0], [-0.5, 0.3], [0.7, -1.0]], 2),
    block("straight", straight, [[0, 1], [5, 0]], [[], []], 1),
]
TERMS = [
    block("valley", valley, [[0, 1], [1, 0], [0, 1], [4, 6]], [[1.0], [2.0], [3.0], [4.0]], 0),
    block("spread", spread, [[0], [0], [6]], [[], [], []], 0),
]


def written_out(blocks: list[Block], x: ca.MX) -> list[ca.MX]:
    """Every block's instances one by one, without `map`."""
    found = []
    for b in blocks:
        z, d = ca.SX.sym("z", b.columns.shape[1]), ca.SX.sym("d", b.data.shape[1])
        function = ca.Function("f", [z, d], [b.build(z, d)])
        found += [
            function(ca.vertcat(*[x[int(i)] for i in where]), numbers)
            for where, numbers in zip(b.columns, b.data, strict=True)
        ]
    return found


@pytest.fixture(scope="module")
def program() -> Program:
    return assemble(SIZE, BLOCKS, TERMS)


@pytest.fixture(scope="module")
def wanted() -> ca.Function:
    """Values and derivatives of the written-out program, by automatic differentiation."""
    x, lam_f, lam_g = ca.MX.sym("x", SIZE), ca.MX.sym("lam_f"), ca.MX.sym("lam_g", 8)
    g = ca.vertcat(*written_out(BLOCKS, x))
    f = sum(written_out(TERMS, x), ca.MX(0))
    hessian = ca.triu(ca.hessian(lam_f * f + ca.dot(lam_g, g), x)[0])
    return ca.Function("w", [x, lam_f, lam_g], [f, ca.gradient(f, x), g, ca.jacobian(g, x), hessian])


@pytest.mark.parametrize("seed", range(3))
def test_values_and_derivatives_are_casadis(program: Program, wanted: ca.Function, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, lam_f, lam_g = rng.normal(size=SIZE), rng.normal(), rng.normal(size=8)
    f, gradient, g, jacobian, hessian = (np.array(value) for value in wanted(x, lam_f, lam_g))
    call, p = program.functions, program.parameters
    got_f, got_gradient = call["grad_f"](x, p)
    got_g, got_jacobian = call["jac_g"](x, p)
    np.testing.assert_allclose(float(got_f), f.item(), rtol=1e-12)
    np.testing.assert_allclose(np.array(got_gradient), gradient, atol=1e-12)
    np.testing.assert_allclose(np.array(got_g), g, atol=1e-12)
    np.testing.assert_allclose(np.array(call["g"](x, p)), g, atol=1e-12)
    np.testing.assert_allclose(np.array(got_jacobian), jacobian, atol=1e-12)
    np.testing.assert_allclose(np.array(call["hess_lag"](x, p, lam_f, lam_g)), hessian, atol=1e-12)


def test_the_solver_sees_the_same_program(program: Program, wanted: ca.Function) -> None:
    function = ca.Function("nlp", [program.nlp["x"], program.nlp["p"]], [program.nlp["f"], program.nlp["g"]])
    x = np.linspace(-1, 1, SIZE)
    f, _, g, _, _ = wanted(x, 0, np.zeros(8))
    got_f, got_g = function(x, program.parameters)
    np.testing.assert_allclose(float(got_f), float(f), rtol=1e-12)
    np.testing.assert_allclose(np.array(got_g), np.array(g), atol=1e-12)


def test_rows_and_bounds_are_in_the_order_of_the_blocks(program: Program) -> None:
    assert program.rows == (("curved", 0, 6), ("straight", 6, 8))
    np.testing.assert_array_equal(program.lower, [0, 1, 2, 3, 4, 5, 0, 1])
    np.testing.assert_array_equal(program.upper, program.lower + 10)


def test_the_hessian_is_upper_triangular_and_has_no_place_twice(program: Program) -> None:
    sparsity = program.functions["hess_lag"].sparsity_out(0)
    assert sparsity.is_triu()
    places = list(zip(*sparsity.get_triplet(), strict=True))
    assert len(set(places)) == len(places)


def test_a_program_may_have_no_rows_or_no_terms() -> None:
    without_rows = assemble(SIZE, [], TERMS)
    assert without_rows.lower.shape == (0,)
    assert without_rows.functions["jac_g"](np.zeros(SIZE), without_rows.parameters)[1].shape == (0, SIZE)
    without_terms = assemble(SIZE, BLOCKS, [])
    f, gradient = without_terms.functions["grad_f"](np.zeros(SIZE), without_terms.parameters)
    assert float(f) == 0
    assert gradient.shape == (SIZE, 1)
    assert not np.array(gradient).any()


def test_the_layout_gives_every_quantity_its_own_place() -> None:
    layout = Layout(steps=5, count=3)
    first, slacks, second = layout.level(), layout.slack(4), layout.level()
    assert layout.controls.shape == (5, 2)
    assert layout.turned.shape == (6,)
    assert layout.points.shape == (6, 6)
    np.testing.assert_array_equal(layout.levels, [first, second])
    np.testing.assert_array_equal(layout.slacks, slacks)
    parts = [layout.controls, layout.turned, layout.points, layout.levels, layout.slacks]
    places = np.concatenate([part.ravel() for part in parts])
    np.testing.assert_array_equal(np.sort(places), np.arange(layout.size))
