"""A second Ctrl-C ends the command at once, whatever it is doing.

Python runs a signal's handler between two of its own instructions, and a long call into a library puts that off.  So
a small process beside this one counts signals by a pipe (`signal.set_wakeup_fd`): it ends the command where a second
one is not heard soon, and clears up after it.  Without it, the system forgets the handler with the first signal
(``SA_RESETHAND``) until Python has run it: a second signal before that ends the process.

Signals within `BURST` seconds of the first one are one: GNU ``timeout`` and programs that pass signals on send two.
"""

from __future__ import annotations

import ctypes
import os
import platform
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

BURST = 0.3
"""Seconds after the first signal in which others are taken for the same one."""
PROMPT = 0.5
"""Seconds in which a second signal should be heard."""
LOOK = 0.02
"""Seconds between two looks at a process that should end."""
DONE = b"\0"
"""What the command says at its end."""
SIGNALS = (signal.SIGINT, signal.SIGTERM)
SA_RESETHAND = 0x80000000
KNOWN_LAYOUT = sys.platform == "linux" and platform.machine() in ("x86_64", "aarch64")
"""Whether `_Action` is what the system's C library calls ``struct sigaction``."""


class _Action(ctypes.Structure):
    """``struct sigaction``."""

    _fields_ = (
        ("handler", ctypes.c_void_p),
        ("mask", ctypes.c_ubyte * 128),
        ("flags", ctypes.c_uint),
        ("restorer", ctypes.c_void_p),
    )


def forget_after_one(number: int) -> None:
    """Let the system take back the handler of a signal with the next one, where that is possible."""
    if not KNOWN_LAYOUT or threading.current_thread() is not threading.main_thread():
        return
    library, action = ctypes.CDLL(None), _Action()
    if library.sigaction(number, None, ctypes.byref(action)) == 0 and action.handler:
        action.flags |= SA_RESETHAND
        library.sigaction(number, ctypes.byref(action), None)


@contextmanager
def watched(abandon: Callable[[], None]) -> Iterator[Callable[[], None] | None]:
    """Within: another process watches this one; gives what tells it that there is no more to do.

    Where a fork is not safe, there is no such process, and None is given.

    Parameters
    ----------
    abandon : callable
        Called there when this process was ended by a second signal.
    """
    if not hasattr(os, "fork") or threading.active_count() > 1:
        yield None
        return
    out, into = os.pipe()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()  # else both processes would write what waits
    parent = os.getpid()
    held = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    watcher = os.fork()
    if watcher == 0:
        os.close(into)
        _watch(parent, out, abandon)
    os.close(out)
    os.set_blocking(into, False)
    before = signal.set_wakeup_fd(into, warn_on_full_buffer=False)
    signal.pthread_sigmask(signal.SIG_SETMASK, held)

    def done() -> None:
        with suppress(OSError):
            os.write(into, DONE)

    try:
        yield done
    finally:
        signal.set_wakeup_fd(before)
        done()
        os.close(into)
        with suppress(ChildProcessError):
            os.waitpid(watcher, 0)


def repeated(first: float | None) -> bool:
    """Whether a signal is another one than that at the time `first` (of `time.monotonic`)."""
    return first is not None and time.monotonic() - first >= BURST


def _watch(parent: int, out: int, abandon: Callable[[], None]) -> None:
    """The life of the process that watches; never returns."""
    try:
        for number in SIGNALS:  # a terminal sends them to both
            signal.signal(number, signal.SIG_IGN)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
        first, second, done = None, None, False
        while second is None and not done:
            if not (said := os.read(out, 64)):
                break  # the process has ended, and all that it started
            done, sent = DONE in said, [byte for byte in said if byte in SIGNALS]
            if sent and first is None:
                first = time.monotonic()
            elif sent and repeated(first):
                second = sent[-1]
        if second is not None and not done:
            done = _end(parent, out, second)
        if first is not None and not done:
            _wait_for_end(parent)
            abandon()
    finally:
        os._exit(0)


def _wait_for_end(parent: int) -> None:
    """Until a process that has closed its pipe is no more."""
    while os.getppid() == parent:
        time.sleep(LOOK)


def _end(parent: int, out: int, last: int) -> bool:
    """End a process unless it hears its second signal: by that signal, and at last at any rate; whether it heard."""
    for number in (None, last, signal.SIGKILL):
        if number is not None and os.getppid() == parent:
            os.kill(parent, number)
        deadline = time.monotonic() + PROMPT
        while os.getppid() == parent and time.monotonic() < deadline:
            if select.select([out], [], [], LOOK)[0] and DONE in os.read(out, 64):
                return True
    return False
