"""Ctrl-C while CasADi solves.

CasADi looks for signals within its evaluations, takes what a handler raises for a failed evaluation of the program,
and goes on.  So the handler runs where Python is, its exception is kept, and it is raised after the solve.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Kept:
    """What a handler raised, if anything."""

    error: BaseException | None = None


@contextmanager
def kept_interrupts() -> Iterator[Kept]:
    """Within: what a handler of SIGINT or SIGTERM raises is kept, for the solver's callback to see; raised at the end.

    Only the main thread is sent signals: in others nothing is changed.
    """
    kept = Kept()
    if threading.current_thread() is not threading.main_thread():
        yield kept
        return

    def handle(number: int, frame: FrameType | None) -> None:
        try:
            before[number](number, frame)
        except BaseException as error:
            kept.error = kept.error or error

    found = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    before = {int(number): handler for number, handler in found.items() if callable(handler)}
    for number in before:
        signal.signal(number, handle)
    try:
        yield kept
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if kept.error is not None:
        raise kept.error
