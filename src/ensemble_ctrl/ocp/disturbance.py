"""About how far errors of the model may take robots from it: margins of the program, recomputed at each solution.

An estimate, for the corners of the ranges and the middle, by formulas of its own: the claim about a plan is made by the
certificate, which shares nothing with this.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import field
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import Predicate, StateSignals
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.terrain import with_terrain
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.uncertainty import POSITION

Floats = NDArray[np.float64]

MOST_MEMBERS = 9
"""Members of a fleet that an ODE defines, the middle one among them."""
MOST_CHORDS = 600
"""Steps beyond which the way bounds a heading's effect."""
NUDGE = 1e-6
"""Relative change by which derivatives are measured."""
SUBSTEPS = 4
"""Euler steps of an error in a step of control."""
FAR = 1e3
"""Metres beyond which errors are not followed."""


@dataclass(frozen=True, eq=False)
class Growth:
    """Errors of a plan.

    Attributes
    ----------
    within : ndarray, shape (steps,)
        Metres by which positions may be off during each step.
    at : ndarray, shape (steps + 1, states)
        By how much each state may be off at the grid times; for robots on arcs a length in any direction.
    states : tuple of str
        Names of the columns.
    round : bool
        Whether `at` is a length in any direction.
    signals : mapping of str to ndarray of shape (steps + 1,)
        By how much headings, speeds, turn rates and commands may be off at the grid times.
    """

    within: Floats
    at: Floats
    states: tuple[str, ...]
    round: bool
    signals: Mapping[str, Floats] = field(default_factory=dict)

    def lost(self, predicate: Predicate) -> Floats:
        """What a predicate loses at most, at all grid times."""
        by_name = dict(predicate.normalised()[0])
        row = np.abs([by_name.get(name, 0.0) for name in self.states])
        # |c| r in any direction, else sum_i |c_i| r_i
        lost = np.asarray(self.at[:, 0] * np.linalg.norm(row) if self.round else self.at @ row)
        for name in by_name.keys() & self.signals.keys():
            lost = lost + abs(by_name[name]) * self.signals[name]
        return lost


class Lowered(StateSignals):
    """Signals of members that errors of the model may take away from what a predicate wants."""

    def __init__(self, signals: StateSignals, growth: Growth) -> None:
        super().__init__(signals.states, signals.names, signals.step)
        self.growth = growth

    def leaf(self, predicate: Predicate, first: int, last: int) -> Floats:
        """As of the members, less what is lost."""
        return np.asarray(super().leaf(predicate, first, last) - self.growth.lost(predicate)[first : last + 1])

    def mean(self) -> StateSignals:
        """The mean state's."""
        return Lowered(super().mean(), self.growth)


def lowered(signals: StateSignals, growth: Growth | None) -> StateSignals:
    """Signals less what errors of the model take, if there are any."""
    return signals if growth is None else Lowered(signals, growth)


def growth(problem: Problem, controls: Floats) -> Growth | None:
    """The errors of a plan; None for a fleet that follows its model."""
    if not problem.uncertain:
        return None
    controls = np.asarray(controls, dtype=float)
    if problem.fleet.system.on_arcs:
        return growth_on_arcs(problem, problem.fleet, controls, problem.duration / len(controls))
    return _by_comparison(problem, controls)


def growth_on_arcs(problem: Problem, fleet: Fleet, controls: Floats, step: float) -> Growth:
    """Of robots on arcs: int V + W, and what the heading adds, by chords or by the way (`docs/uncertainty.md`).

    The fleet is the problem's, or what is known of it on the way.
    """
    bounds = fleet.uncertainty
    members = np.concatenate([fleet.corners, fleet.center[None]])
    a, b = (np.abs(column)[:, None] for column in fleet.coefficients(members)[:, :2].T)
    v, omega = fleet.arcs.rates(*controls.T)
    dv, domega = (_off(fleet, controls, k) for k in (0, 1))
    alpha, beta = (_strays(fleet, k) for k in (0, 1))
    given, wait = bounds.disturbance, bounds.disturbance.get("heading", 0.0)
    drift = given.get(POSITION, 0.0) + float(np.hypot(given.get("x", 0.0), given.get("y", 0.0)))
    late, late_turn = (bounds.jitter * f * np.cumsum(np.abs(np.diff(r, prepend=0))) for f, r in ((a, v), (b, omega)))
    # a command may begin early: that of the next step counts, too
    early = np.concatenate([late[:, 1:], late[:, -1:]], axis=1)
    paths = fleet.trajectories(controls, members, step)

    def errors(strays: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Of place, heading, speed and turn rate by steps, where factors may be off by `strays` more, as of terrain."""
        speed = a * (dv + alpha * (np.abs(v) + dv)) + strays[0] * (np.abs(v) + dv)
        turn = b * (domega + beta * (np.abs(omega) + domega)) + wait + strays[1] * (np.abs(omega) + domega)
        if bounds.heading_hold is None:
            off = wait * bounds.delay + np.cumsum(step * turn, axis=1) + late_turn
        else:
            off = _held(turn, np.diff(late_turn, prepend=0.0, axis=1), step, bounds.heading_hold)
        swept = np.cumsum(step * a * np.abs(v) * np.minimum(off, 2.0), axis=1)
        if bounds.heading_hold is None and len(controls) <= MOST_CHORDS:
            swept = np.minimum(swept, _by_chords(paths, turn * step, late_turn))
        return drift * bounds.delay + swept + np.cumsum(step * (speed + drift), axis=1) + early, off, speed, turn

    strays = with_terrain(problem, members, paths, lambda strays: errors(strays)[0])
    off_place, off, speed, turn = errors(strays)
    within = off_place.max(axis=0)
    # a delay counts where times do: in the task, not beside what stands still
    lag = bounds.delay * float(a.max()) * np.abs(v)
    at = np.concatenate([within[:1], within]) + np.concatenate([lag[:1], lag])
    turned = off.max(axis=0) + bounds.delay * (b * np.abs(omega)).max()
    wrong = fleet.uncertainty.command_errors(fleet.system.controls, controls)
    each = dict(zip(fleet.system.controls, wrong.T, strict=True))
    each |= {"heading": turned, "v": speed.max(axis=0), "omega": turn.max(axis=0)}
    # a grid time is an end of two steps
    signals = {name: np.maximum(np.append(value, 0.0), np.insert(value, 0, 0.0)) for name, value in each.items()}
    return Growth(within, np.tile(at[:, None], (1, 2)), ("x", "y"), True, signals)


def _held(turn: Floats, jumps: Floats, step: float, hold: float) -> Floats:
    """``e' = -e / tau + D`` with jumps, at the ends of all steps, shape (members, steps)."""
    kept, found, off = float(np.exp(-step / hold)), np.empty(jumps.shape), np.zeros(len(jumps))
    for n in range(jumps.shape[1]):
        off = kept * (off + jumps[:, n]) + (1 - kept) * hold * turn[:, n]
        found[:, n] = off + jumps[:, n]
    return found


def _by_chords(paths: Floats, turns: Floats, late: Floats) -> Floats:
    """``sum_k D_k h |p(t_n) - p(t_k)|`` for each member and step, shape (members, steps)."""
    found = np.empty(turns.shape)
    more = turns + np.diff(late, prepend=0.0, axis=1)
    for path, each, row in zip(paths, more, found, strict=True):
        away = np.linalg.norm(path[1:, None] - path[None, :-1], axis=-1)
        row[:] = (np.tri(len(each)) * away) @ each
    return found


def _off(fleet: Any, controls: Floats, which: int) -> Floats:
    """The largest error of the speed (0) or the turn rate (1) that errors of the commands make."""
    spread = fleet.uncertainty.command_errors(fleet.system.controls, controls)
    corners = (controls + np.array(signs) * spread for signs in product((-1.0, 1.0), repeat=2))
    middle = fleet.arcs.rates(*controls.T)[which]
    return np.asarray(np.max([np.abs(fleet.arcs.rates(*c.T)[which] - middle) for c in corners], axis=0))


def _strays(fleet: Any, which: int) -> float:
    """The share by which the factor on the speed or on the turn rate strays."""
    names: Iterable[str] = fleet.uncertainty.varies
    return float(sum(fleet.uncertainty.varies[name] for name in names if fleet.arcs.directions[name][which]))


def _by_comparison(problem: Problem, controls: Floats) -> Growth:
    """Of systems that an ODE defines: ``r' = M r + d`` along members, with the Jacobian there."""
    fleet, step = problem.fleet, problem.duration / len(controls)
    corners = fleet.corners[: MOST_MEMBERS - 1]
    members = np.concatenate([corners, fleet.center[None]])
    with np.errstate(all="ignore"):
        states = np.nan_to_num(fleet.integrated(controls, members, step, SUBSTEPS))
    matrices, drive = _linearised(fleet, controls, members, states[:, :-1])
    r = np.zeros((len(members), states.shape[2]))
    found = [np.zeros(states.shape[2])]
    for n in range(len(controls)):
        for _ in range(SUBSTEPS):
            r = r + step / SUBSTEPS * (np.einsum("mij,mj->mi", matrices[:, n], r) + drive[:, n])
        r = np.minimum(np.nan_to_num(r, nan=FAR), FAR)
        found.append(r.max(axis=0))
    at = np.array(found)
    place = np.linalg.norm(at[:, fleet.place_columns], axis=1)
    return Growth(np.maximum(place[:-1], place[1:]), at, fleet.states, False)


def _linearised(fleet: Any, controls: Floats, members: Floats, states: Floats) -> tuple[Floats, Floats]:
    """The comparison matrix and the drive along members, shapes (members, steps, n, n) and (members, steps, n)."""
    count, steps, n_x = states.shape
    bounds, system = fleet.uncertainty, fleet.system
    x = states.reshape(-1, n_x).T
    u = np.tile(controls, (count, 1)).T
    psi = {name: np.repeat(value, steps) for name, value in fleet.psi(members).items()}

    def slope(argument: str, k: Any, values: Floats) -> Floats:
        """Difference quotient of the right-hand side in one state, command or parameter."""
        size = NUDGE * np.maximum(1.0, np.abs(values))
        ends = []
        for by in (size, -size):
            own: dict[str, Any] = {"x": x.copy(), "u": u.copy(), "psi": dict(psi)}
            own[argument][k] = own[argument][k] + by
            ends.append(system.derivatives(own["x"], own["u"], own["psi"]))
        return np.asarray(np.nan_to_num((ends[0] - ends[1]) / (2 * size)))

    with np.errstate(all="ignore"):
        matrix = np.stack([slope("x", k, x[k]) for k in range(n_x)], axis=1)
        # M_ii = max(J_ii, 0), M_ij = |J_ij|
        diagonal = np.maximum(matrix[np.arange(n_x), np.arange(n_x)], 0.0)
        matrix = np.abs(matrix)
        matrix[np.arange(n_x), np.arange(n_x)] = diagonal
        # d = |w| + |df/du| |du| + |df/dpsi| |dpsi|
        place = bounds.disturbance.get(POSITION, 0.0)
        own = [bounds.disturbance.get(name, 0.0) + place * (name in system.positions) for name in system.states]
        drive = np.tile(np.array(own)[:, None], (1, count * steps))
        for k, error in enumerate(bounds.command_errors(system.controls, u.T).T):
            drive += error * np.abs(slope("u", k, u[k])) if error.any() else 0.0
        for name, share in bounds.varies.items():
            drive += share * np.abs(psi[name] * slope("psi", name, psi[name]))
    shape = (count, steps)
    return matrix.transpose(2, 0, 1).reshape(*shape, n_x, n_x), drive.T.reshape(*shape, n_x)
