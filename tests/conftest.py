"""What holds for every test."""

from __future__ import annotations

import signal

from tests.examples import register

register()
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as for a job that a shell runs in the background
    signal.signal(signal.SIGINT, signal.default_int_handler)
