"""The two number systems of a robustness walk: exact (NumPy) and smooth (NumPy or CasADi).

A value is a matrix of shape (members, times). Everything an operator needs is written once over ``all_of``
(min) and ``any_of`` (max); `ExactOps` replaces what NumPy does faster.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from functools import reduce
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl.formula import Share
from ensemble_ctrl.core.errors import ProblemError

Array = NDArray[np.float64]
Value = Any  # a matrix (members, times) of whatever the operations understand
Combine = Callable[[Iterable[Value]], Value]


class Ops(ABC):
    """Operations on values; slices ``v[:, i:j]`` are all that they need of the matrix type."""

    @abstractmethod
    def all_of(self, values: Iterable[Value]) -> Value:
        """Entrywise minimum of one or more values of one shape."""

    @abstractmethod
    def any_of(self, values: Iterable[Value]) -> Value:
        """Entrywise maximum of one or more values of one shape."""

    @abstractmethod
    def times(self, columns: Sequence[Value]) -> Value:
        """Put values one after the other in time."""

    @abstractmethod
    def members(self, rows: Sequence[Value]) -> Value:
        """Put values of different members below each other."""

    @abstractmethod
    def ranked(self, value: Value, share: Share) -> Value:
        """For each time the value that a share of the members reaches: shape (1, times)."""

    def known(self, value: float, members: int, times: int) -> Value:
        """One number for all members and times."""
        return np.full((members, times), value)

    def worst_member(self, value: Value) -> Value:
        """Smallest value over the members: shape (1, times)."""
        return self.all_of(value[i : i + 1, :] for i in range(value.shape[0]))

    def always(self, value: Value, width: int, count: int) -> Value:
        """Minimum over ``[t, t + width)`` for the first `count` times; width 0: to the end."""
        return self._windows(value, width, count, self.all_of)

    def eventually(self, value: Value, width: int, count: int) -> Value:
        """Maximum over ``[t, t + width)`` for the first `count` times; width 0: to the end."""
        return self._windows(value, width, count, self.any_of)

    def until(self, left: Value, right: Value, low: int, high: int) -> Value:
        """Until over steps [low, high], for all t with t + high in `left`; `right` starts at `low`."""
        count = left.shape[1] - high
        # max_i min(right(t + i), min_{j <= i} left(t + j)) over i = low .. high, the inner minimum carried along
        held = self.all_of(left[:, i : i + count] for i in range(low + 1))
        cases = [self.all_of([right[:, :count], held])]
        for i in range(1, high - low + 1):
            held = self.all_of([held, left[:, low + i : low + i + count]])
            cases.append(self.all_of([right[:, i : i + count], held]))
        return self.any_of(cases)

    def release(self, left: Value, right: Value, low: int, high: int) -> Value:
        """The dual of `until`, with the same arguments. Quadratic in `high` here."""
        count = left.shape[1] - high
        # min_i max(right(t + i), max_{j <= i} left(t + j)) over i = low .. high
        freed = [left[:, i : i + count] for i in range(high + 1)]
        return self.all_of(
            self.any_of([right[:, i - low : i - low + count], *freed[: i + 1]]) for i in range(low, high + 1)
        )

    def until_end(self, left: Value, right: Value, count: int) -> Value:
        """Until over all steps that the values have left, for the first `count` times."""
        last = left.shape[1] - 1
        return self.times([self.until(left[:, i:], right[:, i:], 0, last - i) for i in range(count)])

    def release_end(self, left: Value, right: Value, count: int) -> Value:
        """Release over all steps that the values have left, for the first `count` times."""
        last = left.shape[1] - 1
        return self.times([self.release(left[:, i:], right[:, i:], 0, last - i) for i in range(count)])

    def _windows(self, value: Value, width: int, count: int, combine: Combine) -> Value:
        """Combine `width` shifted slices; for width 0 the columns to the end, from each of `count` times."""
        if width:
            return combine(value[:, i : i + count] for i in range(width))
        size = value.shape[1]
        return self.times([combine(value[:, j : j + 1] for j in range(i, size)) for i in range(count)])


class ExactOps(Ops):
    """Minimum and maximum of NumPy arrays.

    Notes
    -----
    A window costs a number of passes logarithmic in its width, each over all members and times at once; until
    is one backward pass, by ``f U[a,b] g = G[0,a] f and F[a,b] g and F[a,a] (f U g)`` (Donzé, Ferrère and
    Maler 2013).
    """

    def all_of(self, values: Iterable[Value]) -> Array:
        """Entrywise minimum."""
        return _reduced(values, np.minimum)

    def any_of(self, values: Iterable[Value]) -> Array:
        """Entrywise maximum."""
        return _reduced(values, np.maximum)

    def times(self, columns: Sequence[Value]) -> Array:
        """Join in time."""
        return np.hstack(columns)

    def members(self, rows: Sequence[Value]) -> Array:
        """Join members."""
        return np.vstack(rows)

    def ranked(self, value: Value, share: Share) -> Array:
        """Exact order statistic of members that weigh the same."""
        # the rank-th largest value of each column
        place = value.shape[0] - share.rank(value.shape[0])
        return np.asarray(np.partition(value, place, axis=0)[place : place + 1])

    def worst_member(self, value: Value) -> Array:
        """Minimum over the members."""
        return np.asarray(np.min(value, axis=0, keepdims=True))

    def always(self, value: Value, width: int, count: int) -> Array:
        """Sliding minimum."""
        return _sliding(value, width, count, np.minimum)

    def eventually(self, value: Value, width: int, count: int) -> Array:
        """Sliding maximum."""
        return _sliding(value, width, count, np.maximum)

    def until(self, left: Value, right: Value, low: int, high: int) -> Array:
        """Until by one backward pass and two sliding windows."""
        count = left.shape[1] - high
        # G[0,low] left and F[low,high] right and F[low,low] (left U right) (Donze, Ferrere, Maler 2013)
        open_ended = self.until_end(left[:, low:], right, count)
        held = self.always(left, low + 1, count)
        return np.minimum(np.minimum(held, self.eventually(right, high - low + 1, count)), open_ended)

    def release(self, left: Value, right: Value, low: int, high: int) -> Array:
        """Minus the until of the negated values."""
        return -self.until(-left, -right, low, high)

    def until_end(self, left: Value, right: Value, count: int) -> Array:
        """Backward pass ``u(t) = min(left(t), max(right(t), u(t + 1)))``."""
        # times first in memory, so that each step of the pass is one contiguous row
        rows, goals = np.ascontiguousarray(left.T), np.ascontiguousarray(right.T)
        result = np.minimum(rows, goals)
        for t in range(len(rows) - 2, -1, -1):
            np.maximum(goals[t], result[t + 1], out=result[t])
            np.minimum(rows[t], result[t], out=result[t])
        return np.asarray(result[:count].T)

    def release_end(self, left: Value, right: Value, count: int) -> Array:
        """Minus the until of the negated values."""
        return -self.until_end(-left, -right, count)


def _reduced(values: Iterable[Array], pick: np.ufunc) -> Array:
    """Entrywise extremum, with one array of its own for all results on the way."""
    rest = iter(values)
    first = next(rest)
    second = next(rest, None)
    if second is None:
        return first
    result = pick(first, second)
    for value in rest:
        pick(result, value, out=result)
    return np.asarray(result)


def _sliding(value: Array, width: int, count: int, pick: np.ufunc) -> Array:
    """Extremum of `width` entries (0: of all that follow) from each of the first `count` times."""
    if width == 0:
        # running extremum from the end
        value = np.hstack([value[:, : count - 1], pick.reduce(value[:, count - 1 :], axis=1, keepdims=True)])
        return np.asarray(pick.accumulate(value[:, ::-1], axis=1)[:, ::-1])
    value = value[:, : count + width - 1]
    if count == 1:
        return np.asarray(pick.reduce(value, axis=1, keepdims=True))
    # extrema of spans 1, 2, 4 ..; two of the longest that fit cover a window
    span = 1  # value[:, t] covers [t, t + span)
    while 2 * span <= width:
        value = pick(value[:, :-span], value[:, span:])
        span *= 2
    return np.asarray(pick(value[:, :count], value[:, width - span : width - span + count]))


class Backend(Protocol):
    """Functions that the smooth operations need of an array library."""

    def exp(self, value: Value, /) -> Value:
        """Entrywise."""

    def log(self, value: Value, /) -> Value:
        """Entrywise."""

    def fmax(self, left: Value, right: Value, /) -> Value:
        """Entrywise."""

    def fmin(self, left: Value, right: Value, /) -> Value:
        """Entrywise."""

    def hstack(self, values: Sequence[Value], /) -> Value:
        """Join along the second axis."""

    def vstack(self, values: Sequence[Value], /) -> Value:
        """Join along the first axis."""


class NumpyBackend:
    """NumPy's functions under the names of `Backend`."""

    exp = staticmethod(np.exp)
    log = staticmethod(np.log)
    fmax = staticmethod(np.maximum)
    fmin = staticmethod(np.minimum)
    hstack = staticmethod(np.hstack)
    vstack = staticmethod(np.vstack)


class SmoothOps(Ops):
    r"""Log-sum-exp in place of maximum and minimum.

    .. math:: \widetilde{\max}\,a = \frac1K \log\frac1n\sum_i e^{K a_i}, \quad
              \widetilde{\min}\,a = -\frac1K \log\sum_i e^{-K a_i}

    Parameters
    ----------
    sharpness : float
        K > 0, in 1/metres when the values are metres; the error is at most ``log(n)/K`` an operator.
    backend : Backend
        Functions of the array library; NumPy's by default.

    Notes
    -----
    ``eq:maxLSE`` and ``eq:minLSE`` of Arias et al., One Ring to Rule Them All, with ``log(n)/K`` taken off
    the maximum, and evaluated with the shift, so that no K overflows.
    *Guarantee*: every operation is a lower bound of the exact one and does not decrease in its arguments, so
    the smooth robustness of a formula in negation normal form is a **lower bound** of the exact one
    (sufficient, not necessary). This holds for the floating-point numbers too.
    """

    def __init__(self, sharpness: float, backend: Backend | None = None) -> None:
        if not (sharpness > 0 and math.isfinite(sharpness)):
            raise ProblemError(f"sharpness: expected a positive number, got {sharpness}")
        self.sharpness = float(sharpness)
        self.backend: Backend = NumpyBackend() if backend is None else backend

    def all_of(self, values: Iterable[Value]) -> Value:
        """Smooth minimum."""
        items = list(values)
        # eq:minLSE: min a - log(sum_i exp(K (min a - a_i))) / K, never above the minimum
        least = reduce(self.backend.fmin, items)
        return least - self._log_mean_exp([least - item for item in items], 1)

    def any_of(self, values: Iterable[Value]) -> Value:
        """Smooth maximum, less log(n)/K."""
        items = list(values)
        # eq:maxLSE less log(n) / K: max a + log(sum_i exp(K (a_i - max a)) / n) / K, never above the maximum
        most = reduce(self.backend.fmax, items)
        return most + self._log_mean_exp([item - most for item in items], len(items))

    def times(self, columns: Sequence[Value]) -> Value:
        """Join in time."""
        return self.backend.hstack(columns)

    def members(self, rows: Sequence[Value]) -> Value:
        """Join members."""
        return self.backend.vstack(rows)

    def ranked(self, value: Value, share: Share) -> Value:
        """The worst member's value, a lower bound for every share (ranks have no smooth form here)."""
        return self.worst_member(value)

    def _log_mean_exp(self, shifted: list[Value], divisor: int) -> Value:
        """``log(sum exp(K a) / divisor) / K`` for ``a <= 0``; dividing first keeps its sign exact."""
        if len(shifted) == 1:
            return 0.0
        # exponents are <= 0: no overflow, and one of them is 0
        total = sum(self.backend.exp(self.sharpness * item) for item in shifted)
        return self.backend.log(total / divisor) / self.sharpness
