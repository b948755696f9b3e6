"""Proven robustness of a formula for any system: bounds of its predicates on polynomial tubes, cells halved.

A predicate is linear in the states, so that on a piece of time and a cell of parameters it is one polynomial with a
radius.  `Schedule` evaluates the formula on such bounds exactly, as it does for arcs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.bound import last_lowest
from ensemble_ctrl.certificate.general.basis import UNIT, UP, Basis, restriction, restriction_error
from ensemble_ctrl.certificate.general.boxes import Boxes, outwards
from ensemble_ctrl.certificate.general.enclosure import Enclosure
from ensemble_ctrl.certificate.instants import Mesh
from ensemble_ctrl.certificate.masses import MASS_ERROR, Masses
from ensemble_ctrl.certificate.schedule import Bounds, Schedule
from ensemble_ctrl.certificate.task import TaskBound, refined
from ensemble_ctrl.constraints.stl.formula import Share
from ensemble_ctrl.constraints.stl.leaves import Predicate

if TYPE_CHECKING:
    from ensemble_ctrl.problem.ensemble import Member
    from ensemble_ctrl.problem.fleet import Fleet


Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CORNERS = 6
"""Parameters whose ends are tried in all combinations for a low value."""
NUMBERS = 100_000_000
"""Coefficients of all cells looked at before the search for a better bound ends."""


@dataclass(frozen=True, eq=False)
class Elements:
    """Where the elements of a mesh are in an enclosure: instants and intervals in turn.

    Attributes
    ----------
    piece : ndarray of int, shape (elements,)
        The piece of time of the enclosure.
    begin, end : ndarray, shape (elements,)
        The part of it, -1 to 1.
    """

    piece: Ints
    begin: Floats
    end: Floats

    @classmethod
    def of(cls, mesh: Mesh, duration: float, steps: int, parts: int) -> Elements:
        """The elements of a mesh whose pieces cross no piece of the enclosure where a formula looks at them.

        A step of which a formula looks at an end only is one piece of the mesh: its ends are where they are;
        nothing is known of the interval.
        """
        step = duration / steps
        # begin and length of each piece of the mesh in pieces of the enclosure, from its step on
        low, size = (mesh.begin - mesh.owner * step) / step * parts, mesh.length / step * parts
        owner = np.append(np.repeat(mesh.owner, 2), mesh.owner[-1])
        begin = np.append(np.repeat(low, 2), low[-1] + size[-1])
        end = begin.copy()
        end[1::2] += size
        # the piece that holds the middle of an element; an interval across several pieces is not bounded
        part = np.clip(np.floor((begin + end) / 2).astype(np.int64), 0, parts - 1)
        end = np.where(end - begin > 1.5, np.nan, end)
        after = owner >= steps  # after the end robots stand
        piece = np.where(after, steps * parts - 1, owner * parts + part)
        begin, end = (np.where(after, 1.0, 2 * (share - part) - 1) for share in (begin, end))
        return cls(piece, *outwards(begin, end))

    @cached_property
    def groups(self) -> list[tuple[float, float, Ints]]:
        """The elements that are the same part of their pieces."""
        pairs, index = np.unique(np.stack([self.begin, self.end], axis=1), axis=0, return_inverse=True)
        order = np.argsort(index.ravel(), kind="stable")
        cuts = np.searchsorted(index.ravel()[order], np.arange(1, len(pairs)))
        return [(low, high, rows) for (low, high), rows in zip(pairs.tolist(), np.split(order, cuts), strict=True)]


@dataclass(frozen=True, eq=False)
class Signals:
    """Bounds of predicates over the elements of a mesh; each member is a cell of parameters.

    Attributes
    ----------
    basis : Basis
    c : ndarray, shape (cells, pieces of time, states read, times, terms)
    pad : ndarray, shape (cells, pieces of time, states read)
    states : tuple of str
        The states read.
    elements : Elements
    upper : bool
    masses : Masses or None
        Where the formula reads the fleet.
    """

    basis: Basis
    c: Floats
    pad: Floats
    states: tuple[str, ...]
    elements: Elements
    upper: bool = False
    masses: Masses | None = None

    @property
    def members(self) -> int:
        """How many cells."""
        return len(self.c)

    def leaf(self, predicate: Predicate, first: int, last: int) -> Floats:
        """Bounds of a predicate, shape (cells, last - first + 1)."""
        coefficients, offset = predicate.normalised()
        by_name, offset = dict(coefficients), offset + (predicate.slack if self.upper else 0.0)
        row = np.array([by_name.get(name, 0.0) for name in self.states])
        # mu(x~) as one polynomial; slack: |n| pad, 64 u of all numbers, and the cut in time
        c = np.einsum("q,ckqtp->cktp", row, self.c)
        size = np.einsum("q,ckqtp->ck", np.abs(row), np.abs(self.c))
        slack = np.einsum("q,ckq->ck", np.abs(row), self.pad) + 64 * UNIT * (size + abs(offset))
        slack = (slack + restriction_error(self.basis.times) * size) * UP
        sign, found = (1.0 if self.upper else -1.0), np.empty((len(c), len(self.elements.piece)))
        for low, high, rows in self.elements.groups:
            wanted = rows[(rows >= first) & (rows <= last)]
            piece = self.elements.piece[wanted]
            # c_00 + offset +- (sum' |c| + slack) on the part of the piece
            part = restriction(self.basis.times, low, high) @ c[:, piece]
            middle = part[:, :, 0, 0]
            spread = (np.abs(part).sum(axis=(2, 3)) - np.abs(middle)) * UP + slack[:, piece]
            found[:, wanted] = middle + offset + sign * spread
        bound = found[:, first : last + 1]
        return np.where(np.isnan(bound), sign * np.inf, bound)

    def mean(self) -> Bounds:
        """The mean member."""
        return MeanSignals(self)

    def ranked(self, value: Floats, share: Share) -> Floats:
        """The largest value that cells of at least this mass reach; minus infinity if no cells do."""
        if self.masses is None:
            raise AssertionError("a share is of all cells")
        return self.masses.reached(value, share, self.upper)

    def averaged(self) -> Signals:
        """Each cell's average member, for a distribution that is uniform within cells: terms of odd powers vanish."""
        # (1/2) int T_a(s) ds over [-1, 1] = 1 / (1 - a^2) for even a, 0 for odd a
        powers = self.basis.exponents
        weight = np.where(powers % 2 == 0, 1.0 / (1.0 - np.where(powers == 1, 0.0, powers) ** 2.0), 0.0).prod(axis=1)
        c = self.c @ weight[:, None]
        pad = self.pad + 16 * UNIT * np.abs(self.c).sum(axis=(3, 4))
        return replace(self, basis=Basis(self.basis.times, ()), c=c, pad=pad * UP)


@dataclass(frozen=True, eq=False)
class MeanSignals:
    """The mean member of all cells."""

    of: Signals
    members: int = 1

    @property
    def upper(self) -> bool:
        """Whether bounds are upper bounds."""
        return self.of.upper

    def leaf(self, predicate: Predicate, first: int, last: int) -> Floats:
        """The masses' mean of the cells' averages, which are anywhere in a cell if the distribution is not uniform."""
        found = self.of.masses
        if found is None:
            raise AssertionError("a mean is of all cells")
        each = (self.of.averaged() if found.even else self.of).leaf(predicate, first, last)
        # sum_c mass_c mu_c, each mass wrong by MASS_ERROR of the spread, and (cells + 8) u for rounding
        share = found.mass / found.total
        wrong = (0.0 if found.counted else len(share) * MASS_ERROR) * (each.max(axis=0) - each.min(axis=0))
        rounding = (len(share) + 8) * UNIT * np.abs(each).max(axis=0)
        return np.asarray(share @ each + (1.0 if self.upper else -1.0) * (wrong + rounding) * UP)[None]

    def mean(self) -> Bounds:
        """Itself."""
        return self

    def ranked(self, value: Floats, share: Share) -> Floats:
        """All of one member."""
        return value


@dataclass(frozen=True, eq=False)
class TubeCells:
    """Cells of parameters with the polynomials of the states that a formula reads."""

    boxes: Boxes
    pieces: int
    states: tuple[str, ...]
    schedule: Schedule
    elements: Elements
    fleet: Fleet

    @classmethod
    def of(
        cls, enclosure: Enclosure, states: tuple[str, ...], schedule: Schedule, elements: Elements, fleet: Fleet
    ) -> TubeCells:
        """All cells of an enclosure; boxes of one cell are next to each other."""
        rows = np.eye(len(fleet.states))[[fleet.states.index(name) for name in states]].reshape(len(states), -1)
        count, cells = enclosure.c.shape[0], len(enclosure.centre)
        boxes = Boxes.of(enclosure, rows, np.arange(count), -np.ones(count), np.ones(count))
        boxes = boxes.where(np.arange(count * cells).reshape(count, cells).T.ravel())
        return cls(boxes, count, states, schedule, elements, fleet)

    @property
    def centre(self) -> Floats:
        """Middles, shape (cells, parameters)."""
        return self.boxes.centre[:: self.pieces]

    @property
    def half(self) -> Floats:
        """Half widths, shape (cells, parameters)."""
        return self.boxes.half[:: self.pieces]

    @property
    def cost(self) -> float:
        """Coefficients of all of them."""
        return self.boxes.c.size

    def low(self, mass: Masses | None) -> Floats:
        """Lower bounds for all members of each."""
        return self.schedule.value(self._signals(mass))

    def middle(self, mass: Masses | None) -> Floats:
        """Those of members in the middle."""
        every = np.arange(len(self.centre))
        return self.schedule.value(
            replace(self._members(every, np.zeros((len(every), len(self.boxes.wide)))), masses=mass)
        )

    def high(self, mass: Masses) -> Floats:
        """Upper bounds of a formula that reads the fleet."""
        return self.schedule.value(replace(self._signals(mass), upper=True))

    def tried(self, low: Floats) -> tuple[float, float, Member]:
        """The middles of all cells, and the corners of the one with the lowest bound."""
        count = min(len(self.boxes.wide), CORNERS)
        # s = +-1 in the first parameters of the cell with the lowest bound, 0 in the others
        corners = np.array(list(product((-1.0, 1.0), repeat=count))).reshape(2**count, count)
        corners = np.pad(corners, ((0, 0), (0, len(self.boxes.wide) - count)))
        cells = np.concatenate([np.arange(len(low)), np.full(len(corners), int(low.argmin()))])
        s = np.concatenate([np.zeros((len(low), corners.shape[1])), corners])
        some = self._members(cells, s)
        least, most = self.schedule.value(some), self.schedule.value(replace(some, upper=True))
        k = last_lowest(most)
        worst = self.centre[cells[k]].copy()
        worst[self.boxes.wide] += s[k] * self.half[cells[k]][self.boxes.wide]
        worst = np.clip(worst, *_ends(self.fleet))
        return float(least.min()), float(most[k]), dict(zip(self.fleet.names, worst.tolist(), strict=True))

    def halved(self, open_: NDArray[np.bool_], together: bool) -> TubeCells:
        """The open cells in two along the parameter that moves the states most; all alike if `together`."""
        some = self.boxes.where(np.repeat(open_, self.pieces))
        # the parameter that moves the states most on any piece of a cell; one side for all if together
        sizes = some.sizes()[:, 1:].reshape(-1, self.pieces, len(some.wide)).max(axis=1)
        side = np.full(len(sizes), sizes.max(axis=0).argmax()) if together else sizes.argmax(axis=1)
        return replace(self, boxes=some.halved(np.repeat(side + 1, self.pieces)))

    def _signals(self, found: Masses | None = None) -> Signals:
        """Lower bounds over elements for all members of each cell."""
        shape = len(self.centre), self.pieces
        c, pad = (part.reshape(*shape, *part.shape[1:]) for part in (self.boxes.c, self.boxes.pad))
        return Signals(self.boxes.basis, c, pad, self.states, self.elements, False, found)

    def _members(self, cells: Ints, s: Floats) -> Signals:
        """Lower bounds over elements for one member of each of some cells; `s` is -1 to 1 in each parameter."""
        all_, basis = self._signals(), self.boxes.basis
        # T_a(s) of one member: polynomials in time alone are left
        terms = np.cos(np.arccos(s)[:, None, :] * basis.exponents).prod(axis=2)
        c = np.einsum("mkqtp,mp->mkqt", all_.c[cells], terms)[..., None]
        pad = (all_.pad[cells] + 64 * UNIT * np.abs(all_.c[cells]).sum(axis=(3, 4))) * UP
        return replace(all_, basis=Basis(basis.times, ()), c=c, pad=pad)


def bound_task(
    enclosure: Enclosure,
    schedule: Schedule,
    elements: Elements,
    states: tuple[str, ...],
    fleet: Fleet,
    fleet_wide: bool,
) -> TaskBound:
    """Bound the robustness of a formula for every member of an enclosure.

    Notes
    -----
    *Guarantee*: `proven` is never above the robustness of any member in dense time.
    """
    cells = TubeCells.of(enclosure, states, schedule, elements, fleet)
    return refined(
        cells, fleet, fleet_wide, NUMBERS if len(enclosure.wide) else 0, enough=0.0 if fleet_wide else np.inf
    )


def _ends(fleet: Fleet) -> tuple[Floats, Floats]:
    """The ranges of the parameters."""
    distributions = list(fleet.parameters.values())
    return np.array([distribution.lower for distribution in distributions]), np.array(
        [distribution.upper for distribution in distributions]
    )
