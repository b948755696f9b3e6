"""The truncated moment system in nodal coordinates, and the points that stand for the fleet's position curve.

At any time the positions of the fleet are a curve (or, with several parameters, a patch) ``s -> p(s)`` over the scaled
parameters.  Truncation at orders N keeps the polynomial through the robots at the tensor grid of Gauss nodes.  The
displacement of those robots over a step depends on the commands alone, so the decision variables need not carry their
positions: they carry the `points` that the constraints speak of, any linear image of them.

The nodes are Legendre's whatever the parameters' distributions, for the polynomial has to be close to the curve over
the whole range and is turned into points that contain it; the nodes of a distribution that leaves a part of the range
nearly empty are far worse at both.  The distributions have their say in what is averaged: mean, moments and terminal
cost are exact integrals of that polynomial against them.

Parameters that only shift the start add a constant box to every position (``Fleet.shift``): they need no nodes at all,
and rows pay for them with a constant.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.moments import (
    MAX_ORDER,
    Distribution,
    Interval,
    LegendreBasis,
    TensorBasis,
    bernstein_to_moments,
    change_of_basis,
    inner_products,
    kron,
    moments_to_bernstein,
)
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.target import MomentTarget

Floats = NDArray[np.float64]

DENSE = {0: 1, 1: 41, 2: 15, 3: 9}
"""Chebyshev points for each of so many parameters, at whose members the truncation error is measured; else 5."""
TAIL_TOLERANCE = 1e-4
"""Metres of truncation error allowed when the order, or the carried degree, is chosen automatically."""
Range = tuple[tuple[float, float], ...]
"""A range of each scaled dynamic parameter."""
UNIFORM = Interval(-1.0, 1.0)
"""The distribution of a scaled parameter unless another is given."""


@dataclass(frozen=True, eq=False)
class Truncation:
    """Which moments are kept and which points represent them.

    Parameters
    ----------
    orders : tuple of int
        Truncation order N of the moment system in each dynamic parameter.
    degrees : tuple of int
        The points carry the moments 0..degree of the position; the rest is a tail that becomes margin.
    hull : bool
        True for Bernstein coefficients, whose convex hull contains the curve; False for the Gauss-node robots.
    distributions : tuple of Distribution, optional
        What moments are taken against, one distribution for each dynamic parameter; all uniform if not given.
    cells : int
        Equal parts of the first dynamic parameter's range that have separating hyperplanes of their own.
    joint : pair of ndarray, optional
        Scaled members, shape (members, dynamic parameters), and weights that sum to 2, of a distribution that is no
        product; means and squares are over it in place of `distributions`.
    within : tuple of (float, float), optional
        A range of each scaled dynamic parameter: the members that do what a share of the fleet has to do
        (`ensemble_ctrl.ocp.chance`).
    """

    orders: tuple[int, ...]
    degrees: tuple[int, ...]
    hull: bool
    distributions: tuple[Distribution, ...] | None = None
    cells: int = 1
    joint: tuple[Floats, Floats] | None = None
    within: Range | None = None

    @cached_property
    def collocation(self) -> TensorBasis:
        """Basis whose Gauss nodes are the robots that stand for the fleet."""
        return _basis(self.orders)

    @cached_property
    def basis(self) -> TensorBasis:
        """The distributions' basis of the carried moments; of fewer, for a distribution of few values."""
        pairs = zip(self._distributions, self.degrees, strict=True)
        return TensorBasis(
            tuple(distribution.basis(min(degree, distribution.max_order)) for distribution, degree in pairs)
        )

    @property
    def nodes(self) -> Floats:
        """Gauss nodes, shape (nodes, dynamic parameters), scaled."""
        return self.collocation.nodes

    @cached_property
    def to_points(self) -> Floats:
        """Matrix from nodal positions to points, shape (points, nodes)."""
        return self.collocation.nodes_to_bernstein(self.degrees) if self.hull else np.eye(self.collocation.count)

    @property
    def count(self) -> int:
        """How many points represent the curve."""
        return len(self.to_points)

    @cached_property
    def parts(self) -> tuple[Floats, ...]:
        """For each cell the matrix from points to the points of its members alone, shape (points of the cell, points).

        Bernstein coefficients on the cell for hulls, the Gauss-node robots in it otherwise.
        """
        if self.cells == 1 or not self.orders:
            return (np.eye(self.count),)
        # cells [a, b] of the first parameter: its Bernstein coefficients on [a, b] by way of the moments
        ends = list(pairwise(np.linspace(-1.0, 1.0, self.cells + 1).tolist()))
        if not self.hull:
            # nodes in the cell, ends included: a node on an edge is in both cells
            at = self.nodes[:, 0]
            inside = [np.flatnonzero((at >= a - 1e-12) & (at <= b + 1e-12)) for a, b in ends]
            return tuple(np.eye(self.count)[rows] for rows in inside if len(rows))
        first, rest = LegendreBasis(self.degrees[0]), np.eye(self.count // (self.degrees[0] + 1))
        back = bernstein_to_moments(first)
        return tuple(np.asarray(np.kron(moments_to_bernstein(first, a, b) @ back, rest)) for a, b in ends)

    @cached_property
    def inner(self) -> Floats:
        """Matrix from points to the points of the members in `within` alone; the points themselves without one."""
        if self.within is None or not self.orders:
            return np.eye(self.count)
        if not self.hull:
            ends = np.array(self.within)
            inside = ((self.nodes >= ends[:, 0] - 1e-12) & (self.nodes <= ends[:, 1] + 1e-12)).all(axis=1)
            return np.eye(self.count)[inside] if inside.any() else np.eye(self.count)
        # Bernstein coefficients on the box, a Kronecker product over the parameters
        bases = [LegendreBasis(degree) for degree in self.degrees]
        parts = zip(bases, self.within, strict=True)
        return kron([moments_to_bernstein(basis, *ends) @ bernstein_to_moments(basis) for basis, ends in parts])

    @cached_property
    def to_moments(self) -> Floats:
        """Matrix from points to the moments they carry, under the distributions, shape (moments, points)."""
        if self._uniform:
            return self.to_legendre
        # from Legendre polynomials to those of the distributions, a Kronecker product over the parameters
        changes = [
            change_of_basis(LegendreBasis(degree), basis)
            for degree, basis in zip(self.degrees, self.basis.factors, strict=True)
        ]
        return np.asarray(kron(changes) @ self.to_legendre)

    @cached_property
    def to_legendre(self) -> Floats:
        """Matrix from points to the moments against Legendre polynomials, shape (moments, points)."""
        return _basis(self.degrees).bernstein_to_moments() if self.hull else self.collocation.nodes_to_moments()

    @cached_property
    def square(self) -> Floats:
        """Matrix of the quadratic form that is twice the fleet's mean square, shape (points, points)."""
        if self.joint is not None:
            # sum_i w_i p(s_i) . p(s_i) over the joint samples, whose weights sum to 2
            values = self.evaluation(self.joint[0])
            return np.asarray(values.T @ (self.joint[1][:, None] * values))
        # int p . p dmu = m^T (int phi phi^T dmu) m, the identity for uniform distributions
        inner = np.eye(len(self.to_legendre))
        if not self._uniform:
            pairs = zip(self._distributions, self.degrees, strict=True)
            inner = kron([inner_products(distribution, LegendreBasis(degree)) for distribution, degree in pairs])
        return np.asarray(self.to_legendre.T @ inner @ self.to_legendre)

    @cached_property
    def mean(self) -> Floats:
        """Weights of the points in the mean position, shape (points,)."""
        if self.joint is not None:
            # (1/2) sum_i w_i p(s_i); under the distributions m_0 / sqrt(2), since phi_0 = 1 / sqrt(2)
            return np.asarray(self.joint[1] @ self.evaluation(self.joint[0]) / 2)
        return np.asarray(self.to_moments[0] / np.sqrt(2.0))

    def evaluation(self, s: Floats) -> Floats:
        """Matrix from points to positions at scaled parameters `s`, shape (len(s), points)."""
        # p(s) = sum_k m_k phi_k(s), with m_k linear in the points
        return np.asarray(_basis(self.degrees).evaluate(s) @ self.to_legendre)

    @property
    def _distributions(self) -> tuple[Distribution, ...]:
        """One distribution for each dynamic parameter."""
        return (UNIFORM,) * len(self.orders) if self.distributions is None else self.distributions

    @property
    def _uniform(self) -> bool:
        """Whether all distributions are uniform."""
        return all(isinstance(distribution, Interval) for distribution in self._distributions)


def node_drives(problem: Problem, truncation: Truncation) -> Floats:
    """Drives of the Gauss-node robots, shape (nodes, 5)."""
    return problem.fleet.coefficients(problem.fleet.dynamic_members(truncation.nodes))


def positions(problem: Problem, controls: Floats, members: Floats) -> Floats:
    """Exact positions of `members` of shape (members, parameters), shape (members, steps + 1, 2), metres."""
    fleet = problem.fleet
    return fleet.arcs.paths(controls, fleet.coefficients(members), problem.duration / len(controls))


def points(problem: Problem, controls: Floats, truncation: Truncation) -> Floats:
    """The representing points under `controls`, shape (steps + 1, points, 2), metres."""
    nodal = positions(problem, controls, problem.fleet.dynamic_members(truncation.nodes))
    return np.asarray(np.einsum("ij,jtd->tid", truncation.to_points, nodal))


def occupied(problem: Problem, controls: Floats, truncation: Truncation) -> Floats:
    """The points, and those of the curve of each corner of the bodies (`ensemble_ctrl.ocp.bodies`)."""
    curve = points(problem, controls, truncation)
    own = _corners(problem, controls, problem.fleet.dynamic_members(truncation.nodes))
    # C R(g_j + b_j Omega_n) beta for every corner
    curves = np.einsum("ij,jtkd->tkid", truncation.to_points, own) + curve[:, None]
    return np.concatenate([curve, curves.reshape(len(curve), -1, 2)], axis=1)


def _corners(problem: Problem, controls: Floats, members: Floats) -> Floats:
    """Corners of members' bodies relative to their positions, (members, steps + 1, corners, 2); none of points."""
    fleet, times = problem.fleet, len(controls) + 1
    if fleet.footprint is None:
        return np.zeros((len(members), times, 0, 2))
    turned = fleet.arcs.headings(controls, fleet.coefficients(members), problem.duration / len(controls))
    return fleet.footprint.at(np.zeros((len(members), times, 2)), turned)


def tail(problem: Problem, controls: Floats, truncation: Truncation) -> float:
    """Largest distance in metres, over a dense set of members, between a member and the truncated curve.

    Notes
    -----
    An estimate from a few members, used to set margins; the claim about a plan comes from replay and certificate.
    """
    s = _dense(len(truncation.orders))
    # max |p(s) - sum of the carried moments' polynomials| on a tensor grid of Chebyshev points, corners of bodies too
    members, weights = problem.fleet.dynamic_members(s), truncation.evaluation(s)
    exact, own = positions(problem, controls, members), _corners(problem, controls, members)
    curves = occupied(problem, controls, truncation).reshape(len(controls) + 1, -1, truncation.count, 2)
    seen = np.einsum("ij,tkjd->itkd", weights, curves)
    return float(
        np.linalg.norm(np.concatenate([exact[:, :, None], exact[:, :, None] + own], axis=2) - seen, axis=-1).max()
    )


def choose(problem: Problem, controls: Floats) -> Truncation:
    """The truncation the problem asks for, with the lowest orders and degrees that `controls` need.

    Notes
    -----
    With ``order: auto`` degrees grow, each time in the parameter where that helps most, until the tail is below
    `TAIL_TOLERANCE`; in hull form the points carry no more moments than that either, since the tail of a smooth curve
    falls geometrically.
    """
    hull, dynamic = problem.solve.guarantee == "hull", len(problem.fleet.dynamic)
    if not hull and problem.order is not None:
        return _whole(problem, (problem.order,) * dynamic, hull)
    degrees = _degrees(problem, controls, hull, problem.order or MAX_ORDER)
    orders = degrees if problem.order is None else (problem.order,) * dynamic
    return replace(_whole(problem, orders, hull), degrees=degrees)


def plain(orders: tuple[int, ...], hull: bool) -> Truncation:
    """A truncation that carries all its moments, under uniform distributions."""
    return Truncation(orders, orders, hull)


def _whole(problem: Problem, orders: tuple[int, ...], hull: bool) -> Truncation:
    """A truncation of a problem's fleet that carries all its moments."""
    fleet = problem.fleet
    joint = None if fleet.samples is None else fleet.rule(max(orders, default=0) + 1)
    return Truncation(orders, orders, hull, fleet.dynamic_distributions, problem.solve.cells, joint)


def nominal(problem: Problem) -> Truncation:
    """The middle member alone."""
    none = (0,) * len(problem.fleet.dynamic)
    return Truncation(none, none, False)


def coarse(problem: Problem) -> Truncation:
    """A low truncation for first solves: parabolas, or straight lines where there are many parameters."""
    distributions, hull = problem.fleet.dynamic_distributions, problem.solve.guarantee != "moment"
    target = problem.objective.target
    least = len(target.moments) - 1 if isinstance(target, MomentTarget) else 0
    return _whole(problem, (max(2 if len(distributions) < 3 else 1, least),) * len(distributions), hull)


def raised(truncation: Truncation) -> Truncation:
    """The same truncation with one more moment carried in each parameter."""
    degrees = tuple(min(degree + 1, MAX_ORDER) for degree in truncation.degrees)
    orders = tuple(max(pair) for pair in zip(truncation.orders, degrees, strict=True))
    return replace(truncation, orders=orders, degrees=degrees if truncation.hull else orders)


def _degrees(problem: Problem, controls: Floats, hull: bool, ceiling: int) -> tuple[int, ...]:
    """The lowest degrees whose tail is small enough."""
    target = problem.objective.target
    # moments that the target speaks of are carried in any case
    least = max(1, len(target.moments) - 1) if isinstance(target, MomentTarget) else 1
    degrees = (min(least, ceiling),) * len(problem.fleet.dynamic)
    error = tail(problem, controls, plain(degrees, hull))
    # greedy: one degree more in the parameter where the tail falls most
    while error >= TAIL_TOLERANCE and min(degrees, default=ceiling) < ceiling:
        tried = [(tail(problem, controls, plain(d, hull)), d) for d in _one_more(degrees, ceiling)]
        error, degrees = min(tried)
    return degrees


def _one_more(degrees: tuple[int, ...], ceiling: int) -> Iterator[tuple[int, ...]]:
    """Each of the degrees raised by one."""
    for k, degree in enumerate(degrees):
        if degree < ceiling:
            yield (*degrees[:k], degree + 1, *degrees[k + 1 :])


def _basis(orders: tuple[int, ...]) -> TensorBasis:
    """Products of Legendre polynomials."""
    return TensorBasis(tuple(LegendreBasis(order) for order in orders))


def _dense(dynamic: int) -> Floats:
    """A tensor grid of Chebyshev points."""
    # Chebyshev points with the ends: cos(pi j / (n - 1))
    axis = np.cos(np.linspace(0.0, np.pi, DENSE.get(dynamic, 5)))
    return np.array(list(product(*[axis] * dynamic)), dtype=float).reshape(len(axis) ** dynamic, dynamic)
