"""A plain program for any of the problems: Opti, multiple shooting for the middle member, random first guesses.

minimise    effort - weight * rho
subject to  x[k + 1] = RK4(x[k], u[k]),  commands within bounds,
            log-sum-exp of each obstacle's faces >= radius + margin at the grid times,
            smooth robustness of the rest of the task >= rho >= margin
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.constraints.stl import Predicate, SmoothOps, member_robustness

from .judge import cost, verdict
from .tube import pieces

Floats = NDArray[np.float64]

STARTS = 10
SHARP = 20.0
"""Of the log-sum-exp in the task, per metre."""
SHARPER = 100.0
"""Of that over an obstacle's faces: it takes 1.4 cm of a gap beside a rectangle, where `SHARP` would take 7 cm."""
MARGINS = (0.01, 0.04)
"""Metres to spare, in turn: for the middle member alone, and some for the others, whom the program does not know."""
SUBSTEPS = 2
"""Of Runge and Kutta's rule in a step."""


class CasadiFunctions:
    """CasADi's functions under the names that the smooth operations ask for."""

    exp = staticmethod(ca.exp)
    log = staticmethod(ca.log)
    fmax = staticmethod(ca.fmax)
    fmin = staticmethod(ca.fmin)

    def hstack(self, values: Any, /) -> Any:
        """Join along the second axis."""
        return ca.horzcat(*values)

    def vstack(self, values: Any, /) -> Any:
        """Join along the first axis."""
        return ca.vertcat(*values)


class Symbols:
    """States of one member as symbols, shape (states, steps + 1)."""

    members = 1

    def __init__(self, states: ca.SX, names: tuple[str, ...], step: float) -> None:
        self.states, self.names, self.step = states, names, step
        self.steps = states.shape[1] - 1

    def leaf(self, predicate: Predicate, first: int, last: int) -> Any:
        """Robustness of a predicate at the times first..last."""
        terms, offset = predicate.normalised()
        rows = [value * self.states[self.names.index(name), first : last + 1] for name, value in terms]
        return sum(rows[1:], rows[0]) + offset

    def mean(self) -> Symbols:
        """The mean of one member."""
        return self


def one_step(problem: ec.Problem) -> ca.Function:
    """A step of the middle member."""
    system, fleet = problem.fleet.system, problem.fleet
    psi = {name: float(value[0]) for name, value in fleet.psi(fleet.center[None]).items()}
    x, u = ca.SX.sym("x", len(system.states)), ca.SX.sym("u", len(system.controls))

    def rates(at: ca.SX) -> Any:
        return ca.vertcat(*system.xdot(ca.vertsplit(at), ca.vertsplit(u), psi))

    h, end = problem.duration / problem.steps / SUBSTEPS, x
    for _ in range(SUBSTEPS):
        k1 = rates(end)
        k2 = rates(end + h / 2 * k1)
        k3 = rates(end + h / 2 * k2)
        k4 = rates(end + h * k3)
        end = end + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function("step", [x, u], [end])


def task_value(problem: ec.Problem) -> ca.Function:
    """Smooth robustness of what the task asks for beside keeping out of places."""
    names = problem.fleet.system.states
    x = ca.SX.sym("x", len(names), problem.steps + 1)
    signals, ops = Symbols(x, names, problem.duration / problem.steps), SmoothOps(SHARP, CasadiFunctions())
    values = [member_robustness(part.formula, signals, ops) for part in problem.specification.rest]
    return ca.Function("task", [x], [ops.all_of(values) if values else ca.SX(1.0)])


def clearances(problem: ec.Problem, x: ca.MX) -> Iterator[ca.MX]:
    """Smooth distance of the robot's edge from each piece of each obstacle, at the grid times of its window."""
    rows = [problem.fleet.system.states.index(name) for name in problem.fleet.places]
    for avoid in problem.specification.avoid:
        ks = np.flatnonzero(avoid.during(problem.times))
        if not len(ks):
            continue
        places = x[rows, ks.tolist()] - ca.DM(avoid.offsets(problem.times[ks]).T)
        for piece in avoid.pieces:
            # rows of length one: b - A p is the distance from each face's line
            length = np.linalg.norm(piece.A, axis=1)
            level = ca.repmat(ca.DM(piece.b / length), 1, len(ks))
            yield _largest(level - ca.mtimes(ca.DM(piece.A / length[:, None]), places)) - avoid.radius


def _largest(values: ca.MX) -> ca.MX:
    """Smooth maximum of each column, from below."""
    columns = ca.SX.sym("v", values.shape[0])
    value = (ca.logsumexp(SHARPER * columns) - float(np.log(values.shape[0]))) / SHARPER
    return ca.Function("largest", [columns], [value]).map(values.shape[1])(values)


def program(problem: ec.Problem) -> tuple[ca.Opti, ca.MX, ca.MX, ca.MX]:
    """The program, its states, its commands, and the margin as a parameter."""
    fleet, steps = problem.fleet, problem.steps
    opti, step = ca.Opti(), one_step(problem)
    x, u = opti.variable(len(fleet.system.states), steps + 1), opti.variable(len(fleet.input_lower), steps)
    rho, margin = opti.variable(), opti.parameter()
    opti.subject_to(x[:, 0] == ca.DM(fleet.start_states(fleet.center[None])))
    opti.subject_to(ca.vec(x[:, 1:] - step.map(steps)(x[:, :-1], u)) == 0)
    for k in range(steps):
        opti.subject_to(opti.bounded(ca.DM(fleet.input_lower), u[:, k], ca.DM(fleet.input_upper)))
    for value in clearances(problem, x):
        opti.subject_to(ca.vec(value) >= margin)
    opti.subject_to(task_value(problem)(x) >= rho)
    opti.subject_to(opti.bounded(margin, rho, 10.0))
    weights = ca.DM(problem.objective.efforts(len(fleet.input_lower)))
    effort = ca.sum2(ca.mtimes(weights.T, u**2)) * problem.duration / steps
    opti.minimize(effort - problem.objective.robustness * rho)
    return opti, x, u, margin


def plain(problem: ec.Problem, seconds: float, seed: int = 0) -> dict[str, Any]:
    """The best plan of `STARTS` random starts within some seconds: outcome, when it was first so good, and its cost."""
    began, rng = time.perf_counter(), np.random.default_rng(seed)
    opti, x, u, margin = program(problem)
    step, fleet = one_step(problem).mapaccum(problem.steps), problem.fleet
    found: dict[str, Any] = {"outcome": "none", "seconds": seconds, "cost": None}
    for number in range(STARTS):
        left = seconds - (time.perf_counter() - began)
        if left < 0.1:
            break
        guess = pieces(rng, problem.steps, fleet.input_lower, fleet.input_upper, 5)
        start = fleet.start_states(fleet.center[None])
        opti.set_value(margin, MARGINS[number % len(MARGINS)])
        opti.set_initial(u, guess.T)
        driven = np.hstack([start, np.asarray(step(start, guess.T))])
        # where the guess runs away, the states stay at the start
        opti.set_initial(x, driven if np.abs(driven).max() < 1e6 else np.tile(start, (1, problem.steps + 1)))
        opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "max_wall_time": left})
        with contextlib.suppress(RuntimeError):  # the last iterate is judged all the same
            opti.solve()
        controls = np.asarray(opti.debug.value(u)).reshape(guess.shape[1], -1).T
        found = _better(problem, found, controls, time.perf_counter() - began)
    return {**found, "seconds": min(found["seconds"], time.perf_counter() - began)}


def _better(problem: ec.Problem, found: dict[str, Any], controls: Floats, seconds: float) -> dict[str, Any]:
    """The better of what was found and some commands; of proven plans the cheaper one, with the time of the first."""
    controls = np.clip(controls, problem.fleet.input_lower, problem.fleet.input_upper)
    outcome = verdict(problem, controls) if np.isfinite(controls).all() else "none"
    ranks = ("none", "found", "proven")
    if outcome not in ranks or ranks.index(outcome) < ranks.index(found["outcome"]) or outcome == "none":
        return found
    value = cost(problem, controls)
    if outcome == found["outcome"]:
        return {**found, "cost": min(value, found["cost"])}
    return {"outcome": outcome, "seconds": seconds, "cost": value}
