"""Where the members of a fleet may start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    pass


Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Start:
    """The box of parameters and the start of every member, which is linear in them.

    Attributes
    ----------
    names : tuple of str
        The parameters, those of the system and the offsets of the start alike.
    lower, upper : ndarray, shape (parameters,)
        Their ranges.
    origin : ndarray, shape (states,)
        The start where every offset is zero.
    shifts : ndarray of int, shape (parameters,)
        The state whose start a parameter shifts; -1 for a parameter of the system.
    spread : ndarray, shape (states,), optional
        By how much each state of any member may start off besides; zero if not given.
    """

    names: tuple[str, ...]
    lower: Floats
    upper: Floats
    origin: Floats
    shifts: NDArray[np.int64]
    spread: Floats | None = None
