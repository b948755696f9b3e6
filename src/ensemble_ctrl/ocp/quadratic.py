r"""A convex quadratic program with soft rows, by a primal-dual interior-point method on dense matrices.

.. math::

    \min_{z, s \ge 0}\; \tfrac12 z^\top H z + g^\top z + c \textstyle\sum_i s_i
    \quad\text{s.t.}\quad A z + s \ge b, \quad l \le z \le u

A row may fall short at the price `c`, so there always is a solution.  With ``y`` the multipliers of the rows, those of
the shortfalls are ``c - y``: eliminating both leaves one positive definite system in ``z`` for each iteration.

S. Mehrotra, On the implementation of a primal-dual interior point method, 1992.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    price : float
        Of a unit that a row falls short by.
    lower, upper : ndarray, shape (n,)
        Finite bounds, each lower one below the upper.
    """

    H: Floats
    g: Floats
    A: Floats
    b: Floats
    price: float
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
    from scipy.linalg import cho_factor, cho_solve

    H, g, A, b, c = program.H, program.g, program.A, program.b, program.price
    n, m = len(g), len(b)
    z = np.clip(np.zeros(n), *_shrunk(program.lower, program.upper))
    gap = A @ z - b
    t, s = np.maximum(gap, 0.0) + 1e-2, np.maximum(-gap, 0.0) + 1e-2
    y = np.where(gap > 0, 1e-2 * c, 0.5 * c)
    w = c - y
    zl, zu = np.full(n, 0.1), np.full(n, 0.1)
    for count in range(1, iterations + 1):
        low, high = z - program.lower, program.upper - z
        mu = float(y @ t + w @ s + zl @ low + zu @ high) / (2 * (n + m))
        dual = H @ z + g - A.T @ y - zl + zu
        primal = A @ z - b - (t - s)
        if mu < tolerance and np.abs(dual).max() < 10 * tolerance and np.abs(primal).max(initial=0.0) < 10 * tolerance:
            break
        D = 1.0 / (t / y + s / w)
        M = H + A.T @ (D[:, None] * A)
        M[np.diag_indices(n)] += zl / low + zu / high
        factor = cho_factor(M, check_finite=False)

        def direction(target: float, second: tuple[Floats, ...]) -> tuple[Floats, ...]:
            c_t, c_s, c_l, c_u = second
            kappa = (target - c_t) / y - t - ((target - c_s) / w - s)
            pull_l, pull_u = (target - c_l) / low - zl, (target - c_u) / high - zu
            dz = cho_solve(factor, A.T @ (D * (kappa - primal)) - dual + pull_l - pull_u, check_finite=False)
            dy = D * (kappa - A @ dz - primal)
            dt, ds = (target - c_t - t * dy) / y - t, (target - c_s + s * dy) / w - s
            return dz, dt, ds, dy, pull_l - zl / low * dz, pull_u + zu / high * dz

        zero = (np.zeros(m), np.zeros(m), np.zeros(n), np.zeros(n))
        dz, dt, ds, dy, dzl, dzu = direction(0.0, zero)
        pairs = ((t, dt), (s, ds), (low, dz), (high, -dz)), ((y, dy), (w, -dy), (zl, dzl), (zu, dzu))
        go = [min(1.0, *(_longest(value, step) for value, step in side)) for side in pairs]
        after = sum(float((p + go[0] * dp) @ (d + go[1] * dd)) for (p, dp), (d, dd) in zip(*pairs, strict=True))
        target = mu * min(1.0, max(after / (2 * (n + m) * mu), 0.0)) ** 3
        dz, dt, ds, dy, dzl, dzu = direction(target, (dt * dy, -ds * dy, dz * dzl, -dz * dzu))
        pairs = ((t, dt), (s, ds), (low, dz), (high, -dz)), ((y, dy), (w, -dy), (zl, dzl), (zu, dzu))
        first, last = (min(1.0, *(INSIDE * _longest(value, step) for value, step in side)) for side in pairs)
        z, t, s = z + first * dz, t + first * dt, s + first * ds
        y, w, zl, zu = y + last * dy, w - last * dy, zl + last * dzl, zu + last * dzu
    return z, count


def _shrunk(lower: Floats, upper: Floats) -> tuple[Floats, Floats]:
    """Bounds moved in a little, so that there is room on both sides."""
    room = np.minimum(1e-2, 0.1 * (upper - lower))
    return lower + room, upper - room


def _longest(value: Floats, step: Floats) -> float:
    """The longest step that keeps positive values from falling below zero."""
    falling = step < 0
    return float((-value[falling] / step[falling]).min(initial=np.inf))
