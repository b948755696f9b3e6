r"""Where every member is at every instant: a polynomial in time and parameters, and a proven radius around it.

For ``x' = f(x, u, psi)`` with `u` constant in each step, and `psi` and the start in a box of parameters:

1. polynomials `x~` near the true states, by any means (`picard`);
2. their defect ``d = x~' - f(x~, u, psi)`` and their jumps between pieces, as models with remainders (`models`);
3. bounds of the Jacobian over a tube of an assumed radius around them (`gradients`), and from these the true radius
   (`growth`). If it is below the assumed one, no member can have left the tube, and the radius holds.

Pieces are made shorter in time or narrower in a parameter, whichever the polynomials ask for, until the radius is small
enough or the work is too much.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.errors import NotSmooth, Unenclosed, take_refusal
from ensemble_ctrl.certificate.general.basis import UNIT, UP, Basis
from ensemble_ctrl.certificate.general.disturbed import disturbed
from ensemble_ctrl.certificate.general.gradients import up
from ensemble_ctrl.certificate.general.growth import radii
from ensemble_ctrl.certificate.general.jacobian import jacobian
from ensemble_ctrl.certificate.general.models import Model
from ensemble_ctrl.certificate.general.picard import approximate
from ensemble_ctrl.certificate.general.start import Start

if TYPE_CHECKING:
    from ensemble_ctrl.problem.uncertainty import Uncertainty
    from ensemble_ctrl.systems import System


Floats = NDArray[np.float64]

DEGREES = {1: 7, 2: 5, 3: 4}
"""Degree in each of so many parameters to begin with; else `FEWEST`."""
FEWEST = 3
HIGHEST = 9
"""Highest degree in one parameter; beyond it, or beyond `MOST_TERMS`, cells are halved."""
MOST_TERMS = 90
TIMES = 10
"""Coefficients along time."""
ASSUMED = (1e-7, 1e-5, 1e-3, 1e-1)
"""Radii of the tube that are assumed in turn, relative to the size of each state where that is above 1."""
ASSUMED_OF_BOXES = (1e-2, 3e-2, 1e-1, 1.0)
"""The same where starts are off by more than rounding."""
WANTED = 2e-7
"""Radius, relative likewise, below which pieces are not made smaller."""
WORK = 600_000_000
"""Work of all pieces together, about in operations, beyond which they are not tried."""
SPENT = 1_000_000_000
"""Products of coefficients, about 8 seconds, before the search for an enclosure ends."""
BETTER, QUICK = 120_000_000, 30_000_000
"""The same for a better radius than that of an enclosure that was found, and for a box of starts, made on the way."""
ERRORS = (ArithmeticError, AttributeError, LookupError, NotImplementedError, TypeError, ValueError)
"""What a right-hand side may raise where it can't be evaluated on what it is given."""
MOST_PARTS = 16
"""Most pieces of time in one step of control."""


@dataclass(frozen=True, eq=False)
class Enclosure:
    """Polynomials and radii on pieces of time and cells of parameters.

    Attributes
    ----------
    basis : Basis
    c : ndarray, shape (pieces of time, states, cells, times, terms)
        Coefficients of the states.
    radius : ndarray, shape (pieces of time, states, cells)
        Every member is within it of the polynomial, throughout the piece, in each state.
    centre, half : ndarray, shape (cells, parameters)
        Cells of parameters, which together cover their box.
    parts : int
        Pieces of time in one step of control.
    wide : ndarray of int
        The parameters with a width, which the terms of the basis are of.
    model : ndarray, shape of `radius`
        The radius for robots that follow the model.
    """

    basis: Basis
    c: Floats
    radius: Floats
    centre: Floats
    half: Floats
    parts: int
    wide: NDArray[np.int64]
    model: Floats

    @property
    def largest(self) -> float:
        """Largest radius of any state."""
        return float(self.radius.max(initial=0.0))


def enclose(
    system: System, start: Start, controls: Floats, duration: float, bounds: Uncertainty | None = None
) -> Enclosure:
    """The enclosure of all members under piecewise constant controls.

    Parameters
    ----------
    system : System
    start : Start
    controls : ndarray, shape (steps, n_u)
    duration : float
        Seconds of all steps together.
    bounds : Uncertainty, optional
        Errors of the model; none if not given.

    Raises
    ------
    Unenclosed
        If there is none within the work allowed: a system that is not smooth, that divides by something that may
        vanish, or whose bounds grow beyond every tube tried.

    Notes
    -----
    *Guarantee*: every member with parameters in the box is within `Enclosure.radius` of the polynomial, at all times.
    """
    if not (np.isfinite(controls).all() and np.isfinite(start.lower).all() and np.isfinite(start.upper).all()):
        raise Unenclosed("a command or the end of a range is not a finite number")
    wide = np.flatnonzero(start.upper > start.lower)
    basis = Basis(TIMES, (DEGREES.get(len(wide), FEWEST),) * len(wide))
    pieces = Pieces(system, start, np.asarray(controls, dtype=float), duration, basis, wide, np.ones(len(wide), int), 1)
    best: Enclosure | None = None
    chosen = pieces
    reason: Unenclosed | None = None
    spent = 0.0
    while pieces.work <= WORK and pieces.parts <= MOST_PARTS:
        before = pieces.basis.doubled.spent
        try:
            found = pieces.enclosure()
        except NotSmooth:
            raise
        except Unenclosed as error:
            reason, relative = error, np.inf
        else:
            relative = float((found.radius / pieces.scale(found.c)).max(initial=0.0))
            if best is None or found.largest < best.largest:
                best, chosen = found, pieces
        last = pieces.basis.doubled.spent - before
        spent += last
        most = QUICK if start.spread is not None else SPENT if best is None else BETTER
        if relative <= WANTED or (best and start.spread is not None) or spent + 2 * last > most:
            break
        pieces = pieces.finer()
    if best is None:
        raise reason or Unenclosed(f"{pieces.work:.0e} operations would be needed, more than the {WORK:.0e} allowed")
    return disturbed(chosen, best, bounds) if bounds else best


@dataclass(frozen=True, eq=False)
class Pieces:
    """One way to cut time and parameters: so many parts of each step, so many cells of each wide parameter."""

    system: System
    start: Start
    controls: Floats
    duration: float
    basis: Basis
    wide: NDArray[np.int64]
    cells: NDArray[np.int64]
    parts: int

    @property
    def work(self) -> float:
        """Coefficients of all pieces, times what a product does for each, about."""
        times, terms = self.basis.shape
        count = len(self.controls) * self.parts * self.cells.prod() * len(self.system.states)
        return float(count * times * terms * (terms + 100))

    def finer(self) -> Pieces:
        """Shorter in time, or of a higher degree or narrower in a parameter, whichever has the larger last terms."""
        try:
            c = self._polynomials(*self._grid())
        except Unenclosed:
            return replace(self, parts=2 * self.parts)
        # sum |c| of each term over pieces and cells, relative to the size of its state
        size = np.abs(c).sum(axis=(0, 2))
        size = size / (size.sum(axis=(1, 2), keepdims=True) + 1e-300)
        last = float(size[:, -2:].sum())
        # share of the terms with no term above them in a parameter, weighted by a_k / d_k
        share = self.basis.highest * self.basis.exponents / np.maximum(1, self.basis.degrees)
        by = [float((size.sum(axis=1) * weight).sum()) for weight in share.T]
        if not by or last >= max(by):
            return replace(self, parts=2 * self.parts)
        worst = int(np.argmax(by))
        more = tuple(d + 2 * (k == worst) for k, d in enumerate(self.basis.degrees))
        richer = Basis(self.basis.times, more)
        if max(more) <= HIGHEST and richer.shape[1] <= MOST_TERMS:
            return replace(self, basis=richer)
        cells = self.cells.copy()
        cells[worst] *= 2
        return replace(self, cells=cells)

    def enclosure(self) -> Enclosure:
        """Polynomials with their radius; a refusal says when, for whom and because of which states."""
        centre, half = self._grid()
        try:
            return self._enclosure(centre, half)
        except Unenclosed as error:
            if error.piece is None:
                raise
            raise type(error)(f"{error}{self._where(error, centre, half)}") from None

    def _where(self, error: Unenclosed, centre: Floats, half: Floats) -> str:
        """Which states, when and which cell a refusal is about."""
        piece, cell = divmod(error.piece or 0, len(centre))
        names = ", ".join(self.system.states[k] for k in error.states)
        ends = zip(self.start.names, centre[cell] - half[cell], centre[cell] + half[cell], strict=True)
        members = ", ".join(f"{name} {low:.6g}..{high:.6g}" for name, low, high in ends)
        begin, end = piece * self.step, (piece + 1) * self.step
        depends = f" (it depends on {names})" if names else ""
        return f"{depends} at t = {begin:.4g}..{end:.4g} s" + (f" for {members}" if members else "")

    def _enclosure(self, centre: Floats, half: Floats) -> Enclosure:
        """The same for these cells."""
        # proof_systems.md, theorem: |e| <= r < R on every piece, for one of the assumed radii R
        c = self._polynomials(centre, half)
        jacobian(self, c, 0 * self.scale(c), centre, half)  # what it refuses, it names
        defect, jump = self.defect(c, centre, half), self.jump(c, centre, half)
        if not (np.isfinite(defect).all() and np.isfinite(jump).all()):
            raise Unenclosed("the right-hand side is not a finite number everywhere on the way")
        step, scale = self.step * UP, self.scale(c)
        worst: tuple[int, int, int] = (0, 0, 0)
        reason: Unenclosed | None = None
        tubes = ASSUMED if self.start.spread is None else ASSUMED_OF_BOXES
        for assumed in tubes:
            tube = assumed * scale
            try:
                found = radii(jacobian(self, c, tube, centre, half)[0], by_cell(defect), by_cell(jump), step)
            except NotSmooth:
                raise
            except Unenclosed as error:
                reason = error
                continue
            radius = found.transpose(0, 2, 1)
            if (radius < tube).all():
                return Enclosure(self.basis, c, radius, centre, half, self.parts, self.wide, radius)
            k, state, cell = np.argwhere(~(radius < tube))[0].tolist()
            worst, reason = (k, state, cell), None
        if reason is not None:
            raise reason
        k, state, cell = worst
        text = f"the enclosure of {self.system.states[state]} grew beyond {tubes[-1]:g} of its size"
        raise Unenclosed(text, k * len(centre) + cell)

    def scale(self, c: Floats) -> Floats:
        """Largest size of each state, at least 1, shape (1, states, 1)."""
        size = np.abs(c).sum(axis=(3, 4)).max(axis=(0, 2))
        return np.asarray(np.maximum(1.0, size)[None, :, None])

    @property
    def step(self) -> float:
        """Seconds of a piece."""
        return self.duration / (len(self.controls) * self.parts)

    def _grid(self) -> tuple[Floats, Floats]:
        """Centres and half widths (rounded up) of the cells of all parameters, shapes (cells, parameters)."""
        low, high = self.start.lower, self.start.upper
        counts = np.ones(len(low), dtype=int)
        counts[self.wide] = self.cells
        edges = [np.linspace(a, b, n + 1) for a, b, n in zip(low, high, counts, strict=True)]
        lows, highs = (
            np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, len(low)) if len(low) else np.zeros((1, 0))
            for ends in ([e[:-1] for e in edges], [e[1:] for e in edges])
        )
        centre = (lows + highs) / 2
        # the larger distance to an edge, rounded up: the cells cover Q
        half = up(np.maximum(highs - centre, centre - lows)) * (highs > lows)
        return centre, half

    def _polynomials(self, centre: Floats, half: Floats) -> Floats:
        """Coefficients of the states, shape (pieces of time, states, cells, times, terms)."""
        points = np.zeros((len(self.basis.points), len(self.start.names)))
        points[:, self.wide] = self.basis.points
        members = centre[:, None] + half[:, None] * points  # (cells, nodes, parameters)
        psi = {**self._fixed(), **dict(zip(self.start.names, np.moveaxis(members, -1, 0), strict=True))}
        shape = members.shape[:2]
        psi = {name: np.broadcast_to(np.asarray(psi[name], dtype=float), shape) for name in self.system.parameters}
        controls = np.repeat(self.controls, self.parts, axis=0)
        try:
            return approximate(self.system, self.basis, self._origin(centre, half), psi, controls, self.step)
        except Unenclosed:
            raise
        except ERRORS as error:
            raise NotSmooth(f"the right-hand side can't be evaluated for many members: {error}") from error

    def _fixed(self) -> dict[str, Any]:
        """The system's own values of its parameters."""
        return {name: float(value) for name, value in self.system.parameters.items()}

    def _origin(self, centre: Floats, half: Floats) -> Floats:
        """Coefficients of the start in the parameters, shape (states, cells, terms)."""
        # x_0 + S q: q_k = c_k + H_k s_k adds c_k to the constant term and H_k to the term s_k
        found = np.zeros((len(self.start.origin), len(centre), self.basis.shape[1]))
        found[:, :, 0] = self.start.origin[:, None]
        for k, state in enumerate(self.start.shifts):
            if state >= 0:
                found[state, :, 0] += centre[:, k]
                if k in self.wide:
                    found[state, :, self.basis.line(int(np.flatnonzero(self.wide == k)[0]))] += half[:, k]
        return found

    def defect(self, c: Floats, centre: Floats, half: Floats) -> Floats:
        """Bounds of ``|x~' - f(x~, u, psi)|``, shape (pieces of time, states, cells)."""
        count, states, cells = c.shape[:3]
        # x~, u and psi as models; pieces of time and cells together are one axis
        flat = c.transpose(1, 0, 2, 3, 4).reshape(states, count * cells, *self.basis.shape)
        x = [Model(self.basis, rows, np.zeros(count * cells)) for rows in flat]
        rates = self.right_side(
            x, [Model.of(self.basis, u) for u in self.commands(cells)], self._models(c, centre, half)
        )
        found = np.empty((states, count * cells))
        speed = 2.0 / self.step
        for row, rate, coefficients in zip(found, rates, flat, strict=True):
            # the derivative of the polynomial: whole numbers times coefficients, each right to times + 6 roundings
            slope = np.einsum("jk,bks->bjs", self.basis.derivative, coefficients) * speed
            size = np.einsum("jk,bks->b", self.basis.derivative, np.abs(coefficients)) * speed
            own = Model(self.basis, slope, (self.basis.times + 6) * UNIT * size * UP)
            row[:] = (own - rate).size()
        return found.reshape(states, count, cells).transpose(1, 0, 2)

    def jump(self, c: Floats, centre: Floats, half: Floats) -> Floats:
        """Bounds of the jumps at the beginnings of all pieces, the first one from the true start; same shape."""
        # T_j(-1) = (-1)^j and T_j(1) = 1: polynomials in s at the beginning and at the end of each piece
        sign = (-1.0) ** np.arange(self.basis.times)
        starts, ends = np.einsum("ksctp,t->kscp", c, sign), c.sum(axis=3)
        origin = self._origin(centre, half)
        before = np.concatenate([origin[None], ends[:-1]])
        # gamma: sum |c| of the difference, and (times + 8) u sum |c| of both sides for rounding
        size = np.abs(c).sum(axis=(3, 4))
        earlier = np.concatenate([np.abs(origin).sum(axis=2)[None], size[:-1]])
        found = np.asarray(
            (np.abs(starts - before).sum(axis=3) + (self.basis.times + 8) * UNIT * (size + earlier)) * UP
        )
        if self.start.spread is not None:  # true starts about the first polynomial's: one more jump
            found[0] = (found[0] + self.start.spread[:, None]) * UP
        return found

    def commands(self, cells: int) -> list[Floats]:
        """Each command on all pieces, shape (pieces of time times cells,)."""
        return [np.repeat(u, self.parts * cells) for u in self.controls.T]

    def _models(self, c: Floats, centre: Floats, half: Floats) -> dict[str, Any]:
        """The system's parameters as models on all pieces."""
        # psi_k = c_k + H_k s_k: the constant term and the term that is s_k, without remainder
        count = len(c)
        one = Model.of(self.basis, np.ones(count * len(centre)))
        found = self.numbers(one)
        for k, name in enumerate(self.start.names):
            model = one * np.tile(centre[:, k], count)
            if k in self.wide:
                model.c[:, 0, self.basis.line(int(np.flatnonzero(self.wide == k)[0]))] = np.tile(half[:, k], count)
            found[name] = Model(self.basis, model.c, np.zeros(len(model.c)))
        return found

    def numbers(self, like: Any) -> dict[str, Any]:
        """The parameters that all members share, as numbers of the kind of `like`."""
        return {name: like._constant(value) for name, value in self._fixed().items()}

    def right_side(self, x: Sequence[Any], u: Sequence[Any], psi: Mapping[str, Any]) -> list[Any]:
        """The system's own right-hand side on numbers of any kind."""
        known = {name: psi[name] for name in self.system.parameters}
        take_refusal()
        try:
            with np.errstate(all="ignore"):
                rates = list(self.system.xdot(list(x), list(u), known))
        except Unenclosed:
            raise
        except ERRORS as error:
            raise NotSmooth(f"the right-hand side can't be evaluated on intervals: {error}") from error
        if (refused := take_refusal()) is not None:  # the right-hand side has caught it
            raise refused
        kind = type(x[0])
        return [rate if isinstance(rate, kind) else x[0] * 0.0 + rate for rate in rates]


def by_cell(values: Floats) -> Floats:
    """(pieces of time, states, cells) to (pieces of time, cells, states)."""
    return np.ascontiguousarray(values.transpose(0, 2, 1))
