"""A third number system for the robustness walk: values that are rows of the program.

A value is a minimum of *terms*: linear rows on the fleet's points, and *levels*, decision variables that stand at or
below what they are named for.  A minimum of values is the union of their terms and costs nothing; a maximum of n values
becomes a new level with one smooth row

    level <= log(sum_i exp(K part_i)) / K - log(n) / K

*Guarantee*: a level kept below the whole value is never above the formula's exact robustness for any curve in the hull
of the points, because the right-hand side is never above the largest part and every other row is exact.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Literal, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import Formula, Ops, Predicate, Share, Signals, robustness
from ensemble_ctrl.core.errors import UnsupportedError
from ensemble_ctrl.ocp.disturbance import Growth
from ensemble_ctrl.ocp.program import Block, Build
from ensemble_ctrl.ocp.signals import Commanded, SignalRow

Floats = NDArray[np.float64]
Values = NDArray[np.object_]

SHARPNESS = 20.0
"""K of the log-sum-exp, per metre: a maximum of n parts is underestimated by at most log(n) / K metres."""
BAND = 0.35
"""Metres below the largest part, at the guess, within which parts of a maximum are kept."""


Reading = Literal["all", "some", "mean"]
"""Whom a row speaks of: everybody, the members that do what a share has to do, or the mean member."""


class Places(Protocol):
    """What rows ask of a layout: where points stand, and new levels."""

    @property
    def steps(self) -> int:
        """Control steps."""

    @property
    def count(self) -> int:
        """Points at one time."""

    @property
    def points(self) -> NDArray[np.int64]:
        """Indices of the points, shape (steps + 1, states * count): one state after the other."""

    def level(self) -> int:
        """Hand out the index of a new level."""


@dataclass(frozen=True, slots=True)
class Row:
    """``sum of coefficient * state + offset`` at one grid time, for every point, for some members, or for the mean one.

    `columns` says which states, by their place in the points.
    """

    at: int
    columns: tuple[int, ...]
    coefficients: tuple[float, ...]
    offset: float
    of: Reading


@dataclass(frozen=True, slots=True)
class Level:
    """A decision variable by its index."""

    index: int


Term = Row | SignalRow | Level
Minimum = tuple[Term, ...]


class GuessValues:
    """What rows and levels are worth at the guess.

    Parameters
    ----------
    curve : ndarray, shape (steps + 1, points, states)
        The points under the guess, metres.
    places : mapping
        For each reading the matrix from the points to those that its rows hold for.
    signals : Commanded, optional
        What rows about headings and rates are worth.
    """

    def __init__(self, curve: Floats, places: Mapping[Reading, Floats], signals: Commanded | None = None) -> None:
        self.signals = signals
        self.curves = {of: np.einsum("ij,tjd->tid", matrix, curve) for of, matrix in places.items()}
        self.levels: dict[int, float] = {}
        self._known: dict[Minimum, float] = {}

    def of(self, part: Minimum) -> float:
        """The value of a minimum of terms."""
        if part not in self._known:
            self._known[part] = min(self._term(term) for term in part)
        return self._known[part]

    def note(self, level: int, parts: Sequence[float]) -> None:
        """Set a level to the smooth maximum of its parts."""
        # log(sum_i exp(K part_i) / n) / K, shifted by the largest exponent
        scaled = SHARPNESS * np.array(parts)
        top = scaled.max()
        self.levels[level] = float(top + np.log(np.exp(scaled - top).mean())) / SHARPNESS

    def _term(self, term: Term) -> float:
        """The value of one term."""
        if isinstance(term, Level):
            return self.levels[term.index]
        if isinstance(term, SignalRow):
            assert self.signals is not None
            return self.signals.value(term)
        # min_i sum_j c_j P_ij + offset
        at = self.curves[term.of][term.at][:, list(term.columns)]
        return float((at @ np.array(term.coefficients) + term.offset).min())


@dataclass(frozen=True)
class PointSignals:
    """Predicates as rows on the points; all points count as one member, since each row holds for all of them."""

    steps: int
    step: float
    shift: tuple[float, ...] = (0.0, 0.0)
    of: Reading = "all"
    members: int = 1
    states: tuple[str, ...] = ("x", "y")
    errors: Growth | None = None
    signals: Commanded | None = None

    def leaf(self, predicate: Predicate, first: int, last: int) -> Values:
        """One row for each time, shape (1, last - first + 1); of headings and rates one for each kind of member."""
        coefficients, offset = predicate.normalised()
        by_name = dict(coefficients)
        if self.signals is not None and self.of != "mean" and self.signals.reads(by_name):
            lost = np.zeros(self.steps + 1) if self.errors is None else self.errors.lost(predicate)
            return _matrix([self.signals.rows(by_name, offset - float(lost[k]), k) for k in range(first, last + 1)])
        unknown = [name for name in by_name if name not in self.states]
        if unknown:
            wanted = " and ".join(self.states)
            raise UnsupportedError(
                f"task: the planner needs predicates over {wanted}, got {predicate} ({', '.join(unknown)})"
            )
        plane = len(self.states) == 2
        used = tuple(i for i, name in enumerate(self.states) if plane or name in by_name)
        values = tuple(by_name.get(self.states[i], 0.0) for i in used)
        if self.of != "mean":
            # the box of starts takes sum_i |c_i| shift_i from every row but the mean's
            offset -= sum(abs(value) * self.shift[i] for i, value in zip(used, values, strict=True))
        # errors of the model take |c| r(t_k) from the row of each time
        lost = np.zeros(self.steps + 1) if self.errors is None else self.errors.lost(predicate)
        return _matrix([(Row(k, used, values, offset - float(lost[k]), self.of),) for k in range(first, last + 1)])

    def mean(self) -> Signals:
        """The same for the mean member."""
        return replace(self, of="mean")


class LevelOps(Ops):
    """Minimum by union of terms, maximum by a new level; `maxima` lists the rows to add.

    Of the parts of a maximum only those are kept that come within `band` metres of the largest at the guess: the others
    would add nothing to a log-sum-exp of this sharpness, and leaving parts out only lowers it.
    """

    def __init__(self, layout: Places, guess: GuessValues, band: float = BAND) -> None:
        self.layout = layout
        self.guess = guess
        self.band = band
        self.maxima: list[tuple[list[int], int]] = []
        self.below: list[tuple[int, Minimum]] = []
        self._levels: dict[Minimum, int] = {}

    def all_of(self, values: Iterable[Values]) -> Values:
        """Entrywise union of terms."""
        return reduce(np.add, values)

    def any_of(self, values: Iterable[Values]) -> Values:
        """Entrywise a level under the parts' levels."""
        stacked = list(values)
        return _matrix([self._maximum([v[0, t] for v in stacked]) for t in range(stacked[0].shape[1])])

    def known(self, value: float, members: int, times: int) -> Values:
        """A row without a slope."""
        return _matrix([(Row(0, (0, 1), (0.0, 0.0), value, "all"),)] * times)

    def times(self, columns: Sequence[Values]) -> Values:
        """Join in time."""
        return np.hstack(columns)

    def members(self, rows: Sequence[Values]) -> Values:
        """Join members."""
        return np.vstack(rows)

    def ranked(self, value: Values, share: Share) -> Values:
        """Every point, a lower bound for any share."""
        return value

    def _maximum(self, parts: list[Minimum]) -> Minimum:
        """A new level at or below the smooth maximum of the parts."""
        # parts more than `band` below the largest are left out: that only lowers the log-sum-exp
        values = [self.guess.of(part) for part in parts]
        parts = [part for part, value in zip(parts, values, strict=True) if value >= max(values) - self.band]
        if len(parts) == 1:
            return parts[0]
        # a new variable, one smooth row for it, and a level below each part that is a minimum
        level = self.layout.level()
        self.guess.note(level, [self.guess.of(part) for part in parts])
        self.maxima.append(([self._level(part) for part in parts], level))
        return (Level(level),)

    def _level(self, part: Minimum) -> int:
        """A level at or below one part, made once."""
        if len(part) == 1 and isinstance(part[0], Level):
            return part[0].index
        if part not in self._levels:
            self._levels[part] = self.layout.level()
            self.guess.note(self._levels[part], [self.guess.of(part)])
            self.below.append((self._levels[part], part))
        return self._levels[part]


@dataclass(frozen=True, eq=False)
class TaskRows:
    """The rows of a task, and the largest values of its levels that they allow under the guess, by index."""

    blocks: list[Block]
    levels: dict[int, float]


def task_rows(
    parts: Sequence[Formula],
    level: int,
    layout: Places,
    step: float,
    mean: Floats,
    curve: Floats,
    shift: Floats,
    states: tuple[str, ...] = ("x", "y"),
    places: Floats | None = None,
    some: tuple[Sequence[Formula], Floats] | None = None,
    errors: Growth | None = None,
    commanded: Commanded | None = None,
    band: float = BAND,
) -> TaskRows:
    """Rows that keep `level` at or below the robustness of every part.

    Parameters
    ----------
    parts : sequence of Formula
        Ground formulas.
    level : int
        Index of the level of the whole.
    layout : Places
        Hands out further levels.
    step : float
        Seconds.
    mean : ndarray, shape (points,)
        Weights of the points in the mean member's position.
    curve : ndarray, shape (steps + 1, points, states)
        The points under the guess, metres.
    shift : ndarray, shape (states,)
        Half the sides of the box of start positions, metres: predicates hold for all of it.
    states : tuple of str
        Names of the points' coordinates.
    places : ndarray, shape (places, points), optional
        Combinations of the points at which rows have to hold; the points themselves if not given.
    some : pair of sequence of Formula and ndarray, optional
        Ground formulas for some members alone, and the matrix from the points to theirs.
    errors : Growth, optional
        Errors of the model, which take from every row.
    commanded : Commanded, optional
        Headings and rates of robots on arcs.
    band : float
        As of `LevelOps`; with 0 the largest part at the guess is taken, without any loss.
    """
    # for each reading the matrix from variables to the places at which its rows hold
    everybody = np.eye(layout.count) if places is None else places
    readings: dict[Reading, Floats] = {"all": everybody, "mean": mean[None, :]}
    fewer, readings["some"] = ((), everybody) if some is None else some
    guess = GuessValues(curve, readings, commanded)
    signals = PointSignals(layout.steps, step, tuple(shift.tolist()), states=states, errors=errors, signals=commanded)
    ops = LevelOps(layout, guess, band)
    read = [(part, signals) for part in parts] + [(part, replace(signals, of="some")) for part in fewer]
    # the walk over the formula: rows and levels whose minimum is the whole task's robustness
    whole = minimum_of(read, ops)
    if whole:
        ops.below.append((level, whole))
        guess.note(level, [guess.of(whole)])
    # `low <= term` for every term of a minimum: rows on points, and order between levels
    pairs = [(low, term) for low, part in ops.below for term in part]
    rows = [(low, term) for low, term in pairs if isinstance(term, Row)]
    read_off = [(low, term) for low, term in pairs if isinstance(term, SignalRow)]
    order = [(low, term.index) for low, term in pairs if isinstance(term, Level)]
    blocks = [
        *(commanded.blocks(read_off) if commanded is not None and read_off else []),
        *(
            b
            for of, matrix in readings.items()
            for b in _row_blocks([r for r in rows if r[1].of == of], layout, matrix)
        ),
        *_maximum_blocks(ops.maxima),
        *_order_blocks(order),
    ]
    return TaskRows(blocks, guess.levels)


def minimum_of(parts: Sequence[tuple[Formula, PointSignals]], ops: LevelOps) -> Minimum:
    """The value of a conjunction of ground formulas, each with the signals that it reads."""
    return sum((robustness(part, signals, ops) for part, signals in parts), ())


def _matrix(entries: Sequence[Minimum]) -> Values:
    """A value of one member."""
    matrix = np.empty((1, len(entries)), dtype=object)
    matrix[0, :] = np.fromiter(entries, dtype=object, count=len(entries))
    return matrix


def _row_blocks(rows: list[tuple[int, Row]], layout: Places, places: Floats) -> list[Block]:
    """``sum of coefficient * state + offset - level >= 0`` at every place, a combination of the points.

    There is one block for each set of states that rows are about.
    """
    about: dict[tuple[int, ...], list[tuple[int, Row]]] = defaultdict(list)
    for pair in rows:
        about[pair[1].columns].append(pair)
    return [_row_block(used, part, layout, places) for used, part in about.items()]


def _row_block(used: tuple[int, ...], rows: list[tuple[int, Row]], layout: Places, places: Floats) -> Block:
    """The rows about some of the states."""
    n, count, image = layout.count, len(used), ca.DM(places)

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        # sum_i c_i x_i for every variable, mapped to the places, + offset - level
        heights = sum((d[i] * z[i * n : (i + 1) * n] for i in range(1, count)), d[0] * z[:n])
        return ca.mtimes(image, heights) + d[count] - z[count * n]

    # an instance for each row: the states it is about at its time, for every variable, and its level
    at = np.array([row.at for _, row in rows])
    states = np.concatenate([i * n + np.arange(n) for i in used])
    columns = np.column_stack([layout.points[at][:, states], [level for level, _ in rows]])
    data = np.array([[*row.coefficients, row.offset] for _, row in rows])
    return _at_least_zero(build, columns, data, len(places))


def _maximum_blocks(maxima: list[tuple[list[int], int]]) -> list[Block]:
    """One block for each number of parts."""
    by_size: dict[int, list[list[int]]] = defaultdict(list)
    for parts, level in maxima:
        by_size[len(parts)].append([*parts, level])
    return [_maximum_block(n, np.array(columns)) for n, columns in sorted(by_size.items())]


def _maximum_block(n: int, columns: NDArray[np.int64]) -> Block:
    """``level <= smooth maximum of n parts`` for each row of `columns`."""

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        # log(sum exp(K a)) / K - log(n) / K - level
        largest: ca.SX = ca.logsumexp(SHARPNESS * z[:n]) / SHARPNESS
        return largest - float(np.log(n)) / SHARPNESS - z[n]

    return _at_least_zero(build, columns, np.zeros((len(columns), 0)), 1)


def _order_blocks(order: list[tuple[int, int]]) -> list[Block]:
    """``first <= second`` between levels."""
    if not order:
        return []
    return [_at_least_zero(lambda z, d: z[1] - z[0], np.array(order), np.zeros((len(order), 0)), 1)]


def _at_least_zero(build: Build, columns: NDArray[np.int64], data: Floats, rows: int) -> Block:
    """A block of rows that must not be negative."""
    low, high = np.zeros((len(columns), rows)), np.full((len(columns), rows), np.inf)
    return Block("task", build, columns, data, low, high)
