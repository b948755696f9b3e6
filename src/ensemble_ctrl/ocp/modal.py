r"""The moment system in modal coordinates: the paper's form, kept as a reference to test the nodal one against.

With the moments stacked as ``(m_0, m_1, ..., m_N)``, each of four numbers, and constant commands v and omega,

.. math:: \dot m = (v \mathcal{B}_1 + \omega \mathcal{B}_2)\, m, \qquad \mathcal{B}_i = G \otimes B_i

where G multiplies by the parameter (`affine_multiplication_matrix`).  Nothing here is used to plan: the nodal form of
`ensemble_ctrl.ocp.truncation` solves the same system exactly, one arc for each Gauss node.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import Interval, LegendreBasis, affine_multiplication_matrix
from ensemble_ctrl.systems import Unicycle

Floats = NDArray[np.float64]
Advance = Callable[[Floats, Floats], Floats]
"""``(generator times time, stacked moments) -> stacked moments`` after that time."""


def moment_generators(system: Unicycle, basis: LegendreBasis, interval: Interval) -> tuple[Floats, Floats]:
    r"""Generators of the truncated moment system.

    Parameters
    ----------
    system : Unicycle
        Gives B1 and B2 on the lifted state ``(px, py, cos, sin)``.
    basis : LegendreBasis
        Its order N truncates the system.
    interval : Interval
        Range of the parameter.

    Returns
    -------
    calB1, calB2 : ndarray, shape (4 (order + 1), 4 (order + 1))
        ``m' = (v calB1 + omega calB2) m`` for stacked moments ``m.reshape(-1)``; in the parameter's unit.

    Notes
    -----
    ``eq:moment_system`` of Arias et al., One Ring to Rule Them All, with both generators acting through both
    neighbours and with the range's centre (see *Errata*).  One parameter scales the speed and the turn rate.

    Examples
    --------
    >>> calB1, _ = moment_generators(Unicycle(), LegendreBasis(order=1), Interval(0.9, 1.1))
    >>> calB1[0].round(4)
    array([0.    , 0.    , 1.    , 0.    , 0.    , 0.    , 0.0577, 0.    ])
    """
    multiply = affine_multiplication_matrix(basis, interval)
    by_speed, by_turn = (np.asarray(np.kron(multiply, b), dtype=np.float64) for b in system.generators())
    return by_speed, by_turn


def propagate(
    system: Unicycle,
    basis: LegendreBasis,
    interval: Interval,
    initial_moments: ArrayLike,
    controls: ArrayLike,
    step: float,
    method: Literal["exponential", "rk4"] = "exponential",
    substeps: int = 1,
) -> Floats:
    """Moments at the grid times under piecewise-constant commands.

    Parameters
    ----------
    system : Unicycle
        Dynamics and heading convention.
    basis : LegendreBasis
        Basis of the moments.
    interval : Interval
        Range of the parameter.
    initial_moments : array_like, shape (order + 1, 4)
        Moments of ``(px, py, cos, sin)`` at the start; the positions' in metres.
    controls : array_like, shape (steps, 2)
        Commands v (m/s) and omega (rad/s).
    step : float
        Length of a step in seconds, above 0.
    method : {"exponential", "rk4"}
        Matrix exponential of a step, or the classical Runge-Kutta rule.
    substeps : int
        Equal parts of each step, 1 or more; the exponential does not need them.

    Returns
    -------
    ndarray, shape (steps + 1, order + 1, 4)
        Units of `initial_moments`.

    Raises
    ------
    ProblemError
        If an argument has the wrong shape, is not finite or is out of range.

    Notes
    -----
    *Guarantee*: ``exponential`` solves the truncated system up to rounding; ``rk4`` errs by the fourth power of
    ``step / substeps``.

    Examples
    --------
    A member at the origin that heads along x and drives 1 m; at order 0 all members do:

    >>> start = np.sqrt(2) * np.array([[0.0, 0.0, 1.0, 0.0]])
    >>> moments = propagate(Unicycle(), LegendreBasis(0), Interval(1, 1), start, [[1.0, 0.0]], step=1.0)
    >>> (moments[-1] / np.sqrt(2)).round(6)
    array([[1., 0., 1., 0.]])
    """
    start = _finite("initial_moments", initial_moments, (basis.order + 1, 4))
    commands = _finite("controls", controls, (None, 2))
    if not (np.isfinite(step) and step > 0):
        raise ProblemError(f"step: expected a positive number of seconds, got {step}")
    if substeps < 1:
        raise ProblemError(f"substeps: expected 1 or more, got {substeps}")
    advance, part = _method(method), step / substeps
    by_speed, by_turn = moment_generators(system, basis, interval)
    path = [start.ravel()]
    for v, omega in commands:
        # m' = (v B_1 + omega B_2) m over one part of the step
        generator, moments = part * (v * by_speed + omega * by_turn), path[-1]
        for _ in range(substeps):
            moments = advance(generator, moments)
        path.append(moments)
    return np.stack(path).reshape(-1, *start.shape)


def _method(name: str) -> Advance:
    """The rule that advances moments by one part of a step."""
    rules = {"exponential": _exponential, "rk4": _rk4}
    if name not in rules:
        raise ProblemError(f"method: expected exponential or rk4, got {name!r}")
    return rules[name]


def _exponential(generator: Floats, moments: Floats) -> Floats:
    """Exact up to rounding."""
    from scipy.linalg import expm

    return np.asarray(expm(generator) @ moments)


def _rk4(generator: Floats, moments: Floats) -> Floats:
    """The classical rule, for a linear system: Taylor's polynomial of degree four."""
    term = total = moments
    for k in (1, 2, 3, 4):
        term = generator @ term / k
        total = total + term
    return total


def _finite(name: str, value: Any, shape: tuple[int | None, int]) -> Floats:
    """A finite array of the wanted shape; None stands for any length."""
    array = np.asarray(value, dtype=float)
    matches = array.ndim == 2 and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if not matches or not np.isfinite(array).all():
        wanted = ", ".join("steps" if n is None else str(n) for n in shape)
        raise ProblemError(f"{name}: expected finite numbers of shape ({wanted}), got shape {array.shape}")
    return array
