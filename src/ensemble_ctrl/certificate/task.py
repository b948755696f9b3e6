"""Proven robustness of a formula in dense time, for every member, by interval evaluation.

Time is cut into pieces.  A predicate gets a lower bound at each instant between pieces and one throughout each piece,
for all members of a parameter cell.  Because robustness in negation normal form never falls when a predicate rises,
evaluating the formula on lower bounds, which `Schedule` does exactly, gives a lower bound.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.bound import ALIKE, last_lowest
from ensemble_ctrl.certificate.commands import Commands
from ensemble_ctrl.certificate.disturbance import UNIT
from ensemble_ctrl.certificate.enclosure import CELLS, Flow, Ranged, Track, first_cells, signs_of
from ensemble_ctrl.certificate.masses import Masses, masses
from ensemble_ctrl.certificate.schedule import MOST, Schedule
from ensemble_ctrl.certificate.signals import UP, CellSignals
from ensemble_ctrl.constraints.stl.formula import Formula
from ensemble_ctrl.constraints.stl.rewrite import leaves, negation_normal_form, reads_fleet
from ensemble_ctrl.problem.signals import names_in

if TYPE_CHECKING:
    from ensemble_ctrl.problem import Problem
    from ensemble_ctrl.problem.ensemble import Ensemble, Member
    from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]

TIGHT = 5e-4
"""Metres within which the bound of a cell meets that of the worst centre before refinement ends."""
MAX_CELLS = {0: 1, 1: 4096}
"""Cells looked at for so many parameters before the search for a better bound ends; else `MANY_CELLS`."""
MANY_CELLS = 6_000
BLOCK = 1_000_000
"""Numbers held at a time: cells times instants."""
TURN = 0.5
"""Radians that a member turns at most in a piece of time to begin with, but for `MOST_PARTS`."""
MOST_PARTS = 64


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
        Upper bound of the robustness of the worst centre: the truth lies between the two. For a formula that reads the
        fleet (``mean``, ``share``), an upper bound over all cells.
    parameters : dict of str to float
        That centre's parameters; empty where the whole fleet is meant.
    covered : bool
        False if the formula is outside what this method can bound; `proven` is then minus infinity.
    share : float or None
        For ``share(p, f)``, a lower bound of the fleet's share for which `f` is proven with that robustness, 0 to 1.
    unit : str
        Of both numbers, where it is not metres: such as ``m/s``, or ``in mixed units (m, rad)`` for the smallest of
        numbers in several; empty for metres.
    """

    part: str
    proven: float
    sampled: float
    parameters: Member
    covered: bool = True
    share: float | None = None
    unit: str = ""


def scheduled(
    problem: Problem, controls: Floats, ranges: Mapping[str, Ranged], formula: Formula, split: int
) -> tuple[Flow, Schedule, Commands] | None:
    """The flow on the instants that a formula needs, each step in so many parts; None if it looks past the end.

    Its leaves are predicates, its windows numbers. Steps in which members turn far have more parts.
    """
    plain = negation_normal_form(formula)
    flow = Flow.of(problem, controls, ranges)
    # parts of a step: a power of two, so that no part turns by more than TURN
    turns = np.abs(flow.step * flow.omega) * flow.sharpest / TURN
    each = 2 ** np.ceil(np.log2(np.clip(np.nan_to_num(turns, nan=1.0), 1.0, MOST_PARTS))).astype(np.int64)
    parts = split * each
    while parts.sum() > MOST and parts.max() > 1:
        parts = np.maximum(parts // 2, 1)
    schedule = Schedule.of(plain, problem.duration, parts)
    if schedule is None:
        return None
    fine = flow.on(schedule.mesh)
    return fine, schedule, Commands.of(problem, controls, flow, fine, schedule.mesh)


def bound_task(
    problem: Problem,
    controls: Floats,
    ranges: Mapping[str, Ranged],
    formula: Formula,
    fleet: Fleet,
    split: int = 1,
    cells: int = 0,
    enough: float = np.inf,
) -> TaskBound:
    """Bound the robustness of a ground formula for every member with parameters in the ranges.

    `fleet` has the distributions that shares and means are of. `cells` of each parameter are looked at to begin with, 0
    for `CELLS`, and `split` parts of each step. A cell of which `enough` is proven is not looked at more closely.

    Notes
    -----
    *Guarantee*: `proven` is never above the robustness of any member in dense time.
    """
    found = scheduled(problem, controls, ranges, formula, split)
    if found is None:
        return TaskBound(str(formula), -np.inf, np.inf, {}, covered=False)
    flow, schedule, commands = found
    if not np.isfinite(flow.rounding()):
        return TaskBound(str(formula), -np.inf, np.inf, {})
    # parameters that only move the start enter linearly: their sides stay whole first, halved where that fails
    shifts: NDArray[np.bool_] = np.asarray(~flow.directions[:, :3].any(axis=1))
    wide, affine = reads_fleet(formula), any(set(names_in(leaf)) - {"x", "y"} for leaf in leaves(formula))
    bound = _refined(flow, schedule, commands, fleet, wide, shifts, (cells, enough), affine)
    if shifts.any() and bound.proven < 0 <= bound.sampled:
        again = _refined(flow, schedule, commands, fleet, wide, np.zeros_like(shifts), (cells, enough), affine)
        bound = again if again.proven > bound.proven else bound
    return replace(bound, part=str(formula))


class Cells(Protocol):
    """Parts of the parameters' box, with bounds of one formula on each."""

    @property
    def centre(self) -> Floats:
        """Middles, shape (cells, parameters)."""

    @property
    def half(self) -> Floats:
        """Half widths, shape (cells, parameters)."""

    @property
    def cost(self) -> float:
        """What a look at all of them takes."""

    def low(self, mass: Masses | None) -> Floats:
        """Lower bounds for all members of each; `mass` for a formula that reads the fleet."""

    def middle(self, mass: Masses | None) -> Floats:
        """The same if every member were in the middle of its cell."""

    def high(self, mass: Masses) -> Floats:
        """Upper bounds of a formula that reads the fleet."""

    def tried(self, low: Floats) -> tuple[float, float, Member]:
        """Lower and upper bounds of the worst of some members, and that member."""

    def halved(self, open_: NDArray[np.bool_], together: bool) -> Cells:
        """The open ones in two each, or all of them along the same side; the others are left out."""


def refined(cells: Cells, fleet: Ensemble, fleet_wide: bool, most: float, enough: float = np.inf) -> TaskBound:
    """The bound by cells that are halved until each meets the worst member seen, or `most` is spent.

    A cell, and a formula that reads the fleet, is looked at until `enough` is proven of it.

    Notes
    -----
    *Guarantee*: `proven` is at most the smallest lower bound of cells that make up the whole box.
    """
    proven, sampled, target, spent = np.inf, np.inf, np.inf, 0.0
    member: Member = {}
    whole = -np.inf
    while True:
        spent += cells.cost
        mass = masses(fleet, cells.centre, cells.half) if fleet_wide else None
        low = cells.low(mass)
        # branch and bound: cells stay open while their lower bound is below the best member seen
        low = np.where(np.isnan(low), -np.inf, low)
        if mass is not None:
            sampled, target = min(sampled, float(cells.high(mass).min())), float(cells.middle(mass).min())
            whole = max(whole, float(low.min()))
            more = bool((low < target - TIGHT).any()) and sampled >= 0 and whole < enough
            open_ = np.full(len(cells.centre), more)
        else:
            goal, seen, worst = cells.tried(low)
            target = min(target, goal)
            if seen < sampled - ALIKE:
                sampled, member = seen, worst
            open_ = low < min(target - TIGHT, enough)
            proven = min(proven, float(low[~open_].min(initial=np.inf)))
        if spent > most or not open_.any():
            return TaskBound("", whole if fleet_wide else min(proven, float(low.min())), sampled, member)
        cells = cells.halved(open_, fleet_wide)


@dataclass(frozen=True, eq=False)
class FlowCells:
    """Cells of robots on arcs; never halved along `whole_sides`. `affine` for a formula on headings and rates."""

    flow: Flow
    schedule: Schedule
    commands: Commands
    names: Sequence[str]
    whole_sides: NDArray[np.bool_]
    centre: Floats
    half: Floats
    affine: bool = False

    @property
    def cost(self) -> float:
        """How many there are."""
        return len(self.centre)

    def low(self, mass: Masses | None) -> Floats:
        """Lower bounds for all members of each."""
        return self._evaluate(self.centre, self.half, False, mass)

    def middle(self, mass: Masses | None) -> Floats:
        """Those of members in the middle of the sides that are halved."""
        return self._evaluate(self.centre, self.half * self.whole_sides, False, mass)

    def high(self, mass: Masses) -> Floats:
        """Upper bounds of a formula that reads the fleet."""
        return self._evaluate(self.centre, self.half, True, mass)

    def tried(self, low: Floats) -> tuple[float, float, Member]:
        """The middles, and the worst of them moved to the ends of the sides that stay whole.

        Where predicates are affine in the parameters, the corners of the worst cell as well: the bound is met there.
        """
        # an upper bound of one member's robustness is one of the least, too
        value = self.middle(None)
        seen, goal = _with_ends(self.flow, self.centre, value, self.whole_sides), float(value.min())
        if self.affine:
            k = int(low.argmin())
            corners = self.centre[k] + signs_of(len(self.flow.lower)) * self.half[k]
            corners = np.clip(corners, self.flow.lower, self.flow.upper)
            goal = min(goal, float(self._evaluate(corners, np.zeros_like(corners), False).min()))
            seen = np.concatenate([seen, corners])
        high = self._evaluate(seen, np.zeros_like(seen), True)
        k = last_lowest(high)
        return goal, float(high[k]), dict(zip(self.names, seen[k].tolist(), strict=True))

    def halved(self, open_: NDArray[np.bool_], together: bool) -> FlowCells:
        """The open ones in two each."""
        centre, half = _halved(self.flow, self.centre[open_], self.half[open_], ~self.whole_sides, together)
        return replace(self, centre=centre, half=half)

    def _evaluate(self, centres: Floats, half: Floats, upper: bool, mass: Masses | None = None) -> Floats:
        """Bounds of the formula at time 0, one a cell; one that reads the fleet needs all cells, and their mass."""
        everything = [slice(0, len(centres))]
        blocks = everything if mass is not None else _blocks(len(centres), self.flow.steps)
        signals = (CellSignals.of(self.flow, self.commands, centres[rows], half[rows], upper, mass) for rows in blocks)
        return np.concatenate([self.schedule.value(s) for s in signals])


def _refined(
    flow: Flow,
    schedule: Schedule,
    commands: Commands,
    fleet: Fleet,
    wide: bool,
    whole_sides: NDArray[np.bool_],
    effort: tuple[int, float],
    affine: bool,
) -> TaskBound:
    """The bound by cells of the flow's parameters, but for those of `whole_sides`; `effort` is `cells` and `enough`."""
    count = int((~whole_sides).sum())
    each = effort[0] or CELLS.get(count, 2)
    centres, half = first_cells(flow.lower, flow.upper, np.where(whole_sides, 1, each))
    first = FlowCells(flow, schedule, commands, fleet.names, whole_sides, centres, half, affine)
    return refined(first, fleet, wide, MAX_CELLS.get(count, MANY_CELLS), effort[1])


def _with_ends(flow: Flow, centres: Floats, value: Floats, whole_sides: NDArray[np.bool_]) -> Floats:
    """The centres, and the worst of them moved to the ends of the sides that stay whole."""
    if not whole_sides.any():
        return centres
    ends = np.array(list(product(*zip(flow.upper[whole_sides], flow.lower[whole_sides], strict=True))))
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
        # what each side adds to a cell: |dp/dq_k| half_k at its largest, and the remainder's part
        size[rows] = half[rows] * slope + _bending(flow, half[rows])
    size = np.where(sides, size, -1.0)
    k = np.full(len(size), size.max(axis=0).argmax()) if together else size.argmax(axis=1)
    rows_ = np.arange(len(half))
    half, move = half.copy(), np.zeros_like(half)
    half[rows_, k] /= 2
    move[rows_, k] = half[rows_, k]
    # rounded up, so that both halves cover the cell
    half[rows_, k] = half[rows_, k] * UP + UNIT * np.abs(centres[rows_, k])
    return np.concatenate([centres - move, centres + move]), np.concatenate([half, half])


def _bending(flow: Flow, half: Floats) -> Floats:
    """What each parameter's width adds to the nonlinear part at the end, shape (cells, parameters)."""
    whole = flow.remainder(half)[:, -1:]
    # the remainder less the same without one parameter's width
    without = np.repeat(half[:, None], half.shape[1], axis=1) * (1 - np.eye(half.shape[1]))
    return whole - np.stack([flow.remainder(without[:, k])[:, -1] for k in range(half.shape[1])], axis=1)


def _blocks(cells: int, steps: int) -> list[slice]:
    """Cells in turn, so many that their arrays stay small."""
    size = max(1, BLOCK // steps)
    return [slice(first, first + size) for first in range(0, cells, size)]
