"""The process in which Bonmin runs: a job on stdin, its log on stderr, its answer on stdout.

Run by path, not imported: it needs CasADi and NumPy alone, so that it starts fast.  It never outlives its parent, even
one that is killed: Linux ends it with the parent, and anywhere with POSIX timers it ends soon after its time limit.
None of this asks for the interpreter to run, since Bonmin does not let it.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
from contextlib import suppress
from typing import Any

GRACE = 2.0
"""Seconds after the time limit when the child ends by itself, should its parent not have ended it."""
LINE_BUFFERED = 1
"""``_IOLBF`` of the C library on Linux and macOS."""
DIE_WITH_PARENT = 1
"""Linux: ``PR_SET_PDEATHSIG``."""


def main() -> None:
    """Solve the job and write the answer, a pickled dict, to what was stdout."""
    answer = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever the libraries print joins the log
    _unbuffered()
    _never_orphaned(int(sys.argv[1]))
    job = pickle.load(sys.stdin.buffer)
    _limited(job["time_limit"], job["memory"])
    pickle.dump(_solved(job), answer)
    answer.close()
    sys.stdout.flush()
    os._exit(0)  # Bonmin's memory goes back to the system at once, without destructors that may crash


def _unbuffered() -> None:
    """Have C's stdout written line by line, so that the log says how far Bonmin is now."""
    import ctypes

    with suppress(OSError, AttributeError, ValueError):
        library = ctypes.CDLL(None)
        library.setvbuf(ctypes.c_void_p.in_dll(library, "stdout"), None, LINE_BUFFERED, 0)


def _never_orphaned(parent: int) -> None:
    """Ask Linux to end this process with its parent."""
    if sys.platform == "linux":
        import ctypes

        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(DIE_WITH_PARENT, int(signal.SIGKILL))
    if hasattr(os, "getppid") and os.getppid() != parent:
        os._exit(1)  # it was gone before that


def _limited(seconds: float, memory: int) -> None:
    """Wall-clock and memory limits that the system keeps."""
    with suppress(ImportError, AttributeError, ValueError, OSError):
        signal.setitimer(signal.ITIMER_REAL, seconds + GRACE)
        import resource

        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        resource.setrlimit(resource.RLIMIT_AS, (memory, hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _solved(job: dict[str, Any]) -> dict[str, Any]:
    """Run Bonmin on the job."""
    import casadi as ca
    import numpy as np

    functions = {name: ca.Function.deserialize(text) for name, text in job["functions"].items()}
    settings = job["settings"] | {name: functions[name] for name in ("grad_f", "jac_g", "hess_lag")}
    solver = ca.nlpsol("solver", "bonmin", functions["nlp"], settings)
    result = solver(**job["arguments"])
    return {
        "x": np.array(result["x"]).ravel(),
        "cost": float(result["f"]),
        "word": str(solver.stats()["return_status"]),
    }


if __name__ == "__main__":
    main()
