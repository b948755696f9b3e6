"""Hand-written CasADi program for the nine-robot benchmark, the way an expert would write it.

    python tuned_opti.py [guess.npz | outer]

The argument is a first guess: a file with arrays ``v`` and ``omega`` of 160 values each, or the word
``outer`` for a built-in route over the top; without it a built-in route between the boxes is driven.  Each
robot's first states come from simulating it with these controls.

What was chosen, and why:

* ``nlpsol`` with multiple shooting on exact arcs.  All headings are ``pi/4 + psi * turn``, so one shared
  ``turn`` replaces nine headings; positions enter the dynamics linearly.
* Variables in stage order, and the Jacobian and Hessian assembled by hand from small mapped SX functions.
  An automatic Hessian has to colour the blocks that the goal window makes dense, which in the plain program
  costs tens of milliseconds a call, or seconds beforehand with ``expand``; here all set-up takes about 0.06 s
  a solve and a Hessian 3 ms.
* Log-sum-exp bounds as in the plain program, but only for the (robot, step, box) triples near the guess; the
  result is replayed, and solved again with a wider band should a triple left out be violated.
* Coarse to fine: three robots with a blunter log-sum-exp first, then all nine from that control with a small
  barrier parameter.  ``iterations`` is the sum over the solves.
* IPOPT: tolerance 1e-5, METIS ordering in MUMPS (a third faster here than the automatic choice).
"""

from __future__ import annotations

import time

_START = time.perf_counter()

import sys  # noqa: E402
from typing import Any, NamedTuple  # noqa: E402

import casadi as ca  # noqa: E402
import numpy as np  # noqa: E402
from fleet_problem import (  # noqa: E402
    CENTRE,
    DT,
    GOAL,
    HORIZON,
    LIMIT,
    OBSTACLES,
    PSI,
    START,
    STEPS,
    W_EFFORT,
    W_TERMINAL,
    WINDOW,
    Array,
    depths,
    judge,
    report,
    simulate,
)
from numpy.typing import NDArray  # noqa: E402

_IMPORTED = time.perf_counter()

Index = NDArray[np.int64]
Trio = tuple[ca.Function, ca.Function, ca.Function]

BETWEEN = ((1.0, 1.0), (1.8, 3.2), (3.5, 3.3), (3.7, 4.7), (5.0, 4.7), (6.5, 5.5))
OUTER = ((1.0, 1.0), (1.9, 3.0), (2.4, 4.2), (2.2, 5.8), (2.7, 7.0), (4.0, 7.1), (6.5, 5.5))


class Stage(NamedTuple):
    """Settings of one solve."""

    robots: int
    sharp: float
    band: float
    mu: float


COARSE = Stage(3, 15.0, 1.0, 1e-1)
FLEET = Stage(PSI.size, 30.0, 0.5, 1e-3)
REPAIR = Stage(PSI.size, 30.0, 2.0, 1e-3)


class Solved(NamedTuple):
    """The outcome of one solve."""

    v: Array
    omega: Array
    iterations: int
    status: str
    build_s: float
    solve_s: float


def route_guess(route: tuple[tuple[float, float], ...]) -> tuple[Array, Array]:
    """Controls that drive the nominal robot along a rounded polyline, arriving one second early."""
    way = np.array(route)
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    arc = np.minimum(np.linspace(0.0, HORIZON / (HORIZON - 1.0), STEPS + 1), 1.0) * length[-1]
    half = 4
    xy = np.stack([np.interp(arc, length, way[:, i]) for i in (0, 1)], axis=1)
    xy = np.pad(xy, ((half, half), (0, 0)), mode="edge")
    kernel = np.full(2 * half + 1, 1.0 / (2 * half + 1))
    move = np.diff(np.stack([np.convolve(xy[:, i], kernel, "valid") for i in (0, 1)], axis=1), axis=0)
    dist = np.hypot(move[:, 0], move[:, 1])
    heading = np.unwrap(np.arctan2(move[:, 1], move[:, 0]))
    still = dist < 1e-9
    heading[still] = heading[~still][-1]
    node = np.concatenate([[START[2]], (heading[1:] + heading[:-1]) / 2, heading[-1:]])
    top = 0.95 * LIMIT
    return np.clip(dist / DT, -top, top), np.clip(np.diff(node) / DT, -top, top)


class Blocks:
    """Triplets of a sparse matrix whose values come from mapped functions; duplicates are summed."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.shape = shape
        self.rows: list[Index] = []
        self.cols: list[Index] = []
        self.values: list[ca.MX] = []

    def add(self, rows: Index, cols: Index, values: ca.MX | ca.DM) -> None:
        """Append entries; the three are read in the same order."""
        self.rows.append(rows.ravel())
        self.cols.append(cols.ravel())
        self.values.append(ca.vec(ca.densify(values)))

    def assemble(self) -> ca.MX:
        """The sparse matrix, by one constant 0/1 product that sums the duplicates."""
        rows, cols = np.concatenate(self.rows), np.concatenate(self.cols)
        code, slot = np.unique(cols * self.shape[0] + rows, return_inverse=True)
        sparsity = ca.Sparsity.triplet(*self.shape, (code % self.shape[0]).tolist(), (code // self.shape[0]).tolist())
        order = np.argsort(slot, kind="stable")
        starts = np.searchsorted(slot[order], np.arange(code.size + 1))
        # column i of ``pick`` marks the entries that add up to nonzero i
        pick = ca.DM(ca.Sparsity(rows.size, code.size, starts.tolist(), order.tolist()), 1.0)
        return ca.MX(sparsity, ca.mtimes(pick.T, ca.vertcat(*self.values)))


def dynamics(psi: Array) -> Trio:
    """One exact arc of all robots: displacement, its Jacobian, and the Hessian of ``lam . displacement``."""
    u, lam = ca.SX.sym("u", 3), ca.SX.sym("lam", 2 * psi.size)  # u = (v, omega, angle turned so far / psi)
    half = ca.DM(psi) * (u[1] * DT / 2)
    h2 = half * half
    sinc = 1 - h2 / 6 * (1 - h2 / 20 * (1 - h2 / 42))
    heading = START[2] + ca.DM(psi) * u[2] + half
    chord = ca.DM(psi) * (u[0] * DT) * sinc
    move = ca.vertcat(chord * ca.cos(heading), chord * ca.sin(heading))
    hess = ca.hessian(ca.dot(lam, move), u)[0]
    return (
        ca.Function("move", [u], [move]),
        ca.Function("move_jac", [u], [ca.densify(ca.jacobian(move, u))]),
        ca.Function("move_hess", [u, lam], [ca.densify(hess)]),
    )


def curved(name: str, var: ca.SX, par: ca.SX, value: ca.SX) -> Trio:
    """A scalar function with its gradient and dense Hessian."""
    hess, grad = ca.hessian(value, var)
    return (
        ca.Function(name, [var, par], [value]),
        ca.Function(name + "_grad", [var, par], [ca.densify(grad)]),
        ca.Function(name + "_hess", [var, par], [ca.densify(hess)]),
    )


def visit(window: int, sharp: float) -> Trio:
    """Soft best depth of one robot over the window less the robustness; of ``(x, y)`` by step, then rho."""
    q = ca.SX.sym("q", 2 * window + 1)
    x, y = q[: 2 * window : 2], q[1 : 2 * window : 2]
    far = sum(ca.exp(-sharp * e) for e in (x - GOAL[0], GOAL[1] - x, y - GOAL[2], GOAL[3] - y))
    return curved("late", q, ca.SX(0, 0), ca.log(ca.sum1(1 / far) / window) / sharp - q[-1])


def solve(stage: Stage, v0: Array, omega0: Array) -> Solved:
    """Plan for evenly spaced robots from a first guess of the controls."""
    began = time.perf_counter()
    sharp, robots = stage.sharp, stage.robots
    psi = np.linspace(PSI[0], PSI[-1], robots)
    p0 = simulate(v0, omega0, psi)

    # Where everything sits in the decision vector: (v, omega, turn, every x, every y) per step, then the last
    # (turn, x, y), then the robustness.
    size = 3 + 2 * robots
    window = STEPS + 1 - WINDOW
    base = np.arange(STEPS) * size
    command = base + np.arange(3)[:, None]  # (3, steps)
    turn = np.append(base + 2, STEPS * size)
    place = (np.append(base + 3, STEPS * size + 1) + np.arange(2 * robots)[:, None]).reshape(2, robots, STEPS + 1)
    rho_at = STEPS * size + 1 + 2 * robots
    n = rho_at + 1
    x = ca.MX.sym("x", n)

    def take(index: Index) -> ca.MX:
        return ca.reshape(x[index.ravel(order="F").tolist()], index.shape[0], index.shape[1])

    # Obstacle pairs (robot, step, box) worth a constraint: those near the first guess.
    # ``gap`` is (steps + 1, robots, boxes).
    gap = np.stack([(-depths(p0, box)).max(axis=-1) for box in OBSTACLES], axis=-1)
    gap[0] = np.inf
    step_of, robot_of, box_of = np.nonzero(gap < stage.band)
    pairs = step_of.size
    near = place[:, robot_of, step_of]  # (2, pairs)
    boxes = ca.DM(np.array(OBSTACLES)[box_of].T)

    move, move_jac, move_hess = dynamics(psi)
    q, box = ca.SX.sym("q", 2), ca.SX.sym("box", 4)
    faces = ca.vertcat(box[0] - q[0], q[0] - box[1], box[2] - q[1], q[1] - box[3])
    out, out_grad, out_hess = curved("out", q, box, ca.log(ca.sum1(ca.exp(sharp * faces)) / 4) / sharp)
    late, late_grad, late_hess = visit(window, sharp)
    late_at = place[:, :, WINDOW:].transpose(2, 0, 1).reshape(2 * window, robots)
    late_at = np.vstack([late_at, np.full((1, robots), rho_at)])
    late_size = 2 * window + 1

    # Constraints, in rows: turn, arcs, obstacles, robustness.
    u, near_x, late_x = take(command), take(near), take(late_at)
    here, there = place[:, :, :-1].reshape(2 * robots, STEPS), place[:, :, 1:].reshape(2 * robots, STEPS)
    n_arc = 2 * robots * STEPS
    at = np.cumsum([0, STEPS, n_arc, pairs, robots])
    g = ca.vertcat(
        x[turn[1:].tolist()] - x[turn[:-1].tolist()] - DT * x[command[1].tolist()],
        ca.vec(take(there) - take(here) - move.map(STEPS)(u)),
        out.map(pairs)(near_x, boxes).T,
        late.map(robots)(late_x, ca.DM(0, robots)).T,
    )
    lower = np.zeros(at[-1])
    upper = np.where(np.arange(at[-1]) < at[2], 0.0, np.inf)

    jac = Blocks((int(at[-1]), n))

    def fill(rows: Index, cols: Index, value: float) -> None:
        jac.add(rows, cols, ca.DM(np.full(rows.size, value)))

    row = np.arange(STEPS)
    fill(row, turn[1:], 1.0)
    fill(row, turn[:-1], -1.0)
    fill(row, command[1], -DT)
    row = at[1] + np.arange(n_arc).reshape(STEPS, 2 * robots)
    fill(row, there.T, 1.0)
    fill(row, here.T, -1.0)
    jac.add(
        np.broadcast_to(row[:, None, :], (STEPS, 3, 2 * robots)),
        np.broadcast_to(command.T[:, :, None], (STEPS, 3, 2 * robots)),
        -move_jac.map(STEPS)(u),
    )
    jac.add(np.repeat(at[2] + np.arange(pairs), 2), near.T, out_grad.map(pairs)(near_x, boxes))
    jac.add(
        np.repeat(at[3] + np.arange(robots), late_size),
        late_at.T,
        late_grad.map(robots)(late_x, ca.DM(0, robots)),
    )

    # Objective (to be made small): quadratic, so its derivatives are constants.
    ends = place[:, :, -1]
    weight = np.zeros(n)
    weight[command[:2].ravel()] = W_EFFORT * DT
    weight[ends.ravel()] = W_TERMINAL / robots
    aim = np.zeros(n)
    aim[ends] = np.array(CENTRE)[:, None]
    slope = np.zeros(n)
    slope[rho_at] = -1.0
    w, a, c = ca.DM(weight), ca.DM(aim), ca.DM(slope)
    f = ca.dot(w, (x - a) ** 2) + ca.dot(c, x)

    sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", int(at[-1]))
    hess = Blocks((n, n))

    def upper_blocks(index: Index, values: ca.MX) -> None:
        """Symmetric blocks, one per column of ``index`` (whose entries ascend)."""
        k = index.shape[0]
        i, j = np.triu_indices(k)
        keep = (np.arange(index.shape[1])[:, None] * k * k + j * k + i).ravel()
        hess.add(index[i].T, index[j].T, ca.vec(values)[keep.tolist()])

    lam_arc = ca.reshape(lam[int(at[1]) : int(at[2])], 2 * robots, STEPS)
    upper_blocks(command, move_hess.map(STEPS)(u, -lam_arc))
    scale = ca.repmat(lam[int(at[2]) : int(at[3])].T, 4, 1)
    upper_blocks(near, scale * ca.reshape(out_hess.map(pairs)(near_x, boxes), 4, pairs))
    scale = ca.repmat(lam[int(at[3]) : int(at[4])].T, late_size**2, 1)
    upper_blocks(late_at, scale * ca.reshape(late_hess.map(robots)(late_x, ca.DM(0, robots)), late_size**2, robots))
    some = np.flatnonzero(weight)
    hess.add(some, some, sigma * ca.DM(2 * weight[some]))

    p = ca.MX.sym("p", 0, 1)
    options: dict[str, Any] = {
        "print_time": False,
        "grad_f": ca.Function("nlp_grad_f", [x, p], [f, 2 * w * (x - a) + c], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("nlp_jac_g", [x, p], [g, jac.assemble()], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "nlp_hess_l",
            [x, p, sigma, lam],
            [hess.assemble()],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
        "calc_lam_p": False,
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "tol": 1e-5,
            "max_iter": 300,
            "mu_init": stage.mu,
            "mumps_pivot_order": 5,
        },
    }
    nlp: dict[str, Any] = {"x": x, "p": p, "f": f, "g": g}
    solver = ca.nlpsol("solver", "ipopt", nlp, options)
    low, high = np.full(n, -np.inf), np.full(n, np.inf)
    low[command[:2]], high[command[:2]] = -LIMIT, LIMIT
    low[turn[0]] = high[turn[0]] = 0.0
    low[place[:, :, 0]] = high[place[:, :, 0]] = np.array(START[:2])[:, None]
    low[rho_at] = 0.0
    first = np.zeros(n)
    first[command[0]], first[command[1]] = v0, omega0
    first[turn] = np.concatenate([[0.0], np.cumsum(omega0) * DT])
    first[place] = np.moveaxis(p0, -1, 0).transpose(0, 2, 1)
    inside = depths(p0[WINDOW:], GOAL).min(axis=-1).T
    first[rho_at] = max(0.05, float(inside.max(axis=1).min()) - 0.2)
    built = time.perf_counter()
    found = solver(x0=first, lbx=low, ubx=high, lbg=lower, ubg=upper)
    solved = time.perf_counter()
    best = np.asarray(found["x"]).ravel()
    stats = solver.stats()
    return Solved(
        best[command[0]],
        best[command[1]],
        stats["iter_count"],
        stats["return_status"],
        built - began,
        solved - built,
    )


def first_guess() -> tuple[Array, Array]:
    """The controls to start from, as the command line asks."""
    if len(sys.argv) < 2:
        return route_guess(BETWEEN)
    if sys.argv[1] == "outer":
        return route_guess(OUTER)
    with np.load(sys.argv[1]) as file:
        v, omega = np.asarray(file["v"], dtype=float), np.asarray(file["omega"], dtype=float)
    if v.shape != (STEPS,) or omega.shape != (STEPS,):
        raise SystemExit(f"{sys.argv[1]}: v and omega must have {STEPS} values each")
    return v, omega


def main() -> None:
    """Solve coarsely, then for the fleet, and report."""
    coarse = solve(COARSE, *first_guess())
    solves = [coarse, solve(FLEET, coarse.v, coarse.omega)]
    if judge(solves[-1].v, solves[-1].omega).min_clearance < 0:
        solves.append(solve(REPAIR, solves[-1].v, solves[-1].omega))
    done = time.perf_counter()
    last = solves[-1]
    build = sum(s.build_s for s in solves)
    marks = (_START, _IMPORTED, _IMPORTED + build, done)
    report("tuned_opti", marks, sum(s.iterations for s in solves), last.status, last.v, last.omega)


if __name__ == "__main__":
    main()
