r"""The truncated moment system of robots on arcs, for any distribution and any number of parameters.

With the moments stacked coordinate by coordinate, ``(px_0..px_K, py_0..py_K, cos_0..cos_K, sin_0..sin_K)``,

.. math:: \dot m = (v \mathcal{B}_1 + \omega \mathcal{B}_2)\, m, \qquad
          \mathcal{B}_1 = B_1 \otimes G_1, \quad \mathcal{B}_2 = B_2 \otimes G_2

where :math:`G_1` multiplies by the linear and :math:`G_2` by the angular factor of a member, made of the recurrences of
the distributions' polynomials.  The inputs v and omega are those that the commands give: of a bicycle v and
``v tan(delta) / L``.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import TensorBasis, kron, multiplication_matrix
from ensemble_ctrl.ocp.arrays import CasadiArrays
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import sinc

Floats = NDArray[np.float64]
Step = Callable[["MomentSystem", Any, Any, Any, float], Any]
"""``(system, stacked moments, v, omega, seconds) -> stacked moments`` after a step."""


@dataclass(frozen=True, eq=False)
class MomentSystem:
    """The moment system of a fleet, truncated by a basis.

    Parameters
    ----------
    fleet : Fleet
        On arcs.
    basis : TensorBasis
        One basis for each dynamic parameter.
    """

    fleet: Fleet
    basis: TensorBasis

    @property
    def count(self) -> int:
        """Moments of each coordinate."""
        return self.basis.count

    @cached_property
    def shifts(self) -> list[Floats]:
        """Multiplication by each scaled parameter, shape (count, count), from its recurrence."""
        factors = self.basis.factors
        # I x .. x J_i x .. x I
        eyes = [np.eye(factor.order + 1) for factor in factors]
        return [kron([*eyes[:i], multiplication_matrix(factor), *eyes[i + 1 :]]) for i, factor in enumerate(factors)]

    @cached_property
    def multiplications(self) -> tuple[Floats, Floats]:
        """G_1 and G_2, shape (count, count), in the parameters' units."""
        linear, angular = (self._multiplication(column) for column in (0, 1))
        return linear, angular

    def _multiplication(self, column: int) -> Floats:
        """Multiplication by a coefficient that is affine in the scaled parameters."""
        scaled = np.concatenate([np.zeros((1, len(self.basis.factors))), np.eye(len(self.basis.factors))])
        values = self.fleet.coefficients(self.fleet.dynamic_members(scaled))[:, column]
        # G = c I + sum_i h_i J_i with the value c in the middle and the slopes h_i
        slopes = values[1:] - values[0]
        parts = (h * shift for h, shift in zip(slopes, self.shifts, strict=True))
        return np.asarray(sum(parts, values[0] * np.eye(self.count)))

    @cached_property
    def generators(self) -> tuple[Floats, Floats]:
        """The matrices of v and of omega, shape (4 count, 4 count)."""
        b1, b2 = self.fleet.arcs.generators()
        linear, angular = self.multiplications
        return np.asarray(np.kron(b1, linear)), np.asarray(np.kron(b2, angular))

    @cached_property
    def diagonal(self) -> tuple[Floats, Floats, Floats]:
        """Common eigenvectors V of G_1 and G_2 as columns, and the eigenvalues of each."""
        # J_i = V_i diag(nodes) V_i^T, and V is their Kronecker product
        vectors = kron([np.linalg.eigh(multiplication_matrix(factor))[1] for factor in self.basis.factors])
        linear, angular = (np.einsum("ij,ik,kj->j", vectors, G, vectors) for G in self.multiplications)
        return vectors, linear, angular

    def rates(self, m: Any, v: Any, omega: Any) -> Any:
        """``(v calB1 + omega calB2) m``, of a CasADi expression."""
        by_speed, by_turn = (ca.sparsify(ca.DM(generator)) for generator in self.generators)
        return v * ca.mtimes(by_speed, m) + omega * ca.mtimes(by_turn, m)

    def lifted(self, controls: Floats, step: float) -> Floats:
        """Moments of ``(px, py, cos, sin)`` under commands, by exact arcs, shape (steps + 1, 4, count)."""
        fleet, arcs = self.fleet, self.fleet.arcs
        coefficients = fleet.coefficients(fleet.dynamic_members(self.basis.nodes))
        _, omega = arcs.rates(*controls.T)
        turned = np.concatenate([[0.0], step * np.cumsum(omega)])
        # z = (p, cos theta, sin theta) of the robots at the Gauss nodes, then m_k = sum_j w_j phi_k(s_j) z_j
        heading = coefficients[:, 2, None] + coefficients[:, 1, None] * turned
        z = arcs.lift(arcs.paths(controls, coefficients, step), heading)
        return np.asarray(np.einsum("kj,jtn->tnk", self.basis.nodes_to_moments(), z))


def runge_kutta(system: MomentSystem, m: Any, v: Any, omega: Any, seconds: float) -> Any:
    """The classical rule of order four, which for a linear system is Taylor's polynomial."""
    term = total = m
    for k in (1, 2, 3, 4):
        term = system.rates(term, v, omega) * (seconds / k)
        total = total + term
    return total


def exponential(system: MomentSystem, m: Any, v: Any, omega: Any, seconds: float) -> Any:
    """The exact step: the exponential of the generator through the eigenvectors of G_1 and G_2.

    In these coordinates the heading turns by ``b omega dt`` and the position moves by a chord of length
    ``a v dt sinc(b omega dt / 2)`` along the heading at mid-step, with eigenvalues a of G_1 and b of G_2.
    """
    vectors, linear, angular = system.diagonal
    n, b1 = system.count, system.fleet.arcs.generators()[0][:2, 2:]
    # V^T m of the heading's two coordinates, turned by half the angle, and by all of it
    cosine, sine = (ca.mtimes(ca.DM(vectors.T), m[i * n : (i + 1) * n]) for i in (2, 3))
    half = ca.DM(angular) * omega * (seconds / 2)
    middle, end = (_turned(cosine, sine, angle) for angle in (half, 2 * half))
    chord = ca.DM(linear) * v * seconds * sinc(half, CasadiArrays)
    moves = [sum(float(b) * chord * part for b, part in zip(row, middle, strict=True)) for row in b1]
    places = [m[i * n : (i + 1) * n] + ca.mtimes(ca.DM(vectors), moves[i]) for i in (0, 1)]
    return ca.vertcat(*places, *(ca.mtimes(ca.DM(vectors), part) for part in end))


def _turned(cosine: Any, sine: Any, angle: Any) -> tuple[Any, Any]:
    """Cosine and sine of headings that have turned by an angle."""
    c, s = ca.cos(angle), ca.sin(angle)
    return cosine * c - sine * s, sine * c + cosine * s


INTEGRATORS: dict[str, Step] = {"exponential": exponential, "rk4": runge_kutta}
"""How moments advance by a step, by the name that `moments.integrator` has."""


def integrator(name: str) -> Step:
    """The rule of that name.

    Raises
    ------
    ProblemError
        If there is none.
    """
    if name not in INTEGRATORS:
        raise ProblemError(f"moments.integrator: expected one of {', '.join(INTEGRATORS)}, got {name!r}")
    return INTEGRATORS[name]
