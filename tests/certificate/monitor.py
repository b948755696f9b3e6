"""An independent judge of one unicycle: closed-form arcs, and a dense-time monitor that samples every window."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Signal = Callable[[Floats], Floats]
"""A number for each instant."""

LOOKS = 41
"""Instants looked at in a window, its ends among them."""


def driven(controls: Floats, step: float, times: Floats, factor: float = 1.0) -> Floats:
    """Positions of a unicycle that starts at the origin towards +x, shape (*times, 2)."""
    v, omega = factor * np.asarray(controls, dtype=float).T
    n = np.clip(np.floor(times / step).astype(int), 0, len(v) - 1)
    heading = np.concatenate([[0.0], np.cumsum(omega * step)])
    moves = np.array([_arc(v[k], omega[k], heading[k], np.array(step)) for k in range(len(v))])
    places = np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
    rest = np.minimum(times, step * len(v)) - n * step
    return np.asarray(places[n] + _arc(v[n], omega[n], heading[n], rest))


def _arc(v: Floats, omega: Floats, heading: Floats, span: Floats) -> Floats:
    """Displacement along an arc: by its radius, or straight on where it hardly turns."""
    turn = omega * span
    straight = np.abs(turn) < 1e-9
    radius = v / np.where(straight, 1.0, omega)
    x = np.where(straight, v * span * np.cos(heading), radius * (np.sin(heading + turn) - np.sin(heading)))
    y = np.where(straight, v * span * np.sin(heading), radius * (np.cos(heading) - np.cos(heading + turn)))
    return np.stack([x, y], axis=-1)


def _window(a: float, b: float, times: Floats) -> Floats:
    """Instants of a window after each of the times, shape (*times, LOOKS)."""
    return np.asarray(times[..., None] + np.linspace(a, b, LOOKS))


def eventually(a: float, b: float, inner: Signal) -> Signal:
    """``F[a, b]``."""
    return lambda times: inner(_window(a, b, times)).max(axis=-1)


def always(a: float, b: float, inner: Signal) -> Signal:
    """``G[a, b]``."""
    return lambda times: inner(_window(a, b, times)).min(axis=-1)


def until(a: float, b: float, left: Signal, right: Signal) -> Signal:
    """``left U[a, b] right``."""

    def value(times: Floats) -> Floats:
        goals = _window(a, b, times)
        held = left(times[..., None, None] + (goals - times[..., None])[..., None] * np.linspace(0, 1, LOOKS))
        return np.asarray(np.minimum(right(goals), held.min(axis=-1)).max(axis=-1))

    return value


def box_distance(box: list[list[float]], points: Floats) -> Floats:
    """Signed distance to a rectangle."""
    (x0, x1), (y0, y1) = box
    away = np.stack(
        [np.maximum(x0 - points[..., 0], points[..., 0] - x1), np.maximum(y0 - points[..., 1], points[..., 1] - y1)]
    )
    return np.asarray(np.linalg.norm(np.maximum(away, 0.0), axis=0) + np.minimum(away.max(axis=0), 0.0))
