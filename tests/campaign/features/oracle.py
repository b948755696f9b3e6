"""What robots do of a task, as far as their paths on a fine grid of time show it: upper bounds of what is true."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import monitor
from ..model import Long, Node
from ..monitor import Signal
from .geometry import beyond_sides, body_distance, distance
from .paths import Paths
from .world import Featured, below

Floats = NDArray[np.float64]

RAMP = 2e-17
"""Seconds in which a rate goes over from one piece of time to the next."""


def clearance(case: Featured, paths: Paths, name: str, window: tuple[float, float]) -> Floats:
    """Least distance of each robot from something at the times within a window, less its radius, shape (robots,)."""
    begin, end = window
    seen = (paths.times >= begin) & (paths.times <= end)
    times = np.concatenate([[begin, min(end, paths.times[-1])], paths.times[seen]])
    # places between two times by their chord, but for `bulge`
    place = np.stack([[np.interp(times, paths.times, one) for one in axis] for axis in np.moveaxis(paths.place, 2, 0)])
    place = np.moveaxis(place, 0, 2)
    heading = np.array([np.interp(times, paths.times, one) for one in paths.heading])
    if name in case.base.motions:
        when, where = (np.array(part) for part in case.base.motions[name])
        place = place - np.stack([np.interp(times, when, where[:, k]) for k in (0, 1)], axis=1)
    if case.footprint:
        body = np.array(case.footprint)
        each = [body_distance(shape, body, place, heading) for shape in case.shapes[name]]
    else:
        each = [distance(shape, place) for shape in case.shapes[name]]
    return np.asarray(np.min(each, axis=0).min(axis=1) - case.base.radius)


def apart(one: Paths, other: Paths, window: tuple[float, float]) -> float:
    """Least distance of any two robots at the times within a window."""
    seen = (one.times >= window[0]) & (one.times <= window[1])
    gaps = one.place[:, None, seen] - other.place[None, :, seen]
    return float(np.linalg.norm(gaps, axis=-1).min(initial=np.inf))


def robustness(case: Featured, paths: Paths, part: Node, k: int) -> float:
    """Of one robot, at time 0."""
    return float(_signal(case, paths, part, k).at(np.zeros(1, Long))[0])


def missed(paths: Paths, part: Node) -> float:
    """By how much that may be below the truth, for a part that is more than the least of what is seen."""
    return 4 * paths.bulge + 1e-8 * (1 + float(np.abs(paths.place).max()))


def _signal(case: Featured, paths: Paths, node: Node, k: int) -> Signal:
    """A formula's robustness over time."""
    times = paths.times.astype(Long)
    x, y = paths.place[k].T.astype(Long)
    match node[0]:
        case "pred":
            value = Long(node[1]) * x + Long(node[2]) * y + Long(node[3])
            return Signal(times, value / np.hypot(Long(node[1]), Long(node[2])))
        case "in":
            (x0, x1), (y0, y1) = case.base.regions[node[1]]
            return monitor.combined([Signal(times, side) for side in (x - x0, x1 - x, y - y0, y1 - y)], smallest=True)
        case "avoid":
            shapes = case.shapes[node[1]]
            each = [beyond_sides(shape, paths.place[k], case.base.radius).astype(Long) for shape in shapes]
            return monitor.combined([Signal(times, one) for one in each], smallest=True)
        case "signal":
            return _rates(paths, node, k)
        case "within":
            return _within(paths, node, k)
        case "not":
            return -_signal(case, paths, node[1], k)
        case "and" | "or":
            return monitor.combined([_signal(case, paths, part, k) for part in below(node)], node[0] == "and")
        case "U":
            left, right = _signal(case, paths, node[3], k), _signal(case, paths, node[4], k)
            if node[1] is None:
                return monitor.until_rest(left, right)
            return monitor.until_window(left, right, Long(node[1]), Long(node[2]))
    child = _signal(case, paths, node[3], k)
    child = child if node[0] == "F" else -child
    value = monitor.eventually_rest(child) if node[1] is None else monitor.eventually(child, *map(Long, node[1:3]))
    return value if node[0] == "F" else -value


def _column(paths: Paths, name: str, k: int) -> tuple[Floats, bool]:
    """A signal of a robot: at the times, or in the pieces between them."""
    name = {"delta": "second"}.get(name, name)
    return (paths.heading[k], False) if name == "heading" else (paths.rates[name][k], True)


def _rates(paths: Paths, node: Node, k: int) -> Signal:
    """A linear predicate on headings and rates, which go over to the next piece's in no time."""
    ends = np.repeat(paths.times.astype(Long), 2)[1:-1]
    ends[1:-1:2] -= Long(RAMP)
    ends[2::2] += Long(RAMP)
    total = np.full(len(ends), Long(node[2]))
    for name, factor in node[1]:
        value, between = _column(paths, name, k)
        total += Long(factor) * (np.repeat(value, 2) if between else np.repeat(value, 2)[1:-1]).astype(Long)
    return Signal(ends, total / np.sqrt(sum(Long(factor) ** 2 for _, factor in node[1])))


def _within(paths: Paths, node: Node, k: int) -> Signal:
    """How far an angle is within its range, whole turns aside."""
    _, name, half, centre = node
    value, _ = _column(paths, name, k)
    flat = _rates(paths, ("signal", ((name, 1.0),), 0.0), k)
    low, high = (int(np.floor((end - centre) / (2 * np.pi))) for end in (value.min(), value.max()))
    turns = [Long(centre) + 2 * Long(np.pi) * n for n in range(low - 1, high + 3)]
    pairs = [
        monitor.combined([Signal(flat.t, half + side * (flat.y - turn)) for side in (-1, 1)], smallest=True)
        for turn in turns
    ]
    return monitor.combined(pairs, smallest=False)
