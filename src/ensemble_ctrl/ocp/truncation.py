"""The truncated moment system in nodal coordinates, and the points that stand for the fleet's position curve.

At any time the positions of the fleet are a curve ``s -> p(s)`` over the scaled parameter.  Truncation at order N keeps
the polynomial through the robots at N + 1 Gauss nodes.  These are Legendre's whatever the parameter's law, for the
polynomial has to be close to the curve over the whole range and is turned into points that contain it; the nodes of a
law that leaves a part of the range nearly empty are far worse at both.  The law has its say in what is averaged: mean,
moments and terminal cost are exact integrals of that polynomial against it.

The displacement of those robots over a step depends on the commands alone, so the decision variables need not carry
their positions: they carry the `points` that the constraints speak of, any linear image of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.moments import (
    Basis,
    Interval,
    Law,
    LegendreBasis,
    bernstein_to_moments,
    change_of_basis,
    inner_products,
    nodes_to_bernstein,
    nodes_to_moments,
)
from ensemble_ctrl.problem import MAX_ORDER, Problem

Floats = NDArray[np.float64]

DENSE = 41
"""Members (Chebyshev points) at which the truncation error is measured."""
TAIL_TOLERANCE = 1e-4
"""Metres of truncation error allowed when the order, or the carried degree, is chosen automatically."""
UNIFORM = Interval(-1.0, 1.0)
"""The law of the scaled parameter unless another is given."""


@dataclass(frozen=True, eq=False)
class Truncation:
    """Which moments are kept and which points represent them.

    Parameters
    ----------
    order : int
        Truncation order N of the moment system.
    degree : int
        The points carry the moments 0..degree of the position; the rest is a tail that becomes margin.
    hull : bool
        True for Bernstein coefficients, whose convex hull contains the curve; False for the Gauss-node robots.
    law : Law
        What moments are taken against.
    """

    order: int
    degree: int
    hull: bool
    law: Law = UNIFORM

    @cached_property
    def collocation(self) -> LegendreBasis:
        """Basis whose Gauss nodes are the robots that stand for the fleet."""
        return LegendreBasis(self.order)

    @cached_property
    def basis(self) -> Basis:
        """The law's basis of the carried moments; of fewer, for a law of few values."""
        return self.law.basis(min(self.degree, self.law.max_order))

    @property
    def nodes(self) -> Floats:
        """Gauss nodes, shape (order + 1,), scaled parameter."""
        return self.collocation.nodes

    @cached_property
    def to_points(self) -> Floats:
        """Matrix from nodal positions to points, shape (points, order + 1)."""
        if self.hull:
            return nodes_to_bernstein(self.collocation, degree=self.degree)
        return np.eye(self.order + 1)

    @property
    def count(self) -> int:
        """How many points represent the curve."""
        return len(self.to_points)

    @cached_property
    def to_moments(self) -> Floats:
        """Matrix from points to the moments they carry, under the law, shape (basis.order + 1, points)."""
        if isinstance(self.law, Interval):
            return self.to_legendre
        return change_of_basis(LegendreBasis(self.degree), self.basis) @ self.to_legendre

    @cached_property
    def to_legendre(self) -> Floats:
        """Matrix from points to the moments against Legendre polynomials, shape (degree + 1, points)."""
        if self.hull:
            return bernstein_to_moments(LegendreBasis(self.degree))
        return nodes_to_moments(self.collocation)

    @cached_property
    def square(self) -> Floats:
        """Matrix of the quadratic form that is twice the fleet's mean square, shape (points, points)."""
        if isinstance(self.law, Interval):
            return np.asarray(self.to_legendre.T @ self.to_legendre)
        return np.asarray(self.to_legendre.T @ inner_products(self.law, LegendreBasis(self.degree)) @ self.to_legendre)

    def evaluation(self, s: Floats) -> Floats:
        """Matrix from points to positions at scaled parameters `s`, shape (len(s), points)."""
        return np.asarray(LegendreBasis(self.degree).evaluate(s) @ self.to_legendre)


def parameter_nodes(problem: Problem, truncation: Truncation) -> Floats:
    """Parameters of the Gauss-node robots, shape (order + 1,)."""
    return np.asarray(problem.fleet.parameter.to_parameter(truncation.nodes))


def positions(problem: Problem, controls: Floats, parameters: Floats) -> Floats:
    """Exact positions of the members with these `parameters`, shape (members, steps + 1, 2), metres."""
    fleet = problem.fleet
    return fleet.system.positions(
        controls, fleet.position, fleet.own_heading, parameters, problem.duration / len(controls)
    )


def points(problem: Problem, controls: Floats, truncation: Truncation) -> Floats:
    """The representing points under `controls`, shape (steps + 1, points, 2), metres."""
    nodal = positions(problem, controls, parameter_nodes(problem, truncation))
    return np.asarray(np.einsum("ij,jtd->tid", truncation.to_points, nodal))


def tail(problem: Problem, controls: Floats, truncation: Truncation) -> float:
    """Largest distance in metres, over a dense set of members, between a member and the truncated curve.

    Notes
    -----
    An estimate from 41 members, used to set margins; the claim about a plan comes from replay and certificate.
    """
    s = np.cos(np.linspace(0.0, np.pi, DENSE))
    exact = positions(problem, controls, np.asarray(problem.fleet.parameter.to_parameter(s)))
    curve = np.einsum("ij,tjd->itd", truncation.evaluation(s), points(problem, controls, truncation))
    return float(np.linalg.norm(exact - curve, axis=-1).max())


def choose(problem: Problem, controls: Floats) -> Truncation:
    """The truncation the problem asks for, with the lowest order and degree that `controls` need.

    Notes
    -----
    With ``order: auto`` the order is the first one whose tail is below `TAIL_TOLERANCE`; in hull form the points
    carry no more moments than that either, since the tail of a smooth curve falls geometrically.
    """
    hull, law = problem.solve.guarantee == "hull", problem.fleet.parameter
    if not hull and problem.order is not None:
        return Truncation(problem.order, problem.order, hull, law)
    ceiling = problem.order or MAX_ORDER
    degree = next((n for n in range(1, ceiling) if tail(problem, controls, _plain(n, hull)) < TAIL_TOLERANCE), ceiling)
    return Truncation(problem.order or degree, degree, hull, law)


def raised(problem: Problem, truncation: Truncation) -> Truncation:
    """The same truncation with one more moment carried."""
    degree = min(truncation.degree + 1, MAX_ORDER)
    order = max(truncation.order, degree)
    return Truncation(order, degree if truncation.hull else order, truncation.hull, truncation.law)


def _plain(order: int, hull: bool) -> Truncation:
    """A truncation that carries all its moments."""
    return Truncation(order, order, hull)
