r"""Sequential quadratic programs on the commands: the equations eliminated, the rest soft.

With x = (d, z), d the dependent variables and z the others, the equations c(d, z) = 0 are solved for d by Newton's
method at every point, and around it

.. math:: \delta d = -C_d^{-1} C_z\, \delta z, \qquad Z = \begin{pmatrix} -C_d^{-1} C_z \\ I \end{pmatrix}

so the quadratic program in :math:`\delta z` has the Hessian :math:`Z^\top H Z` of the cost alone (Gauss-Newton) and
the rows :math:`J Z`, which may fall short at the weight of the program's slacks.  A line search on the exact cost,
shortfalls included, guards every step.  `ensemble_ctrl.ocp.online` does the same with closed-form slopes in place of Z.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.solvers.base import Iteration, Nlp, Outcome, SolverOptions, Status, Watch
from ensemble_ctrl.ocp.solvers.quadratic import Quadratic, solve_quadratic
from ensemble_ctrl.ocp.weights import SLACK_WEIGHT

if TYPE_CHECKING:
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import SuperLU

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

NEAR = 0.5
"""Metres, or the unit of a row, beyond its bound within which it takes part."""
TRUST = 0.25
"""Share of a variable's range by which one quadratic program may change it."""
FAR = 10.0
"""By how much it may change a variable without a range."""
LEAST_TRUST = 1e-3
"""Share of those at which the search ends."""
PROXIMAL = 1e-3
"""Curvature added in every direction."""
SHARES = (1.0, 0.5, 0.25, 0.1)
"""Of a step that the line search tries."""
SHORT = 1e-4
"""Metres by which a row may fall short in a solution."""
NEWTON = 8
"""Most iterations by which the equations are solved."""
EQUAL = 1e-9
"""Largest defect of an equation."""
EDGE = 1e-6
"""Room between bounds that meet."""

STATUS: dict[str, Status] = {
    "converged": "solved",
    "falls short": "infeasible",
    "out of iterations": "limit",
    "out of time": "limit",
    "interrupted": "interrupted",
}
"""This solver's words to ours."""


class Sqp:
    """Sequential quadratic programming by condensing."""

    statuses = STATUS

    def solve(self, nlp: Nlp, options: SolverOptions, watch: Watch | None = None) -> Outcome:
        """Improve the guess until the cost falls by less than the tolerance."""
        if len(nlp.discrete) or len(nlp.dependent) != int((nlp.program.lower == nlp.program.upper).sum()):
            return Outcome("failed", nlp.guess, np.inf, 0, "needs as many dependent variables as equations, none whole")
        condensed = Condensed(nlp)
        point = condensed.at(nlp.guess)
        trust, word, count = 1.0, "out of iterations", 0
        for count in range(options.max_iterations):
            if watch is not None and watch(Iteration(count, point.cost, float(point.short.max(initial=0.0)))):
                word = "interrupted"
                break
            if options.left <= 0:
                word = "out of time"
                break
            better = _searched(point, point.step(trust))
            gain = 0.0 if better is None else point.merit - better.merit
            point = better or point
            if gain < options.tolerance:
                trust /= 4
                if trust < LEAST_TRUST:
                    word = "converged" if point.short.max(initial=0.0) <= SHORT else "falls short"
                    break
        x = point.with_slacks()
        return Outcome(self.statuses[word], x, condensed.value(x), count, word)


def _searched(point: _Point, step: Floats) -> _Point | None:
    """The first point on the way that is better; None if there is none."""
    for share in SHARES:
        tried = point.moved(share * step)
        if tried.merit < point.merit:
            return tried
    return None


class Condensed:
    """The program by its independent variables."""

    def __init__(self, nlp: Nlp) -> None:
        self.nlp, self.functions, self.p = nlp, nlp.program.functions, nlp.program.parameters
        # z: variables that are neither fixed, dependent nor slacks
        free = nlp.lower < nlp.upper
        free[nlp.dependent] = free[nlp.slacks] = False
        self.independent = np.flatnonzero(free)
        self.equations: Bools = nlp.program.lower == nlp.program.upper
        # the weight of slack is its slope in the cost
        gradient = np.array(self.functions["grad_f"](nlp.guess, self.p)[1]).ravel()
        self.weight = float(gradient[nlp.slacks].max(initial=0.0)) or SLACK_WEIGHT

    def value(self, x: Floats) -> float:
        """The cost."""
        return float(self.functions["grad_f"](x, self.p)[0])

    def rows(self, x: Floats) -> tuple[Floats, csc_array]:
        """Values of all rows and their Jacobian."""
        from scipy.sparse import csc_array

        g, jacobian = self.functions["jac_g"](x, self.p)
        return np.array(g).ravel(), csc_array(jacobian.sparse())

    def at(self, x: Floats) -> _Point:
        """A vector without slack, within bounds, whose dependent variables are made to satisfy the equations."""
        x = np.clip(x, self.nlp.lower, self.nlp.upper)
        x[self.nlp.slacks] = 0.0
        g, jacobian = self.rows(x)
        for _ in range(NEWTON):
            # Newton on c(d, z) = 0 for the dependent variables: d <- d - C_d^-1 c
            defect = (g - self.nlp.program.lower)[self.equations]
            if not np.isfinite(defect).all() or np.abs(defect).max(initial=0.0) <= EQUAL:
                break
            x[self.nlp.dependent] -= self.factor(jacobian).solve(defect)
            g, jacobian = self.rows(x)
        return _Point(self, x, g, jacobian)

    def factor(self, jacobian: csc_array) -> SuperLU:
        """``C_d``, factored."""
        from scipy.sparse.linalg import splu

        return splu(jacobian[self.equations][:, self.nlp.dependent].tocsc())


@dataclass(frozen=True, eq=False)
class _Point:
    """A vector that satisfies the equations, with its rows."""

    condensed: Condensed
    x: Floats
    g: Floats
    jacobian: csc_array

    @cached_property
    def cost(self) -> float:
        """Without shortfalls."""
        return self.condensed.value(self.x)

    @cached_property
    def short(self) -> Floats:
        """By how much each row falls short."""
        program = self.condensed.nlp.program
        return np.maximum(np.maximum(program.lower - self.g, self.g - program.upper), 0.0)

    @property
    def merit(self) -> float:
        """The cost with shortfalls; infinite where something is not finite."""
        whole = self.cost + self.condensed.weight * float(self.short.sum())
        return whole if np.isfinite(whole) else np.inf

    def moved(self, step: Floats) -> _Point:
        """After a change of the independent variables; the others follow."""
        x = self.x.copy()
        x[self.condensed.independent] += step
        return self.condensed.at(x)

    def step(self, trust: float) -> Floats:
        """The change of the independent variables that the quadratic program here asks for."""
        condensed, nlp = self.condensed, self.condensed.nlp
        Z = self.directions()
        gradient = np.array(condensed.functions["grad_f"](self.x, condensed.p)[1]).ravel()
        zero = np.zeros(len(self.g))
        upper = condensed.functions["hess_lag"](self.x, condensed.p, 1.0, zero).sparse()
        # Z^T H Z from the upper triangle, with the positive part of its eigenvalues
        half = Z.T @ (upper @ Z)
        diagonal = Z.T @ (upper.diagonal()[:, None] * Z)
        eigen, vectors = np.linalg.eigh(half + half.T - diagonal)
        H = (vectors * (np.maximum(eigen, 0.0) + PROXIMAL)) @ vectors.T
        # J Z dz >= b, and dz within its bounds and the trust region
        A, b = self._rows(Z)
        low, high = (bound[condensed.independent] - self.x[condensed.independent] for bound in (nlp.lower, nlp.upper))
        width = high - low
        most = trust * np.where(np.isfinite(width), TRUST * np.where(np.isfinite(width), width, 0.0), FAR)
        bounds = np.maximum(low, -most) - EDGE, np.minimum(high, most) + EDGE
        return solve_quadratic(Quadratic(H, Z.T @ gradient, A, b, condensed.weight, *bounds))[0]

    def directions(self) -> Floats:
        """Z, shape (variables, independent)."""
        condensed = self.condensed
        Z = np.zeros((len(self.x), len(condensed.independent)))
        Z[condensed.independent, np.arange(len(condensed.independent))] = 1.0
        # Z = (-C_d^-1 C_z; I)
        slopes = self.jacobian[condensed.equations][:, condensed.independent].toarray()
        Z[condensed.nlp.dependent] = -condensed.factor(self.jacobian).solve(slopes)
        return Z

    def _rows(self, Z: Floats) -> tuple[Floats, Floats]:
        """Rows ``A dz >= b`` of the inequalities near their bounds."""
        program, inequality = self.condensed.nlp.program, ~self.condensed.equations
        parts = []
        for sign, bound in ((1.0, program.lower), (-1.0, program.upper)):
            # lower <= g and g <= upper as rows of one sign, within NEAR of their bounds
            gap = sign * (self.g - bound)
            near = np.flatnonzero(inequality & np.isfinite(bound) & (gap < NEAR))
            parts.append((sign * (self.jacobian[near] @ Z), -gap[near]))
        return np.concatenate([A for A, _ in parts]), np.concatenate([b for _, b in parts])

    def with_slacks(self) -> Floats:
        """The vector with the slacks that its rows need."""
        x, slacks = self.x.copy(), self.condensed.nlp.slacks
        reads = self.jacobian[:, slacks].tocoo()
        # each slack is the largest shortfall of the rows that read it
        np.maximum.at(x, slacks[reads.col], self.short[reads.row])
        return x
