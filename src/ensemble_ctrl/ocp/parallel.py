"""Independent solves side by side, each in a process of its own: CasADi and IPOPT hold state of their whole process.

A forked process starts with everything that is loaded here, the solver too, so nothing is sent to it; it sends its
iterations and last its result through a pipe.  Nothing interrupts CasADi while it builds a program, which takes long
for very long horizons: the process that builds is ended instead, so that time limits and Ctrl-C are kept.  Where there
is no safe fork, the solves run one after another in this process.
"""

from __future__ import annotations

import gc
import mmap
import os
import pickle
import select
import signal
import struct
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import field
from functools import partial
from typing import Any, Generic, TypeVar

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import WorkerError
from ensemble_ctrl.core.jobs.lifetime import end_with
from ensemble_ctrl.ocp.solvers import BUILDING, Iteration, Watch, preload, reserve

T = TypeVar("T")
Work = Callable[[int, Watch], T]
"""Solves one candidate, by its number, under a watch."""
Tell = Callable[[int, Iteration], bool]
"""Called with a candidate and its iteration; returning True asks every candidate to stop."""

GRACE = 5.0
"""Seconds that a process is given to end by itself, once it should."""
SILENCE = 1.0
"""Seconds after which a process that says nothing is told of again, so that whoever listens may stop it."""
LENGTH = struct.Struct("!Q")
"""How the length of a message is written before it."""


def each(work: Work[T], count: int, tell: Tell, left: Callable[[], float]) -> list[T | None]:
    """The results of ``work(0, watch)`` ... ``work(count - 1, watch)``.

    Parameters
    ----------
    work : callable
        Its result can be pickled, and does not depend on what was solved before.
    count : int
        Number of candidates.
    tell : callable
        Told of every iteration, and about once a second where there is none: of the last one again, or `BUILDING`.
        Returning True asks all to stop with what they have, and no more are begun.
    left : callable
        Seconds that are left.

    Returns
    -------
    list
        In the order of the candidates, whichever ends first; None for one that was not begun, whose process ended
        without a result, or that raised.

    Raises
    ------
    Exception
        What the first candidate raised, where none has a result.
    WorkerError
        If that is how its process ended: the system ends one that takes too much memory.

    Notes
    -----
    *Guarantee*: no process that was started here is running any more on return, also by an exception.
    """
    most = workers(count)
    if most > 0:
        preload()
        return _Pool(work, count, tell, left, most).run()
    found = _Found[T](count)
    stopped = False

    def telling(candidate: int, iteration: Iteration) -> bool:
        nonlocal stopped
        stopped = tell(candidate, iteration) or stopped
        return stopped

    for i in range(count):
        if i and (stopped or left() <= 0):
            break
        try:
            found.results[i] = work(i, partial(telling, i))
        except Exception as error:
            found.errors[i] = error
    return found.checked()


def alone(work: Callable[[Watch], T], tell: Callable[[Iteration], bool], left: Callable[[], float]) -> T | None:
    """The result of one piece of work, as of `each`."""
    return each(lambda _, watch: work(watch), 1, lambda _, iteration: tell(iteration), left)[0]


def workers(count: int) -> int:
    """Processes for `count` candidates: no more than there are cores, and 0 where a fork is not safe or no use.

    A fork copies only the thread that asks for it, so there must be no other one that could hold a lock. A process that
    was started here can be ended as it is.
    """
    if not endable() or _State.forked:
        return 0
    return max(1, min(count, len(os.sched_getaffinity(0))))


def endable() -> bool:
    """Whether work is, or would be, done in a process that can be ended."""
    return _State.forked or (sys.platform == "linux" and threading.active_count() == 1)


class _State:
    """Of this process."""

    forked = False


@dataclass(eq=False)
class _Found(Generic[T]):
    """What the candidates came to."""

    count: int
    results: list[T | None] = field(init=False)
    errors: dict[int, Exception] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.results = [None] * self.count

    def checked(self) -> list[T | None]:
        """The results; an error where there is nothing else."""
        if self.errors and all(result is None for result in self.results):
            raise self.errors[min(self.errors)]
        return self.results


@dataclass(eq=False)
class _Child:
    """A process that solves one candidate, with the pipe that it writes to."""

    candidate: int
    pid: int
    pipe: int
    waiting: bytearray = field(default_factory=bytearray)
    last: Iteration = BUILDING
    heard: float = field(default_factory=time.monotonic)
    answered: bool = False

    def messages(self) -> Iterator[tuple[str, Any]]:
        """What has arrived since the last time; ends with ``("ended", None)`` where the process closed its pipe."""
        arrived = os.read(self.pipe, 1 << 16)
        self.waiting += arrived
        while len(self.waiting) >= LENGTH.size:
            end = LENGTH.size + LENGTH.unpack(self.waiting[: LENGTH.size])[0]
            if len(self.waiting) < end:
                break
            message = bytes(self.waiting[LENGTH.size : end])
            del self.waiting[:end]
            yield pickle.loads(message)
        if not arrived:
            yield "ended", None

    def end(self) -> None:
        """End the process, if it still runs, and clear up after it."""
        with suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)
        self.ended()

    def ended(self) -> int:
        """Clear up after a process that has ended, or is about to; the signal that ended it, or 0."""
        os.close(self.pipe)
        try:
            status = os.waitpid(self.pid, 0)[1]
        except ChildProcessError:  # the program clears up after all of its children itself
            return 0
        return os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0


@dataclass(eq=False)
class _Pool(Generic[T]):
    """The processes that run, the candidates that wait, and the results so far."""

    work: Work[T]
    count: int
    tell: Tell
    left: Callable[[], float]
    most: int
    stop: mmap.mmap = field(default_factory=lambda: mmap.mmap(-1, 1))
    children: dict[int, _Child] = field(default_factory=dict)
    stopped_at: float | None = None

    def run(self) -> list[T | None]:
        """Run every candidate."""
        found = _Found[T](self.count)
        todo = list(range(self.count))
        try:
            while self.children or (todo and not self._over()):
                while todo and len(self.children) < self.most and not self._over():
                    self._start(todo.pop(0))
                for child in self._ready():
                    self._read(child, found)
                self._break_silence()
                if self._overdue():
                    break
        finally:
            for child in self.children.values():
                child.end()
            self.stop.close()
        return found.checked()

    def _over(self) -> bool:
        """Whether to begin no more candidates."""
        return self.stopped_at is not None or self.left() <= 0

    def _overdue(self) -> bool:
        """Whether processes that should have ended by themselves still have not."""
        late = self.stopped_at is not None and time.monotonic() - self.stopped_at > GRACE
        return late or self.left() < -GRACE

    def _ready(self) -> list[_Child]:
        """The processes that have something to say; waits for a while."""
        ready, _, _ = select.select(list(self.children), [], [], 0.2)
        return [self.children[pipe] for pipe in ready]

    def _tell(self, child: _Child) -> None:
        """Pass on how far a process is, and remember a wish to stop."""
        child.heard = time.monotonic()
        if self.stopped_at is None and self.tell(child.candidate, child.last):
            self.stop[0] = 1
            self.stopped_at = time.monotonic()

    def _break_silence(self) -> None:
        """Pass on again how far a process is that has said nothing for a while."""
        for child in self.children.values():
            if time.monotonic() - child.heard > SILENCE:
                self._tell(child)

    def _read(self, child: _Child, found: _Found[T]) -> None:
        """Take what a process says."""
        for kind, what in child.messages():
            if kind == "iteration":
                child.last = what
                self._tell(child)
            elif kind == "result":
                found.results[child.candidate], child.answered = what, True
            elif kind == "error":
                found.errors[child.candidate], child.answered = what, True
            elif kind == "ended":
                del self.children[child.pipe]
                number = child.ended()
                if not child.answered and number != signal.SIGTERM:  # which a group of processes is asked to stop by
                    found.errors[child.candidate] = WorkerError(_how_it_ended(number))

    def _start(self, candidate: int) -> None:
        """Fork a process for one candidate."""
        out, into = os.pipe()
        parent = os.getpid()
        with _signals_held():
            pid = os.fork()
            if pid == 0:
                _live(self.work, candidate, into, self.stop, parent)
        os.close(into)
        self.children[out] = _Child(candidate, pid, out)


def _how_it_ended(number: int) -> str:
    """What is said of a process without a result."""
    if not number:
        return "the solver's process ended without a result"
    why = "; was there too little memory?" if number == signal.SIGKILL else ""
    return f"the solver's process was ended by {signal.Signals(number).name}{why}"


@contextmanager
def _signals_held() -> Iterator[None]:
    """Within: signals wait, so that a new process is never asked to stop by the handlers of the old one."""
    held = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, held)


def _live(work: Work[Any], candidate: int, into: int, stop: mmap.mmap, parent: int) -> None:
    """The life of a forked process; never returns, and runs nothing that its parent meant to run at its own end."""
    try:
        _State.forked = True
        gc.freeze()  # what is there already is the parent's: looking through it for garbage would copy its memory
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends Ctrl-C to both; the parent asks to stop
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT, signal.SIGTERM})
        end_with(parent)

        def watch(iteration: Iteration) -> bool:
            _send(into, "iteration", iteration)
            return stop[0] != 0

        try:
            reserve()
            _send(into, "result", work(candidate, watch))
        except Exception as error:
            error.add_note(traceback.format_exc())
            _send(into, "error", error)
    finally:
        os._exit(0)


def _send(into: int, kind: str, what: Any) -> None:
    """Write one message; a parent that is gone ends this process."""
    message = pickle.dumps((kind, what))
    rest = memoryview(LENGTH.pack(len(message)) + message)
    while rest:
        try:
            rest = rest[os.write(into, rest) :]
        except BrokenPipeError:
            os._exit(1)


__all__ = ["GRACE", "Tell", "Work", "alone", "each", "endable", "workers"]
