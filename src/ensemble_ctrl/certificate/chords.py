"""How far the places of a fleet's members are from each other at the grid times, cell by cell."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.enclosure import Flow, Track, first_cells

Floats = NDArray[np.float64]


def chords(flow: Flow) -> Iterator[Floats]:
    """Upper bounds of ``|p(t_n) - p(t_k)|`` for each cell of a flow's `grid`, in turn, and a little beyond its ends."""
    centres, half = first_cells(flow.lower, flow.upper, flow.grid)
    track, wider = Track.of(flow, centres), half * (1 + 1e-9) + 1e-12 * np.abs(centres)
    for place, slope, width in zip(track.position, track.slope, wider, strict=True):
        yield chords_of(flow, place, slope, width)


def chords_of(flow: Flow, place: Floats, slope: Floats, half: Floats) -> Floats:
    """The same of one cell with this track of its centre and these half widths, shape (steps + 1, steps + 1)."""
    # |p_c(t) - p_c(s)| + sum_k half_k |dp/dq_k (t) - dp/dq_k (s)| + R(max(t, s))
    rest = flow.remainder(half[None])[0]
    away = _distances(place) + np.maximum(rest[:, None], rest)
    for j, width in enumerate(half):
        away += width * _distances(slope[:, j])
    return np.asarray(away + 2 * flow.rounding())


def _distances(places: Floats) -> Floats:
    """Of places from each other."""
    x, y = (places[:, None, k] - places[:, k] for k in (0, 1))
    return np.asarray(np.sqrt(x * x + y * y))
