"""Bounds of the derivatives of a right-hand side over tubes around polynomials, by states, commands and parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.errors import Unenclosed
from ensemble_ctrl.certificate.general.basis import UP
from ensemble_ctrl.certificate.general.gradients import Gradient, down, up
from ensemble_ctrl.certificate.general.growth import Jacobian

if TYPE_CHECKING:
    from ensemble_ctrl.certificate.general.enclosure import Pieces
    from ensemble_ctrl.problem.uncertainty import Uncertainty

Floats = NDArray[np.float64]


def jacobian(
    pieces: Pieces, c: Floats, tube: Floats, centre: Floats, half: Floats, bounds: Uncertainty | None = None
) -> tuple[Jacobian, Floats]:
    """Bounds of the Jacobian on every piece over the tube around its polynomial, and what drives the error.

    Parameters
    ----------
    pieces : Pieces
    c : ndarray, shape (pieces of time, states, cells, times, terms)
    tube : ndarray
        Assumed radius, which broadcasts to (pieces of time, states, cells).
    centre, half : ndarray, shape (cells, parameters)
    bounds : Uncertainty, optional
        Errors of the model; none if not given.

    Returns
    -------
    Jacobian, drive
        The drive, shape (pieces of time, cells, states), bounds
        ``|f(x, u + du, psi + dpsi) + w - f(x, u, psi)|`` for all `x` in the tube.

    Notes
    -----
    *Guarantee*: both hold for all states of the tube and all commands and parameters within the errors, so that the
    mean value theorem may be used along a segment to any true state, command and parameters.
    """
    count, states, cells = c.shape[:3]
    # boxes that hold x~(tau, s) +- R: c_00 +- (sum' |c| + R), rounded outwards
    middle = c[..., 0, 0]
    away = (np.abs(c).sum(axis=(3, 4)) - np.abs(middle)) * UP + np.abs(middle) * 1e-12 + tube
    low, high = (a.transpose(1, 0, 2).reshape(states, -1) for a in (down(middle - away), up(middle + away)))
    spread = _Spread.of(pieces, centre, half, count, bounds)
    slots = states + len(spread.sizes)
    x = [Gradient.of(low[i], high[i], slots, i) for i in range(states)]
    commands = [Gradient.of(*ends, slots, slot and states + slot - 1) for ends, slot in spread.commands]
    psi = {name: Gradient.of(*ends, slots, slot and states + slot - 1) for name, (ends, slot) in spread.psi.items()}
    rates = pieces.right_side(x, commands, {**pieces.numbers(x[0]), **psi})
    # [J_low, J_high]: rows are the derivatives of each rate by all states, then by commands and parameters with errors
    ends = [np.stack([getattr(rate, by) for rate in rates]) for by in ("low_by", "high_by")]
    if not all(np.isfinite(end).all() for end in ends):
        raise Unenclosed("the derivative of the right-hand side is not bounded near the way")
    matrices = [
        np.ascontiguousarray(end[:, :states].reshape(states, states, count, cells).transpose(2, 3, 0, 1))
        for end in ends
    ]
    # d = |w| + sum_k sup |df/dz_k| |dz_k| over the commands and parameters z_k with errors
    drive = np.tile(_disturbances(pieces, bounds)[:, None], (1, count * cells))
    for k, size in enumerate(spread.sizes):
        steepest = np.maximum(np.abs(ends[0][:, states + k]), np.abs(ends[1][:, states + k]))
        drive = (drive + steepest * size * UP) * UP
    return Jacobian(*matrices), drive.reshape(states, count, cells).transpose(1, 2, 0)


def _disturbances(pieces: Pieces, bounds: Uncertainty | None) -> Floats:
    """``|w|`` of every state; one of the position counts for each of its coordinates."""
    system, given = pieces.system, {} if bounds is None else bounds.disturbance
    own = "position" not in system.states
    each = [
        given.get(name, 0.0) + (given.get("position", 0.0) if own and name in system.positions else 0.0)
        for name in system.states
    ]
    return np.array(each) * UP


Ends = tuple[Floats, Floats]


class _Spread:
    """Commands and parameters on all pieces as intervals, and by how much those with errors may be off.

    Each comes with its place among `sizes`, counted from one; None where it has no error.
    """

    def __init__(self) -> None:
        self.sizes: list[Floats] = []
        self.commands: list[tuple[Ends, int | None]] = []
        self.psi: dict[str, tuple[Ends, int | None]] = {}

    @classmethod
    def of(cls, pieces: Pieces, centre: Floats, half: Floats, count: int, bounds: Uncertainty | None) -> _Spread:
        """All of them for pieces of time times cells."""
        found, cells = cls(), len(centre)
        values = pieces.commands(cells)
        errors = np.zeros((len(values[0]) if values else 0, len(values)))
        if bounds is not None:
            errors = bounds.command_errors(pieces.system.controls, np.column_stack(values)) * UP
        for value, error in zip(values, errors.T, strict=True):
            found.commands.append(found._with_error((value, value), error))
        # the cells' ends, widened by the share that a parameter strays
        ends, varies = (down(centre - half), up(centre + half)), {} if bounds is None else bounds.varies
        for k, name in enumerate(pieces.start.names):
            each = np.tile(ends[0][:, k], count), np.tile(ends[1][:, k], count)
            found.psi[name] = found._strayed(each, varies.get(name, 0.0))
        for name in sorted(set(varies) - set(pieces.start.names)):
            value = np.full(count * cells, float(pieces.system.parameters[name]))
            found.psi[name] = found._strayed((value, value), varies[name])
        return found

    def _strayed(self, ends: Ends, share: float) -> tuple[Ends, int | None]:
        """A parameter that strays by a share of its own value."""
        return self._with_error(ends, share * np.maximum(np.abs(ends[0]), np.abs(ends[1])) * UP)

    def _with_error(self, ends: Ends, error: Any) -> tuple[Ends, int | None]:
        """An interval widened by an error, which gets a place of its own."""
        if not error.any():
            return ends, None
        self.sizes.append(error)
        return (down(ends[0] - error), up(ends[1] + error)), len(self.sizes)
