"""Explicit rules that follow an autonomous differential equation over one step of a constant command.

`rk4` is short enough to be differentiated in a program; `extrapolated`, of order 8, is what judges controls.  The error
of either is estimated by halving its steps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Rates = Callable[[Any], Any]
Rule = Callable[[Rates, Any, float, int], Any]

SEQUENCE = (2, 4, 6, 8)
"""Substeps of the midpoint rules that `extrapolated` combines."""


def rk4(rates: Rates, x: Any, step: float, substeps: int) -> Any:
    """The state after `step` seconds by the classical Runge-Kutta rule.

    Parameters
    ----------
    rates : callable
        The right-hand side: a state to its rates, of the same shape.
    x : array or expression
        The state at the start.
    step : float
        Seconds.
    substeps : int
        Equal parts of the step, one evaluation of the rule each.

    Returns
    -------
    array or expression
        Of the kind of `x`; the error is of order ``(step / substeps)^4``.

    Examples
    --------
    >>> round(rk4(lambda x: -x, 1.0, 1.0, 8), 6)
    0.36788
    """
    h = step / substeps
    for _ in range(substeps):
        # classical tableau: nodes 0, 1/2, 1/2, 1 and weights 1/6, 1/3, 1/3, 1/6 (Hairer, Norsett, Wanner 1993, II.1)
        a = rates(x)
        b = rates(x + h / 2 * a)
        c = rates(x + h / 2 * b)
        d = rates(x + h * c)
        x = x + h / 6 * (a + 2 * b + 2 * c + d)
    return x


def extrapolated(rates: Rates, x: Any, step: float, substeps: int) -> Any:
    """The state after `step` seconds by Gragg's rule extrapolated to step zero, of order 8; arguments as of `rk4`.

    Notes
    -----
    The error of the smoothed midpoint rule has even powers of its step only, so that each further entry of `SEQUENCE`
    raises the order by two. W. B. Gragg, On extrapolation algorithms for ordinary initial value problems, 1965.

    Examples
    --------
    >>> import math
    >>> abs(extrapolated(lambda x: -x, 1.0, 1.0, 4) - math.exp(-1.0)) < 1e-9
    True
    """
    h = step / substeps
    for _ in range(substeps):
        first = rates(x)
        # Aitken-Neville in h^2: T_jk = T_j,k-1 + (T_j,k-1 - T_j-1,k-1) / ((n_j / n_j-k)^2 - 1) (same, II.9)
        row: list[Any] = []
        for j, n in enumerate(SEQUENCE):
            entries = [_midpoint(rates, x, first, h, n)]
            for k in range(1, j + 1):
                ratio = (n / SEQUENCE[j - k]) ** 2
                entries.append(entries[-1] + (entries[-1] - row[k - 1]) / (ratio - 1))
            row = entries
        x = row[-1]
    return x


def _midpoint(rates: Rates, x: Any, first: Any, step: float, count: int) -> Any:
    """Gragg's smoothed midpoint rule with `count` substeps, an even number."""
    h = step / count
    # Euler's step, then x_{i+1} = x_{i-1} + 2 h f(x_i) (Gragg 1965)
    before, here = x, x + h * first
    for _ in range(count - 1):
        before, here = here, before + 2 * h * rates(here)
    # smoothing (x_{n-1} + 2 x_n + x_{n+1}) / 4
    return (here + before + h * rates(here)) / 2


ORDERS: dict[Rule, int] = {rk4: 4, extrapolated: 2 * len(SEQUENCE)}
"""The power of the step with which the error of each rule falls."""


def halving_error(rule: Rule, coarse: Any, fine: Any) -> Any:
    """The error of `fine`, made with twice the substeps of `coarse`, to leading order (Richardson's estimate)."""
    return (fine - coarse) / (2 ** ORDERS[rule] - 1)
