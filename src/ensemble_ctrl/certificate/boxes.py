"""Pieces of a fleet's motion: cells of parameters during pieces of steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes as columns: index of the centre in the track, half widths, step, and the share of the step they cover.

    `cell` is the first cell that each is a part of.
    """

    centre: Ints
    cell: Ints
    half: Floats
    step: Ints
    begin: Floats
    end: Floats

    def __len__(self) -> int:
        return len(self.centre)

    def where(self, mask: NDArray[np.bool_]) -> Boxes:
        """Some of the boxes."""
        return Boxes(*(column[mask] for column in vars(self).values()))

    def joined(self, other: Boxes) -> Boxes:
        """Both lists."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Boxes(*(np.concatenate(pair) for pair in pairs))
