"""A nonlinear program made of small functions, each repeated over many places of the decision vector.

The program is

    minimise    sum over terms  sum over instances  f(x[columns], data)
    subject to  lower <= g(x[columns], data) <= upper     for every block and instance
                x_lower <= x <= x_upper

Every derivative is taken once, of the small function, and mapped over its instances; the values are then scattered
into the sparse Jacobian and Hessian.  Automatic differentiation of the whole program costs up to 100 times more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Build = Callable[[ca.SX, ca.SX], ca.SX]


@dataclass(frozen=True, eq=False)
class Block:
    """One small function over many places of the decision vector.

    Parameters
    ----------
    name : str
        What the rows say, for reports of conflicts.
    build : callable
        ``(z, data) -> expression`` on CasADi SX columns: ``z`` of ``n_z`` and ``data`` of ``n_data`` entries.
    columns : ndarray of int, shape (instances, n_z)
        Where each instance finds its ``z`` in the decision vector; no index twice in one instance.
    data : ndarray, shape (instances, n_data)
        Numbers that differ between instances.
    lower, upper : ndarray, shape (instances, n_rows)
        Bounds of the rows; for a term of the objective both are empty.
    """

    name: str
    build: Build
    columns: Ints
    data: Floats
    lower: Floats
    upper: Floats

    @property
    def instances(self) -> int:
        """How many times the function stands in the program."""
        return len(self.columns)


@dataclass(frozen=True, eq=False)
class Program:
    """The assembled program: CasADi functions of ``(x, p)`` with every derivative, and the numbers to call them with.

    ``rows[i] = (name, start, stop)`` says which rows of ``g`` belong to which block.
    """

    functions: dict[str, ca.Function]
    nlp: dict[str, ca.MX]
    parameters: Floats
    lower: Floats
    upper: Floats
    rows: tuple[tuple[str, int, int], ...]


@dataclass(frozen=True, eq=False)
class _Mapped:
    """A block's value and derivatives over all instances, as flat vectors, with the places they belong to."""

    value: ca.MX
    jacobian: ca.MX
    jacobian_places: Ints
    hessian: ca.MX
    hessian_places: Ints


def assemble(size: int, blocks: Sequence[Block], terms: Sequence[Block]) -> Program:
    """Build the program of `size` decision variables from constraint `blocks` and objective `terms`."""
    x = ca.MX.sym("x", size)
    data = [b.data.ravel() for b in (*blocks, *terms)]
    p = ca.MX.sym("p", sum(d.size for d in data))
    # data of all blocks one after the other in p, rows of all blocks one after the other in g
    starts = np.concatenate([[0], np.cumsum([d.size for d in data])]).astype(int)
    pieces = [p[int(starts[i]) : int(starts[i + 1])] for i in range(len(data))]
    row_counts = [b.lower.size for b in blocks]
    row_starts = np.concatenate([[0], np.cumsum(row_counts)]).astype(int)
    n_rows = int(row_starts[-1])
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", n_rows)
    mapped = [
        _map(b, x, pieces[i], lam_g[int(row_starts[i]) : int(row_starts[i + 1])], int(row_starts[i]))
        for i, b in enumerate(blocks)
    ]
    costs = [_map(t, x, pieces[len(blocks) + i], ca.repmat(lam_f, t.instances, 1), 0) for i, t in enumerate(terms)]
    g = ca.vertcat(*[m.value for m in mapped]) if mapped else ca.MX(0, 1)
    f = sum((ca.sum1(c.value) for c in costs), ca.MX(0))
    # grad f, J and the upper triangle of the Hessian of lam_f f + lam_g . g, from the instances' values
    gradient = _scatter([(c.jacobian_places * np.array([0, 1]), c.jacobian) for c in costs], (1, size)).T
    jacobian = _scatter([(m.jacobian_places, m.jacobian) for m in mapped], (n_rows, size))
    hessian = _scatter([(m.hessian_places, m.hessian) for m in (*mapped, *costs)], (size, size))
    functions = {
        "grad_f": ca.Function("nlp_grad_f", [x, p], [f, ca.densify(gradient)], ["x", "p"], ["f", "grad:f:x"]),
        "jac_g": ca.Function("nlp_jac_g", [x, p], [g, jacobian], ["x", "p"], ["g", "jac:g:x"]),
        "hess_lag": ca.Function(
            "nlp_hess_l",
            [x, p, lam_f, lam_g],
            [hessian],
            ["x", "p", "lam:f", "lam:g"],
            ["triu:hess:gamma:x:x"],
        ),
        "g": ca.Function("g", [x, p], [g]),
    }
    return Program(
        functions=functions,
        nlp={"x": x, "p": p, "f": f, "g": g},
        parameters=np.concatenate(data) if data else np.zeros(0),
        lower=np.concatenate([b.lower.ravel() for b in blocks]) if blocks else np.zeros(0),
        upper=np.concatenate([b.upper.ravel() for b in blocks]) if blocks else np.zeros(0),
        rows=tuple((b.name, int(row_starts[i]), int(row_starts[i + 1])) for i, b in enumerate(blocks)),
    )


def _map(block: Block, x: ca.MX, data: ca.MX, multipliers: ca.MX, first_row: int) -> _Mapped:
    """Value, Jacobian and Hessian of the block's function at every instance."""
    n_z, n_data = block.columns.shape[1], block.data.shape[1]
    z, d = ca.SX.sym("z", n_z), ca.SX.sym("d", n_data)
    value = ca.densify(block.build(z, d))
    lam = ca.SX.sym("l", value.numel())
    jacobian = ca.jacobian(value, z)
    hessian = ca.triu(ca.hessian(ca.dot(lam, value), z)[0])
    # gather z of every instance, map value, Jacobian and Hessian of the small function over all of them
    n = block.instances
    place = ca.reshape(x[block.columns.ravel().tolist()], n_z, n)
    per_data = ca.reshape(data, n_data, n)
    first = ca.Function("first", [z, d], [value, _nonzeros(jacobian)]).map(n)
    second = ca.Function("second", [z, d, lam], [_nonzeros(hessian)]).map(n)
    values, slopes = first(place, per_data)
    curvatures = second(place, per_data, ca.reshape(multipliers, value.numel(), n))
    # where each instance's non-zeros stand in the whole Jacobian, and in the upper triangle of the Hessian
    row, column = (np.array(i, dtype=np.int64) for i in jacobian.sparsity().get_triplet())
    upper, lower = (np.array(i, dtype=np.int64) for i in hessian.sparsity().get_triplet())
    rows = first_row + np.arange(n)[:, None] * value.numel() + row
    ends = np.stack([block.columns[:, upper], block.columns[:, lower]], -1)
    return _Mapped(
        value=ca.vec(values),
        jacobian=ca.vec(slopes),
        jacobian_places=np.stack([rows, block.columns[:, column]], -1).reshape(-1, 2),
        hessian=ca.vec(curvatures),
        hessian_places=np.sort(ends, -1).reshape(-1, 2),
    )


def _nonzeros(matrix: ca.SX) -> ca.SX:
    """The structural non-zeros of `matrix` as a dense column."""
    return matrix.nz[:] if matrix.nnz() else ca.SX(0, 1)


def _scatter(parts: Sequence[tuple[Ints, ca.MX]], shape: tuple[int, int]) -> ca.MX:
    """Sum the parts' values into one sparse matrix at their (row, column) places."""
    places = np.concatenate([p for p, _ in parts]) if parts else np.zeros((0, 2), np.int64)
    if not len(places):
        return ca.MX(*shape)
    # number the distinct places column by column; values at the same place are summed by a 0/1 matrix
    key = places[:, 1] * shape[0] + places[:, 0]
    unique, inverse = np.unique(key, return_inverse=True)
    rows, columns = unique % shape[0], unique // shape[0]
    sparsity = ca.Sparsity.triplet(shape[0], shape[1], rows.tolist(), columns.tolist())
    values = ca.vertcat(*[v for _, v in parts])
    if len(unique) == len(key):
        return ca.MX(sparsity, values[np.argsort(inverse).tolist()])
    one_a_column = ca.Sparsity(len(unique), len(key), list(range(len(key) + 1)), inverse.tolist())
    return ca.MX(sparsity, ca.mtimes(ca.MX(ca.DM(one_a_column, 1.0)), values))
