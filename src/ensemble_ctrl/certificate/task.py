"""Proven robustness of a formula in dense time, for every member, by interval evaluation.

Time is cut into *elements*: grid time 0, the open interval after it, grid time 1, and so on.  A predicate gets a lower
bound that holds throughout an element for all members of a parameter cell.  Because robustness in negation normal form
never falls when a predicate rises, evaluating the formula on lower bounds gives a lower bound.  Windows count elements:
for windows on the grid, the elements from ``e + 2a`` to ``e + 2b`` are exactly those that the window meets for every
instant of element ``e``, for both of ``F`` and ``G``.  A window off the grid is moved to it by `gridded`, to the side
that lowers the value.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.enclosure import Flow, Track, first_cells
from ensemble_ctrl.constraints.stl import (
    Eventually,
    ExactOps,
    Formula,
    Predicate,
    Share,
    Signals,
    Until,
    member_robustness,
    negation_normal_form,
    reads_fleet,
    resolve,
)
from ensemble_ctrl.constraints.stl.rewrite import rebuilt
from ensemble_ctrl.constraints.stl.robustness import Temporal, reach
from ensemble_ctrl.fleet import Fleet, Member
from ensemble_ctrl.moments import Interval

Floats = NDArray[np.float64]

TIGHT = 5e-4
"""Metres within which the bound of a cell meets that of the worst centre before refinement ends."""
MAX_CELLS = {0: 1, 1: 4096}
"""Cells looked at for so many parameters before the search for a better bound ends; else `MANY_CELLS`."""
MANY_CELLS = 6_000
CELLS = {0: 1, 1: 16, 2: 5, 3: 3}
"""Cells of each of so many parameters to begin with; else 2."""
BLOCK = 1_000_000
"""Numbers held at a time: cells times instants."""
NEAR = 1e-6
"""Share of a step within which a time counts as on the grid: decimal numbers are not exact in binary."""
ALIKE = 1e-12
"""Difference below which two shares count as the same: decimal numbers are not exact in binary."""
FINEST = 32
"""Most parts into which a step is cut to put windows on the grid."""
UP = 1 + 1e-12
"""Factor by which half widths are rounded up."""


@dataclass(frozen=True)
class TaskBound:
    """Robustness of one part of the task.

    Attributes
    ----------
    part : str
        The formula as text.
    proven : float
        Every member's robustness in dense time is at least this, metres.
    sampled : float
        Upper bound of the robustness of the worst centre: the truth lies between the two. Infinite for a formula that
        reads the fleet (``mean``, ``share``), which a list of centres can't refute.
    parameters : dict of str to float
        That centre's parameters; empty where there is none.
    covered : bool
        False if the formula is outside what this method can bound; `proven` is then minus infinity.
    share : float or None
        For ``share(p, f)``, a lower bound of the fleet's share for which `f` is proven with that robustness, 0 to 1.
    """

    part: str
    proven: float
    sampled: float
    parameters: Member
    covered: bool = True
    share: float | None = None


@dataclass(frozen=True, eq=False)
class CellSignals:
    """Bounds of predicates over elements; each member is a parameter cell."""

    centres: Floats
    half: Floats
    position: Floats
    slope: Floats
    curvature: Floats
    bulge: Floats
    error: float
    step: float
    upper: bool = False
    mass: Floats | None = None

    @classmethod
    def of(
        cls, flow: Flow, centres: Floats, half: Floats, upper: bool = False, mass: Floats | None = None
    ) -> CellSignals:
        """Enclosures of the cells ``centres +- half``, both of shape (cells, parameters); `mass` if all are there."""
        track = Track.of(flow, centres)
        n = np.arange(flow.steps)[None, :]
        bulge = flow.growth(n, np.full((1, 1), flow.step), flow.drives(centres)[:, None], half[:, None])
        curvature = flow.remainder(half)
        rest = bulge, flow.rounding(), flow.step / 2, upper, mass
        return cls(centres, half, track.position, track.slope, curvature, *rest)

    @property
    def members(self) -> int:
        """How many cells."""
        return len(self.centres)

    @property
    def steps(self) -> int:
        """Elements less one."""
        return 2 * int(self.bulge.shape[1])

    def leaf(self, predicate: Predicate, first: int, last: int) -> Floats:
        """Bounds of a predicate, shape (cells, last - first + 1)."""
        coefficients, offset = predicate.normalised()
        by_name = dict(coefficients)
        row = np.array([by_name.get("x", 0.0), by_name.get("y", 0.0)])
        value = self.position @ row + offset
        reach = (np.abs(self.slope @ row) * self.half[:, None]).sum(axis=-1)
        spread = reach + self.curvature + self.error
        sign = 1.0 if self.upper else -1.0
        ends = value + sign * spread
        between = (np.maximum if self.upper else np.minimum)(ends[:, :-1], ends[:, 1:]) + sign * self.bulge
        return _interleaved(ends, between)[:, first : last + 1]

    def mean(self) -> Signals:
        """The mean member.

        With a uniform law cells weigh the same: centres average, and curvature over a cell averages to a third. With
        another law a cell's mean may be anywhere in it.
        """
        away = self.curvature.max(axis=0, keepdims=True) / 3
        position = self.position.mean(axis=0, keepdims=True)
        if self.mass is not None:
            reach = (np.linalg.norm(self.slope, axis=-1) * self.half[:, None]).sum(axis=-1) + self.curvature
            away = (self.mass @ reach)[None] * UP
            position = np.einsum("c,ctd->td", self.mass, self.position)[None]
        return CellSignals(
            self.centres[:1],
            np.zeros_like(self.half[:1]),
            position,
            np.zeros_like(self.slope[:1]),
            away,
            self.bulge.max(axis=0, keepdims=True),
            self.error,
            self.step,
            self.upper,
        )


@dataclass(frozen=True, eq=False)
class CellOps(ExactOps):
    """Exact operations in which the fleet's cells have masses, which sum to 1."""

    mass: Floats

    def ranked(self, value: Floats, share: Share) -> Floats:
        """The largest value that cells of at least this mass reach; a share within 1e-12 of another is the same."""
        order = np.argsort(value, axis=0)
        mass = self.mass[order]
        below = np.cumsum(mass, axis=0) - mass
        enough = below <= 1 - share.p + (-ALIKE if share.strict else ALIKE)
        last = np.where(enough.any(axis=0), len(enough) - 1 - enough[::-1].argmax(axis=0), 0)
        return np.asarray(np.take_along_axis(np.take_along_axis(value, order, axis=0), last[None], axis=0))


def bound_task(flow: Flow, formula: Formula, fleet: Fleet, cells: int = 0) -> TaskBound:
    """Bound the robustness of a ground formula for every member of a fleet whose flow this is.

    `cells` of each parameter are looked at to begin with; 0 for `CELLS`.

    Notes
    -----
    *Guarantee*: `proven` is never above the robustness of any member in dense time, nor in discrete time on the grid.
    """
    plain = negation_normal_form(resolve(formula, flow.steps * flow.step))
    below, above = (gridded(plain, flow.step, upper=upper) for upper in (False, True))
    if below is None or reach(below, flow.step) > flow.steps:
        return TaskBound(str(formula), -np.inf, np.inf, {}, covered=False)
    shifts: NDArray[np.bool_] = np.asarray(~flow.directions[:, :3].any(axis=1))
    found = _refined(flow, (below, above), fleet, shifts, cells)
    if shifts.any() and found.proven < 0 <= found.sampled:
        again = _refined(flow, (below, above), fleet, np.zeros_like(shifts), cells)
        found = again if again.proven > found.proven else found
    return replace(found, part=str(formula))


def _refined(
    flow: Flow, pair: tuple[Formula, Formula | None], fleet: Fleet, whole_sides: NDArray[np.bool_], cells: int
) -> TaskBound:
    """The bound by cells that are halved until each meets its centre's value; never along `whole_sides`.

    The pair is the formula with its windows moved so that it falls, and so that it rises if there is such a move.
    """
    formula, above = pair
    count = int((~whole_sides).sum())
    each = cells or CELLS.get(count, 2)
    centres, half = first_cells(flow.lower, flow.upper, np.where(whole_sides, 1, each))
    fleet_wide, names = reads_fleet(formula), fleet.names
    even = fleet.cloud is None and all(isinstance(law, Interval) for law in fleet.parameters.values())
    proven, sampled, target, total = np.inf, np.inf, np.inf, 0
    member: Member = {}
    while len(centres):
        total += len(centres)
        mass = masses(fleet, centres, half) if fleet_wide else None
        low, centre = (_evaluate(flow, formula, centres, h, False, mass, even) for h in (half, half * whole_sides))
        if above is not None and not fleet_wide:
            seen = _with_ends(flow, centres, centre, whole_sides)
            best = _evaluate(flow, above, seen, np.zeros_like(seen), True)
            if best.min() < sampled:
                sampled, member = float(best.min()), dict(zip(names, seen[best.argmin()].tolist(), strict=True))
        target = min(target, float(centre.min()))
        open_ = low < target - TIGHT
        if fleet_wide:
            proven = float(low.min())
            open_ = np.full(len(low), bool(open_.any()))
        else:
            proven = min(proven, float(low[~open_].min(initial=np.inf)))
        if total > MAX_CELLS.get(count, MANY_CELLS) or not open_.any():
            proven = min(proven, float(low.min()))
            break
        centres, half = _halved(flow, centres[open_], half[open_], ~whole_sides, fleet_wide)
    return TaskBound(str(formula), proven, sampled, member)


def _with_ends(flow: Flow, centres: Floats, value: Floats, whole_sides: NDArray[np.bool_]) -> Floats:
    """The centres, and the worst of them moved to the ends of the sides that stay whole."""
    if not whole_sides.any():
        return centres
    ends = np.array(
        list(product(*((a, b) for a, b in zip(flow.lower[whole_sides], flow.upper[whole_sides], strict=True))))
    )
    moved = np.tile(centres[value.argmin()], (len(ends), 1))
    moved[:, whole_sides] = ends
    return np.concatenate([centres, moved])


def _halved(
    flow: Flow, centres: Floats, half: Floats, sides: NDArray[np.bool_], together: bool
) -> tuple[Floats, Floats]:
    """Each cell in two along the one of `sides` that moves its members most; all along the same one if `together`."""
    size = np.zeros_like(half)
    for rows in _blocks(len(centres), flow.steps):
        slope = np.linalg.norm(Track.of(flow, centres[rows]).slope, axis=-1).max(axis=1)
        size[rows] = half[rows] * slope + _bending(flow, half[rows])
    size = np.where(sides, size, -1.0)
    k = np.full(len(size), size.max(axis=0).argmax()) if together else size.argmax(axis=1)
    rows_ = np.arange(len(half))
    half, move = half.copy(), np.zeros_like(half)
    half[rows_, k] /= 2
    move[rows_, k] = half[rows_, k]
    half[rows_, k] *= UP
    return np.concatenate([centres - move, centres + move]), np.concatenate([half, half])


def _bending(flow: Flow, half: Floats) -> Floats:
    """What each parameter's width adds to the nonlinear part at the end, shape (cells, parameters)."""
    whole = flow.remainder(half)[:, -1:]
    without = np.repeat(half[:, None], half.shape[1], axis=1) * (1 - np.eye(half.shape[1]))
    return whole - np.stack([flow.remainder(without[:, k])[:, -1] for k in range(half.shape[1])], axis=1)


def gridded(formula: Formula, step: float, upper: bool) -> Formula | None:
    """A formula in negation normal form with every window moved to grid times, so that its value never rises.

    Parameters
    ----------
    formula : Formula
        With windows in seconds.
    step : float
        Seconds between grid times.
    upper : bool
        True moves windows so that the value never falls instead.

    Returns
    -------
    Formula or None
        None if a window that has to shrink holds no grid time.
    """
    parts = [gridded(part, step, upper) for part in formula.parts]
    if any(part is None for part in parts):
        return None
    same = rebuilt(formula, (part for part in parts if part is not None))
    if not isinstance(same, Temporal) or same.a is None or same.b is None:
        return same
    shrinks = isinstance(same, Eventually | Until) != upper
    slack = -NEAR if shrinks else NEAR
    low, high = (same.a / step + slack, same.b / step - slack)
    low, high = (np.ceil(low), np.floor(high)) if shrinks else (np.floor(low), np.ceil(high))
    return replace(same, a=float(low * step), b=float(high * step)) if low <= high else None


def alignment(formula: Formula, step: float) -> int:
    """The smallest number of parts of a step with which every window is on the grid, 1 if none up to `FINEST` does."""
    times = list(_times(formula))
    aligned = (n for n in range(1, FINEST + 1) if all(abs(t * n / step - round(t * n / step)) < NEAR for t in times))
    return next(aligned, 1)


def _times(formula: Formula) -> Iterator[float]:
    """Ends of every window, seconds."""
    if isinstance(formula, Temporal) and formula.a is not None and formula.b is not None:
        yield from (formula.a, formula.b)
    for part in formula.parts:
        yield from _times(part)


def _evaluate(
    flow: Flow,
    formula: Formula,
    centres: Floats,
    half: Floats,
    upper: bool,
    mass: Floats | None = None,
    even: bool = True,
) -> Floats:
    """Bounds of the formula at time 0, one a cell; one that reads the fleet needs all cells, and their mass.

    `even` says that the law is uniform within cells too.
    """
    everything = [slice(0, len(centres))]
    blocks = everything if mass is not None else _blocks(len(centres), flow.steps)
    ops = ExactOps() if mass is None else CellOps(mass)
    signals = (CellSignals.of(flow, centres[rows], half[rows], upper, None if even else mass) for rows in blocks)
    return np.concatenate([np.asarray(member_robustness(formula, s, ops))[:, 0] for s in signals])


def masses(fleet: Fleet, centres: Floats, half: Floats) -> Floats:
    """The laws' mass of each of the equal cells that make up the fleet's box, shape (cells,).

    Cells share their edges, and what lies on an edge belongs to the lower cell, so that nothing counts twice.
    """
    laws, cloud = list(fleet.parameters.items()), fleet.cloud or {}
    mass, robots = np.ones(len(centres)), None
    for k, (name, law) in enumerate(laws):
        width = law.upper - law.lower
        count = max(1, round(width / (2 * half[0, k]))) if width else 1
        index = np.clip(((centres[:, k] - law.lower) / max(width, 1e-300) * count).astype(int), 0, count - 1)
        edges = law.lower + width * np.arange(1, count) / count
        if name in cloud:
            place = np.searchsorted(edges, cloud[name], side="left")
            inside = index[:, None] == place
            robots = inside if robots is None else robots & inside
        elif isinstance(law, Interval):
            mass /= count
        else:
            mass *= np.diff(np.concatenate([[0.0], law.cdf(edges), [1.0]]))[index]
    return mass if robots is None else np.asarray(mass * robots.mean(axis=1))


def _blocks(cells: int, steps: int) -> list[slice]:
    """Cells in turn, so many that their arrays stay small."""
    size = max(1, BLOCK // steps)
    return [slice(first, first + size) for first in range(0, cells, size)]


def _interleaved(ends: Floats, between: Floats) -> Floats:
    """Grid times and intervals in turn, shape (cells, 2 steps + 1)."""
    out = np.empty((len(ends), ends.shape[1] + between.shape[1]))
    out[:, ::2], out[:, 1::2] = ends, between
    return out
