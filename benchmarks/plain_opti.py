"""Hand-written CasADi program for the nine-robot benchmark, the way a competent user would write it.

    python plain_opti.py

Opti with multiple shooting, a Runge-Kutta step and log-sum-exp bounds as small SX functions called in a
loop, a straight line as the first guess, IPOPT with its default options.  What was chosen, with the rough
time of the whole process as each choice was added:

* First try, a state matrix per robot and a soft minimum over all robots and times: 125 s.
* One state vector per time step for the whole fleet, declared in the order of time: 58 s.
* The robustness as a variable that bounds every robot's own, since the soft minimum over the nine makes a
  dense block of 378 variables in the Hessian: 17 s.
* One soft clearance per robot and step, rather than five constraints: 13 s.
* ``detect_simple_bounds``, and a log-sum-exp sharpness of 30 (20 takes as long and scores worse, 50 takes
  half as long again and scores a little better): 9 s.
* ``expand`` stays off: it halves the time of the iterations, but unrolling the Hessian takes longer than that
  saves, about 19 s in all.
"""

import time

_START = time.perf_counter()

import contextlib  # noqa: E402
from typing import TypeVar  # noqa: E402

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
    report,
)

_IMPORTED = time.perf_counter()

SHARP = 30.0
ROBOTS = PSI.size


T = TypeVar("T", ca.SX, ca.MX)


def soft_min(e: T) -> T:
    """Smooth lower bound of the minimum."""
    return -ca.logsumexp(-SHARP * e) / SHARP


def soft_max(e: T) -> T:
    """Smooth lower bound of the maximum."""
    return (ca.logsumexp(SHARP * e) - float(np.log(e.numel()))) / SHARP


def fleet_step() -> ca.Function:
    """One Runge-Kutta step of all robots."""
    x, u, psi = ca.SX.sym("x", 3, ROBOTS), ca.SX.sym("u", 2), ca.DM(PSI).T

    def f(s: ca.SX) -> ca.SX:
        return ca.vertcat(psi * u[0] * ca.cos(s[2, :]), psi * u[0] * ca.sin(s[2, :]), psi * u[1])

    k1 = f(x)
    k2 = f(x + DT / 2 * k1)
    k3 = f(x + DT / 2 * k2)
    k4 = f(x + DT * k3)
    return ca.Function("step", [ca.vec(x), u], [ca.vec(x + DT / 6 * (k1 + 2 * k2 + 2 * k3 + k4))])


def fleet_clearance() -> ca.Function:
    """Soft clearance of every robot from all boxes."""
    x = ca.SX.sym("x", 3, ROBOTS)
    out = []
    for i in range(ROBOTS):
        px, py = x[0, i], x[1, i]
        boxes = [soft_max(ca.vertcat(a - px, px - b, c - py, py - d)) for a, b, c, d in OBSTACLES]
        out.append(soft_min(ca.vertcat(*boxes)))
    return ca.Function("clearance", [ca.vec(x)], [ca.vertcat(*out)])


def fleet_depth() -> ca.Function:
    """Soft depth of every robot in the goal box, as a row."""
    x = ca.SX.sym("x", 3, ROBOTS)
    a, b, c, d = GOAL
    out = [soft_min(ca.vertcat(x[0, i] - a, b - x[0, i], x[1, i] - c, d - x[1, i])) for i in range(ROBOTS)]
    return ca.Function("depth", [ca.vec(x)], [ca.horzcat(*out)])


def main() -> None:
    """Build, solve and report."""
    step, clearance, depth = fleet_step(), fleet_clearance(), fleet_depth()
    opti = ca.Opti()
    states, controls = [], []
    for _ in range(STEPS):
        states.append(opti.variable(3 * ROBOTS))
        controls.append(opti.variable(2))
    states.append(opti.variable(3 * ROBOTS))
    rho = opti.variable()

    opti.subject_to(states[0] == np.tile(START, ROBOTS))
    for k in range(STEPS):
        opti.subject_to(states[k + 1] == step(states[k], controls[k]))
        opti.subject_to(opti.bounded(-LIMIT, controls[k], LIMIT))
        opti.subject_to(clearance(states[k + 1]) >= 0)
    visits = ca.vertcat(*(depth(x) for x in states[WINDOW:]))
    for i in range(ROBOTS):
        opti.subject_to(soft_max(visits[:, i]) >= rho)
    opti.subject_to(rho >= 0)

    u = ca.horzcat(*controls)
    miss = ca.reshape(states[-1], 3, ROBOTS)[:2, :] - ca.repmat(ca.DM(CENTRE), 1, ROBOTS)
    opti.minimize(W_TERMINAL / ROBOTS * ca.sumsqr(miss) + W_EFFORT * DT * ca.sumsqr(u) - rho)

    way = np.array(CENTRE) - np.array(START[:2])
    for k, x in enumerate(states):
        here = np.array(START[:2]) + way * k / STEPS
        opti.set_initial(x, np.tile([*here, np.arctan2(way[1], way[0])], ROBOTS))
    opti.set_initial(u[0, :], np.hypot(*way) / HORIZON)

    options = {"print_time": False, "expand": False, "detect_simple_bounds": True}
    opti.solver("ipopt", options, {"print_level": 0, "sb": "yes"})
    built = time.perf_counter()
    with contextlib.suppress(RuntimeError):  # the status says why; the last iterate is judged all the same
        opti.solve()
    solved = time.perf_counter()
    stats = opti.stats()
    best = np.asarray(opti.debug.value(u))
    marks = (_START, _IMPORTED, built, solved)
    report("plain_opti", marks, stats["iter_count"], stats["return_status"], best[0], best[1])


if __name__ == "__main__":
    main()
