"""Where members are, with 64 bits of mantissa: extrapolated midpoint steps, halved until they agree to a last digit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl import OdeSystem

Long = NDArray[np.longdouble]
Rates = Callable[[Long], Long]

SEQUENCE = (2, 4, 6, 8, 10, 12, 14, 16)
"""Midpoint steps of each row of the table: the order is 16."""
AGREED = 3e-18
"""Difference of the last two orders, relative to the larger of 1 and the state, below which a step is taken."""
HALVINGS = 9
"""Halvings of one step at most; what is left then is returned as an error."""


def along(
    system: OdeSystem, start: Long, psi: Mapping[str, Long], controls: NDArray[np.float64], step: Any, shares: Any
) -> tuple[Long, float]:
    """States of all members at shares of every step, shape (steps, shares, states, members), and a bound of the error.

    Parameters
    ----------
    start : ndarray, shape (states, members)
    psi : mapping of str to ndarray of shape (members,)
    controls : ndarray, shape (steps, n_u)
    step : longdouble
        Seconds.
    shares : ndarray, shape (shares,)
        Rising, the last one 1.

    Notes
    -----
    The error is the largest difference of two orders, relative to the larger of 1 and the state: 16th order, so that
    the higher one is better by far.
    """
    found = np.empty((len(controls), len(shares), *start.shape), dtype=np.longdouble)
    x, worst = start, 0.0
    for k, u in enumerate(controls.tolist()):

        def rates(at: Long, u: list[float] = u) -> Long:
            rows = system.xdot(list(at), u, psi)
            return np.stack([np.broadcast_to(np.asarray(row, dtype=np.longdouble), at.shape[1:]) for row in rows])

        before = np.longdouble(0)
        for j, share in enumerate(shares):
            x, error = _step(rates, x, (share - before) * step, HALVINGS)
            worst, before = max(worst, error), share
            found[k, j] = x
    return found, worst


def _step(rates: Rates, x: Long, h: Any, halvings: int) -> tuple[Long, float]:
    """One step, halved as often as it takes, with the largest difference of two orders."""
    if h == 0:
        return x, 0.0
    table: list[list[Long]] = []
    for j, n in enumerate(SEQUENCE):
        row = [_midpoint(rates, x, h, n)]
        for k in range(1, j + 1):
            ratio = np.longdouble(n * n) / np.longdouble(SEQUENCE[j - k] ** 2)
            row.append(row[k - 1] + (row[k - 1] - table[j - 1][k - 1]) / (ratio - 1))
        table.append(row)
    best, second = table[-1][-1], table[-1][-2]
    error = float((np.abs(best - second) / np.maximum(1, np.abs(best))).max(initial=0.0))
    if error <= AGREED or not halvings:
        return best, error
    middle, first = _step(rates, x, h / 2, halvings - 1)
    end, last = _step(rates, middle, h / 2, halvings - 1)
    return end, max(first, last)


def _midpoint(rates: Rates, x: Long, step: Any, n: int) -> Long:
    """Gragg's modified midpoint rule with `n` steps."""
    h = step / n
    before, here = x, x + h * rates(x)
    for _ in range(n - 1):
        before, here = here, before + 2 * h * rates(here)
    return np.asarray((here + before + h * rates(here)) / 2)
