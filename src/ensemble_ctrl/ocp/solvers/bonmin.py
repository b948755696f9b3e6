"""Bonmin, a branch and bound over nonlinear programs, in a process of its own.

Bonmin calls nobody back, overruns its own time limit, prints to stdout and at times crashes.  In a child process its
log says how far it is, the limit is kept by ending the process, and a crash is a status.
"""

from __future__ import annotations

import os
import pickle
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.program import Program
from ensemble_ctrl.ocp.solvers import bonmin_child
from ensemble_ctrl.ocp.solvers.base import Iteration, Nlp, Outcome, SolverOptions, Status
from ensemble_ctrl.ocp.solvers.base import Watch as Watching

Floats = NDArray[np.float64]

STATUS: dict[str, Status] = {"SUCCESS": "solved", "INFEASIBLE": "infeasible", "LIMIT_EXCEEDED": "limit"}
"""Bonmin's words to ours; any other word means `failed`."""
NOTHING = 1e40
"""A cost or bound beyond this is Bonmin's way to say that it has none."""
INNER = {"algorithm": "B-BB", "warm_start": "optimum", "tol": 1e-4, "max_iter": 200}
"""Branch and bound, since the other algorithms need a convex program; a node starts from its parent's solution, which
makes it several times faster."""
OWN_SHARE = 0.6
"""Bonmin's own limit as a share of the real one: it overruns it, and what it has found is lost if it is ended."""
POLL = 0.05
"""Seconds between two looks at the child."""
NUMBER = r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)"
LINES = {
    "nodes": re.compile(r"(?:After|and|took \d+ iterations and) (\d+) nodes"),
    "cost": re.compile(rf"(?:Integer solution of|best objective|on tree,) {NUMBER}"),
    "bound": re.compile(rf"best possible {NUMBER}"),
}


@dataclass(frozen=True)
class Branching:
    """How far a branch and bound is.

    Attributes
    ----------
    nodes : int
        Nodes done.
    cost : float
        Of the best solution so far, as minimised; infinite without one.
    bound : float
        Bonmin's bound; minus infinity without one.  *Guarantee*: none where the program is not convex, since each
        node is solved to a local optimum only.
    """

    nodes: int = 0
    cost: float = np.inf
    bound: float = -np.inf


Watch = Callable[[Branching], bool]
"""Called a few times a second; returning True ends the search."""


@dataclass(frozen=True)
class BonminOptions:
    """Limits of one run.

    Parameters
    ----------
    time_limit : float
        Seconds of wall clock after which the process is ended.
    cutoff : float
        Only solutions that cost less are looked for.
    memory : int
        Bytes of address space the process may use, where the system can tell.
    log : Path, optional
        File that Bonmin's output is appended to.
    """

    time_limit: float = 20.0
    cutoff: float = np.inf
    memory: int = 4 * 2**30
    log: Path | None = None


@dataclass(frozen=True, eq=False)
class MixedOutcome:
    """What a run ended with: `x` is None if there is no solution, whatever the status."""

    status: Status
    x: Floats | None
    branching: Branching
    message: str
    seconds: float


def bonmin(
    program: Program,
    discrete: NDArray[np.bool_],
    guess: Floats,
    lower: Floats,
    upper: Floats,
    options: BonminOptions,
    watch: Watch | None = None,
) -> MixedOutcome:
    """Solve `program` with the `discrete` variables restricted to whole numbers.

    Parameters
    ----------
    program : Program
        Assembled, with its derivatives.
    discrete : ndarray of bool, shape (variables,)
        Which variables are whole numbers.
    guess, lower, upper : ndarray, shape (variables,)
        Start and bounds.
    options : BonminOptions
        Limits.
    watch : callable, optional
        Sees the progress and may end the search.

    Returns
    -------
    MixedOutcome
        Always: a process that crashes, is killed or can't be started has the status ``failed`` and says why.

    Notes
    -----
    *Guarantee*: none of optimality.  The program is not convex; ``solved`` means that the tree was searched with local
    solutions at its nodes.
    """
    began = time.perf_counter()
    job = _job(program, discrete, guess, lower, upper, options)
    with tempfile.TemporaryFile() as given, tempfile.TemporaryFile() as answer, tempfile.TemporaryFile() as log:
        try:
            given.write(job)
            given.seek(0)
            child = _started(given, answer, log)
        except OSError as error:
            return MixedOutcome("failed", None, Branching(), f"bonmin could not be started: {error}", 0.0)
        try:
            ended = _watched(child, log, began + options.time_limit, watch)
        finally:
            _end(child)
        text = _text(log)
        _append(options.log, text)
        return _outcome(child.returncode, ended, answer, text, time.perf_counter() - began)


class Bonmin:
    """A branch and bound over nonlinear programs (P. Bonami et al., An algorithmic framework for convex mixed integer
    nonlinear programs, 2008), in a process of its own.
    """

    statuses = STATUS

    def solve(self, nlp: Nlp, options: SolverOptions, watch: Watching | None = None) -> Outcome:
        """Solve for less than the cutoff; a cost of infinity where nothing was found."""
        discrete = np.zeros(len(nlp.guess), dtype=bool)
        discrete[nlp.discrete] = True
        limits = BonminOptions(options.left, options.cutoff, options.memory, options.log)

        def watching(now: Branching) -> bool:
            return watch is not None and watch(Iteration(now.nodes, now.cost, 0.0, now.bound))

        found = bonmin(nlp.program, discrete, nlp.guess, nlp.lower, nlp.upper, limits, watching)
        x, cost = (nlp.guess, np.inf) if found.x is None else (found.x, found.branching.cost)
        return Outcome(found.status, x, cost, found.branching.nodes, found.message, found.branching.bound)


START = Branching()
"""Before Bonmin has said anything."""


def progress_of(log: str, before: Branching = START) -> Branching:
    """What the log says of the progress, after what was known `before`."""
    found: dict[str, float] = {}
    for line in log.splitlines():
        if line.startswith("Cbc"):
            found |= {name: float(hit[1]) for name, pattern in LINES.items() if (hit := pattern.search(line))}
    cost, bound = found.get("cost", before.cost), found.get("bound", before.bound)
    return replace(
        before,
        nodes=int(found.get("nodes", before.nodes)),
        cost=cost if abs(cost) < NOTHING else before.cost,
        bound=bound if abs(bound) < NOTHING else before.bound,
    )


def _job(
    program: Program,
    discrete: NDArray[np.bool_],
    guess: Floats,
    lower: Floats,
    upper: Floats,
    options: BonminOptions,
) -> bytes:
    """Everything the child needs."""
    nlp: dict[str, Any] = program.nlp
    functions = {name: program.functions[name] for name in ("grad_f", "jac_g", "hess_lag")}
    functions["nlp"] = ca.Function("nlp", [nlp["x"], nlp["p"]], [nlp["f"], nlp["g"]], ["x", "p"], ["f", "g"])
    inner: dict[str, Any] = INNER | {"time_limit": OWN_SHARE * options.time_limit}
    if np.isfinite(options.cutoff):
        inner["cutoff"] = options.cutoff
    settings = {"discrete": discrete.tolist(), "print_time": False, "bonmin": inner}
    bounds = {"lbx": lower, "ubx": upper, "lbg": program.lower, "ubg": program.upper}
    return pickle.dumps(
        {
            "functions": {name: function.serialize() for name, function in functions.items()},
            "settings": settings,
            "arguments": {"x0": guess, "p": program.parameters, **bounds},
            "time_limit": options.time_limit,
            "memory": options.memory,
        }
    )


def _started(given: IO[bytes], answer: IO[bytes], log: IO[bytes]) -> subprocess.Popen[bytes]:
    """The child, in a session of its own, so that a Ctrl-C at the terminal reaches the parent alone."""
    return subprocess.Popen(
        [sys.executable, "-u", bonmin_child.__file__, str(os.getpid())],
        stdin=given,
        stdout=answer,
        stderr=log,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "OMP_NUM_THREADS": "1"},
    )


def _watched(child: subprocess.Popen[bytes], log: IO[bytes], deadline: float, watch: Watch | None) -> Status | None:
    """Wait for the child; returns why it has to be ended, or None if it ended by itself."""
    seen = Branching()
    while True:
        left = deadline - time.perf_counter()
        if left <= 0:
            return "limit"
        try:
            child.wait(min(POLL, left))
            return None
        except subprocess.TimeoutExpired:
            seen = progress_of(_text(log), seen)
            if watch is not None and watch(seen):
                return "interrupted"


def _end(child: subprocess.Popen[bytes]) -> None:
    """End the child and all that it started, and wait until it is gone."""
    if child.poll() is None:
        try:
            os.killpg(child.pid, signal.SIGKILL)
        except (AttributeError, OSError):
            child.kill()
    child.wait()


def _outcome(code: int, ended: Status | None, answer: IO[bytes], log: str, seconds: float) -> MixedOutcome:
    """The child's answer, or why there is none."""
    branching = progress_of(log)
    if ended is not None:
        words = {"limit": "ended at the time limit", "interrupted": "ended on request"}[ended]
        return MixedOutcome(ended, None, branching, words, seconds)
    answer.seek(0)
    data = answer.read()
    if code != 0 or not data:
        return MixedOutcome("failed", None, branching, _why(code, log), seconds)
    found = pickle.loads(data)
    status = STATUS.get(found["word"], "failed")
    good = abs(found["cost"]) < NOTHING and bool(np.isfinite(found["x"]).all()) and status != "infeasible"
    cost = found["cost"] if good else np.inf
    message = found["word"].replace("_", " ").lower()
    return MixedOutcome(status, found["x"] if good else None, replace(branching, cost=cost), message, seconds)


def _why(code: int, log: str) -> str:
    """Why the process gave no answer, in words."""
    last = next((line.strip() for line in reversed(log.splitlines()) if line.strip()), "")
    if code < 0:
        try:
            return f"bonmin's process was ended by {signal.Signals(-code).name}"
        except ValueError:
            return f"bonmin's process was ended by signal {-code}"
    return f"bonmin's process failed with exit code {code}: {last[:200]}"


def _text(log: IO[bytes]) -> str:
    """The log so far; read without moving the place where the child writes."""
    size = os.fstat(log.fileno()).st_size
    return os.pread(log.fileno(), size, 0).decode(errors="replace")


def _append(path: Path | None, text: str) -> None:
    """Keep the log; a full disk is no reason to lose a solution."""
    if path is not None:
        with suppress(OSError), path.open("a", encoding="utf-8") as file:
            file.write(text)
