r"""Chebyshev polynomials in the time within a step and in the scaled parameters, and the matrices that act on them.

A polynomial is ``sum c[i, a] T_i(tau) T_{a_1}(s_1) ... T_{a_p}(s_p)`` with ``|tau| <= 1`` and ``|s_k| <= 1``: `i` runs
over the degrees in time, `a` over the exponents with ``a_1 / d_1 + ... + a_p / d_p <= 1``, in the order of that sum:
parameters that bend the states more have a higher degree. Every ``T`` is at most 1 in absolute value, so that
``sum |c|`` bounds the polynomial.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from math import lcm

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

UNIT = 2.0**-53
"""Unit roundoff of double precision."""
UP = 1 + 1e-12
"""Factor that makes up for the roundings of a sum of up to 8,000 non-negative terms."""


@dataclass(frozen=True)
class Basis:
    """The polynomials of degree below `times` in time and of weighted total degree at most one in the parameters.

    Parameters
    ----------
    times : int
        Coefficients along time, at least 2.
    degrees : tuple of int
        Largest degree in each parameter, each at least 1.
    """

    times: int
    degrees: tuple[int, ...]

    @property
    def parameters(self) -> int:
        """How many parameters there are."""
        return len(self.degrees)

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of the coefficients of one polynomial."""
        return self.times, len(self.exponents)

    @cached_property
    def exponents(self) -> Ints:
        """Exponents of the parameters, shape (terms, parameters), in the order of their weighted degree."""
        return _exponents(self.degrees, 1)

    @cached_property
    def highest(self) -> NDArray[np.bool_]:
        """Which terms have no term above them in each parameter, shape (terms, parameters)."""
        known = set(map(tuple, self.exponents.tolist()))
        above = self.exponents[:, None] + np.eye(self.parameters, dtype=np.int64)
        return np.array([[tuple(e) not in known for e in row] for row in above.tolist()]).reshape(self.exponents.shape)

    @cached_property
    def to_times(self) -> Floats:
        """Coefficients to values at the nodes in time, shape (times, times)."""
        return cosines(self.times, self.times)

    @cached_property
    def from_times(self) -> Floats:
        """Values at the nodes in time to coefficients, shape (times, times)."""
        return inverse(self.times)

    @cached_property
    def points(self) -> Floats:
        """Nodes in the parameters, shape (nodes, parameters), each coordinate from -1 to 1."""
        # Chebyshev nodes cos((2 j + 1) pi / 2 n), n = d + 1: T_1 at the nodes is the node
        lines = [cosines(d + 1, 2)[:, 1] for d in self.degrees]
        return np.array(list(product(*lines))).reshape(-1, self.parameters) if lines else np.zeros((1, 0))

    @cached_property
    def to_points(self) -> Floats:
        """Coefficients to values at the nodes in the parameters, shape (nodes, terms)."""
        found = np.ones((len(self.points), len(self.exponents)))
        # prod_k T_{a_k} at every node of the tensor grid
        nodes = np.array(list(product(*(range(d + 1) for d in self.degrees))), dtype=np.int64)
        for k, d in enumerate(self.degrees):
            found *= cosines(d + 1, d + 1)[nodes[:, k, None], self.exponents[:, k]]
        return found

    @cached_property
    def from_points(self) -> Floats:
        """Values at the nodes in the parameters to coefficients, shape (terms, nodes); higher terms are dropped."""
        # discrete orthogonality: 1 / n for T_0, 2 / n for the others, in each parameter
        weight = np.where(self.exponents == 0, 1.0, 2.0).prod(axis=1) / len(self.points)
        return np.asarray(weight[:, None] * self.to_points.T)

    @cached_property
    def derivative(self) -> Floats:
        """Coefficients to those of the derivative by tau, shape (times, times): whole numbers, exact."""
        # T_k' = 2 k (T_(k-1) + T_(k-3) + ...), with half of T_0
        matrix = np.zeros((self.times, self.times))
        for k in range(1, self.times):
            matrix[k - 1 :: -2, k] = 2.0 * k
        matrix[0] /= 2
        return matrix

    @cached_property
    def middle_time(self) -> Floats:
        """Values of the polynomials in time at 0, shape (times,): whole numbers."""
        return np.resize([1.0, 0.0, -1.0, 0.0], self.times)

    @cached_property
    def middle_cell(self) -> Floats:
        """Values of the terms at the middle of the cell, shape (terms,): whole numbers."""
        return np.asarray(np.array([1.0, 0.0, -1.0, 0.0])[self.exponents % 4].prod(axis=1))

    def in_parameter(self, parameter: int, low: float, high: float) -> Floats:
        """Coefficients to those on a part of the range of one parameter, shape (terms, terms).

        Entries are those of `restriction`, so that its error holds here, too.
        """
        key = parameter, low, high
        if key not in self._parts:
            # the change of basis in one parameter; exponents of the others stay the same
            line = restriction(self.degrees[parameter] + 1, low, high)
            rest = np.delete(self.exponents, parameter, axis=1)
            alike = (rest[:, None] == rest[None]).all(axis=2)
            powers = self.exponents[:, parameter]
            self._parts[key] = np.where(alike, line[powers[:, None], powers[None]], 0.0)
        return self._parts[key]

    @cached_property
    def _parts(self) -> dict[tuple[int, float, float], Floats]:
        """Matrices of `in_parameter`, kept."""
        return {}

    @cached_property
    def doubled(self) -> Doubled:
        """What products of two polynomials need."""
        return Doubled(self)

    def line(self, parameter: int) -> int:
        """The term that is the parameter itself."""
        wanted = np.zeros(self.parameters, dtype=int)
        wanted[parameter] = 1
        return int(np.flatnonzero((self.exponents == wanted).all(axis=1))[0])


class Doubled:
    """Products: values at twice as many nodes in time, and a table of the products of terms in the parameters.

    Attributes
    ----------
    to_times, from_times : ndarray, shapes (2 times - 1, times) and (2 times - 1, 2 times - 1)
        Coefficients to values at the nodes, and values to the coefficients of the product.
    terms : int
        Terms of a product: those of total degree up to twice that of the factors.
    error : float
        Times the two sums of absolute coefficients: a bound of all the roundings of one product.
    flat_error : float
        The same where one factor is constant in time: each pair is rounded once, and at most so many are summed.
    spent : float
        Products of coefficients so far.
    """

    def __init__(self, basis: Basis) -> None:
        self.count = 2 * basis.times - 1
        self.to_times = cosines(self.count, basis.times)
        self.from_times = inverse(self.count)
        self.table, self.terms, most = _products(basis.degrees)
        self.error = _product_error(basis.times, self.count, most)
        self.flat_error = (most + 2) * UNIT * UP
        self.spent = 0.0


def _product_error(times: int, count: int, most: int) -> float:
    """The bound of the roundings of a product; the derivation is in ``docs/proof_systems.md``.

    Values at the nodes are sums of `times` products with cosines that are right to 8 roundings; their product is summed
    over at most `most` pairs; interpolation magnifies errors at the nodes by its Lebesgue constant, below
    ``1 + log(count)``; the matrix to the coefficients has absolute row sums of at most 2.
    """
    at_nodes = 2 * (times + 10) + most + 4
    back = 2 * count * (count + 12)
    return (at_nodes * (1 + float(np.log(count))) + back) * UNIT * UP


@lru_cache(maxsize=64)
def cosines(nodes: int, degrees: int) -> Floats:
    """``T_k`` at the Chebyshev nodes, shape (nodes, degrees), each entry right to 8 roundings of 1.

    The angle ``k (2 j + 1) pi / (2 nodes)`` is reduced in whole numbers, so that the cosine is one of an angle of at
    most a quarter turn.
    """
    # k (2 j + 1) in units of pi / 2 n: modulo a whole turn, then by symmetry to a quarter turn
    turn = (np.arange(degrees) * (2 * np.arange(nodes)[:, None] + 1)) % (4 * nodes)
    turn = np.minimum(turn, 4 * nodes - turn)
    sign = np.where(turn > nodes, -1.0, 1.0)
    angle = np.minimum(turn, 2 * nodes - turn) * (np.pi / (2 * nodes))
    return np.asarray(sign * np.where(angle == np.pi / 2, 0.0, np.cos(angle)))


@lru_cache(maxsize=64)
def inverse(nodes: int) -> Floats:
    """Values at the Chebyshev nodes to coefficients, shape (nodes, nodes)."""
    # c_k = 2 / n sum_j T_k(x_j) f(x_j), half of that for k = 0
    matrix = 2.0 / nodes * cosines(nodes, nodes).T
    matrix[0] /= 2
    return np.asarray(matrix)


@lru_cache(maxsize=256)
def restriction(count: int, low: float, high: float) -> Floats:
    """Coefficients on [-1, 1] to those of the same polynomial on [low, high] scaled to [-1, 1], shape (count, count).

    Entries are right to ``restriction_error(count)``.
    """
    # T_k at the nodes of [low, high] by T_k = 2 x T_(k-1) - T_(k-2), interpolated on [-1, 1]
    x = (low + high) / 2 + (high - low) / 2 * cosines(count, 2)[:, 1]
    values = np.empty((count, count))
    values[:, 0] = 1.0
    if count > 1:
        values[:, 1] = x
    for k in range(2, count):
        values[:, k] = 2 * x * values[:, k - 1] - values[:, k - 2]
    return inverse(count) @ values


def restriction_error(count: int) -> float:
    """Times the sum of absolute coefficients: the error of a polynomial that was moved to a part of its range.

    The recurrence is right to ``16 count^2`` roundings at each node within [-1, 1], which interpolation magnifies by
    its Lebesgue constant; the matrix to coefficients and the sums over its product add ``2 count (2 count + 12)``.
    """
    return (16 * count**2 * (1 + float(np.log(count))) + 2 * count * (2 * count + 12) + 8) * UNIT * UP


@lru_cache(maxsize=64)
def _exponents(degrees: tuple[int, ...], times: int) -> Ints:
    """All exponents of weighted degree at most `times`, in the order of that degree; those of one set come first."""
    if not degrees:
        return np.zeros((1, 0), dtype=np.int64)
    found = np.array(list(product(*(range(times * d + 1) for d in degrees))), dtype=np.int64)
    # sum_k a_k / d_k <= times, in whole numbers
    weights = np.array([lcm(*degrees) // d for d in degrees])
    weighted = found @ weights
    kept = weighted <= times * lcm(*degrees)
    found, weighted = found[kept], weighted[kept]
    return np.asarray(found[np.lexsort((*found.T[::-1], weighted))])


@lru_cache(maxsize=32)
def _products(degrees: tuple[int, ...]) -> tuple[csc_array, int, int]:
    """The table of products of terms, its number of rows, and the most pairs that add to one row.

    ``T_a T_b`` is the mean of ``T_(a+b)`` and ``T_|a-b|`` in each parameter: column ``a * terms + b`` holds the weights
    ``2^-parameters``, which are exact.
    """
    factors, whole = _exponents(degrees, 1), _exponents(degrees, 2)
    count, parameters = len(factors), len(degrees)
    shape = tuple(2 * d + 1 for d in degrees)
    # number of each exponent of a product
    place = np.zeros(shape, dtype=np.int64)
    place[tuple(whole.T)] = np.arange(len(whole)) if parameters else 0
    a, b = (i.ravel() for i in np.meshgrid(np.arange(count), np.arange(count), indexing="ij"))
    rows = []
    # T_a T_b = (T_(a+b) + T_|a-b|) / 2 in each parameter
    for sums in product((True, False), repeat=parameters):
        e = np.where(np.array(sums, dtype=bool), factors[a] + factors[b], np.abs(factors[a] - factors[b]))
        rows.append(place[tuple(e.T)] if parameters else np.zeros(1, dtype=np.int64))
    flat, columns = np.concatenate(rows), np.tile(a * count + b, len(rows))
    weights = np.full(len(flat), 0.5**parameters)
    table = csc_array((weights, (flat, columns)), shape=(len(whole), count * count))
    return table, len(whole), int(np.bincount(flat).max())
