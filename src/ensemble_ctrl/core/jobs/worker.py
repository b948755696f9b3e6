"""The life of a worker: reads units from standard input, one JSON object a line, and answers each with another.

Its first line has its versions. What libraries write to standard output goes to standard error.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
from importlib import import_module
from time import perf_counter
from typing import IO, Any

from ensemble_ctrl.core.jobs.lifetime import end_with
from ensemble_ctrl.core.jobs.versions import versions

IDLE = 60.0
"""Seconds without a unit after which a worker ends."""


def main(parent: int) -> None:
    """Work until there is no more to read."""
    end_with(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends Ctrl-C to both; the parent ends this one
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    worker = _Worker()
    _say(answers, {"versions": versions()})
    while _is_asked() and (line := sys.stdin.readline()):
        _say(answers, worker.answer(json.loads(line)))


def _is_asked() -> bool:
    """Whether there is something to read; waits for that, but not for ever."""
    return os.name == "nt" or bool(select.select([sys.stdin], [], [], IDLE)[0])


class _Worker:
    """The content that was read last: units of one content mostly follow each other."""

    def __init__(self) -> None:
        self.key: tuple[str, str] | None = None
        self.prepared: Any = None

    def answer(self, asked: dict[str, Any]) -> dict[str, Any]:
        """The result of one unit, or what was raised."""
        began = perf_counter()
        signal.setitimer(signal.ITIMER_REAL, asked["limit"])  # the system ends this process then; 0 takes it back
        try:
            self._prepare(asked)
            result = import_module(asked["kind"]).run(self.prepared, asked["index"])
            found = {"result": json.loads(json.dumps(result, allow_nan=False)), "error": ""}
        except Exception as error:
            found = {"result": None, "error": f"{type(error).__name__}: {error}"}
        signal.setitimer(signal.ITIMER_REAL, 0)
        return {**found, "seconds": perf_counter() - began, "memory": _memory()}

    def _prepare(self, asked: dict[str, Any]) -> None:
        """Read the content, if it is another one than before."""
        key = asked["kind"], asked["digest"]
        if key != self.key:
            self.key, self.prepared = None, import_module(asked["kind"]).prepare(asked["content"])
            self.key = key


def _memory() -> int:
    """Largest resident set of this process or of one that it started, bytes; 0 where that is not known."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    kilobytes = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return kilobytes * (1 if sys.platform == "darwin" else 1024)


def _say(answers: IO[str], what: dict[str, Any]) -> None:
    """Write one line."""
    answers.write(json.dumps(what, allow_nan=False) + "\n")
    answers.flush()
