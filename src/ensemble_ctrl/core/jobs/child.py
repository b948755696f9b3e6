"""A worker process as its parent sees it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from typing import Any

from ensemble_ctrl.core.errors import WorkerError
from ensemble_ctrl.core.jobs.unit import Unit
from ensemble_ctrl.core.jobs.versions import differing

LARGEST = 1 << 30
"""Bytes of memory above which a worker is replaced by a new one, once it has answered."""
PROGRAM = (
    "import json, sys; parent, path = json.loads(sys.argv[1]); sys.path[:] = path; "
    "from ensemble_ctrl.core.jobs.worker import main; main(parent)"
)
"""What a worker runs; it finds modules where its parent does, and nowhere else."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


Asked = Mapping[str, str | int | float | bool]
"""A unit without the text of its content, as strict JSON."""


class Died(Exception):
    """The worker ended without an answer; the message says how."""


class Child:
    """A worker process; one unit at a time.

    Parameters
    ----------
    versions : dict of str to str
        What its versions have to be.

    Notes
    -----
    On Linux it ends with the thread that made it, however that ends.
    """

    def __init__(self, versions: dict[str, str]) -> None:
        self.versions, self._greeted, self._holds, self._arrived = versions, False, "", bytearray()
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115
        command = [sys.executable, "-P", "-c", PROGRAM, json.dumps([os.getpid(), sys.path])]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env={**os.environ, **{name: os.environ.get(name, "1") for name in THREADS}},
        )

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self._process.poll() is None

    @property
    def pid(self) -> int:
        """The number of its process."""
        return self._process.pid

    def fileno(self) -> int:
        """What to wait for an answer on."""
        assert self._process.stdout is not None
        return self._process.stdout.fileno()

    def ask(self, asked: Asked, text: str) -> None:
        """Give it a unit; the content's text only if it is not the last one that it was given.

        Raises
        ------
        Died
            If it can't take it.
        """
        assert self._process.stdin is not None
        held, line = str(asked["kind"]) + str(asked["digest"]), dict(asked)
        if self._holds != held:
            self._holds, line["content"] = held, text
        try:
            self._process.stdin.write(json.dumps(line).encode() + b"\n")
            self._process.stdin.flush()
        except OSError:
            raise Died(self._how()) from None

    def answer(self) -> dict[str, Any] | None:
        """The answer, once it is there as a whole; None if it is not, after waiting for a part of it.

        Raises
        ------
        Died
            If it has ended.
        WorkerError
            If it never began to work, or has other versions.
        """
        if b"\n" not in self._arrived:
            arrived = os.read(self.fileno(), 1 << 20)
            if not arrived:
                raise Died(self._how()) if self._greeted else WorkerError(self._never_began())
            self._arrived += arrived
        while b"\n" in self._arrived:
            line, _, rest = self._arrived.partition(b"\n")
            self._arrived = rest
            if self._greeted:
                return dict(json.loads(line))
            self._greet(json.loads(line)["versions"])
        return None

    def finished(self) -> dict[str, Any]:
        """The answer, however long that takes; raises as `answer` does."""
        while True:
            found = self.answer()
            if found is not None:
                return found

    def kill(self) -> None:
        """Let it end, while another thread waits for its answer."""
        self._process.kill()

    def end(self) -> None:
        """End it, and clear up after it."""
        self._process.kill()
        self._how()

    def _greet(self, theirs: dict[str, str]) -> None:
        """Take its first line."""
        self._greeted = True
        other = differing(self.versions, theirs)
        if other:
            raise WorkerError(f"a worker has other versions, so that its results may differ: {other}")

    def _how(self) -> str:
        """How it ended; waits for that."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                try:
                    pipe.close()
                except OSError:  # what it had not read
                    continue
        self._errors.close()
        code = self._process.wait()
        return f"ended by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"

    def _never_began(self) -> str:
        """Why there was not one line."""
        self._errors.seek(0)
        last = self._errors.read().decode("utf-8", "replace").strip().splitlines()[-1:]
        return f"a worker could not begin ({'; '.join([self._how(), *last])})"


def asked_of(unit: Unit) -> Asked:
    """A unit as `Child.ask` takes it."""
    return {
        "kind": unit.kind,
        "digest": unit.content.digest,
        "index": unit.index,
        "limit": unit.limit,
        "alone": unit.alone,
    }


def is_spent(asked: Asked, answer: Mapping[str, Any]) -> bool:
    """Whether a worker is of no more use after its answer: it has grown, or was for this unit alone."""
    return bool(asked["alone"] or answer["memory"] > LARGEST)
