"""Progress on stderr: one rewritten line on a terminal, a plain line a second elsewhere; and the wish to stop."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from math import inf, isfinite
from types import FrameType
from typing import TYPE_CHECKING, TextIO

from ensemble_ctrl.cli.watcher import SIGNALS, forget_after_one, repeated, watched
from ensemble_ctrl.core.plain import visible

if TYPE_CHECKING:
    from ensemble_ctrl.ocp.solvers import Iteration


KEPT = "stopping after this iteration; the best plan so far is kept"
"""What the first signal does, of a plan."""


class Progress:
    """Says what is going on; as a callable it is the planner's `progress` and returns whether to stop.

    Parameters
    ----------
    quiet : bool
        Say nothing.
    verbose : bool
        Keep a line for every phase and iteration instead of rewriting one.
    stream : text stream, optional
        Where to; stderr without it.
    """

    def __init__(self, quiet: bool = False, verbose: bool = False, stream: TextIO | None = None) -> None:
        self.stream = sys.stderr if stream is None else stream
        self.quiet, self.verbose = quiet, verbose
        self.live = rewritable(self.stream) and not verbose
        self.phases: list[tuple[str, float]] = []
        self.stop_signal: int | None = None
        self._last_line = time.monotonic()
        self._shown = False

    def __call__(self, phase: str, iteration: Iteration | None) -> bool:
        """Take note of a phase or an iteration."""
        if iteration is None:
            self._begin(phase)
        else:
            self.passing(f"{phase}: {_how_far(iteration)}")
        return self.stop_signal is not None

    def finish(self) -> None:
        """End the last phase, wipe the live line and say how long each phase took."""
        self._begin("")
        self.wipe()
        spans = zip(self.phases, self.phases[1:], strict=False)
        self._write(", ".join(f"{name} {after - at:.2f} s" for (name, at), (_, after) in spans) + "\n")

    def note(self, text: str) -> None:
        """A line that stays."""
        self.wipe()
        self._write(visible(text) + "\n")

    def _begin(self, phase: str) -> None:
        """The next phase."""
        self.phases.append((phase, time.perf_counter()))
        if phase and (self.live or self.verbose):
            self.passing(f"{phase} ...")

    def passing(self, text: str) -> None:
        """Show a line that the next one replaces."""
        now = time.monotonic()
        if self.live:
            self._write(f"\r\x1b[K{visible(text)[: _columns(self.stream) - 1]}")
            self._shown = True
        elif self.verbose or now - self._last_line >= 1.0:
            self._write(visible(text) + "\n")
            self._last_line = now

    def wipe(self) -> None:
        """Remove the live line."""
        if self._shown:
            self._write("\r\x1b[K")
            self._shown = False

    def _write(self, text: str) -> None:
        """Write and flush; a stream that is closed, full or in use (this may be a signal) is no reason to fail."""
        if self.quiet:
            return
        with suppress(OSError, ValueError, RuntimeError):
            self.stream.write(text)
            self.stream.flush()


@contextmanager
def stoppable(progress: Progress, abandon: Callable[[], None], promise: str = KEPT) -> Iterator[None]:
    """Within: the first Ctrl-C or SIGTERM asks to stop and keep the best plan; a second, later one ends at once.

    Parameters
    ----------
    progress : Progress
        Where the wish to stop is kept.
    abandon : callable
        Called before the process ends at once.
    promise : str
        What is said of the first signal.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread is sent signals
        return
    first: float | None = None
    with watched(abandon) as done:

        def handle(number: int, frame: FrameType | None) -> None:
            nonlocal first
            if progress.stop_signal is not None and repeated(first):
                abandon()
                if done is not None:
                    done()
                os._exit(128 + number)
            if done is None:
                listen()
            if first is not None:
                return
            first, progress.stop_signal = time.monotonic(), number
            progress.note(f"{promise} (again to stop at once)")

        def listen() -> None:
            for number in SIGNALS:
                signal.signal(number, handle)
                if done is None:
                    forget_after_one(number)

        before = {number: signal.getsignal(number) for number in SIGNALS}
        listen()
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def rewritable(stream: TextIO) -> bool:
    """Whether a line may be rewritten: on a terminal that can, unless ``NO_COLOR`` is set."""
    return stream.isatty() and os.environ.get("TERM") != "dumb" and not os.environ.get("NO_COLOR")


def _how_far(iteration: Iteration) -> str:
    """An iteration of IPOPT, or how far Bonmin is, in words."""
    if iteration.count < 0:
        return "at work"
    if iteration.bound is None and iteration.violation == inf:
        return "building the program"
    if iteration.bound is None:
        return f"iteration {iteration.count}, cost {iteration.cost:.4f}, violation {iteration.violation:.1e}"
    cost = f"cost {iteration.cost:.4f}" if isfinite(iteration.cost) else "nothing better yet"
    bound = f", bound {iteration.bound:.4f}" if isfinite(iteration.bound) else ""
    return f"{iteration.count} nodes, {cost}{bound}"


def _columns(stream: TextIO) -> int:
    """Width of the terminal."""
    try:
        return os.get_terminal_size(stream.fileno()).columns or 80
    except (OSError, ValueError):
        return 80
