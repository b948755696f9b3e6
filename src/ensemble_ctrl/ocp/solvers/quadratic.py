r"""A convex quadratic program with soft rows, by a primal-dual interior-point method on dense matrices.

.. math::

    \min_{z, s \ge 0}\; \tfrac12 z^\top H z + g^\top z + c \textstyle\sum_i s_i
    \quad\text{s.t.}\quad A z + s \ge b, \quad l \le z \le u

A row may fall short at the penalty `c`, so there always is a solution.  With ``y`` the multipliers of the rows, those
of the shortfalls are ``c - y``: eliminating both leaves one positive definite system in ``z`` for each iteration.

S. Mehrotra, On the implementation of a primal-dual interior point method, 1992.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass

Floats = NDArray[np.float64]

INSIDE = 0.99
"""Share of the way to the nearest bound that a step goes."""


@dataclass(frozen=True, eq=False)
class Quadratic:
    """The program's numbers.

    Attributes
    ----------
    H, g : ndarray, shapes (n, n) and (n,)
        Positive semidefinite.
    A, b : ndarray, shapes (m, n) and (m,)
        Soft rows.
    penalty : float
        Of a unit that a row falls short by.
    lower, upper : ndarray, shape (n,)
        Finite bounds, each lower one below the upper.
    """

    H: Floats
    g: Floats
    A: Floats
    b: Floats
    penalty: float
    lower: Floats
    upper: Floats


def solve_quadratic(program: Quadratic, tolerance: float = 1e-5, iterations: int = 30) -> tuple[Floats, int]:
    """The minimiser and the iterations that it took.

    Parameters
    ----------
    program : Quadratic
    tolerance : float
        Largest mean complementarity at the end, in units of the cost.
    iterations : int
        Most iterations; the point reached is within the bounds whatever happens.

    Returns
    -------
    z : ndarray, shape (n,)
    count : int
    """
    n, m = len(program.g), len(program.b)
    z = np.clip(np.zeros(n), *_shrunk(program.lower, program.upper))
    # start: A z - b = over - short with both positive, y and c - y, multipliers of the bounds
    gap = program.A @ z - program.b
    over, short = np.maximum(gap, 0.0) + 1e-2, np.maximum(-gap, 0.0) + 1e-2
    y = np.where(gap > 0, 1e-2, 0.5) * program.penalty
    at = _Iterate(z, over, short, y, program.penalty - y, np.full(n, 0.1), np.full(n, 0.1))
    for count in range(iterations):
        system = _System(program, at)
        if system.solved(tolerance):
            return at.z, count
        # Mehrotra: predictor to complementarity 0, centring (mu_aff / mu)^3, corrector with second-order terms
        guess = system.direction(0.0, np.zeros(2 * (n + m)))
        first, last = at.longest(guess, program, 1.0)
        pairs = at.products(guess, program, first, last)
        target = system.mean * min(1.0, max(float(pairs.mean()) / system.mean, 0.0)) ** 3
        step = system.direction(target, guess.second())
        at = at.moved(step, *at.longest(step, program, INSIDE))
    return at.z, iterations


@dataclass(frozen=True, eq=False)
class _Iterate:
    """Variables, how far rows are over and short, and multipliers: of both of those, and of the bounds."""

    z: Floats
    over: Floats
    short: Floats
    y: Floats
    w: Floats
    low: Floats
    high: Floats

    def primal(self, program: Quadratic) -> Floats:
        """What has to stay positive on the primal side: rows over and short, and the room to both bounds."""
        return np.concatenate([self.over, self.short, self.z - program.lower, program.upper - self.z])

    @property
    def dual(self) -> Floats:
        """Their multipliers."""
        return np.concatenate([self.y, self.w, self.low, self.high])

    def longest(self, step: _Iterate, program: Quadratic, share: float) -> tuple[float, float]:
        """The longest steps on both sides, 1 at most, that keep everything positive."""
        # ratio test on both sides; INSIDE of the way, and never more than a full Newton step
        primal = _longest(self.primal(program), step.change)
        return min(1.0, share * primal), min(1.0, share * _longest(self.dual, step.dual))

    def products(self, step: _Iterate, program: Quadratic, first: float, last: float) -> Floats:
        """Complementarity after a step."""
        return np.asarray((self.primal(program) + first * step.change) * (self.dual + last * step.dual))

    @property
    def change(self) -> Floats:
        """As a step: by how much it changes what has to stay positive."""
        return np.concatenate([self.over, self.short, self.z, -self.z])

    def second(self) -> Floats:
        """As a step: the products that a linear picture leaves out."""
        return np.asarray(self.change * self.dual)

    def moved(self, step: _Iterate, first: float, last: float) -> _Iterate:
        """After a step of two lengths."""
        ahead = [
            a + first * b for a, b in zip((self.z, self.over, self.short), (step.z, step.over, step.short), strict=True)
        ]
        duals = zip((self.y, self.w, self.low, self.high), (step.y, step.w, step.low, step.high), strict=True)
        return _Iterate(*ahead, *(a + last * b for a, b in duals))


class _System:
    """The linear system of one iteration, factored once for both of its directions."""

    def __init__(self, program: Quadratic, at: _Iterate) -> None:
        from scipy.linalg import cho_factor

        self.program, self.at = program, at
        self.room_low, self.room_high = at.z - program.lower, program.upper - at.z
        # residuals: H z + g - A^T y - low + high (stationarity), A z - b - over + short (rows), mean complementarity
        products = at.primal(program) * at.dual
        self.mean = float(products.mean())
        self.slope = program.H @ at.z + program.g - program.A.T @ at.y - at.low + at.high
        self.excess = program.A @ at.z - program.b - (at.over - at.short)
        # eliminate over, short and y: M = H + A^T W A + D, W and D of the complementarity of rows and of bounds
        self.weight = 1.0 / (at.over / at.y + at.short / at.w)
        M = program.H + program.A.T @ (self.weight[:, None] * program.A)
        M[np.diag_indices(len(M))] += at.low / self.room_low + at.high / self.room_high
        self.factor = cho_factor(M, check_finite=False)

    def solved(self, tolerance: float) -> bool:
        """Whether the iterate is good enough."""
        wrong = max(float(np.abs(self.slope).max()), float(np.abs(self.excess).max(initial=0.0)))
        return self.mean < tolerance and wrong < 10 * tolerance

    def direction(self, target: float, second: Floats) -> _Iterate:
        """Newton's step to complementarity `target`, with `second` products known."""
        from scipy.linalg import cho_solve

        at, A, m, n = self.at, self.program.A, len(self.at.y), len(self.at.z)
        # right-hand side with the targets of complementarity, then back to y, over, short and the bounds' multipliers
        over, short, low, high = np.split(target - second, np.cumsum([m, m, n]))
        kappa = over / at.y - at.over - (short / at.w - at.short)
        pull_low, pull_high = low / self.room_low - at.low, high / self.room_high - at.high
        right = A.T @ (self.weight * (kappa - self.excess)) - self.slope + pull_low - pull_high
        z = cho_solve(self.factor, right, check_finite=False)
        y = self.weight * (kappa - A @ z - self.excess)
        return _Iterate(
            z,
            (over - at.over * y) / at.y - at.over,
            (short + at.short * y) / at.w - at.short,
            y,
            -y,
            pull_low - at.low / self.room_low * z,
            pull_high + at.high / self.room_high * z,
        )


def _shrunk(lower: Floats, upper: Floats) -> tuple[Floats, Floats]:
    """Bounds moved in a little, so that there is room on both sides."""
    # strictly inside of both bounds
    room = np.minimum(1e-2, 0.1 * (upper - lower))
    return lower + room, upper - room


def _longest(value: Floats, step: Floats) -> float:
    """The longest step that keeps positive values from falling below zero."""
    falling = step < 0
    return float((-value[falling] / step[falling]).min(initial=np.inf))
