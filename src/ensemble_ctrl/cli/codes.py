"""Exit codes, as documented for users."""

from __future__ import annotations

import signal

OK = 0
INTERNAL = 1
USAGE = 2
NO_PLAN = 3
NOT_VERIFIED = 4
LIMIT = 5
INTERRUPTED = 130
TERMINATED = 143


def of_signal(number: int | None) -> int:
    """The exit code of a run that a signal ended."""
    return TERMINATED if number == signal.SIGTERM else INTERRUPTED
