"""Signal Temporal Logic in continuous time, exact for signals that are linear between their knots.

Robustness changes by at most as much as the signals of the predicates do. So with a signal replaced by its chords, the
value is that of the signal itself give or take what the chords leave it by.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .model import Long, Longs

Combine = Callable[[Longs, Longs], Longs]


@dataclass(frozen=True, eq=False)
class Signal:
    """A continuous function, linear between increasing times."""

    t: Longs
    y: Longs

    def at(self, times: Longs) -> Longs:
        """Values; the end's beyond an end."""
        k = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, max(len(self.t) - 2, 0))
        if len(self.t) == 1:
            return np.full(len(times), self.y[0])
        share = np.clip((times - self.t[k]) / (self.t[k + 1] - self.t[k]), 0, 1)
        return np.asarray(self.y[k] + share * (self.y[k + 1] - self.y[k]))

    def __neg__(self) -> Signal:
        """Its negation."""
        return Signal(self.t, -self.y)

    def until(self, end: np.longdouble) -> Signal:
        """The part up to a time."""
        if end >= self.t[-1]:
            return self
        keep = self.t < end
        if not keep.any():
            return Signal(self.t[:1], self.y[:1])
        return Signal(np.append(self.t[keep], end), np.append(self.y[keep], self.at(np.array([end]))))


def combined(signals: Sequence[Signal], smallest: bool) -> Signal:
    """The smallest or the largest of several, up to the first end."""
    result = signals[0]
    for other in signals[1:]:
        result = _pair(result, other, np.minimum if smallest else np.maximum)
    return result


def _pair(f: Signal, g: Signal, combine: Combine) -> Signal:
    """Both on the times of both and where they cross."""
    end = min(f.t[-1], g.t[-1])
    f, g = f.until(end), g.until(end)
    t = f.t if len(f.t) == len(g.t) and bool((f.t == g.t).all()) else np.unique(np.concatenate([f.t, g.t]))
    a, b = f.at(t), g.at(t)
    cross = _crossings(t, a - b)
    if len(cross):
        t = np.unique(np.concatenate([t, cross]))
        a, b = f.at(t), g.at(t)
    return Signal(t, combine(a, b))


def _crossings(t: Longs, d: Longs) -> Longs:
    """Where a signal is zero between its knots."""
    k = np.flatnonzero(d[:-1] * d[1:] < 0)
    return np.asarray(t[k] + (t[k + 1] - t[k]) * (d[k] / (d[k] - d[k + 1])))


def eventually(f: Signal, a: np.longdouble, b: np.longdouble) -> Signal:
    """The largest value within the window ``[t + a, t + b]``."""
    end = max(f.t[-1] - b, Long(0))
    knots = np.concatenate([f.t - a, f.t - b, np.array([Long(0), end])])
    t = np.unique(knots[(knots >= 0) & (knots <= end)])
    if len(t) == 1:
        inside = f.y[(f.t > t[0] + a) & (f.t < t[0] + b)]
        ends = f.at(np.array([t[0] + a, t[0] + b]))
        return Signal(t, np.array([np.concatenate([ends, inside]).max()]))
    # knots within the window all through the piece from t[i] to t[i + 1]
    between = _largest(f.y, np.searchsorted(f.t, t[1:] + a, "left"), np.searchsorted(f.t, t[:-1] + b, "right"))
    first, last = f.at(t + a), f.at(t + b)
    return _upper_envelope(t, [(first[:-1], first[1:]), (last[:-1], last[1:]), (between, between)])


def _upper_envelope(t: Longs, lines: Sequence[tuple[Longs, Longs]]) -> Signal:
    """The largest of several lines on each piece of time, each with its values at the piece's ends."""
    begin, span = t[:-1], np.diff(t)
    shares = [np.zeros(len(begin), Long)]
    for i, (p0, p1) in enumerate(lines):
        for q0, q1 in lines[i + 1 :]:
            real = np.isfinite(p0) & np.isfinite(q0)
            d0, d1 = (np.where(real, p, 0) - np.where(real, q, 0) for p, q in ((p0, q0), (p1, q1)))
            cross = d0 * d1 < 0
            shares.append(np.where(cross, d0 / np.where(cross, d0 - d1, 1), 0))
    at = np.stack(shares)
    with np.errstate(invalid="ignore"):
        values = [np.where(np.isfinite(p0), p0 + at * (p1 - p0), p0) for p0, p1 in lines]
    best = np.maximum.reduce(values)
    end = np.maximum.reduce([p1[-1:] for _, p1 in lines])
    times, index = np.unique(np.append((begin + at * span).ravel(), t[-1]), return_index=True)
    return Signal(times, np.append(best.ravel(), end)[index])


def _largest(y: Longs, low: np.ndarray, high: np.ndarray) -> Longs:
    """The largest of ``y[low:high]`` for each pair; minus infinity for none."""
    tables = [y]
    while len(tables[-1]) > 2 ** (len(tables) - 1):
        half = 2 ** (len(tables) - 1)
        tables.append(np.maximum(tables[-1][:-half], tables[-1][half:]))
    size = high - low
    result = np.full(len(low), -np.inf, Long)
    for level, table in enumerate(tables):
        here = (size >= 2**level) & (size < 2 ** (level + 1))
        if here.any() and len(table):
            first, last = low[here], high[here] - 2**level
            result[here] = np.maximum(table[first], table[last])
    return result


def eventually_rest(f: Signal) -> Signal:
    """The largest value from now to the end."""
    if len(f.t) == 1:
        return f
    later = np.maximum.accumulate(f.y[::-1])[::-1][1:]
    return _upper_envelope(f.t, [(f.y[:-1], f.y[1:]), (later, later)])


def until_rest(f: Signal, g: Signal) -> Signal:
    """``f U g`` up to the end: the largest of min(g(t'), smallest f on [t, t']) over t' from t on."""
    both = _pair(f, g, np.minimum)
    t = both.t
    f, g = Signal(t, f.at(t)), Signal(t, g.at(t))
    if len(t) == 1:
        return both
    f0, f1, g0, g1 = f.y[:-1], f.y[1:], g.y[:-1], g.y[1:]
    falls = f1 < f0
    later = np.empty(len(t), Long)
    later[-1] = both.y[-1]
    within = np.where(falls, np.maximum(both.y[:-1], both.y[1:]), np.minimum(f0, np.maximum(g0, g1)))
    holds = np.where(falls, f1, f0)
    for i in range(len(t) - 2, -1, -1):
        later[i] = max(within[i], min(holds[i], later[i + 1]))
    # where f falls it is max(h, const), where it rises min(f, max(g, const)); both are linear between crossings
    const = np.where(falls, np.maximum(both.y[1:], np.minimum(f1, later[1:])), np.maximum(g1, later[1:]))
    share = [np.zeros(len(t) - 1, Long)]
    for p0, p1 in ((f0, f1), (g0, g1)):
        d0, d1 = p0 - const, p1 - const
        cross = d0 * d1 < 0
        share.append(np.where(cross, d0 / np.where(cross, d0 - d1, 1), 0))
    at = np.stack(share)
    fa, ga = f0 + at * (f1 - f0), g0 + at * (g1 - g0)
    value = np.where(falls, np.maximum(np.minimum(fa, ga), const), np.minimum(fa, np.maximum(ga, const)))
    times, index = np.unique(np.append((t[:-1] + at * np.diff(t)).ravel(), t[-1]), return_index=True)
    return Signal(times, np.append(value.ravel(), later[-1])[index])


def until_window(f: Signal, g: Signal, a: np.longdouble, b: np.longdouble) -> Signal:
    """``f U[a,b] g``: the right side within the window, and the left up to one that may come later.

    It ends where the window still fits: the left side is read up to its end, too.
    """
    later = until_rest(f, g)
    shifted = later.t >= a
    t = np.unique(np.append(later.t[shifted] - a, Long(0)))
    delayed = Signal(t, later.at(t + a))
    held = -eventually(-f, Long(0), a)
    whole = combined([eventually(g, a, b), held, delayed], smallest=True)
    return whole.until(max(f.t[-1] - b, Long(0)))


def ranked(signals: Sequence[Signal], weights: Longs, share: float) -> Signal:
    """The largest value that members of at least this weight reach, at every time."""
    t = np.unique(np.concatenate([s.t for s in signals]))
    values = np.stack([s.at(t) for s in signals])
    cross = [_crossings(t, values[i] - values[j]) for i in range(len(signals)) for j in range(i)]
    t = np.unique(np.concatenate([t, *cross]))
    values = np.stack([s.at(t) for s in signals])
    order = np.argsort(-values, axis=0)
    enough = np.cumsum(weights[order], axis=0) >= Long(share) - Long(1e-12)
    first = enough.argmax(axis=0)
    return Signal(t, np.take_along_axis(np.take_along_axis(values, order, axis=0), first[None], axis=0)[0])
