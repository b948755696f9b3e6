"""Polynomials near the true states: spectral Picard iteration at Chebyshev nodes. Nothing is claimed of how near."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.errors import Unenclosed
from ensemble_ctrl.certificate.general.basis import Basis, cosines

if TYPE_CHECKING:
    from ensemble_ctrl.systems import System


Floats = NDArray[np.float64]

ITERATIONS = 60
"""Most iterations of one step."""
SETTLED = 4e-16
"""Change of an iteration, relative to the largest state, below which it has ended."""


def approximate(
    system: System, basis: Basis, start: Floats, psi: Mapping[str, Floats], controls: Floats, step: float
) -> Floats:
    """Coefficients of the states in every step, shape (steps, states, cells, times, terms).

    Parameters
    ----------
    system : System
    basis : Basis
    start : ndarray, shape (states, cells, terms)
        Coefficients of the start in the parameters.
    psi : mapping of str to ndarray, shape (cells, nodes)
        Parameters at the nodes of each cell.
    controls : ndarray, shape (steps, n_u)
    step : float
        Seconds.

    Raises
    ------
    Unenclosed
        If a state runs away.
    """
    # values at the nodes to coefficients of their integral in time, and to its values from tau = -1 on
    slopes = _antiderivative(basis.times) @ basis.from_times * (step / 2)
    sums = (cosines(basis.times, basis.times) - _signs(basis.times)) @ slopes
    sign = _signs(basis.times)[1:]
    shape = start.shape[1], basis.times, len(basis.points)
    parameters = {name: np.broadcast_to(value[:, None, :], shape).ravel() for name, value in psi.items()}
    found = np.empty((len(controls), *start.shape[:2], *basis.shape))
    edge = start
    for k, command in enumerate(np.asarray(controls, dtype=float)):
        # Picard iteration at the nodes: x <- x(-1) + int f(x, u, psi), from the constant x(-1)
        first = (edge @ basis.to_points.T)[:, :, None, :]
        values = np.repeat(first, basis.times, axis=2)
        for _ in range(ITERATIONS):
            with np.errstate(all="ignore"):
                rates = _rates(system, values, command.tolist(), parameters)
                new = first + sums @ rates
                change = np.abs(new - values).max()
            values = new
            if not change > SETTLED * (1 + np.abs(values).max()):
                break
        if not np.isfinite(values).all():
            state, cell = np.argwhere(~np.isfinite(values))[0, :2].tolist()
            raise Unenclosed(f"{system.states[state]} runs away or is no number", k * values.shape[1] + cell)
        # integrated term by term: the noise of values would be magnified by the derivative
        found[k] = slopes @ (_rates(system, values, command.tolist(), parameters) @ basis.from_points.T)
        # the constant term makes the polynomial continuous: sum_j (-1)^j c_j = x(-1); T_j(1) = 1 at the end
        found[k, :, :, 0] = edge - sign @ found[k, :, :, 1:]
        edge = found[k].sum(axis=2)
    return found


def _rates(system: System, values: Floats, command: list[float], psi: Mapping[str, Floats]) -> Floats:
    """The right-hand side at all nodes, shape of `values`; the system sees one long list of members."""
    flat = values.reshape(len(values), -1)
    rates = np.empty_like(flat)
    for row, value in zip(rates, system.xdot(list(flat), command, psi), strict=True):
        row[...] = value
    return rates.reshape(values.shape)


def _antiderivative(times: int) -> Floats:
    """Coefficients to those of the antiderivative by tau without its constant, the last one left out."""
    # int T_k = T_(k+1) / (2 (k + 1)) - T_(k-1) / (2 (k - 1)), int T_0 = T_1
    grown = np.zeros((times + 1, times))
    grown[1, 0] = 1.0
    for k in range(1, times):
        grown[k + 1, k] += 0.5 / (k + 1)
        if k > 1:
            grown[k - 1, k] -= 0.5 / (k - 1)
    return grown[:times]


def _signs(times: int) -> Floats:
    """Values of the polynomials in time at the beginning of a piece."""
    return np.asarray((-1.0) ** np.arange(times))
