"""The classical Runge-Kutta rule of order 4, and its error by halving steps, for arrays and expressions alike."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

ORDER = 4
"""The error of a fixed time falls with this power of the step."""


def rk4(rates: Callable[[Any], Any], x: Any, step: float, substeps: int) -> Any:
    """The state after `step` seconds of an autonomous system.

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
        a = rates(x)
        b = rates(x + h / 2 * a)
        c = rates(x + h / 2 * b)
        d = rates(x + h * c)
        x = x + h / 6 * (a + 2 * b + 2 * c + d)
    return x


def richardson(coarse: Any, fine: Any) -> Any:
    """The error of `fine`, made with twice the substeps of `coarse`, to leading order (Richardson's estimate)."""
    return (fine - coarse) / (2**ORDER - 1)
